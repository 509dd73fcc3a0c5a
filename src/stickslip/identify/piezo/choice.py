"""Choice of the number of play operators, of asymmetry and of creep in a piezo's model, by
cross-validation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...physics.piezo.creep import spread
from ...quantities.units import QuantityError
from ..recorded.known_noise import white_noise
from .columns import CREEP_BEGINS, Columns, Observed, PlayGrid, columns
from .linear import held_out, residuals, solved, typical
from .timing import Lateness

# Numbers of play operators that are tried; more than the last predicted no better on any data tested.
PLAYS = (1, 2, 4, 6, 8, 12, 16)
FOLDS = 6  # number of parts of each recording for cross-validation
# A smaller model is as good as the best one if its held-out rms residual beyond white noise exceeds the best
# one's by less than the share ENOUGH. In addition, a difference of chi-squared of NOISE is allowed, because
# noise alone can cause it.
ENOUGH, NOISE = 0.02, 10.0
# Longest time constant of continuing creep, in durations of the longest recording: real stacks creep for
# hours.
BEYOND = 10.0
# Shortest recording (or rest of the drive) that shows creep, in multiples of `CREEP_BEGINS`.
LONG_ENOUGH = 20.0
SAMPLES_PER_PLAY = 10  # fewest samples of a recording for each fitted play
# Largest change of a drive during a rest, relative to the range of the drive.
STILL = 0.01


class Shape(NamedTuple):
    """A form of the model to compare: `bent`, True with the squared voltage; `skew` of the plays' input
    [1/V], 0 for none; and `late`, the delay and lag of the voltage for this form."""

    bent: bool
    skew: float
    late: Lateness


class Choice(NamedTuple):
    """Result of the choice: `grid`, the model's thresholds, zones and creep times; `late`, delay and lag of
    the voltage; `score`, the typical rms residual of the held-out parts, m (see `typical`); and `remarks`,
    sentences on the choice."""

    grid: PlayGrid
    late: Lateness
    score: float
    remarks: tuple[str, ...]


def range_of(observed: Sequence[Observed]) -> tuple[float, float]:
    """Return least and greatest voltage [V] of all recordings and of the rests before them."""
    lows = [min(float(one.drive.min()), one.rest) for one in observed]
    highs = [max(float(one.drive.max()), one.rest) for one in observed]
    return min(lows), max(highs)


def chosen(
    observed: Sequence[Observed],
    shapes: Sequence[Shape],
    operators: int | None,
    creep: bool | None,
    time_constants: Sequence[float] = (),
) -> Choice:
    """Return the smallest model that predicts held-out parts about as well as the best one.

    Args:
        observed: the recordings.
        shapes: forms of the model to compare. Of neighbours that differ only in the square, the one with it
            is last.
        operators: number of plays; None: the choice compares the numbers in `PLAYS`.
        creep: True: with creep; False: without; None: the choice compares both.
        time_constants: time constants of the creep, s; by default two per decade from 0.1 s to the length of
            the recordings, or to `BEYOND` times this length if that fits better.

    Raises:
        QuantityError: the recordings do not determine the number of plays, the time constants or the
            requested creep.
    """
    lasts, fewest = _lasts(observed), min(one.time.size for one in observed)
    long_enough = lasts >= LONG_ENOUGH * CREEP_BEGINS
    _refuse_undetermined(observed, operators, bool(creep) and not long_enough, time_constants)
    plays = PLAYS if operators is None else (operators,)
    crept = (False, True) if creep is None and long_enough else (bool(creep),)
    tried = []
    positions = [one.position for one in observed]
    # A shape with the square and one without it share all other columns, which take most of the time.
    alike = [list(some) for _, some in groupby(shapes, key=lambda one: (one.skew, one.late))]
    for n, some in product((n for n in plays if n * SAMPLES_PER_PLAY <= fewest), alike):
        bent, skew, late = some[-1]
        most = PlayGrid.over(*range_of(observed), n, bent, lasts if max(crept) else 0.0, skew)
        if most.times.size and len(time_constants):
            most = most._replace(times=np.array(time_constants))
        parts = [columns(one, late.timing, most) for one in observed]
        for shape, creeps in product(some, crept):
            grid = most.without(bent=not shape.bent, creep=not creeps)
            kept = [Columns(*(rows[:, : n + shape.bent] for rows in part)) for part in parts]
            size = n + shape.bent + bool(skew) + creeps
            tried.append((held_out(kept, positions, grid, FOLDS), size, grid, late))
    best = min((squares for squares, *_ in tried), key=typical)
    white = float(np.mean([white_noise(y) for y in positions]))
    count = sum(y.size for y in positions)
    good = [one for one in tried if _as_good(one[0], best, white, count)]
    squares, _, grid, late = min(good, key=lambda one: one[1])
    remarks = _remarks(observed, grid, len(tried), creep, long_enough)
    made = Choice(grid, late, typical(squares), tuple(remarks))
    return _lasting(observed, made, lasts) if grid.times.size and not time_constants else made


def _lasts(observed: Sequence[Observed]) -> float:
    """Return the duration of the longest recording, s."""
    return max(float(one.time[-1]) for one in observed)


def _refuse_undetermined(
    observed: Sequence[Observed], operators: int | None, too_short: bool, time_constants: Sequence[float]
) -> None:
    """Raise QuantityError if the recordings do not determine the number of plays `operators` (None: chosen)
    or the `time_constants` [s], or if `too_short`: creep is requested, but the recordings do not show any."""
    lasts, fewest = _lasts(observed), min(one.time.size for one in observed)
    if operators is not None and not 1 <= operators <= fewest // SAMPLES_PER_PLAY:
        raise QuantityError(
            f"operators = {operators} is out of range: 1 to {fewest // SAMPLES_PER_PLAY} for {fewest} samples"
        )
    for tau in time_constants:
        shortest = 2.0 * float(observed[0].time[1])
        if not shortest <= tau <= lasts:
            raise QuantityError(
                f"time_constants has {tau:g} s, which recordings of {lasts:.3g} s do not determine: "
                f"from {shortest:.3g} s to {lasts:.3g} s"
            )
    if too_short:
        raise QuantityError(
            f"creep = True, but the recordings last {lasts:.3g} s: "
            f"at least {LONG_ENOUGH * CREEP_BEGINS:g} s are needed"
        )


def _remarks(
    observed: Sequence[Observed], grid: PlayGrid, tried: int, creep: bool | None, long_enough: bool
) -> list[str]:
    """Return sentences on the chosen model and on the limits of its creep.

    Args:
        observed: the recordings.
        grid: thresholds, zones and creep times of the chosen model.
        tried: number of compared models.
        creep: the user's choice; None: left to cross-validation.
        long_enough: True if the recordings are long enough to show creep.
    """
    remarks: list[str] = []
    if tried > 1:
        remarks.append(
            f"{grid.thresholds.size} plays, {'with' if grid.zones.size else 'without'} asymmetry"
            f"{' and skew' * bool(grid.skew)}, "
            f"{'with' if grid.times.size else 'without'} creep: the smallest of {tried} models that "
            f"predicts parts left out at most {100 * ENOUGH:g} % worse than the best, noise apart"
        )
    if creep is None and not long_enough:
        remarks.append(f"creep is left out: it does not show within {_lasts(observed):.3g} s")
    if creep is None and grid.times.size and not any(map(_rests, observed)):
        remarks.append(
            f"creep is from a voltage that never rests for {LONG_ENOUGH * CREEP_BEGINS:g} s: there it can "
            "stand for hysteresis that the plays do not describe, and what it predicts of a voltage held is "
            "not tested; record one, or leave it out (creep=False)"
        )
    return remarks


def left_of_all(observed: Sequence[Observed], late: Lateness, grid: PlayGrid) -> tuple[float, float]:
    """Return the standard deviation [m] of the residuals of a model fitted to all samples, and its creep (a
    share of the position per decade of time).

    Args:
        observed: the recordings.
        late: delay and lag of the voltage.
        grid: thresholds, zones and creep times of the model.
    """
    parts = [columns(one, late.timing, grid) for one in observed]
    positions = [one.position for one in observed]
    found = solved(parts, positions, grid)
    return float(np.std(residuals(parts, positions, found))), found.creep


def _lasting(observed: Sequence[Observed], choice: Choice, lasts: float) -> Choice:
    """Return the choice with creep that ends with the recordings (after `lasts` s), or with creep that lasts
    `BEYOND` times as long, whichever has smaller residuals; a remark compares both.

    Both have the same number of parameters. If continuing creep is assumed to end, creep is overestimated by
    a sixth.
    """
    beyond = choice.grid._replace(times=spread(CREEP_BEGINS, BEYOND * lasts))
    tried = [
        (*left_of_all(observed, choice.late, grid), end, grid)
        for grid, end in ((choice.grid, lasts), (beyond, BEYOND * lasts))
    ]
    (_, _, end, grid), (_, creep, other, _) = sorted(tried, key=lambda one: one[0])
    said = (
        f"creep is by terms from {CREEP_BEGINS:g} s to {end:.3g} s; by those to {other:.3g} s, which leave "
        f"more, it would be {creep:.3g} per decade, and the interval is not for that"
    )
    choice = choice._replace(remarks=(*choice.remarks, said))
    if grid is choice.grid:
        return choice
    parts = [columns(one, choice.late.timing, grid) for one in observed]
    return choice._replace(
        grid=grid, score=typical(held_out(parts, [one.position for one in observed], grid, FOLDS))
    )


def _as_good(squares: NDArray[np.float64], best: NDArray[np.float64], white: float, count: int) -> bool:
    """Return True if a model predicts the held-out folds about as well as the best one.

    Every model leaves white noise. If white noise dominates the residual, a difference of 2 % may be the
    whole effect of creep; so the comparison uses the residual without white noise.

    Args:
        squares, best: mean square residual of each fold with this model and with the best one, m².
        white: standard deviation of the white noise, m.
        count: number of samples of all recordings.
    """
    rest = max(1.0 - (white / max(typical(best), 1e-300)) ** 2, 0.0)
    more = 2.0 * math.log((typical(squares) + 1e-300) / (typical(best) + 1e-300))
    return more <= 2.0 * ENOUGH * rest + NOISE / count


def _rests(one: Observed) -> bool:
    """Return True if the drive of a recording rests for at least `LONG_ENOUGH` times `CREEP_BEGINS`, which is
    long enough to show creep."""
    size = int(LONG_ENOUGH * CREEP_BEGINS / one.time[1])
    if size > one.time.size:
        return False
    swing = scipy.ndimage.maximum_filter1d(one.drive, size) - scipy.ndimage.minimum_filter1d(one.drive, size)
    return bool(np.min(swing[size // 2 : one.time.size - size // 2]) < STILL * np.ptp(one.drive))
