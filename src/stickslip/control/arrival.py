r"""Arrival at a target, judged by the estimated position and its uncertainty instead of by single readings.

While a loop holds, a reading differs from the target by :math:`e_k = x_k - r + n_k`, with the position x, the
target r and the sensor's noise n. While the contact sticks, the piezo moves the position by :math:`p_k =
C\,(u_{k-1} - u_0)`, because the loop also follows noise. Over the last B = 8 batches of ticks,

.. math:: |\bar e| + \sqrt{t^2\,\frac{s_B^2}{B} + z^2\,(s_p^2 + \max(c_1, 0))} \le \varepsilon

is required. The standard error of the mean is that of batch means of e - p (standard deviation s_B), so
correlated noise is included [law2015, ch. 9]. The position itself moves by s_p, and by the common part of
successive readings, :math:`c_1 = s_e^2 - \overline{(e_k - e_{k-1})^2} / 2`: vibration, and slow noise, which
one sensor cannot distinguish. Drift of the sensor that is slower than all batches remains unseen. The
engine's ``c/arrival.h`` evaluates this at each tick.
"""

from __future__ import annotations

import math
from typing import Any

from ..engine.library import library
from ..quantities.units import with_prefix


class Arrival:
    """Statistical test whether a position is at its target, computed by a mover in C; this class shows its
    numbers."""

    def __init__(self, plan: Any, mover: Any) -> None:
        self._plan, self._mover = plan, mover

    @property
    def offset(self) -> float:
        """Return the mean deviation of the readings from the target over the last 8 batches, m; NaN before
        the first 8 batches are complete."""
        return self._mover.there.offset

    @property
    def doubt(self) -> float:
        """Return half the width of the interval of the position's deviation from the target, m: the root in
        the module's equation. The position is at the target if the magnitude of `offset` plus `doubt` is
        within the tolerance."""
        return math.sqrt(self._mover.there.doubt2)

    @property
    def noise(self) -> float:
        """Return the standard deviation of the sensor's noise, from the change between successive readings,
        m."""
        return math.sqrt(self._mover.there.noise2)

    def remark(self, unit: str) -> str:
        """Return the sentence that warns of a sensor's noise above a third of the tolerance. The noise is not
        checked here.

        Args:
            unit: unit of positions, m or rad.
        """
        own = self._plan.arrival
        noise, tolerance, doubt = (with_prefix(one, unit) for one in (self.noise, own.tolerance, self.doubt))
        seconds = with_prefix(library().ARRIVAL_BATCHES * own.batch / self._plan.rate, "s")
        return (
            f"the sensor's noise of {noise} rms is more than a third of Stepping.tolerance, {tolerance}: the "
            f"loop moves the position by part of it, and the mean over {seconds} is known to {doubt}. A "
            "slower loop and a longer Stepping.dwell help"
        )
