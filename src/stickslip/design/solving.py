"""Computation of the steady steps at all points of a map, block by block, and of their intervals.

A steady step is the net step on a periodic orbit. After an interruption, the results of finished blocks are
kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.orbits import Orbits
from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.progress import Progress
from ..simulation.members import Columns, Members, checked_columns
from ..simulation.steady_members import CONVERGED, orbit_blocks
from ..simulation.steady_members import STATUS as OF_ORBITS
from ..waveform.signal import Waveform
from .motion import within_a_period

Array = NDArray[np.float64]

STATUS = (*OF_ORBITS, "not_computed")
NOT_COMPUTED = len(OF_ORBITS)
# Approximate number of members (pairs of a point and a draw) that `intervals` computes in one call. If the
# map has few points, several draws are computed together, which is faster.
AT_ONCE = 4096
# Smallest share of draws with a steady step at a point for which an interval of the step is given there.
ENOUGH = 0.9
LEVEL = 0.95

# Type of the first arguments of `solved`, which are the same for a map and its draws: model, drive, columns
# (varied fields by name, SI, arrays [points]), tolerance [m], normal force over its reference, number of
# threads, output stage.
Common = tuple[Actuator, Waveform, Mapping[str, Array], float, Any, int | None, OutputStage | None]


class Solved(NamedTuple):
    """Results at all points of a map, arrays [points].

    Fields: net `steps` and estimates of their `errors`, m, or rad for a rotary actuator, NaN without a steady
    step; `beside`, further results by name (see `design.motion`); `status`, index of `STATUS`; `reasons` in
    words, "" where converged; and `interrupted`, True if Ctrl-C stopped the computation.
    """

    steps: Array
    errors: Array
    beside: dict[str, Array]
    status: NDArray[np.int8]
    reasons: list[str]
    interrupted: bool


def solved(
    model: Actuator,
    waveform: Waveform,
    columns: Mapping[str, Array],
    tolerance: float,
    normal_load: Waveform | float,
    threads: int | None,
    output: OutputStage | None,
    progress: Progress,
    extras: tuple[str, ...] = (),
) -> Solved:
    """Return the steady steps at all points. After Ctrl-C the results of finished blocks are returned, and
    the other points have the status `NOT_COMPUTED`.

    Args:
        model, waveform, normal_load, output: as for `step_map`.
        columns: varied fields of model and drive by name, arrays [points], SI.
        tolerance: tolerance of the net step, m, or rad for a rotary actuator.
        threads: number of threads; None: one per processor.
        progress: called after each block of points with activity and finished fraction.
        extras: names of further results: "backlash", "backward_rate", "ringing", "ripple".

    Raises:
        QuantityError: see `orbit_blocks`.
    """
    columns = checked_columns(model, waveform, columns)
    count = next(iter(columns.values())).size
    steps, errors = np.full((2, count), np.nan)
    beside = {name: np.full(count, np.nan) for name in extras}
    status, reasons = np.full(count, NOT_COMPUTED, np.int8), ["not computed"] * count

    def moved(of: Members, part: Columns, found: Orbits, states: NDArray[np.int8]) -> dict[str, Array]:
        return within_a_period(model, of, part, found, states == CONVERGED, tolerance, extras)

    blocks = orbit_blocks(
        model, waveform, columns, tolerance, normal_load, threads, moved if extras else None, output
    )
    try:
        for start, block in blocks:
            part = slice(start, start + block.status.size)
            there = block.status == CONVERGED
            steps[part] = np.where(there, block.found.steps, np.nan)
            errors[part] = np.where(there, block.found.errors, np.nan)
            for name, values in beside.items():
                values[part] = block.beside[name]
            status[part], reasons[part] = block.status, block.reasons
            progress("solving for periodic motion", part.stop / count)
    except KeyboardInterrupt:
        return Solved(steps, errors, beside, status, reasons, True)
    return Solved(steps, errors, beside, status, reasons, False)


def intervals(
    common: Common, drawn: Mapping[str, Array], progress: Progress
) -> tuple[Array, Array, NDArray[np.int64], bool]:
    """Compute the net steps at all points for each draw of uncertain parameters, and return their intervals.

    Args:
        common: arguments of `solved` that are the same for all draws, see `Common`.
        drawn: draws of the parameters by name, arrays [draws], SI.
        progress: called with activity and finished fraction.

    Returns:
        Lower and upper end of the 95 % interval of the net step, [points], m, or rad for a rotary actuator;
        the number of draws with a steady step at each point; and True if Ctrl-C stopped the computation. Then
        the ends are NaN, unless enough draws were finished.
    """
    model, waveform, columns, tolerance, normal_load, threads, output = common
    points, draws = next(iter(columns.values())).size, next(iter(drawn.values())).size
    together = max(1, AT_ONCE // points)
    steps, interrupted = np.full((draws, points), np.nan), False
    for begin in range(0, draws, together):
        some = slice(begin, min(begin + together, draws))
        size = some.stop - begin
        members = {name: np.tile(column, size) for name, column in columns.items()}
        members |= {name: np.repeat(values[some], points) for name, values in drawn.items()}
        share = size / draws
        found = solved(
            model,
            waveform,
            members,
            tolerance,
            normal_load,
            threads,
            output,
            lambda doing, part, begin=begin, share=share: progress(doing, begin / draws + share * part),
        )
        steps[some] = found.steps.reshape(size, points)
        interrupted = found.interrupted
        if interrupted:
            break
    return *ends(steps), interrupted


def ends(steps: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return lower and upper end of the 95 % interval of the net step at each point, and the number of draws
    with a steady step there.

    Args:
        steps: net steps [draws, points], NaN without a steady step. The ends have the same unit; they are NaN
            where fewer than the share `ENOUGH` of the draws have a steady step.
    """
    draws, points = steps.shape
    count, low, high = np.isfinite(steps).sum(axis=0), np.full(points, np.nan), np.full(points, np.nan)
    fine = count >= ENOUGH * draws
    if np.any(fine):
        quantiles = [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]
        low[fine], high[fine] = np.nanquantile(steps[:, fine], quantiles, axis=0)
    return low, high, count
