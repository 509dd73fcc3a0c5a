"""Many members of one model at once: parameter sets, drive amplitudes, loads."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..actuator import Actuator
from ..plant.generated import with_values as plant_with
from ..plant.system import Plant, state_size, values_of
from ..records import did_you_mean, quantities
from ..solve.outcome import DONE, STEP_TOO_SMALL, TOO_MANY_STEPS
from ..solve.periods import integrate_members
from ..units import QuantityError, to_si
from ..waveform.drive import Drive
from ..waveform.signal import Waveform
from .errors import SimulationWarning
from .models import Contact, checked_drive, contact_load
from .refinement import FINER, LOOSE, MOST_STEPS, PER_DIFFERENCE, PER_NUMBER, ROUNDS
from .trajectory import sample_times
from .varied import changed_fields, free_names, with_values

REFUSED = 4
OUTCOMES = {
    DONE: "complete",
    STEP_TOO_SMALL: "step_too_small",
    TOO_MANY_STEPS: "too_many_steps",
    REFUSED: "refused",
}
# Of the drive and of the contact: they multiply the waveform, and the normal force.
SCALES = ("drive_scale", "load")
BLOCK = 256
# A GPU wants many threads at once.
GPU_BLOCK = 1 << 17


class Block(NamedTuple):
    """What became of some members; see `simulate_ensemble`."""

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
    sample_rate: float | None = None,
    times: ArrayLike | None = None,
    tolerance: float | str = 1e-9,
    load: Waveform | float = 1.0,
    max_steps: int = 2_000_000,
    threads: int | None = None,
    engine: Literal["cpu", "cuda"] = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Simulate many members of a model under one drive signal, from rest, on all processors.

    Args:
        model: the actuator that the members vary.
        waveform: the drive, V.
        duration: s; left out, that of the waveform, if it ends.
        parameters: one array per name, all [members], SI. Names are the fields of the law and of the
            actuator, "stiction_ratio", "breakaway_share" (see `identify_friction`), "drive_scale" (a factor
            on the waveform), and "load" (the normal force over its reference). Stiction and breakaway
            deflection that are not among them keep their ratio to Coulomb friction.
        sample_rate, times: of the trajectories, as for `simulate`; left out, only summaries are kept, and
            memory beyond them does not grow with the number of members.
        tolerance: m, as for `simulate`.
        load: normal force over its reference, for all members.
        max_steps: of each member.
        threads: how many; all processors if left out.
        engine: "cuda" runs the same steps on a GPU, a thread for each member (extra ``stickslip[cuda]``);
            where it cannot (no GPU, trajectories wanted, a law with other than one internal state), the
            processors do it, with a `SimulationWarning` that says why.
        progress: called with the members done and all members, after each block.

    Returns:
        Dataset over "member" with the parameters, net_displacement (m, up to the time reached), status
        (0 complete; see its flag_meanings), error_estimate (m, see `simulate`), time_reached (s), steps,
        reason (empty where complete), and end_effector_position over "member" and "time" where samples were
        asked for. A member that fails leaves the others as they are.

    Raises:
        QuantityError: an unknown name, arrays of different length, or see `simulate`.
    """
    varied = _columns(model, parameters)
    count = next(iter(varied.values())).size
    wanted = np.zeros(0)
    if times is not None or sample_rate is not None:
        wanted = sample_times(waveform, duration, sample_rate or 1e3, times)
        duration = float(wanted[-1])
    tolerance = to_si(tolerance, "m", "tolerance")
    end = waveform.duration if duration is None else to_si(duration, "s", "duration")
    if not (math.isfinite(end) and end > 0.0):
        raise QuantityError(f"duration = {end} s must be finite and > 0 s")
    if not tolerance > 0.0:
        raise QuantityError(f"tolerance = {tolerance} m must be > 0 m")
    drive = checked_drive(model, waveform, end, periodic=False)
    task = _Task(model, drive, contact_load(load, end), end, tolerance, max_steps, wanted, None)
    if engine == "cuda":
        task = task._replace(gpu=_gpu(model, wanted))
    found = Block(
        np.zeros(count, np.int8),
        np.zeros(count),
        np.zeros(count, np.int64),
        np.zeros(count),
        np.full(count, np.nan),
        np.full((count, wanted.size), np.nan),
        [],
    )
    for start, block in _blocks(task, varied, count, threads or os.cpu_count() or 1):
        part = slice(start, start + block.status.size)
        for all_of_them, some in zip(found[:-1], block[:-1], strict=True):
            all_of_them[part] = some
        found.reasons.extend(block.reasons)
        if progress is not None:
            progress(part.stop, count)
    off = int(np.sum((found.status == DONE) & ~(found.error <= tolerance)))
    if off:
        warnings.warn(
            f"{off} of {count} members are not shown to be within the tolerance: see error_estimate",
            SimulationWarning,
            stacklevel=2,
        )
    return _dataset(model, varied, found, wanted)


class _Task(NamedTuple):
    model: Actuator
    drive: Drive
    contact: Contact
    end: float
    tolerance: float
    max_steps: int
    times: NDArray[np.float64]
    gpu: Any  # the module `solve.cuda`, or None


def _gpu(model: Actuator, times: NDArray[np.float64]) -> Any:
    """The GPU's engine, or None with a warning that says why not."""
    why = ""
    if times.size:
        why = "the GPU keeps summaries only, and trajectories are asked for"
    else:
        from ..solve import cuda  # only here: it takes a second, and a driver

        if cuda.available():
            return cuda
        why = "there is no GPU that Numba can use (extra stickslip[cuda], and NVIDIA's driver)"
    warnings.warn(f"the processors do it instead: {why}", SimulationWarning, stacklevel=3)
    return None


def _columns(model: Actuator, parameters: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
    known = [*free_names(model), *SCALES]
    columns = {}
    for name, values in parameters.items():
        if name not in known:
            raise QuantityError(
                f"{name!r} cannot vary{did_you_mean(name, known)}: there are {', '.join(known)}"
            )
        columns[name] = np.atleast_1d(np.asarray(values, dtype=float))
        if columns[name].ndim != 1 or columns[name].size == 0:
            raise QuantityError(f"{name} must be a list of values, one per member")
    sizes = {name: column.size for name, column in columns.items()}
    if len(set(sizes.values())) != 1:
        raise QuantityError(f"parameters must be arrays of one length; there are {sizes or 'none'}")
    return columns


def _blocks(
    task: _Task, columns: Mapping[str, NDArray[np.float64]], count: int, threads: int
) -> Iterator[tuple[int, Block]]:
    """Blocks in order, a bounded number of them at work."""
    # Of few members, each thread gets some.
    size, threads = (GPU_BLOCK, 1) if task.gpu else (max(1, min(BLOCK, -(-count // threads))), threads)
    starts = range(0, count, size)
    cut = ({name: c[s : s + size] for name, c in columns.items()} for s in starts)
    with ThreadPoolExecutor(threads) as pool:
        waiting: list[Any] = []
        for start, part in zip(starts, cut, strict=True):
            waiting.append((start, pool.submit(_block, task, part)))
            if len(waiting) > 2 * threads:
                first, future = waiting.pop(0)
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()


def _block(task: _Task, columns: Mapping[str, NDArray[np.float64]]) -> Block:
    values = {name: c for name, c in columns.items() if name not in SCALES}
    count = next(iter(columns.values())).size
    status, reasons = _refused(task.model, columns, values, count)
    fields, own = changed_fields(task.model, values)
    # Unchecked: the members that are wrong are known by now, and are left out.
    law = tuple.__new__(type(task.model.friction), fields.values())
    members = tuple.__new__(Actuator, (task.model._asdict() | own | {"friction": law}).values())
    own_load = task.contact._replace(normal=task.contact.normal * columns.get("load", 1.0))
    of = task.contact.system(task.model)
    table = _values(own_load.system(members), columns, count)
    states = np.zeros((count, state_size(of.plant)))
    if task.drive.before != 0.0 or np.any(members.axial_force):
        for m in np.flatnonzero(status == DONE).tolist():
            one = of._replace(plant=plant_with(of.plant, table[m]))
            states[m] = task.contact.rest(one, task.drive.before)
    found = _refined(task, of, table, states, status.astype(np.int64))
    status[:], net = found.outcomes, found.net
    net[status == REFUSED] = np.nan
    for m in np.flatnonzero((status != DONE) & (status != REFUSED)).tolist():
        reasons[m] = f"{OUTCOMES[int(status[m])].replace('_', ' ')} at t = {found.reached[m]:.6g} s"
    return Block(status, found.reached, found.steps, net, found.error, found.positions, reasons)


class _Runs(NamedTuple):
    """Arrays of members: outcomes, times reached [s], steps tried, net displacements, sampled positions and
    errors [m]."""

    outcomes: Any
    reached: Any
    steps: Any
    net: Any
    positions: Any
    error: Any


def _run(
    task: _Task, of: Any, table: Any, states: Any, outcomes: NDArray[np.int64], tolerance: float
) -> _Runs:
    """Each member once, with steps whose local errors are in proportion to the tolerance."""
    count, q, outcomes = len(table), states.copy(), outcomes.copy()
    reached, steps = np.zeros(count), np.zeros(count, np.int64)
    positions = np.full((count, task.times.size), np.nan)
    common = (of.plant, task.drive, task.contact.drive, table, q, np.array([0.0, task.end]), tolerance)
    if task.gpu:
        task.gpu.integrate_members(*common, task.max_steps, (outcomes, reached, steps))
    else:
        found = outcomes, reached, steps, positions
        integrate_members(*common, task.max_steps, task.times, of.slider, found)
    net = q[:, of.slider] - states[:, of.slider]
    return _Runs(outcomes, reached, steps, net, positions, np.full(count, np.nan))


def _refined(task: _Task, of: Any, table: Any, states: Any, outcomes: NDArray[np.int64]) -> _Runs:
    """Each member until smaller steps change it by no more than the tolerance: as `refinement.refined`."""
    level = LOOSE * task.tolerance
    made = _run(task, of, table, states, outcomes, level)
    todo = np.flatnonzero(made.outcomes == DONE)
    coarse = _Runs(*(column[todo] for column in made))
    for _ in range(ROUNDS if todo.size else 0):
        level *= FINER
        fine = _run(task, of, table[todo], states[todo], np.full(todo.size, DONE), level)
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
    return made


def _values(of: Any, columns: Mapping[str, NDArray[np.float64]], count: int) -> NDArray[np.float64]:
    """The numbers of each member's plant, [members, numbers], the drive scaled."""
    scale, plant = columns.get("drive_scale", 1.0), of.plant
    modes = tuple(mode._replace(drive=mode.drive * scale) for mode in plant.modes)
    contacts = tuple(
        c if c.drive_rate is None else c._replace(drive_rate=c.drive_rate * scale) for c in plant.elements
    )
    return values_of(Plant(modes, contacts, plant.rate), count)


def _rows(fields: Mapping[str, Any], count: int) -> list[tuple[Any, ...]]:
    """The fields of each member; a field that is a tuple (of elements) stays one."""

    def column(value: Any) -> list[Any]:
        if isinstance(value, tuple):
            return list(zip(*map(column, value), strict=True))
        return np.broadcast_to(np.asarray(value, dtype=float), count).tolist()

    return list(zip(*map(column, fields.values()), strict=True))


def _refused(
    model: Actuator,
    columns: Mapping[str, NDArray[np.float64]],
    values: Mapping[str, NDArray[np.float64]],
    count: int,
) -> tuple[NDArray[np.int8], list[str]]:
    """Which members a record would refuse, and why; those in doubt are built to hear it from the record."""
    fine = np.ones(count, dtype=bool)
    known = quantities(type(model)) | quantities(type(model.friction))
    for name, column in columns.items():
        fine &= known[name].allows(column) if name in known else np.isfinite(column) & (column >= 0.0)
    law_type, names = type(model.friction), {*columns} - {*quantities(type(model))}
    if hasattr(law_type, "_check") and names:  # one field of the law against another
        for m, row in enumerate(_rows(changed_fields(model, values)[0], count)):
            try:
                tuple.__new__(law_type, row)._check()
            except QuantityError:
                fine[m] = False
    status, reasons = np.where(fine, DONE, REFUSED).astype(np.int8), [""] * count
    for m in np.flatnonzero(~fine).tolist():
        try:
            for name in SCALES:
                if name in columns and not (np.isfinite(columns[name][m]) and columns[name][m] >= 0.0):
                    raise QuantityError(f"{name} = {columns[name][m]:g} must be finite and >= 0")
            with_values(model, {name: float(c[m]) for name, c in values.items()})
            status[m] = DONE
        except QuantityError as error:
            reasons[m] = str(error)
    return status, reasons


def _dataset(
    model: Actuator, columns: Mapping[str, NDArray[np.float64]], found: Block, times: NDArray[np.float64]
) -> xr.Dataset:
    known = quantities(type(model)) | quantities(type(model.friction))
    data: dict[str, Any] = {
        name: (
            "member",
            c,
            {"units": known[name].unit, "long_name": known[name].meaning} if name in known else {},
        )
        for name, c in columns.items()
    }
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
