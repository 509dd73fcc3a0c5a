r"""Arrival at a target, judged by the estimated position and its uncertainty instead of by single readings.

While a loop holds, a reading differs from the target by :math:`e_k = x_k - r + n_k`, with the position x, the
target r and the sensor's noise n. While the contact sticks, the piezo moves the position by :math:`p_k =
C\,(u_{k-1} - u_0)`, because the loop also follows noise. Over the last B = 8 batches of ticks,

.. math:: |\bar e| + \sqrt{t^2\,\frac{s_B^2}{B} + z^2\,(s_p^2 + \max(c_1, 0))} \le \varepsilon

is required, with the tolerance :math:`\varepsilon`. Here u is the voltage, with the value u_0 at the first
reading of the hold, and C the gain of the piezo. s_e and s_p are the standard deviations of e and p; t = 2.36
is the 97.5 % quantile of Student's distribution, and z = 2.

The first term below the root is the uncertainty of the mean, from batch means of e - p (standard deviation
s_B), so that correlated noise is included [law2015, ch. 9]. The second term is the motion of the position: by
s_p, and by the common part of successive readings, :math:`c_1 = s_e^2 - \overline{(e_k - e_{k-1})^2} / 2`.
That part is vibration or slow noise, which one sensor cannot distinguish.

Drift of the sensor that is slower than all batches remains unseen. The engine's ``c/arrival.h`` evaluates the
condition at the end of each batch, from the eighth batch on.
"""

from __future__ import annotations

import math
from typing import Any

from ..engine.library import library
from ..quantities.units import with_prefix


class Arrival:
    """Numbers of the statistical test whether a position is at its target, which a mover in C computes.

    After another move starts, they keep their last values until 8 new batches are complete.

    Args:
        plan: C struct `mover_plan`, parameters of the move.
        mover: C struct `mover`, which contains the results of the test.
    """

    def __init__(self, plan: Any, mover: Any) -> None:
        self._plan, self._mover = plan, mover

    @property
    def offset(self) -> float:
        """Return the mean of reading minus target over the last 8 batches, m (rad for a rotary actuator); NaN
        before the first 8 batches are complete."""
        return self._mover.there.offset

    @property
    def doubt(self) -> float:
        """Return half the width of the interval of the position's deviation from the target, m (rad): the
        root in the module's equation; NaN before 8 batches. The position is at the target if the magnitude of
        `offset` plus `doubt` is within the tolerance."""
        return math.sqrt(self._mover.there.doubt2)

    @property
    def noise(self) -> float:
        """Return the standard deviation of the sensor's noise, m (rad), from the change between successive
        readings; NaN before 8 batches."""
        return math.sqrt(self._mover.there.noise2)

    def remark(self, unit: str) -> str:
        """Return a warning that the sensor's noise is above a third of the tolerance, with the present
        numbers.

        The caller must have checked that the noise is so large.

        Args:
            unit: unit of positions, "m" or "rad".
        """
        own = self._plan.arrival
        noise, tolerance, doubt = (with_prefix(one, unit) for one in (self.noise, own.tolerance, self.doubt))
        seconds = with_prefix(library().ARRIVAL_BATCHES * own.batch / self._plan.rate, "s")
        return (
            f"the sensor's noise of {noise} rms is more than a third of Stepping.tolerance, {tolerance}: the "
            f"loop moves the position by part of it, and the mean over {seconds} is known to {doubt}. A "
            "slower loop and a longer Stepping.dwell help"
        )
