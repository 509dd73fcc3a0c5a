r"""Lack of fit: tests whether a model leaves more than the noise, where the noise is known independently.

There are up to five tests, each if a recording allows it:

* given noise: the reduced chi-squared;
* samples at rest before and after the motion, or else differences between periods: all residuals in motion,
  about the level at rest, against that noise and the drift that it shows (`drift`);
* samples at rest before the motion: residuals in motion against these, by their differences over equal times,
    :math:`D(k) = \frac{1}{2} \langle (r_{i+k} - r_i)^2 \rangle`, so that drift is not a misfit;
* the same samples: the largest change of the level in motion between neighbouring groups of samples, as a
  wrong slip causes it, against the changes at rest;
* periods of the drive: the part that repeats is model error, the part that does not is noise. The power of
  the mean over the periods is compared with the power of the scatter about it, at each frequency.

Correlated noise has fewer independent samples (`independent`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .drift import drift
from .judgement import DEFAULT, Judgement

# Share of samples off the usual converter level at which the noise at rest shows its full variance.
MOST_HIDDEN = 0.3
# Fewest samples at rest for tests against them; differences are over up to an eighth of them.
FEWEST_AT_REST = 40
FEWEST_PERIODS = 3
# SMOOTHED: spectral lines in a running mean. BANDS: number of bands of lines that are tested.
SMOOTHED, BANDS = 5, 4
# Largest ratio of a part's power to the usual power at which the part still counts as rest.
MOST_POWER = 2.0
AT_REST, BETWEEN = "before it moves", "by what does not repeat from period to period"

Array = NDArray[np.float64]


class KnownNoise(NamedTuple):
    """Noise of a recording, known independently of the residuals.

    Attributes:
        given: standard deviation, one number or shape (n,), in the unit of the data; None: unknown.
        at_rest: number of samples before any motion.
        period: first sample of the periodic part, samples per period, and number of samples in the part; the
            second is 0 if nothing repeats.
        step: converter step, in the unit of the data; 0: none.
        drift: variance that a random walk gains from sample to sample, in the unit of the data squared.
        rest_again: number of samples after any motion.
        straightened: True if a drift was fitted to all samples and may hide a misfit; then the drift of the
            rest alone is removed.
    """

    given: NDArray[np.float64] | float | None = None
    at_rest: int = 0
    period: tuple[float, float, float] = (0.0, 0.0, math.inf)
    step: float = 0.0
    drift: float = 0.0
    rest_again: int = 0
    straightened: bool = False


class Lack(NamedTuple):
    """Comparison of the residuals of a recording with its noise.

    Attributes:
        name: name of the recording.
        ratio: rms residual divided by the noise, of the test (see the module) with the largest ratio among
            those that show a lack, or else of the first possible test. NaN if the noise is not known.
        chance: probability that a correct model has such a residual, multiplied by the number of tests; the
            smallest of those that show a lack, or else of the first possible test; 1 without known noise.
        against: noise with which the residual is compared, in words.
        judgement: thresholds of the tests.
    """

    name: str
    ratio: float
    chance: float
    against: str
    judgement: Judgement = DEFAULT

    @property
    def seen(self) -> bool:
        """Return True if the test shows a lack of fit: by its probability and by the ratio to the noise."""
        return self.chance < self.judgement.false_alarm and self.ratio >= self.judgement.lack_ratio

    @property
    def statement(self) -> str:
        """Return a sentence on the lack of fit; "" if the test shows none."""
        if not self.seen:
            return ""
        return (
            f"the model does not explain {self.name}: residual {self.ratio:.3g} x the noise ({self.against})"
        )

    @property
    def sentence(self) -> str:
        """Return the statement with its consequence for the intervals of a fit; "" if the test shows no lack
        of fit."""
        return f"{self.statement}; its intervals are not to be trusted" if self.seen else ""


class _Compared(NamedTuple):
    ratio: float
    chance: float
    against: str


def lack_of_fit(
    residuals: Array, known: KnownNoise, name: str, n_fitted: float = 0.0, judgement: Judgement = DEFAULT
) -> Lack:
    """Compare the residuals [n] of one recording with its noise, and return the result as a `Lack`.

    Args:
        residuals: model minus measured, at equal intervals, in the unit of the data.
        known: noise of the recording.
        name: name of the recording.
        n_fitted: number of parameters fitted to the recording; 0 for a prediction.
        judgement: thresholds of the tests.
    """
    r = np.asarray(residuals, dtype=float)
    if known.straightened and known.at_rest >= FEWEST_AT_REST:
        r = _straightened(r, known.at_rest)
    made = [
        _by_given(r, known, n_fitted),
        _by_drift(r, known, n_fitted > 0),
        _by_rest(r, known),
        _by_levels(r, known),
        _by_periods(r, known),
    ]
    found = [one for one in made if one is not None]
    if not found:
        return Lack(name, math.nan, 1.0, "", judgement)
    found = [one._replace(chance=min(1.0, one.chance * len(found))) for one in found]
    seen = [one for one in found if one.chance < judgement.false_alarm and one.ratio >= judgement.lack_ratio]
    told = max(seen, key=lambda one: one.ratio) if seen else found[0]
    chance = min([one.chance for one in seen] or [told.chance])
    return Lack(name, told.ratio, chance, told.against, judgement)


def lacks_of(
    residuals: Sequence[Array],
    known: Sequence[KnownNoise],
    names: Sequence[str],
    share: float,
    judgement: Judgement = DEFAULT,
) -> tuple[Lack, ...]:
    """Return the lack-of-fit test (`Lack`) of each recording, with probabilities multiplied by the number of
    recordings; see `lack_of_fit`.

    Args:
        residuals, known, names: residuals [n], known noise and name of each recording.
        share: number of fitted parameters divided by the number of data.
        judgement: thresholds of the tests.
    """
    parts = zip(residuals, known, names, strict=True)
    found = [lack_of_fit(r, one, name, share * r.size, judgement) for r, one, name in parts]
    return tuple(one._replace(chance=min(1.0, len(found) * one.chance)) for one in found)


def _straightened(r: Array, at_rest: int) -> Array:
    """Return the residuals [n] minus the straight line through the first `at_rest` samples."""
    at = np.arange(r.size, dtype=float)
    return np.asarray(r - np.polyval(np.polyfit(at[:at_rest], r[:at_rest], 1), at), dtype=float)


def independent(rows: Array) -> float:
    r"""Return the number of independent samples that determine a variance as well as one of the rows of
    autocorrelated samples [rows, n].

    The number is :math:`2 (\sum P)^2 / \sum P^2` for the common spectrum P, corrected for the scatter of P,
    which makes the denominator too large by the factor 1 + 1/rows.
    """
    power = np.mean(np.abs(np.fft.rfft(rows - rows.mean(axis=1, keepdims=True))[:, 1:]) ** 2, axis=0)
    square = float(power @ power)
    if square <= 0.0:
        return float(rows.shape[1])
    return min(2.0 * (1.0 + 1.0 / len(rows)) * float(power.sum()) ** 2 / square, float(rows.shape[1]))


def independent_samples(r: Array, memory: int = 1) -> float:
    """Return the number of independent samples that determine a variance as well as the autocorrelated series
    r [n], of which `memory` is the expected correlation length in samples."""
    size = min(r.size, max(8 * memory, r.size // 8, 16))
    count = r.size // size
    return r.size / size * independent(r[: count * size].reshape(count, size))


def _by_given(r: Array, known: KnownNoise, n_fitted: float) -> _Compared | None:
    if known.given is None:
        return None
    over = r / known.given
    freedom = max(over.size - n_fitted, 1.0)
    square = float(over @ over) / freedom
    share = independent_samples(over, 1) / over.size
    chance = float(scipy.special.chdtrc(freedom * share, square * freedom * share))
    return _Compared(math.sqrt(square), chance, "as it was given")


def _by_drift(r: Array, known: KnownNoise, fitted: bool) -> _Compared | None:
    # Without rest, a drift of the sensor looks like wrong steps. A fit is then not tested, but a prediction
    # is.
    if fitted and known.at_rest < FEWEST_AT_REST:
        return None
    n = known.at_rest if known.at_rest >= FEWEST_AT_REST else 0
    quiet, moved = _quiet(r, known), r[n:] - (r[:n].mean() if n else 0.0)
    if not quiet or moved.size < 8:
        return None
    every = np.concatenate([part - part.mean() for part in quiet])
    shown = any(np.ptp(part) > 0.0 for part in quiet)
    noise = _in_motion(float(np.mean(every**2)) if shown else 0.0, known.step, every.size)
    if noise <= 0.0:
        return None
    chances, far, likely = np.ones(1), np.zeros(1), 0.0
    if shown:
        chances, far, likely = drift(quiet, 0.5 * n + np.arange(moved.size, dtype=float), known.drift)
    square, count = float(np.mean(moved**2)), independent_samples(every)
    # A drift has one degree of freedom at any length: few samples are independent if it dominates the noise.
    freedom = (noise + far) ** 2 / (noise**2 * every.size / (count * moved.size) + far**2)
    chance = float(chances @ scipy.special.fdtrc(freedom, count, square / (noise + far)))
    return _Compared(
        math.sqrt(square / (noise + likely)), chance, f"{AT_REST if n else BETWEEN}, with its drift"
    )


def _quiet(r: Array, known: KnownNoise) -> list[Array]:
    """Return the parts of the residuals that show only noise and drift, as arrays: rest before and after the
    motion or, without rest before, the changes from period to period divided by the root of 2. Parts that are
    far noisier than the others are left out, because something moves there."""
    n = known.at_rest
    if n >= FEWEST_AT_REST:
        found = [part for part in (r[:n], r[r.size - known.rest_again :]) if part.size >= FEWEST_AT_REST]
    else:
        folded = _folded(r, known)
        found = [] if folded is None else list(np.diff(folded, axis=0) / math.sqrt(2.0))
    if not found:
        return []
    lag = min(part.size for part in found) // 8
    powers = [float(np.mean((part[lag:] - part[:-lag]) ** 2)) for part in found]
    usual = powers[0] if n >= FEWEST_AT_REST else float(np.median(powers))
    return [part for part, power in zip(found, powers, strict=True) if power <= MOST_POWER * usual]


def _by_rest(r: Array, known: KnownNoise) -> _Compared | None:
    n = known.at_rest
    if n < FEWEST_AT_REST or r.size - n < n // 4 + 8:
        return None
    worst: _Compared | None = None
    lags = _lengths(1, n // 8)
    for lag in lags:
        quiet, moving = (0.5 * (part[lag:] - part[:-lag]) ** 2 for part in (r[:n], r[n:]))
        noise, left = _in_motion(float(quiet.mean()), known.step, n), float(moving.mean())
        if noise <= 0.0:
            continue
        counts = [_independent_differences(part, lag) for part in (r[:n], r[n:])]
        chance = float(scipy.special.fdtrc(max(counts[1], 1.0), max(counts[0], 1.0), left / noise)) * len(
            lags
        )
        one = _Compared(math.sqrt(left / noise), min(chance, 1.0), AT_REST)
        if worst is None or one.chance < worst.chance:
            worst = one
    return worst


def _by_levels(r: Array, known: KnownNoise) -> _Compared | None:
    """Test the largest change of the level between slips; None if the test is impossible.

    The rms test mistakes a wrong slip that the next slips correct for drift, and for the test of differences
    such a slip is too rare.
    """
    n = known.at_rest
    noise = _in_motion(float(np.var(r[:n])), known.step, n) if n >= FEWEST_AT_REST else 0.0
    sizes = [m for m in _lengths(4, n // 16) if 8 * m <= n and 4 * m + 8 <= r.size - n]
    if noise <= 0.0 or not sizes:
        return None
    chance = min(_of_largest_change(r, n, m, noise) for m in sizes) * len(sizes)
    left = scipy.signal.detrend(r[n:])
    return _Compared(
        math.sqrt(float(np.mean(left**2)) / noise), min(chance, 1.0), f"{AT_REST}, by changes of level"
    )


def _of_largest_change(r: Array, n: int, m: int, noise: float) -> float:
    """Return the probability that noise changes the mean of m samples as much as the largest change in the
    motion after sample n, times the number of independent changes. Changes are over a gap of 2 m samples.

    The variance of these changes is estimated from the n samples at rest, but is at least that of white noise
    with the variance `noise`.
    """
    level = np.convolve(r, np.full(m, 1.0 / m), mode="valid")
    change = (level[3 * m :] - level[: -3 * m]) ** 2
    quiet, moving = change[: n - 4 * m + 1], change[n - 2 * m :]
    usual = max(float(quiet.mean()), 2.0 * noise / m)
    # Changes that start less than 1.5 times m samples apart are not independent (m: samples in a group).
    count = max((n - 3 * m) / (1.5 * m), 1.0)
    return float(scipy.special.fdtrc(1.0, count, float(moving.max()) / usual)) * 1.5 * moving.size / m


def _lengths(least: int, most: int, count: int = 3) -> list[int]:
    """Return up to `count` different whole lengths in geometric progression from `least` to `most`."""
    return np.unique(np.geomspace(least, max(most, least), count).astype(int)).tolist()


def _independent_differences(r: Array, lag: int) -> float:
    """Return the `independent_samples` of the differences over `lag` samples, at most the number for white
    noise: each sample is in two differences, which a short spectrum shows only roughly."""
    found = r[lag:] - r[:-lag]
    return min(independent_samples(found, lag), found.size / 1.5)


def _in_motion(quiet: float, step: float, samples: int) -> float:
    """Return the variance in motion of noise that has the variance `quiet` at rest.

    At rest, a converter with the step `step` may stay on one level and hide the noise. In motion, the
    variance is step^2 / 12 plus that of the noise before the converter. This noise is taken so large that it
    leaves the middle of a step as often as observed, at least once in `samples`.
    """
    if step <= 0.0:
        return quiet
    leaves = min(max(quiet / step**2, 1.0 / samples), MOST_HIDDEN)
    hidden = 0.5 * step / -float(scipy.special.ndtri(0.5 * leaves))
    return max(quiet, hidden**2 + step**2 / 12.0)


def _by_periods(r: Array, known: KnownNoise) -> _Compared | None:
    folded = _folded(r, known)
    if folded is None:
        return None
    count, size = folded.shape
    about = np.column_stack([np.ones(size), np.linspace(-1.0, 1.0, size)])
    q, _ = np.linalg.qr(about)
    folded = folded - (folded @ q) @ q.T  # a drift does not belong to the repeated shape
    mean = folded.mean(axis=0)
    spread = _spectrum(folded - mean, count - 1)
    spread = np.maximum(spread, size * known.step**2 / 12.0)
    if not np.all(spread > 0.0):
        return None
    excess = 2.0 * count * np.abs(np.fft.rfft(mean)[1 : spread.size + 1]) ** 2 / spread
    # Compare the lowest lines alone, then more, then all: a smooth misfit is in few lines.
    bands = _lengths(min(4, spread.size), spread.size, BANDS)
    freedom = 2.0 * (count - 1) * SMOOTHED
    chances = [float(scipy.special.fdtrc(2 * k, freedom, np.mean(excess[:k]) / 2.0)) for k in bands]
    within = float(np.mean((folded - mean) ** 2)) * count / (count - 1)
    ratio = math.sqrt(1.0 + max(float(np.mean(mean**2)) / within - 1.0 / count, 0.0))
    return _Compared(ratio, min(1.0, min(chances) * len(bands)), BETWEEN)


def _folded(r: Array, known: KnownNoise) -> Array | None:
    """Return the periods after the first as rows [count, samples per period]; None if there are too few."""
    first, length, lasts = known.period
    size = math.floor(length)
    # The first period starts from rest, so it differs from all others.
    count = math.floor(min(r.size - first, lasts) / length + 1e-6) - 1 if size >= 8 else 0
    if count < FEWEST_PERIODS:
        return None
    begins = np.round(first + length * np.arange(1, count + 1)).astype(int)
    begins = begins[begins + size <= r.size]
    return r[begins[:, None] + np.arange(size)] if begins.size >= FEWEST_PERIODS else None


def _spectrum(rows: Array, freedom: int) -> Array:
    """Return the smoothed power spectrum of rows [rows, n], summed over the rows and divided by `freedom`
    (the degrees of freedom), at each line between 0 and half the sampling frequency."""
    lines = (rows.shape[1] - 1) // 2
    power = np.sum(np.abs(np.fft.rfft(rows)[:, 1 : lines + 1]) ** 2, axis=0) / freedom
    return scipy.ndimage.uniform_filter1d(power, min(SMOOTHED, lines), mode="nearest")


def left_over(name: str, left: float, least: Array, more: int, fitted: int) -> Lack:
    """Return a lack-of-fit test (`Lack`) of a model against a richer model with more free values.

    Args:
        name: name of the recordings.
        left: residual sum of squares of the model.
        least: residuals [n] of the richer model, which are taken as noise.
        more: number of values that only the richer model has.
        fitted: number of values of the richer model.
    """
    noise, freedom = float(least @ least), least.size - fitted
    ratio = math.sqrt(left / noise) if noise > 0.0 else math.nan
    if not ratio > 1.0 or freedom < 1:
        return Lack(name, ratio, 1.0, "")
    freedom *= independent_samples(least, 1) / least.size
    chance = float(scipy.special.fdtrc(more, freedom, (ratio**2 - 1.0) * freedom / more))
    return Lack(name, ratio, chance, "by what it leaves with other values of the stage")


def said(lacks: Sequence[Lack]) -> tuple[str, ...]:
    """Return the sentences of the tests that show a lack of fit, only the first for each recording."""
    seen: dict[str, Lack] = {}
    for one in lacks:
        if one.seen:
            seen.setdefault(one.name, one)
    return tuple(one.sentence for one in seen.values())
