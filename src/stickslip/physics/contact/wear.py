r"""Wear by Archard's law, and friction while a pair runs in [archard1953; blau2005].

.. math:: V = k P s, \qquad F(s) = F_\infty + (F_0 - F_\infty)\, e^{-s/s_0}

V is the worn volume after a sliding distance s under the load P; k [m²/N] is 1e-18 to 1e-13 for dry pairs,
known to a factor of ten at best, and jumps where a pair changes from mild to severe wear. The friction F
changes from F_0 to F_∞, by 63 % over the path s_0. The exponential describes curves without a maximum; curves
with one are as frequent [blau2005]. In a stick-slip actuator s is the total path of sliding in both
directions, not the travel.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si, to_si


@record
class RunningIn(NamedTuple):
    """Friction force during running-in as a function of the sliding path: an exponential from the `first` to
    the `last` value [N], 63 % of which passes over the `path` [m]; see the module."""

    first: Annotated[float, Quantity("N", "F_0", "friction at the beginning", above=0)]
    last: Annotated[float, Quantity("N", "F_∞", "friction at the end", above=0)]
    path: Annotated[float, Quantity("m", "s_0", "path for 63 % of the change", above=0)]

    def force(self, slid: ArrayLike) -> NDArray[np.float64]:
        """Return the friction force F [N] after sliding paths [m], in their shape.

        Raises:
            QuantityError: a path is negative.
        """
        path = array_si(slid, "m", "slid")
        if not np.all(path >= 0.0):
            raise QuantityError("slid [m] is out of range: it must be >= 0 m")
        return self.last + (self.first - self.last) * np.exp(-path / self.path)


def worn_depth(
    wear_rate: float | str, normal_force: float | str, slid: float | str, area: float | str
) -> float:
    """Return the depth [m] worn off an area that is always in contact [archard1953].

    Args:
        wear_rate: k, m²/N (or "1e-6 mm^3/(N m)").
        normal_force: normal force, N.
        slid: total path of sliding, m.
        area: area of the worn surface, m².

    Raises:
        QuantityError: a value is out of range.
    """
    given = {
        "wear_rate": (wear_rate, "m^2/N"),
        "normal_force": (normal_force, "N"),
        "slid": (slid, "m"),
        "area": (area, "m^2"),
    }
    found = {name: to_si(value, unit, name) for name, (value, unit) in given.items()}
    for name, value in found.items():
        if not 0.0 <= value < np.inf or (name == "area" and value == 0.0):
            raise QuantityError(f"{name} = {value:g} {given[name][1]} is out of range: it must be positive")
    return found["wear_rate"] * found["normal_force"] * found["slid"] / found["area"]


def sliding_path(sliding_displacement: ArrayLike) -> float:
    """Return the total path of sliding in both directions, m.

    The path includes the elastic presliding at each reversal, which does not cause wear.

    Args:
        sliding_displacement: relative displacement of the contact from a simulation or recording, m, [n].

    Raises:
        QuantityError: a sample is not finite, or the array has another shape.
    """
    x = array_si(sliding_displacement, "m", "sliding_displacement")
    if x.ndim != 1 or not np.all(np.isfinite(x)):
        raise QuantityError(f"sliding_displacement [m] of the shape {x.shape} must be finite samples [n]")
    return float(np.sum(np.abs(np.diff(x))))
