"""Simulation of many members (variants of one model and drive) at once: parameters, drive amplitudes,
loads."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.binding import DriveTable
from ..engine.law_of import law_of
from ..engine.members import ComposedMembers, MemberDrives, integrate_members
from ..engine.outcome import DONE, NO_NUMBER, STEP_TOO_SMALL, TOO_MANY_STEPS
from ..friction import element
from ..physics.actuator import Actuator
from ..physics.electronics.stack import Stack
from ..quantities.progress import Progress, unheard
from ..quantities.units import labelled_for, optional_si
from ..waveform.drive import Drive
from ..waveform.signal import Waveform
from .demand import labelled_demand
from .drives import refuse_no_waveform, tables
from .errors import SimulationWarning
from .members import (
    BLOCK,
    Columns,
    Members,
    block_size,
    checked_columns,
    in_blocks,
    labelled,
    own_tables,
    prepared,
)
from .models import contact_load
from .plant.at_piezo import tabulated
from .refinement import FINER, LOOSE, MOST_STEPS, PER_DIFFERENCE, PER_NUMBER, ROUNDS
from .trajectory import checked_tolerance, run_time, sample_times

if TYPE_CHECKING:
    import xarray as xr

REFUSED = 4
OUTCOMES = {
    DONE: "complete",
    STEP_TOO_SMALL: "step_too_small",
    TOO_MANY_STEPS: "too_many_steps",
    NO_NUMBER: "no_number",
    REFUSED: "refused",
}
# Largest number of members in a block on a GPU. It is large, because a GPU is slow with few threads.
GPU_BLOCK = 1 << 18


class Block(NamedTuple):
    """Results of one block of members, one entry per member.

    Fields: `status`, code (key of `OUTCOMES`); `reached`, time reached [s]; `steps`, integration steps tried;
    `net`, net displacement (NaN: refused), and `error`, its estimated error, or with samples that of the
    positions (NaN: unknown), m or rad; `positions` [members, times] of the end-effector, m or rad; `reasons`
    of failures ("" if complete).
    """

    status: NDArray[np.int8]
    reached: NDArray[np.float64]
    steps: NDArray[np.int64]
    net: NDArray[np.float64]
    error: NDArray[np.float64]
    positions: NDArray[np.float64]
    reasons: list[str]


def simulate_ensemble(
    model: Actuator,
    waveform: Waveform,
    duration: float | str | None = None,
    *,
    parameters: Mapping[str, ArrayLike],
    sample_rate: float | str | None = None,
    times: ArrayLike | None = None,
    tolerance: float | str = 1e-9,
    load: Waveform | float = 1.0,
    stack: Stack | None = None,
    max_steps: int = 2_000_000,
    threads: int | None = None,
    engine: Literal["cpu", "cuda"] = "cpu",
    progress: Progress = unheard,
) -> xr.Dataset:
    """Simulate many members of a model and its drive signal, from rest, on all processors.

    Args:
        model: the actuator that the members vary.
        waveform: the drive, V.
        duration: s; by default the duration of the waveform, if it has an end; without samples, the duration
            of each member's own waveform.
        parameters: one array per name, all [members], in SI or with units. Names are the fields of the law,
            of the actuator, of its piezo ("piezo_weight_2", "piezo_capacitance") and of the waveform
            ("amplitude", "frequency"; "value_3" and "time_2" of a list), "stiction_ratio", "breakaway_share"
            (see `identify_friction`), "drive_scale" (a factor on the waveform), and "load" (the normal force
            over its reference). Stiction and breakaway deflection that are not varied keep their ratio to
            Coulomb friction.
        sample_rate, times: samples of the trajectories, as for `simulate`; by default only summaries are
            kept, which need little memory.
        tolerance: tolerance of the positions, or of the net displacement, m (rad), as for `simulate`.
        load: normal force relative to its reference, for all members: a number or a waveform.
        stack: piezo stack that each periodic drive charges; it adds peak_current and rms_current (A),
            energy_per_step (J, per period), heat (W) and temperature_rise (K), see `demand`.
        max_steps: largest number of integration steps of each member.
        threads: number of threads; by default one per processor.
        engine: "cuda" runs the same steps on a GPU, a thread for each member (extra ``stickslip[cuda]``); if
            that is impossible (no GPU, or trajectories are required), it runs on the processors, with a
            `SimulationWarning`.
        progress: function that is called after each block with "simulating" and the finished fraction.

    Returns:
        Dataset over "member" with the parameters, net_displacement (m, up to the time reached; NaN if the
        member is refused), status (0 complete; see its flag_meanings), error_estimate (m, see `simulate`),
        time_reached (s), steps, reason (empty where complete), and end_effector_position over "member" and
        "time" if samples were requested. A failing member does not affect the others. A `SimulationWarning`
        counts complete members that are not shown to be within the tolerance.

    Raises:
        QuantityError: an unknown name, arrays of different length, or see `simulate`.
    """
    tolerance = checked_tolerance(model, tolerance)
    duration = optional_si(duration, "s", "duration")
    sample_rate = optional_si(sample_rate, "Hz", "sample_rate")
    varied = checked_columns(model, waveform, parameters)
    refuse_no_waveform(waveform)
    count = next(iter(varied.values())).size
    wanted = np.zeros(0)
    if times is not None or sample_rate is not None:
        rate = 1e3 if sample_rate is None else sample_rate
        wanted = sample_times(waveform, duration, rate, times, numbers=max(count, 10))
        duration = float(wanted[-1])
    end = run_time(waveform, duration)
    task = _EnsembleTask(
        model,
        waveform,
        None if own_tables(model, waveform, varied) else tables(model, waveform, end, periodic=False),
        load,
        None if duration is None else end,
        tolerance,
        max_steps,
        wanted,
        _gpu(model, wanted) if engine == "cuda" else None,
    )
    contact_load(load, end)  # raises QuantityError for an invalid load, before any member is simulated
    demand = labelled_demand(model, waveform, varied, stack, count)
    size = block_size(model, waveform, varied, end, GPU_BLOCK if task.gpu else BLOCK)
    found = Block(
        np.zeros(count, np.int8),
        np.zeros(count),
        np.zeros(count, np.int64),
        np.zeros(count),
        np.full(count, np.nan),
        np.full((count, wanted.size), np.nan),
        [],
    )
    for start, block in in_blocks(
        lambda part: _block(task, part), varied, size, task.gpu.AT_ONCE if task.gpu else threads
    ):
        part = slice(start, start + block.status.size)
        for all_of_them, some in zip(found[:-1], block[:-1], strict=True):
            all_of_them[part] = some
        found.reasons.extend(block.reasons)
        progress("simulating", part.stop / count)
    off = int(np.sum((found.status == DONE) & ~(found.error <= tolerance)))
    if off:
        warnings.warn(
            f"{off} of {count} members are not shown to be within the tolerance: see error_estimate",
            SimulationWarning,
            stacklevel=2,
        )
    return labelled_for(model, _dataset(model, waveform, varied, found, wanted).assign(demand))


class _EnsembleTask(NamedTuple):
    """Arguments of `simulate_ensemble`, with units converted, for the work on each block.

    `tables` is a function from the tolerance [m] to the drive table that all members share; None if members
    have different drives. `end` [s] is the common end of the runs; None: each ends with its own waveform.
    `times` [s] of the samples is empty if only summaries are kept.
    """

    model: Actuator
    waveform: Waveform
    tables: Callable[[float], Drive] | None
    load: Waveform | float
    end: float | None
    tolerance: float
    max_steps: int
    times: NDArray[np.float64]
    gpu: Any  # module `engine.cuda`; None to run on the processors


def _gpu(model: Actuator, times: NDArray[np.float64]) -> Any:
    """Return the module `engine.cuda` if the ensemble can run on a GPU; otherwise issue a `SimulationWarning`
    with the reason, and return None. `times` are the sample times: a GPU cannot keep samples."""
    if times.size:
        why = "the GPU keeps summaries only, and trajectories are asked for"
    else:
        from ..engine import cuda  # imported only here, because most ensembles use no GPU

        why = cuda.missing() or cuda.refused(law_of(element(model.friction, 0)))
        if not why:
            return cuda
    warnings.warn(f"the processors do it instead: {why}", SimulationWarning, stacklevel=3)
    return None


def _block(task: _EnsembleTask, columns: Mapping[str, NDArray[np.float64]]) -> Block:
    found, reasons = _refined(task, columns)
    status, net = found.outcomes.astype(np.int8), found.net
    net[status == REFUSED] = np.nan
    for m in np.flatnonzero((status != DONE) & (status != REFUSED)).tolist():
        reasons[m] = f"{OUTCOMES[int(status[m])].replace('_', ' ')} at t = {found.reached[m]:.6g} s"
    return Block(status, found.reached, found.steps, net, found.error, found.positions, reasons)


class _Runs(NamedTuple):
    """Results of one run of many members as arrays [members].

    Fields: `outcomes`, codes (keys of `OUTCOMES`); `reached`, times reached [s]; `steps` tried; `net`
    displacements [m]; `positions` [members, times] in m; `error` [m], NaN until two runs are compared.
    """

    outcomes: Any
    reached: Any
    steps: Any
    net: Any
    positions: Any
    error: Any


def _run(
    task: _EnsembleTask, of: Members, rows: NDArray[np.int64], outcomes: Any, tolerance: float, careful: bool
) -> _Runs:
    """Simulate some members of a block once; return their results, without an error estimate.

    Args:
        task: settings of the ensemble.
        of: the block of members.
        rows: indices, in the block, of the members to simulate.
        outcomes: outcome code of each of these members, in place; only members with DONE are simulated.
        tolerance: tolerance of the engine, m, to which local errors are in proportion.
        careful: True if small vibrations of sticking contacts must be resolved.
    """
    q, values, which, column = of.states[rows], of.values[rows], of.which[rows], of.of.slider
    spans = np.column_stack([np.zeros(rows.size), of.ends[rows]])
    how = tolerance, careful, task.max_steps
    if task.gpu:
        drives = of.drives, which, of.load
        reached, steps = np.zeros(rows.size), np.zeros(rows.size, np.int64)
        positions = np.zeros((rows.size, 0))
        task.gpu.integrate_members(of.of.plant, drives, values, q, spans, *how, (outcomes, reached, steps))
    else:
        plants = ComposedMembers(of.of.plant, values)
        drives = MemberDrives(of.drives, which), DriveTable(of.load)
        reached, steps, positions = integrate_members(
            plants, *drives, outcomes, q, spans, *how, task.times, column
        )
    net = q[:, column] - of.states[rows, column]
    return _Runs(outcomes, reached, steps, net, positions, np.full(rows.size, np.nan))


def _refined(task: _EnsembleTask, columns: Columns) -> tuple[_Runs, list[str]]:
    """Simulate each member of a block, given by its columns, until its estimated error is within the
    tolerance, or a limit of `refinement` is reached.

    Each repetition, for the members that need one, has smaller steps and finer drive tables (compare
    `refinement.refined`). Return the results, and the reason why each member was refused ("" if valid).
    """
    level = LOOSE * task.tolerance

    def members() -> Members:
        rows = task.model, task.waveform, task.tables, task.load, columns
        return prepared(*rows, task.end, level)

    of = members()
    outcomes = np.where(of.fine, np.int64(DONE), np.int64(REFUSED))
    made = _run(task, of, np.arange(outcomes.size), outcomes, level, False)
    todo = np.flatnonzero(made.outcomes == DONE)
    # On a GPU, neighbouring threads wait for each other: sort the members by their number of steps.
    if task.gpu:
        todo = todo[np.argsort(made.steps[todo], kind="stable")]
    coarse = _Runs(*(column[todo] for column in made))
    for _ in range(ROUNDS if todo.size else 0):
        level *= FINER
        if tabulated(task.model.piezo):
            of = members()
        fine = _run(task, of, todo, np.full(todo.size, DONE, np.int64), level, True)
        apart = PER_NUMBER * np.abs(coarse.net - fine.net)
        if task.times.size:
            apart = PER_DIFFERENCE * np.max(np.abs(coarse.positions - fine.positions), axis=1)
        apart[fine.outcomes != DONE] = np.nan
        for whole, part in zip(made, coarse._replace(error=apart), strict=True):
            whole[todo] = part
        on = (apart > task.tolerance) & (fine.steps <= MOST_STEPS)
        if not np.any(on):
            break
        todo, coarse = todo[on], _Runs(*(column[on] for column in fine))
    return made, of.reasons


def _dataset(
    model: Actuator,
    waveform: Waveform,
    columns: Mapping[str, NDArray[np.float64]],
    found: Block,
    times: NDArray[np.float64],
) -> xr.Dataset:
    import xarray as xr

    data = labelled(model, waveform, columns)
    data["net_displacement"] = (
        "member",
        found.net,
        {"units": "m", "long_name": "displacement of the end-effector up to the time reached"},
    )
    flags = {"flag_values": list(OUTCOMES), "flag_meanings": " ".join(OUTCOMES.values())}
    data["error_estimate"] = (
        "member",
        found.error,
        {"units": "m", "long_name": "how far the position may be off, by a run with smaller steps"},
    )
    data["status"] = ("member", found.status, flags)
    data["time_reached"] = ("member", found.reached, {"units": "s", "long_name": "time reached"})
    data["steps"] = ("member", found.steps, {"units": "", "long_name": "steps tried"})
    data["reason"] = ("member", np.array(found.reasons, dtype=str))
    if times.size:
        data["end_effector_position"] = (
            ("member", "time"),
            found.positions,
            {"units": "m", "long_name": "end-effector position"},
        )
    made = xr.Dataset(data, coords={"time": ("time", times, {"units": "s"})} if times.size else {})
    return made.assign_attrs(title=f"ensemble of {model.name or type(model).__name__}")
