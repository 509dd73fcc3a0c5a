r"""Arrival at a target, judged by the estimated position and its uncertainty instead of by single readings.

A reading in a loop that holds is off the target by :math:`e_k = x_k - r + n_k`, with the position x, the
target r and the sensor's noise n. While the contact sticks, the piezo moves the position by
:math:`p_k = C\,(u_{k-1} - u_0)`, where the loop follows noise, too. Over the last `BATCHES` batches of ticks,

.. math:: |\bar e| + \sqrt{t^2\,\frac{s_B^2}{B} + z^2\,(s_p^2 + \max(c_1, 0))} \le \varepsilon

is required. The standard error of the mean is that of batch means of e - p (standard deviation s_B), so
correlated noise counts as what it is [law2015, ch. 9]. The position itself moves by s_p, and by what
successive readings share, :math:`c_1 = s_e^2 - \overline{(e_k - e_{k-1})^2} / 2`: vibration, and slow noise,
which one sensor cannot distinguish. Drift of the sensor that is slower than all batches remains unseen.
"""

from __future__ import annotations

import math

from ..units import with_prefix

BATCHES = 8  # B, of ticks; few enough for a short dwell, and Student's t is near its limit
STUDENT = 2.3646  # t: 97.5 % quantile of Student's t with BATCHES - 1 degrees of freedom
SPREAD = 2.0  # z: standard deviations of the moving position that must be within the tolerance
NOISY = 1.0 / 3.0  # share of the tolerance from which on the sensor's noise is reported


class Arrival:
    """Judge of a position that is held; `sees` takes every reading.

    Args:
        tolerance: m.
        gain: m/V, of the piezo.
        size: ticks of a batch.

    Attributes:
        offset: m, mean of the readings from the target, over the last batches; NaN before there are enough.
    """

    def __init__(self, tolerance: float, gain: float, size: int) -> None:
        self._tolerance, self._gain, self._size = tolerance, gain, size
        self.offset = self._doubt2 = self._noise2 = math.nan
        self.begin()

    def begin(self) -> None:
        """Forget the readings: the motion begins anew."""
        self._rows = [[0.0] * 5 for _ in range(BATCHES)]  # sums of e, p, e², p², (e - e₋₁)²
        self._batch = self._ticks = self._batches = 0
        self._first, self._start, self._last = True, 0.0, 0.0

    def sees(self, measured: float, goal: float, voltage: float) -> bool:
        """Whether a batch has ended with the position at the goal, for a reading [m] under a voltage [V]."""
        off, moved = measured - goal, self._gain * voltage - goal
        if self._first:
            self._first, self._start, self._last = False, moved, off
        moved = moved - self._start
        row = self._rows[self._batch]
        row[0] += off
        row[1] += moved
        row[2] += off * off
        row[3] += moved * moved
        row[4] += (off - self._last) * (off - self._last)
        self._last = off
        self._ticks += 1
        if self._ticks < self._size:
            return False
        self._ticks, self._batch = 0, (self._batch + 1) % BATCHES
        self._batches = min(self._batches + 1, BATCHES)
        there = self._batches == BATCHES and self._judged()
        self._rows[self._batch] = [0.0] * 5
        return there

    def _judged(self) -> bool:
        """By all batches; the order of the sums is that of the translation to C."""
        count, sums, squares = float(BATCHES * self._size), [0.0] * 5, 0.0
        for row in self._rows:
            for k in range(5):
                sums[k] += row[k]
        mean, moved = sums[0] / count, sums[1] / count
        for row in self._rows:
            apart = (row[0] - row[1]) / self._size - (mean - moved)
            squares += apart * apart
        noise2 = 0.5 * sums[4] / count
        alike = _positive(sums[2] / count - mean * mean - noise2)
        wandering = _positive(sums[3] / count - moved * moved)
        error = STUDENT * STUDENT * squares / (BATCHES * (BATCHES - 1.0))
        self.offset, self._noise2 = mean, noise2
        self._doubt2 = error + SPREAD * SPREAD * (wandering + alike)
        left = self._tolerance - abs(mean)
        return left >= 0.0 and self._doubt2 <= left * left

    @property
    def doubt(self) -> float:
        """Largest likely distance of the position from the target plus `offset`, m."""
        return math.sqrt(self._doubt2)

    @property
    def noise(self) -> float:
        """Standard deviation of the part of the readings that changes from tick to tick, m."""
        return math.sqrt(self._noise2)

    @property
    def noisy(self) -> bool:
        """Whether the noise is large against the tolerance."""
        return self._noise2 > NOISY * NOISY * self._tolerance * self._tolerance

    def remark(self, rate: float, unit: str) -> str:
        """The noise against the tolerance in a sentence, for ticks at a rate [Hz] and positions in a unit."""
        noise, tolerance, doubt = (
            with_prefix(one, unit) for one in (self.noise, self._tolerance, self.doubt)
        )
        seconds = with_prefix(BATCHES * self._size / rate, "s")
        return (
            f"the sensor's noise of {noise} rms is more than a third of Stepping.tolerance, {tolerance}: the "
            f"loop moves the position by part of it, and the mean over {seconds} is known to {doubt}. A "
            "slower loop and a longer Stepping.dwell help"
        )


def _positive(value: float) -> float:
    return value if value > 0.0 else 0.0
