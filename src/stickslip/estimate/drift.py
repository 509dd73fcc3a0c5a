"""Drift of a sensor (a random walk and a slope), as samples at rest show it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..quantities.units import with_prefix

# Range of the tried random walks: standard deviation of the walk's step per sample, divided by the standard
# deviation of the white noise.
LEAST_WALK, MOST_WALK = 1e-4, 1.0
# TRIED: number of random walks that are tried in this range. LINES: number of spectral lines used, from the
# lowest. At higher lines, noise after a low-pass filter resembles a random walk.
TRIED, LINES = 33, 16
_LOGS = np.linspace(2.0 * math.log(LEAST_WALK), 2.0 * math.log(MOST_WALK), TRIED)
# Fewest samples at rest for which a slope is estimated; fewer do not distinguish a slope from a random walk.
FEWEST = 100

Array = NDArray[np.float64]


def walk_and_white(
    pieces: Sequence[Array], lines: int | None = None
) -> Callable[[float], tuple[float, float]]:
    """Return the likelihood of a random walk plus white noise as a function of their ratio.

    The returned function takes the natural logarithm of the variance that the walk gains per sample divided
    by the variance of the white noise. It returns minus twice the log-likelihood (up to a constant), and the
    most likely variance of the white noise. The differences of walk plus white noise are a moving average:
    their covariance is tridiagonal, with sines as eigenvectors.

    Args:
        pieces: arrays of samples [n] with both kinds of noise.
        lines: number of spectral lines used, from the lowest; None: all.
    """
    angles, powers = (
        np.concatenate([one[:lines] for one in kind]) for kind in zip(*map(sine_powers, pieces), strict=True)
    )
    of_white = 2.0 - 2.0 * np.cos(angles)

    def found(log_ratio: float) -> tuple[float, float]:
        variances = of_white + math.exp(log_ratio)
        total = float(np.sum(powers / variances))
        return powers.size * math.log(total) + float(np.sum(np.log(variances))), total / powers.size

    return found


def sine_powers(r: Array) -> tuple[Array, Array]:
    """Return angular frequencies [rad per sample], and the power of the sample-to-sample differences of r [n]
    in a sine basis at these frequencies; both have the shape (n - 1,), as n samples have n - 1
    differences."""
    return np.pi * np.arange(1, r.size) / r.size, _sines(np.diff(r)) ** 2


def _sines(x: Array) -> Array:
    return np.asarray(scipy.fft.dst(x, type=1, norm="ortho"))


def drift(pieces: Sequence[Array], times: Array, walks: float = 0.0) -> tuple[Array, Array, float]:
    """Predict the drift of a channel, a random walk plus a slope, from samples at rest.

    Args:
        pieces: arrays of samples [n] at rest, at least one of which is not constant; their levels may differ.
        times: times for which the drift is predicted, in samples after the instant at which the drift is
            zero.
        walks: smallest variance that a random walk gains from sample to sample, in the squared unit of the
            samples.

    Returns:
        Probability of each of the tried random walks, shape (TRIED,); the expected square of the drift,
        averaged over `times`, for each of these walks; and the most likely mean square of the drift, one
        number. Squares are in the squared unit of the samples.
    """
    sizes = np.array([float(r.size) for r in pieces])
    weights = sizes**3 / 12.0
    centred = [np.arange(r.size) - 0.5 * (r.size - 1) for r in pieces]
    slope = sum(float(t @ r) for t, r in zip(centred, pieces, strict=True)) / float(weights.sum())
    criterion, white = np.array([*map(walk_and_white(pieces, LINES), _LOGS)]).T
    chances = _chances(criterion)
    walk = np.maximum(white * np.exp(_LOGS), walks)
    # Variance of the estimated slope by white noise plus its variance by a random walk. For one array of n
    # samples, the second is 6/5 of the variance that the walk gains per sample, divided by n.
    unsure = white / weights.sum() + walk * 1.2 * float(weights**2 @ (1.0 / sizes)) / weights.sum() ** 2
    ahead, squares = float(np.mean(np.abs(times))), float(np.mean(times**2))
    far = walk * ahead + (slope**2 + unsure) * squares
    likely = math.exp(float(chances @ np.log(walk))) * ahead
    likely += max(slope**2 - float(chances @ unsure), 0.0) * squares
    return chances, far, likely


class Drift(NamedTuple):
    """Linear drift of a channel: `slope` in the channel's unit per s, its standard `error`, and the time
    `about` [s] at which the drift is zero."""

    slope: float
    error: float
    about: float

    def at(self, time: Array) -> Array:
        """Return the drift of the channel at the times [n], s, in the unit of the channel."""
        return self.slope * (time - self.about)

    def unsure(self, time: Array) -> Array:
        """Return the change of the drift at the times [n], s, in the unit of the channel, if the slope is one
        standard error greater; the change is negative before `about`."""
        return self.error * (time - self.about)


def said_drift(slope: float, error: float, unit: str) -> str:
    """Return a phrase with the drift rate of a channel and its standard error: "drifts by 2 nm/s (standard
    error 0.1 nm/s)"; both numbers are in `unit` per second."""
    rate, known_to = (with_prefix(x, f"{unit}/s", 3) for x in (slope, error))
    return f"drifts by {rate} (standard error {known_to})"


def drift_seen(time: Array, samples: Array, surely: float) -> Drift | None:
    """Return the linear drift of samples [n] at rest at equidistant times [s], zero at the mean time.

    The result is None if the slope is at most `surely` times its standard error, if all samples are equal, or
    if there are fewer than `FEWEST`.
    """
    if samples.size < FEWEST or not np.ptp(samples) > 0.0:
        return None
    interval = float(time[-1] - time[0]) / (time.size - 1)
    slope, error = (per_sample / interval for per_sample in slope_at_rest(samples))
    return Drift(slope, error, float(time.mean())) if abs(slope) > surely * error else None


def off_by_drifts(times: Sequence[Array], drifts: Sequence[Drift | None]) -> Array:
    """Return the change of the subtracted drifts at all samples if a slope were one standard error greater, a
    column for each recording, in the unit of the data, shape (samples of all recordings, recordings). The
    recordings change by the opposite, their residuals (model minus measured) by the same.

    Args:
        times: times of each recording, s.
        drifts: drift that was subtracted from each recording; None: no drift was subtracted.
    """
    parts = [
        np.zeros_like(time) if drift is None else drift.unsure(time)
        for time, drift in zip(times, drifts, strict=True)
    ]
    return np.asarray(scipy.linalg.block_diag(*(part[:, None] for part in parts)))


def slope_at_rest(samples: Array) -> tuple[float, float]:
    """Return the slope of samples [n] at rest, in their unit per sample, and its standard error, which allows
    for white noise and for a random walk as far as the samples show one."""
    differences = np.diff(samples)
    found, by_slope = (_sines(x)[:LINES] for x in (differences, np.ones(differences.size)))
    of_white = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, found.size + 1) / samples.size)
    variances = of_white + np.exp(_LOGS)[:, None]
    told = np.sum(by_slope**2 / variances, axis=1)
    slopes = np.sum(by_slope * found / variances, axis=1) / told
    left = np.sum((found - slopes[:, None] * by_slope) ** 2 / variances, axis=1)
    # Restricted likelihood: the slope is estimated from the same samples, so one of them gives no information
    # on the noise.
    criterion = (found.size - 1) * np.log(left) + np.sum(np.log(variances), axis=1) + np.log(told)
    chances = _chances(criterion)
    slope = float(chances @ slopes)
    return slope, math.sqrt(float(chances @ (left / (found.size - 1) / told + (slopes - slope) ** 2)))


def _chances(criterion: Array) -> Array:
    """Return the probabilities of the tried random walks [k], whose sum is 1, from minus twice the
    log-likelihood of each walk [k]."""
    chances = np.exp(-0.5 * (criterion - criterion.min()))
    return chances / chances.sum()
