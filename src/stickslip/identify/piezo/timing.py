r"""Delay and lag of a piezo's voltage, from the edges of its drive.

Under a slow periodic drive a lag and hysteresis both open the loop, and what a model of hysteresis lacks is
taken up by the lag: a recording of one frequency does not distinguish them. After an edge they look
different: the lag relaxes, the hysteresis acts at once. So the delay and the lag are those that fit best
after the edges, while the rest of the model is fitted elsewhere. Without an edge neither is estimated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .columns import Columns, DelayAndLag, Observed, PlayGrid, columns
from .linear import Solution, solve

# Smallest change of the drive from one sample to the next that is an edge: relative to the drive's range
# (EDGE), and relative to the median change (UNUSUAL). An edge exceeds both.
EDGE, UNUSUAL = 0.05, 8.0
# A window of samples after an edge shows delay and lag. OVER: the edge is over when the error of a model
# without delay and lag has fallen to this share of its maximum. LONGER: length of the window relative to the
# time until then. FEWEST, MOST: smallest and largest number of samples in a window.
OVER, LONGER, FEWEST, MOST = 0.05, 1.5, 8, 400
# Largest share of the samples until the next edge in a window; the other samples show the hysteresis.
AFTER = 0.5
EDGES = 40  # largest number of edges of a recording that are examined, evenly chosen
# Initial guesses of the search: delays in samples, lags relative to the length of the windows.
DELAYS, LAGS = (0.2, 0.8, 1.4, 2.2), (0.1, 0.2, 0.4)

Array = NDArray[np.float64]


class Edges(NamedTuple):
    """Edges of the drives of all recordings.

    Fields: `windows`, for each recording the pairs (first sample, end) of the examined windows after edges;
    `masks`, for each recording an array [n], True for samples outside the windows of all its edges.
    """

    windows: tuple[tuple[tuple[int, int], ...], ...]
    masks: tuple[NDArray[np.bool_], ...]

    @property
    def number(self) -> int:
        """Return the number of examined edges in all recordings."""
        return sum(map(len, self.windows))


class Lateness(NamedTuple):
    """Delay and lag of the voltage (`timing`), `remarks`, sentences on their origin, and the `edges` that
    determine them (without windows if no edges were used)."""

    timing: DelayAndLag
    remarks: tuple[str, ...]
    edges: Edges


def edges_of(observed: Sequence[Observed], still: Sequence[Array]) -> Edges:
    """Return the edges of all drives, with a window of samples after each that shows delay and lag.

    An edge is left out if the next one follows too soon for a window.

    Args:
        observed: the recordings.
        still: for each recording, the position by a model without delay and lag, m, offset included, [n].
    """
    windows, masks = [], []
    for one, shown in zip(observed, still, strict=True):
        change = np.abs(np.diff(one.drive, prepend=one.rest))
        usual = float(np.median(change))
        range_ = float(np.ptp(one.drive))
        found = np.flatnonzero(change > max(EDGE * range_, UNUSUAL * usual)).tolist()
        ends = [*found[1:], one.time.size][: len(found)]
        left = np.abs(one.position - shown)
        made = [
            (first, _until(left, first, end))
            for first, end in zip(found, ends, strict=True)
            if AFTER * (end - first) >= FEWEST
        ]
        mask = np.ones(one.time.size, dtype=bool)
        for first, end in made:
            mask[first:end] = False
        every = max(1, math.ceil(len(made) / EDGES))
        windows.append(tuple(made[::every]))
        masks.append(mask)
    return Edges(tuple(windows), tuple(masks))


def _until(left: Array, first: int, end: int) -> int:
    """Return the index after the last sample of an edge's window.

    The edge is over when the error of a model without lag falls to the median error, or to the share `OVER`
    of its maximum after the edge. The window is `LONGER` times as long, limited by `FEWEST`, `MOST` and
    `AFTER`.

    Args:
        left: absolute error of a model without lag at each sample, m, [n].
        first: index of the first sample after the edge.
        end: index of the next edge, or number of samples.
    """
    most = min(MOST, int(AFTER * (end - first)))
    after = left[first : first + most]
    high = np.flatnonzero(after > max(OVER * float(after.max()), float(np.median(left))))
    lasts = int(high[-1]) + 1 if high.size else 0
    return first + int(np.clip(LONGER * lasts, FEWEST, most))


def lateness(
    observed: Sequence[Observed], grid: PlayGrid, edges: Edges, near: DelayAndLag | None = None
) -> Lateness:
    """Return the delay and lag that fit best after the edges; without edges both are 0 s.

    Args:
        observed: the recordings.
        grid: thresholds, zones and creep times of the model, whose coefficients are fitted to the samples
            outside the windows.
        edges: edges with their windows.
        near: initial guess; None: the best of several guesses.
    """
    if not edges.number:
        said = (
            "the drive has no edges: a lag of the voltage cannot be told from hysteresis, and is taken as 0 s"
        )
        return Lateness(DelayAndLag(), (said,), edges)
    positions = [one.position for one in observed]

    def misfit(x: Array) -> Array:
        timing = DelayAndLag(abs(float(x[0])), abs(float(x[1])))
        parts = [columns(one, timing, grid) for one in observed]
        return after(parts, positions, solve(parts, positions, grid, edges.masks), edges)

    def square(x: Array) -> float:
        return float(np.sum(misfit(x) ** 2))

    step = float(np.median(np.diff(observed[0].time)))
    lengths = [end - first for windows in edges.windows for first, end in windows]
    lasts = float(np.median(lengths)) * step
    # The sum of squares has a local minimum for every sample at which the edge may be, so several delays are
    # tried.
    starts = [np.array([d * step, share * lasts]) for d in DELAYS for share in LAGS]
    start = min(starts, key=square) if near is None else np.array(near)
    simplex = start + np.array([[0.0, 0.0], [0.3 * step, 0.0], [0.0, 0.3 * start[1]]])
    size = square(start) or 1.0
    end = scipy.optimize.minimize(
        lambda x: square(x) / size,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-3 * step, "fatol": 1e-5, "maxfev": 120},
    )
    best = np.abs(end.x)
    spread = _spread(misfit, best, step)
    said = (
        f"delay {best[0]:.3g} s and lag {best[1]:.3g} s (standard errors {spread.delay:.1g} s, "
        f"{spread.lag:.1g} s) are those seen after {edges.number} edge{'s' * (edges.number > 1)} of the "
        "drive; the intervals of the others hold for them"
    )
    return Lateness(DelayAndLag(*best.tolist()), (said,), edges)


def after(parts: Sequence[Columns], positions: Sequence[Array], found: Solution, edges: Edges) -> Array:
    """Return the residuals (model minus measured), m, of the samples in the windows after all edges, joined.
    The mean of each window is subtracted, because creep from before an edge is not a lag.

    Args:
        parts: for each recording the responses that the coefficients multiply (`columns`).
        positions: measured positions of each recording, m.
        found: coefficients of the columns.
        edges: windows after the edges.
    """
    left = []
    for of, y, windows in zip(parts, positions, edges.windows, strict=True):
        shown = found.position(of)
        for first, end in windows:
            r = shown[first:end] - y[first:end]
            left.append(r - r.mean())
    return np.concatenate(left)


def _spread(misfit: Callable[[Array], Array], best: Array, step: float) -> DelayAndLag:
    """Return the linearised standard errors of delay and lag, s; NaN if they cannot be determined.

    Args:
        misfit: function from an array of delay and lag [s] to residuals [m], shape (n,).
        best: delay and lag with the smallest residuals, s.
        step: sampling interval, s.
    """
    h, r = 0.05 * step, misfit(best)
    ends = [(np.maximum(best - d, 0.0), best + d) for d in h * np.eye(2)]  # delay and lag are not negative
    slopes = np.column_stack([(misfit(b) - misfit(a)) / float(np.sum(b - a)) for a, b in ends])
    try:
        covariance = np.linalg.inv(slopes.T @ slopes) * float(r @ r) / max(r.size - 2, 1)
    except np.linalg.LinAlgError:
        return DelayAndLag(math.nan, math.nan)
    return DelayAndLag(*np.sqrt(np.diag(covariance)).tolist())
