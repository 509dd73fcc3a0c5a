r"""Clock jitter in residuals: samples taken early or late have errors in proportion to the speed.

Residuals of a correct model have the variance :math:`s^2 + \tau^2 v^2` with the noise s, the speed v of the
model and the jitter :math:`\tau`. Errors of a wrong model are also large at high speed, but similar in
neighbouring samples and in the next period. Jitter is independent in these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

# QUIET: where jitter widens the scatter by less than this factor, a sample counts as slow. BESIDE: number of
# slow samples in the running median that gives the level of the residuals. FAR: deviations are cut at this
# number of standard deviations of the noise (plus the largest jitter), so that spikes and jumps do not count.
QUIET, BESIDE, FAR = 1.4, 5, 30.0
# Smallest gain of twice the log-likelihood for which scatter in proportion to the speed is accepted: 25 (5
# standard errors of one number), doubled because neighbouring deviations share samples.
GAINED = 50.0
# The scatter is not jitter if timing errors of neighbouring samples, or of successive periods, have a
# correlation above COMMON, or above ERRORS standard errors of the correlation if that is larger. The same
# limits apply to the mean timing error, in standard deviations.
COMMON, ERRORS = 0.3, 3.0
# Fewest samples with jitter as large as the noise, without which no jitter is recognised.
FEWEST = 12
# Range in which the jitter (standard deviation of the sampling instants) is searched, in sampling intervals.
LEAST, MOST = 1e-4, 3.0

Array = NDArray[np.float64]


class Scatter(NamedTuple):
    """Scatter of residuals that increases with the speed.

    Attributes:
        delay: standard deviation of the timing error of single samples, in sampling intervals; 0: none.
        widening: factor by which the timing error increases the standard deviation of each residual, [n]; 1
            at rest.
        independent: True if the timing errors of neighbouring samples and of successive periods are
            independent and have no common mean; the scatter is then clock jitter.
    """

    delay: float
    widening: Array
    independent: bool

    def narrowed(self, residuals: Array) -> Array:
        """Return the residuals [n], in their unit, with their deviations from the level of slow neighbours
        divided by `widening`, so that the scatter is uniform; unchanged if `delay` is 0."""
        if self.delay == 0.0:
            return residuals
        level = _level(residuals, self.widening < QUIET)
        return np.asarray(level + (residuals - level) / self.widening)


def calm(count: int) -> Scatter:
    """Return a `Scatter` without jitter for `count` samples."""
    return Scatter(0.0, np.ones(count), False)


def jitter_of(
    residuals: Sequence[Array], measured: Sequence[Array], times: Sequence[Array], periods: Sequence[float]
) -> tuple[Scatter, ...]:
    """Return a `Scatter` for each recording; one without jitter where the residuals do not show clock jitter.

    Args:
        residuals: model minus measured of each recording, [n].
        measured: measured values of each recording, [n].
        times: times of each recording, s, [n]; without them, a recording is not searched for jitter.
        periods: samples in a period of each recording's drive; 0: not periodic.
    """
    found = [calm(r.size) for r in residuals]
    for i, (r, x, t, period) in enumerate(zip(residuals, measured, times, periods, strict=True)):
        if t.size == r.size == x.size and r.size > 1:
            seen = scatter(r, np.gradient(r + x), period)
            found[i] = seen if seen.independent else found[i]
    return tuple(found)


def scatter(residuals: Array, change: Array, period: float = 0.0) -> Scatter:
    """Return the scatter of residuals as a function of the speed, as a `Scatter`; one without jitter if the
    recording is too short or the scatter does not increase with the speed.

    Args:
        residuals: residuals of one recording, at equal intervals, [n].
        change: change of the model within a sampling interval, in the unit of the residuals, [n].
        period: samples in a period of the drive; 0: not periodic.
    """
    speed, none = np.abs(change), calm(residuals.size)
    if residuals.size < 4 * FEWEST or not speed.max() > 0.0:
        return none
    # The deviation from the mean of both neighbours scatters evenly for noise of any spectrum, and contains
    # no slow drift.
    off = residuals[1:-1] - 0.5 * (residuals[:-2] + residuals[2:])
    square = speed**2
    square = square[1:-1] + 0.25 * (square[:-2] + square[2:])
    noise = 1.4826 * float(np.median(np.abs(off)))
    if noise <= 0.0:
        return none
    # Limit the deviations, because spikes and jumps are not scatter.
    off = np.minimum(np.abs(off), FAR * noise + MOST * np.sqrt(square))

    def likely(log: float) -> float:
        over = 1.0 + math.exp(2.0 * log) * square
        return off.size * math.log(float(np.mean(off**2 / over))) + float(np.sum(np.log(over)))

    limits = (math.log(LEAST / noise), math.log(MOST / noise))
    best: Any = scipy.optimize.minimize_scalar(
        likely, bounds=limits, method="bounded", options={"xatol": 1e-3}
    )
    ratio = math.exp(float(best.x))
    over = 1.0 + ratio**2 * square
    alike, here = float(np.mean(off**2)), float(np.mean(off**2 / over))
    gained = np.sort(off**2 / alike - off**2 / (here * over) + np.log(alike / (here * over)))
    # Leave out the largest contributions, because a jump gains at two samples only, jitter at many.
    if float(np.sum(gained[: -FEWEST // 2])) < GAINED:
        return none
    level = math.sqrt(here / 1.5)
    delay = ratio * level * math.sqrt(1.5)
    widening = np.sqrt(1.0 + (delay * speed / level) ** 2)
    apart = (residuals - _level(residuals, widening < QUIET)) / (level * widening)
    return Scatter(delay, widening, _independent(apart, change, widening >= QUIET, period))


def _level(r: Array, slow: NDArray[np.bool_]) -> Array:
    """Return the level of the residuals r [n], in their unit: a running median of the samples that `slow` [n]
    marks, interpolated for the others; zeros with fewer than `BESIDE` such samples."""
    if np.count_nonzero(slow) < BESIDE:
        return np.zeros(r.size)
    at = np.flatnonzero(slow)
    return np.asarray(
        np.interp(np.arange(r.size), at, scipy.ndimage.median_filter(r[at], BESIDE, mode="nearest"))
    )


def _independent(off: Array, change: Array, fast: NDArray[np.bool_], period: float) -> bool:
    """Return True if timing errors are those of clock jitter: independent of the timing errors of the next
    sample and of the next period, and without a common mean. False for fewer than `FEWEST` fast samples.

    Args:
        off: residuals divided by their standard deviation, [n].
        change: change of the model within a sampling interval, [n]; only its sign is used.
        fast: True for samples at which the timing error dominates the noise, [n].
        period: samples in a period of the drive; 0: not periodic.
    """
    if np.count_nonzero(fast) < FEWEST:
        return False
    late = np.where(fast, off * np.sign(change), 0.0)
    lags = [1, round(period)] if period >= 2.0 else [1]
    for lag in lags:
        both = fast[lag:] & fast[:-lag]
        count = int(np.count_nonzero(both))
        if count < FEWEST // 2:
            continue
        square = 0.5 * (np.mean(late[lag:][both] ** 2) + np.mean(late[:-lag][both] ** 2))
        if float(np.mean((late[lag:] * late[:-lag])[both])) > max(COMMON, ERRORS / math.sqrt(count)) * square:
            return False
    return abs(float(np.mean(late[fast]))) < max(COMMON, ERRORS / math.sqrt(np.count_nonzero(fast)))
