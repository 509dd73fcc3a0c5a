"""Steady stepping of many members (variants of one model and drive) at once."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.members import MemberDrives
from ..engine.orbits import Orbits
from ..engine.outcome import DONE, NOT_FOUND
from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage
from ..physics.electronics.stack import Stack
from ..quantities.progress import Progress, unheard
from ..quantities.records import of_kind
from ..quantities.units import labelled_for, unit_for
from ..waveform.drive import Drive
from ..waveform.signal import Waveform
from .demand import labelled_demand
from .drives import endless, tables
from .errors import SimulationWarning
from .load import refuse_other_period
from .members import (
    Columns,
    Members,
    block_size,
    checked_columns,
    in_blocks,
    labelled,
    own_tables,
    prepared,
    waveform_columns,
)
from .models import contact_load, refuse_places
from .periodic import orbits_of
from .plant.at_piezo import tabulated
from .refinement import FINER
from .steady import NOT_FOLLOWED, not_found, period_of, stable, unstable
from .trajectory import checked_tolerance

if TYPE_CHECKING:
    import xarray as xr

CONVERGED, STOPPED, MISSED, UNSTABLE, REFUSED = range(5)
STATUS = ("converged", "not_followed", "not_found", "unstable", "refused")
BLOCK = 64  # largest number of members that one thread computes as a block


# Type of a function that computes further results of a block. Its arguments are the members, their varied
# values by name, their orbits, and their status codes; it returns arrays by name. It is called in the thread
# that found the orbits.
Beside = Callable[[Members, Columns, Orbits, NDArray[np.int8]], dict[str, NDArray[np.float64]]]


class _SteadyTask(NamedTuple):
    """Arguments of `orbit_blocks` for the work on each block.

    `tables` is a function from the tolerance [m] to the drive table that all members share; None if members
    have different drives. `beside` computes further results of a block; None: no further results.
    """

    model: Actuator
    waveform: Waveform
    tables: Callable[[float], Drive] | None
    load: Waveform | float
    tolerance: float
    beside: Beside | None
    output: OutputStage | None


class OrbitBlock(NamedTuple):
    """Orbits of a block of members.

    Fields: `found`, the orbits; `status`, a code for each member (index in `STATUS`); `reasons`, why each
    orbit failed ("" if converged); `beside`, further results, arrays by name (see `Beside`).
    """

    found: Orbits
    status: NDArray[np.int8]
    reasons: list[str]
    beside: dict[str, NDArray[np.float64]]


def steady_steps(
    model: Actuator,
    waveform: Waveform,
    *,
    parameters: Mapping[str, ArrayLike],
    tolerance: float | str = 1e-10,
    load: Waveform | float = 1.0,
    output: OutputStage | None = None,
    stack: Stack | None = None,
    threads: int | None = None,
    progress: Progress = unheard,
) -> xr.Dataset:
    """Return the `steady_step` of many members of a model and its drive signal, computed on all processors.

    Args:
        model: the actuator that the members vary.
        waveform: periodic (one with a `period`), V.
        parameters: one array per name, all [members], as for `simulate_ensemble`.
        tolerance: tolerance of the net step, m, or rad for a rotary actuator.
        load: normal force relative to its reference, for all members: a number, or a waveform as for
            `steady_orbit`; members with a period that the waveform does not fit are refused.
        output: converter and amplifier that each drive passes (`OutputStage.behind`); by default, the drive
            reaches the piezo unchanged.
        stack: piezo stack that each drive charges; adds peak_current and rms_current (A),
            energy_per_step (J, per period), heat (W) and temperature_rise (K), see `demand`.
        threads: number of threads; by default one per processor.
        progress: function that is called after each block with the activity and the finished fraction.

    Returns:
        Dataset over "member" with the parameters, net_step (m per period) and its error_estimate (m), NaN
        unless converged, largest_multiplier (growth factor of a small disturbance per period), periods
        (number integrated), status (0 converged; see its flag_meanings) and reason (empty where converged).

    Raises:
        QuantityError: an unknown name, arrays of different length, or see `steady_orbit`.

    Warns:
        SimulationWarning: the error of a converged member exceeds the tolerance, or is not known.
    """
    tolerance = checked_tolerance(model, tolerance)
    columns = checked_columns(model, waveform, parameters)
    count, blocks = next(iter(columns.values())).size, []
    demand = labelled_demand(model, waveform, columns, stack, count, output)
    for start, block in orbit_blocks(model, waveform, columns, tolerance, load, threads, output=output):
        blocks.append(block)
        progress("solving for periodic motion", (start + block.status.size) / count)
    made = labelled_for(model, _dataset(model, waveform, columns, blocks).assign(demand))
    off = int(np.sum((made["status"] == CONVERGED) & ~(made["error_estimate"] <= tolerance)))
    if off:
        warnings.warn(
            f"{off} of {count} members are not shown to be within the tolerance: see error_estimate",
            SimulationWarning,
            stacklevel=2,
        )
    return made


def orbit_blocks(
    model: Actuator,
    waveform: Waveform,
    columns: Mapping[str, NDArray[np.float64]],
    tolerance: float,
    load: Waveform | float = 1.0,
    threads: int | None = None,
    beside: Beside | None = None,
    output: OutputStage | None = None,
) -> Iterator[tuple[int, OrbitBlock]]:
    """Yield pairs: the index of the first member of each block, and the orbits of the block.

    Args:
        columns: result of `members.checked_columns`; the other arguments as for `steady_steps`.
        beside: function for further results of each block (see `Beside`). The states of the members that it
            gets are those on the orbits, at the start of a period.
        output: converter and amplifier that each drive passes; by default none.

    Raises:
        QuantityError: see `steady_orbit`.
    """
    period, waveform = period_of(waveform), endless(waveform)
    # If no field of the waveform varies, all members share one drive, which passes the output stage only
    # once.
    if output is not None and not waveform_columns(waveform, columns):
        waveform, output = of_kind(output, OutputStage, "output").behind(waveform), None
        period = period_of(waveform)
    tolerance = checked_tolerance(model, tolerance)
    contact_load(load, period)  # raises QuantityError for an invalid load, before any member is computed
    refuse_other_period(load, _common_period(period, columns))
    refuse_places(model)
    own = output is not None or own_tables(model, waveform, columns)
    by_tolerance = None if own else tables(model, waveform, period, periodic=True)
    task = _SteadyTask(model, waveform, by_tolerance, load, tolerance, beside, output)
    size = block_size(model, waveform, columns, period, BLOCK, output)
    return in_blocks(lambda part: _block(task, part), columns, size, threads)


def _common_period(period: float, columns: Mapping[str, NDArray[np.float64]]) -> float | None:
    """Return the period that all members share, s; None if periods differ, or the first is not positive.

    Args:
        period: period of the unvaried waveform, s.
        columns: varied values by name, [members].
    """
    if not any(name.startswith(("frequency", "period")) for name in columns):
        return period
    own = columns.get("frequency", columns.get("period", np.zeros(1)))
    if not (own[0] > 0.0 and np.all(own == own[0])):
        return None
    return float(1.0 / own[0] if "frequency" in columns else own[0])


def _block(task: _SteadyTask, columns: Mapping[str, NDArray[np.float64]]) -> OrbitBlock:
    of, found = _orbits(task, columns, task.tolerance)
    if tabulated(task.model.piezo):
        of, again = _orbits(task, columns, FINER * task.tolerance, of.states)
        again.errors[:] += np.abs(again.steps - found.steps)
        again.periods[:] += found.periods
        found = again
    status, reasons = np.zeros(len(of.reasons), np.int8), of.reasons
    for m in np.flatnonzero((found.outcomes != DONE) | ~stable(found.radius)).tolist():
        if reasons[m]:
            status[m] = REFUSED
        elif found.outcomes[m] == DONE:
            status[m], reasons[m] = UNSTABLE, unstable(found.radius[m])
        elif found.outcomes[m] == NOT_FOUND:
            status[m] = MISSED
            numbers = int(found.periods[m]), float(found.residuals[m]), found.radius[m]
            reasons[m] = not_found(*numbers, unit_for(task.model, "m"))
        else:
            status[m], reasons[m] = STOPPED, NOT_FOLLOWED
    made = task.beside(of, columns, found, status) if task.beside else {}
    return OrbitBlock(found, status, reasons, made)


def _orbits(
    task: _SteadyTask, columns: Columns, tolerance: float, states: NDArray[np.float64] | None = None
) -> tuple[Members, Orbits]:
    """Return a block of members and their orbits.

    Args:
        task: settings of the search.
        columns: varied values of the block by name, [members].
        tolerance: tolerance of the position, m, for the precision of the drive tables.
        states: initial guesses of the states on the orbits [members, states]; None: rest.
    """
    rows = task.model, task.waveform, task.tables, task.load, columns
    of = prepared(*rows, None, tolerance, periodic=True, output=task.output)
    if states is not None:
        of.states[:] = states
    outcomes, drives = np.where(of.fine, DONE, REFUSED), MemberDrives(of.drives, of.which)
    given = of.of.plant, of.values, drives, of.load, outcomes, of.states, of.ends
    return of, orbits_of(*given, task.tolerance, of.of.slider)


def _dataset(
    model: Actuator, waveform: Waveform, columns: Mapping[str, NDArray[np.float64]], blocks: list[OrbitBlock]
) -> xr.Dataset:
    import xarray as xr

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(block.found, name) for block in blocks])

    status = np.concatenate([block.status for block in blocks])
    there = status == CONVERGED
    data = labelled(model, waveform, columns)
    data["net_step"] = (
        "member",
        np.where(there, joined("steps"), np.nan),
        {"units": "m", "long_name": "net displacement of the end-effector per period"},
    )
    data["error_estimate"] = (
        "member",
        np.where(there, joined("errors"), np.nan),
        {"units": "m", "long_name": "how far the net step may be off, by a coarser integration"},
    )
    about = {"units": "", "long_name": "largest multiplier of a disturbance per period"}
    data["largest_multiplier"] = ("member", joined("radius"), about)
    data["periods"] = ("member", joined("periods"), {"units": "", "long_name": "periods integrated"})
    flags = {"flag_values": list(range(len(STATUS))), "flag_meanings": " ".join(STATUS)}
    data["status"] = ("member", status, flags)
    data["reason"] = ("member", np.array([r for block in blocks for r in block.reasons], dtype=str))
    return xr.Dataset(data).assign_attrs(title=f"steady steps of {model.name or type(model).__name__}")
