r"""Detection of jumps and bursts in residuals, with noise of any spectrum, apart from changes that other
parameter values could describe.

A jump is one impulse in the differences of the residuals, a burst two opposite ones. Sines make the
differences of noise independent (see `drift`), each with the power S of the noise's spectrum. So with
residuals r, their derivatives J by the parameters, and a jump h, all in a sine basis divided by
:math:`\sqrt{S}`,

.. math:: z = \frac{h^T P r}{\sqrt{h^T P h}}, \qquad P = 1 - J (J^T J)^{-1} J^T

is the size of the jump over its standard error, for all instants at once by two transforms. P removes the
misfit that the jump itself left by pulling the parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .coloured import filter_and_walk, spectrum_of_differences
from .drift import sine_powers
from .outliers import TO_DEVIATION

# Smallest significant size of a jump or burst, in standard errors. The largest of 1e5 samples of white noise
# reaches 5, of 1800 samples of 1/f noise 7.5.
SURE = 8.0
# Number of events in one recording at which they count as noise or model error, and none is returned.
MOST = 6
# Numbers of samples of the bursts that are searched for; a longer burst is found as two jumps.
WIDTHS = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90)
# Bursts longer than the recording's number of samples divided by this number are not searched for.
LONGEST_PART = 10
# Smallest share of the information on a jump that is independent of the parameters; with less, a jump cannot
# be distinguished from a change of the parameters.
LEAST_LEFT = 1e-3
# FEWEST: fewest samples of a recording that is searched. LONGEST: largest number of samples; a longer
# recording is averaged over neighbours.
FEWEST, LONGEST = 32, 10_000
FIRST_BAND = 8  # number of spectral lines in the lowest octave of the noise's spectrum

Array = NDArray[np.float64]
Places = NDArray[np.intp]


class Event(NamedTuple):
    """A jump or burst: the residuals from sample `first` to before sample `last` are shifted by `size`, in
    their unit; a jump lasts to the end of the recording. `score` is the size divided by its standard error,
    with the sign of the size."""

    first: int
    last: int
    size: float
    score: float

    def shape(self, count: int) -> Array:
        """Return 1 for the shifted samples and 0 elsewhere, shape (count,)."""
        at = np.arange(count)
        return ((at >= self.first) & (at < self.last)).astype(float)

    @property
    def certainty(self) -> float:
        """Return the magnitude of the score divided by the smallest significant score, so at least 1 for a
        significant event."""
        return abs(self.score) / SURE


def events(residuals: Array, columns: Array, floor: float = 0.0, least: float = 0.0) -> list[Event]:
    """Return jumps and bursts in residuals, as `Event` in the order of their first samples; an empty list if
    there are too many to be single events.

    A recording of over `LONGEST` samples is averaged over neighbours, so its events start and end at whole
    groups of samples.

    Args:
        residuals: residuals of one recording, at equal intervals, [n].
        columns: derivatives of the residuals by the parameters, and time courses of other known faults, [n,
            k].
        floor: smallest standard deviation of white noise, in the unit of the residuals.
        least: smallest size of an event that is returned, in the unit of the residuals.
    """
    r = np.asarray(residuals, dtype=float)
    if r.size < FEWEST or not np.ptp(r) > 0.0:
        return []
    if r.size > LONGEST:
        many = math.ceil(r.size / LONGEST)
        coarse = events(_means(r, many), _means(columns, many), floor / math.sqrt(many), least)
        ends = [r.size if e.last == r.size // many else e.last * many for e in coarse]
        return [e._replace(first=e.first * many, last=end) for e, end in zip(coarse, ends, strict=True)]
    widths = [w for w in WIDTHS if w * LONGEST_PART <= r.size]
    white = max(TO_DEVIATION * float(np.median(np.abs(np.diff(r)))) / math.sqrt(2.0), floor)
    if white <= 0.0:
        return []
    angles = np.pi * np.arange(1, r.size) / r.size
    # The noise is first taken as white, with the deviation that the differences of neighbours show, because
    # an estimate of the full spectrum would include the jumps.
    look = (2.0 - 2.0 * np.cos(angles)) * white**2
    found: list[Event] = []
    while len(found) < MOST:
        one = _Whitened(r, columns, found, look).strongest(widths)
        if one.certainty < 1.0:
            break
        found.append(one)
    if not found:
        return []
    found, noise = _confirmed(r, columns, found, look, floor)
    while len(found) < MOST:
        one = _Whitened(r, columns, found, noise).strongest(widths)
        if one.certainty < 1.0:
            return sorted(e for e in found if abs(e.size) >= least)
        more, noise = _confirmed(r, columns, [*found, one], noise, floor)
        if one[:2] not in [e[:2] for e in more]:
            return sorted(e for e in more if abs(e.size) >= least)
        found = more
    return []


def _means(rows: Array, many: int) -> Array:
    """Return the means of successive groups of `many` rows, [n / many, ...]; an incomplete last group is
    dropped."""
    count = len(rows) // many
    return np.asarray(rows[: count * many].reshape(count, many, *rows.shape[1:]).mean(axis=1))


def _confirmed(
    r: Array, columns: Array, found: list[Event], noise: Array, floor: float
) -> tuple[list[Event], Array]:
    """Return the events that make the residuals significantly more likely than any noise without them, and
    the spectrum [n - 1] of the differences of the noise.

    The noise is estimated again without each event, because a small jump resembles a random walk.

    Args:
        r: residuals, [n].
        columns: derivatives by the parameters and time courses of other faults, [n, k].
        found: events that may be noise.
        noise: first estimate of the spectrum, [n - 1].
        floor: smallest standard deviation of white noise, in the unit of the residuals.
    """
    while True:
        noise, likely = _spectrum(_Whitened(r, columns, found, noise).left(), floor)
        if not found:
            return [], noise
        judged = []
        for one in found:
            others = _Whitened(r, columns, [e for e in found if e is not one], noise)
            event = others.at(one)
            _, less = _spectrum(others.left(), floor)
            gained = math.sqrt(max(less - likely, 0.0))
            judged.append(event._replace(score=math.copysign(min(abs(event.score), gained), event.size)))
        weakest = min(judged, key=lambda e: e.certainty)
        if weakest.certainty >= 1.0:
            return judged, noise
        found = [e for e in judged if e is not weakest]


def _spectrum(left: Array, floor: float) -> tuple[Array, float]:
    """Return the spectrum [n - 1] of the differences of residuals `left` [n] that are only noise, and
    Schwarz's criterion of this spectrum (minus twice its log-likelihood plus a penalty for its parameters)
    [schwarz1978].

    `floor` is the smallest standard deviation of white noise, in the unit of the residuals.
    """
    angles, powers = sine_powers(left)
    filter, variance, walk = filter_and_walk([left])
    white = (2.0 - 2.0 * np.cos(angles)) * floor**2
    found = np.maximum(spectrum_of_differences(angles, filter, variance, walk), white)
    # 1/f noise is neither white nor a random walk, so the power is estimated for each octave separately.
    ends = [FIRST_BAND * 2**i for i in range(64) if FIRST_BAND * 2 ** (i + 1) < powers.size]
    for band in np.split(np.arange(powers.size), ends):
        found[band] *= max(float(np.mean(powers[band] / found[band])), 1.0)
    numbers = filter.size - 1 + (walk > 0.0)
    criterion = float(np.sum(powers / found + np.log(found))) + numbers * math.log(left.size)
    return found, criterion


class _Whitened:
    """Differences of residuals r [n] in a sine basis, divided by the root of their spectrum (so that noise is
    white), without the part that columns and known events describe. Methods estimate the sizes of further
    events in them.

    `columns` [n, k] are derivatives by the parameters and time courses of other faults, as for `events`;
    `found` are the known events, and `spectrum` [n - 1] is that of the differences of the noise.
    """

    def __init__(self, r: Array, columns: Array, found: Sequence[Event], spectrum: Array) -> None:
        shapes = [e.shape(r.size)[:, None] for e in found]
        self.r, self.columns = r, np.concatenate([columns, *shapes], axis=1)
        self.root = 1.0 / np.sqrt(spectrum)
        norms = np.linalg.norm(self.columns, axis=0)
        self.columns = self.columns[:, norms > 0.0] / norms[norms > 0.0]
        self.sines = self.root[:, None] * _sines(np.diff(self.columns, axis=0))
        self.data = self.root * _sines(np.diff(r))
        u, s, _ = np.linalg.svd(self.sines, full_matrices=False)
        q = u[:, s > 1e-9 * s.max(initial=0.0)]
        self.numerator = _sines(self.root * (self.data - q @ (q.T @ self.data)))
        self.of_columns = _sines(self.root[:, None] * q)
        half = np.concatenate([[0.0], 1.0 / spectrum, [0.0]])
        self.lags = np.fft.irfft(half, 2 * r.size)

    def left(self) -> Array:
        """Return the residuals [n], in their unit, without the part that the columns and the known events
        describe."""
        coefficients = np.linalg.lstsq(self.sines, self.data, rcond=1e-9)[0]
        return np.asarray(self.r - self.columns @ coefficients)

    def _information(self, k: Places, m: Places) -> Array:
        """Return the product, weighted by the noise, of an impulse before sample k with one before sample m,
        for each pair of the arrays k and m. The part that columns and known events describe is removed from
        both impulses."""
        by = self.of_columns
        own = self.lags[np.abs(k - m)] - self.lags[k + m]
        return own - np.einsum("kc,kc->k", by[k - 1], by[m - 1])

    def _made(self, k: Places, width: int | None) -> tuple[Array, Array]:
        """Return the sizes, in the unit of the residuals, and the scores of jumps before each of the samples
        k; with a `width` (in samples), of bursts that start there. Both are 0 where the columns could
        describe the event."""
        numerator, information = self.numerator[k - 1], self._information(k, k)
        whole = self.lags[0] - self.lags[2 * k]
        if width is not None:
            end = k + width
            numerator = numerator - self.numerator[end - 1]
            both = self.lags[width] - self.lags[k + end]
            whole = whole + self.lags[0] - self.lags[2 * end] - 2.0 * both
            information = information + self._information(end, end) - 2.0 * self._information(k, end)
        seen = information > LEAST_LEFT * whole
        information = np.where(seen, information, np.inf)
        return numerator / information, numerator / np.sqrt(information)

    def at(self, one: Event) -> Event:
        """Return the event with its size and score computed again for this noise."""
        n = self.r.size
        size, score = self._made(np.array([one.first]), None if one.last == n else one.last - one.first)
        return Event(one.first, one.last, float(size[0]), float(score[0]))

    def strongest(self, widths: Sequence[int]) -> Event:
        """Return the jump or burst with the greatest magnitude of the score; bursts of the given numbers of
        samples (`widths`) are tried."""
        n, best = self.r.size, Event(1, self.r.size, 0.0, 0.0)
        for width in (None, *widths):
            k = np.arange(1, n - (width or 0))
            sizes, scores = self._made(k, width)
            i = int(np.argmax(np.abs(scores)))
            last = n if width is None else int(k[i]) + width
            one = Event(int(k[i]), last, float(sizes[i]), float(scores[i]))
            best = max(best, one, key=lambda e: e.certainty)
        return best


def _sines(x: Array) -> Array:
    return np.asarray(scipy.fft.dst(x, type=1, norm="ortho", axis=0))
