r"""Ageing of a contact at rest, and how humidity changes it [dieterich1972; baumberger2006].

.. math:: \frac{F_S(t)}{F_C} = 1 + \beta \ln \left( 1 + \frac{t}{t_0} \right)

with the time at rest t, β of some hundredths (about 0.02 to 0.1 per decade for rock, paper, polymers and
metals) and t_0 of about a second. The formula has no limit: beyond the measured times the ratio is a guess. A
push during the rest speeds the ageing up or slows it down without a larger area [dillavou2020]. In ultrahigh
vacuum, or with clean metals, cold welding occurs instead.

In single nanometre contacts of silica and other oxides, water forms the bonds that age: without water
(far below 1 % relative humidity) there is no ageing, at 10 to 40 % it is strong, above 40 % it subsides
[mcclimon2024]. For other materials and sizes no comparable measurements exist.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si, to_si

# Limits of the relative humidity (0 to 1) for the ageing of oxide contacts: there is no ageing below DRY,
# strong ageing from DAMP to WET, and weaker ageing above WET.
DRY, DAMP, WET = 0.01, 0.10, 0.40


@record
class Ageing(NamedTuple):
    """Static friction that grows with the logarithm of the time at rest (see the module) [dieterich1972].

    `rate` is β, the growth per e-fold of time relative to the Coulomb friction; `cut_off` is t_0, s.
    """

    rate: Annotated[float, Quantity("", "β", "growth per e-fold of time, of the Coulomb friction", minimum=0)]
    cut_off: Annotated[float, Quantity("s", "t_0", "time below which nothing ages", above=0)] = 1.0

    def stiction_ratio(self, rest: ArrayLike) -> NDArray[np.float64]:
        """Return the ratio of static friction F_S to Coulomb friction F_C after rests of given durations [s],
        in the shape of `rest`. Raises QuantityError for a negative duration."""
        time = array_si(rest, "s", "rest")
        if not np.all(time >= 0.0):
            raise QuantityError("rest [s] is out of range: it must be >= 0 s")
        return 1.0 + self.rate * np.log1p(time / self.cut_off)


def oxide_ageing(relative_humidity: float | str) -> str:
    """Return how strongly nanometre contacts of silica age at a relative humidity, as a word.

    Args:
        relative_humidity: 0 to 1, or "35 %".

    Returns:
        "none" below 1 %, "strong" from 10 to 40 %, "subsiding" above, or "between" for 1 to 10 %, where there
        are no measurements.

    Raises:
        QuantityError: the humidity is out of range.
    """
    share = to_si(relative_humidity, "", "relative_humidity")
    if not 0.0 <= share <= 1.0:
        raise QuantityError(
            f"relative_humidity = {share:g} is out of range: it must be 0 to 1 (or 0 % to 100 %)"
        )
    if share < DRY:
        return "none"
    return "between" if share < DAMP else "strong" if share <= WET else "subsiding"
