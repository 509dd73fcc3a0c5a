"""Derivatives of a trajectory, and of the steady step, by the parameters and the initial state."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.binding import ComposedPlant, DriveTable
from ..engine.members import ComposedMembers, MemberDrives
from ..engine.near import Neighbours, integrate_near
from ..engine.outcome import DONE
from ..friction import element as part_of
from ..friction import elements
from ..friction.law import has_jumps, project
from ..physics.actuator import Actuator
from ..quantities.records import did_you_mean
from ..quantities.units import ANGLE, QuantityError, labelled_for, optional_si, to_si, unit_for
from ..waveform.drive import Drive, constant
from ..waveform.members import Drives, stacked
from ..waveform.pieces import with_breaks
from ..waveform.signal import Waveform
from .drives import Driven, checked_drive, table_precision
from .errors import SimulationError, SimulationWarning
from .models import RelativeLoad, System, contact_load
from .neighbour_drives import DIFFERENCE, beside, breaks_apart, longer
from .plant.system import values_of
from .state import row_of
from .trajectory import checked_tolerance, sample_times
from .varied import (
    changed_fields,
    drive_names,
    model_names,
    quantity_of,
    record_names,
    value_of,
    with_normal_force,
)

if TYPE_CHECKING:
    import xarray as xr

REFERENCE = RelativeLoad()  # constant normal force at which the friction parameters are valid
INITIAL = {  # parameter names of the initial state, with units for a linear actuator
    "initial_stage_position": "m",
    "initial_stage_velocity": "m/s",
    "initial_end_effector_position": "m",
    "initial_end_effector_velocity": "m/s",
    "initial_bristle_deflection": "m",
}
BY_ROW = "initial row "  # prefix of an internal name: "initial row 3" means the initial value of state 3
# A derivative is accepted if, with a tolerance ten times smaller, it changes by at most SETTLED times its
# largest value over time. REFINED: largest number of times that the tolerance is divided by ten.
SETTLED, REFINED = 0.01, 4
# A damping below this fraction of mass times natural frequency (even 0) is changed as if it had that value.
LEAST_DAMPING = 1e-3
DAMPING = ("N s/m", ANGLE.unit("N s/m"))  # unit of a damping, for a linear and for a rotary actuator


class NeighbouringModels(NamedTuple):
    """A model and its neighbours, each with one slightly changed parameter or initial value.

    Attributes:
        model, of: the unchanged model, and its plant.
        values, states: numbers of the plant (see `values_of`) and initial state, a row per neighbour.
        steps: change of the parameter of each neighbour, signed, in the parameter's SI unit.
        drives, periods: drive and period [s] (0: none) of each neighbour; None if all have the same drive.
        breaks: times [s] at which only the normal force has a new segment; all drives get one there.
        itself: drive table of the unchanged model, if neighbours have their own drives.
    """

    model: Actuator
    of: System
    values: NDArray[np.float64]
    states: NDArray[np.float64]
    steps: NDArray[np.float64]
    drives: Drives | None = None
    periods: NDArray[np.float64] | None = None
    breaks: NDArray[np.float64] = np.zeros(0)
    itself: Drive | None = None


def initial_row(of: System, name: str) -> int | None:
    """Return the index of the state whose initial value a name (`INITIAL`, `BY_ROW`) means, or None."""
    if name.startswith(BY_ROW):
        return int(name.removeprefix(BY_ROW))
    return row_of(of, name.removeprefix("initial_")) if name in INITIAL else None


def _small(of: System, row: int) -> float:
    """Return the change of the initial value of state `row` for a difference quotient, m or m/s."""
    if row >= of.bodies:
        return 1e-13 if row < of.inner else 1e-10
    return 1e-9 if row % 2 else 1e-12


def refuse_law(model: Actuator) -> None:
    """Raise QuantityError for a law without internal states, or one whose force jumps: no derivatives."""
    if model.clamped:
        return
    if elements(model.friction) == 0:
        raise QuantityError(
            f"derivatives are for a law with internal states; {type(model.friction).__name__} has none, "
            "and its motion is no smooth function of its parameters: difference `simulate` instead"
        )
    if has_jumps(model.friction):
        raise QuantityError(
            "derivatives need a law whose force does not jump at the start of sliding; that of this "
            f"{type(model.friction).__name__} jumps (stiction_ratio above 1, or a reset): difference "
            "`simulate` instead"
        )


def moved(
    model: Actuator,
    names: Sequence[str],
    state: NDArray[np.float64],
    before: float | None,
    contact: RelativeLoad = REFERENCE,
    waveform: Waveform | None = None,
    end: float = 0.0,
    slipping: Collection[int] = (),
    settled: bool = False,
    tolerance: float = 1e-9,
) -> NeighbouringModels:
    """Return the neighbours of a model at a given initial state, one for each parameter name.

    With `before` [V], each starts at rest under this voltage, and not in `state`. With a `waveform`,
    simulated up to `end` [s], names may be its fields; if `settled`, drives are one period in the steady
    state. `contact` is the normal force. Drive tables are accurate to the position `tolerance` [m]. The
    states with indices `slipping` are put on the bound of each neighbour's law.

    Raises:
        QuantityError: a name that is not known, a static law, or one whose force jumps.
    """
    model = with_normal_force(model, names)
    of = contact.system(model)
    refuse_law(model)
    known = [*model_names(model), *(name for name in INITIAL if initial_row(of, name) is not None)]
    known += [name for name in names if name.startswith(BY_ROW)]
    of_waveform = record_names(waveform) if waveform is not None else []
    of_drive = {*drive_names(model)} | ({*of_waveform} - {*known})
    as_it_is = Driven(model.piezo, waveform, table_precision(model, tolerance))
    itself = longer(as_it_is, end, settled) if {*names} & of_drive else None
    values, states, steps, tables, periods = [], [], [], list[Drive](), []
    for name in names:
        if name not in known and name not in of_waveform:
            hint = did_you_mean(name, [*known, *of_waveform])
            raise QuantityError(
                f"no derivative by {name!r}{hint}: there are {', '.join([*known, *of_waveform])}"
            )
        other, own, table, period = of, state.copy(), itself, as_it_is.period
        if itself is not None and name in of_drive:
            table, period, step = beside(model, name, as_it_is, itself, end, settled)
            if before is not None:
                own = contact.rest(of, table.before)
        elif (row := initial_row(of, name)) is not None:
            step = _small(of, row)
            if row >= of.bodies:  # change a deflection towards 0, because it may be at its bound
                step = -math.copysign(step, own[row])
            own[row] += step
        else:
            value = value_of(model, name)
            step = _step(model, name, value)
            # Unchecked, because it may exceed a bound of its field by a millionth.
            fields, changed = changed_fields(model, {name: value + step})
            law = tuple.__new__(type(model.friction), fields.values())
            if changed:
                changed = {**model._asdict(), **changed, "friction": law}
                other = contact.system(tuple.__new__(Actuator, changed.values()))
            elif not of.clamped:
                other = _with_law(of, law)
            if before is not None:
                own = contact.rest(other, before)
            for row, one in internal(other) if slipping else ():
                if row in slipping:
                    own[row] = project(one, 1e3 * own[row])
        values.append(values_of(other.plant)[0])
        states.append(own)
        steps.append(step)
        if table is not None:
            tables.append(table)
            periods.append(period)
    breaks = np.zeros(0) if itself is None else breaks_apart(contact.table, itself, end)
    n = len(names)  # if 0, the arrays below still have their number of columns
    return NeighbouringModels(
        model,
        of,
        np.array(values) if n else np.empty((0, values_of(of.plant).shape[1])),
        np.array(states).reshape(n, state.size),
        np.array(steps),
        None if itself is None else stacked([with_breaks(table, breaks) for table in tables]),
        None if itself is None else np.array(periods),
        breaks,
        itself,
    )


def _step(model: Actuator, name: str, value: float) -> float:
    """Return the change of a parameter for a difference quotient, in its SI unit (see `LEAST_DAMPING`)."""
    least = LEAST_DAMPING * model.end_effector_mass * model.natural_frequency
    if abs(value) < least < math.inf:
        quantity = quantity_of(model, None, name)
        if quantity is not None and quantity.unit in DAMPING:
            return DIFFERENCE * least
    return DIFFERENCE * (abs(value) or 1.0)


def _with_law(of: System, law: Any) -> System:
    """Return the system with another friction law of the same type in its contact."""
    contact, *others = of.plant.elements
    return of._replace(plant=of.plant._replace(elements=(contact._replace(law=law), *others)))


def follow_moved(
    of: NeighbouringModels,
    drive: Drive,
    state: NDArray[np.float64],
    times: NDArray[np.float64],
    tolerance: float,
    max_steps: int = 20_000_000,
    load: Drive | None = None,
    over_period: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Integrate a model with its neighbours; return samples (see `engine.binding.integrate`), and derivatives
    of the end-effector's position [times, names] and of the last state [states, names].

    `state` is replaced by the last state. With `over_period` each neighbour ends after its own period.

    Raises:
        SimulationError: the motion could not be simulated to the end.
    """
    plant, column = of.of.plant, of.of.slider
    samples = np.full((times.size, state.size + max(len(plant.elements), 1)), np.nan)
    ends = np.full(len(of.steps) + 1, times[-1])
    if over_period and of.periods is not None:
        ends[1:] = of.periods
    own = None if of.drives is None else MemberDrives(of.drives, np.arange(len(of.steps)))
    members = ComposedMembers(plant, of.values)
    near = Neighbours(members, of.states.copy(), column, own, float(ends[0]), ends[1:])
    if of.breaks.size:
        drive = with_breaks(drive, of.breaks)
    (outcome, reached, _, _), positions = integrate_near(
        ComposedPlant(plant),
        DriveTable(drive),
        DriveTable(load or constant(1.0)),
        state,
        (0.0, float(times[-1])),
        tolerance,
        max_steps,
        times,
        samples,
        near,
    )
    if outcome != DONE:
        raise SimulationError(f"the motion could not be followed beyond t = {reached:.6g} s")
    by = (positions - samples[:, column]).T / of.steps
    return samples, by, (near.states - state).T / of.steps


def sensitivities(
    model: Actuator,
    waveform: Waveform,
    duration: float | str | None = None,
    *,
    parameters: Sequence[str],
    sample_rate: float | str = 1e3,
    times: ArrayLike | None = None,
    tolerance: float | str = 1e-9,
    load: Waveform | float = 1.0,
) -> xr.Dataset:
    """Return the end-effector's position and its derivatives by parameters and initial state.

    Each derivative is a difference quotient with a neighbour that has the same integration steps as the
    trajectory (see `engine.near`), so it contains no noise of the error control. Derivatives are computed at
    the tolerance, then up to four times at a tenth of the last, until two agree within 1 % of the largest.

    Args:
        model: an actuator whose law has internal states, and no jumps of its force.
        parameters: names of fields of the law and of the actuator, "stiction_ratio", "breakaway_share";
            values of the piezo ("piezo_weight_2", "piezo_share_1", "piezo_capacitance"; numbered in lists);
            "initial_stage_position", "initial_stage_velocity", "initial_end_effector_position",
            "initial_end_effector_velocity", "initial_bristle_deflection"; and fields of the waveform
            ("amplitude", "frequency", "value_3").
        waveform, duration, sample_rate, times, tolerance, load: as for `simulate`. The load does not change
            when breaks of the drive move, except that a coincident break moves with them.

    Returns:
        Dataset over "parameter" and "time" (s) of derivative, in m per unit of the parameter, whose unit is
        the coordinate "unit"; end_effector_position (m); and derivative_error [parameter]: change of the
        derivative since ten times the tolerance. A `SimulationWarning` names parameters that do not agree.

    Raises:
        QuantityError: an unknown name, a static law, a waveform whose jumps move with the smallest change of
            a field, or see `simulate`.
        SimulationError: the motion could not be simulated to the end.
    """
    import xarray as xr

    tolerance = checked_tolerance(model, tolerance)
    sample_rate = to_si(sample_rate, "Hz", "sample_rate")
    duration = optional_si(duration, "s", "duration")
    parameters = checked_names(parameters)
    wanted = sample_times(waveform, duration, sample_rate, times)
    end = float(wanted[-1])
    drive = checked_drive(model, waveform, end, periodic=False, tolerance=tolerance)
    contact = contact_load(load, end)
    state = contact.rest(contact.system(model), drive.before)
    of = moved(model, parameters, state, drive.before, contact, waveform, end, tolerance=tolerance)
    if of.itself is not None:  # with creep, segments depend on the end of a table: use the neighbours' end
        drive = of.itself

    def derivatives(tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        samples, by, _ = follow_moved(of, drive, state.copy(), wanted, tolerance, load=contact.table)
        return samples, by

    samples, by, errors = until_settled(derivatives, tolerance)
    warn_unsettled(parameters, by, errors, 0.0)
    made = xr.Dataset(
        {
            "end_effector_position": (
                "time",
                samples[:, of.of.slider],
                {"units": "m", "long_name": "end-effector position"},
            ),
            "derivative": (
                ("parameter", "time"),
                by.T,
                {"units": "m per unit of the parameter", "long_name": "derivative of the position"},
            ),
            "derivative_error": (
                "parameter",
                errors,
                {"units": "m per unit of the parameter", "long_name": "largest error of the derivative"},
            ),
        },
        coords={
            "time": ("time", wanted, {"units": "s"}),
            "parameter": list(parameters),
            "unit": ("parameter", [_unit(model, waveform, name) for name in parameters]),
        },
    )
    return labelled_for(model, made)


def checked_names(parameters: Any) -> list[str]:
    """Return a collection of parameter names as a list; raise QuantityError for anything else."""
    given = parameters if isinstance(parameters, Collection) and not isinstance(parameters, str) else [None]
    if not all(isinstance(name, str) for name in given):
        raise QuantityError(f"parameters = {parameters!r} must be a list of names")
    return list(given)


def until_settled(
    derivatives: Callable[[float], tuple[NDArray[np.float64], NDArray[np.float64]]],
    tolerance: float,
    least: NDArray[np.float64] | float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the results of `derivatives`, a function of the tolerance [m], when they are accepted
    (`SETTLED`; errors up to `least` [names] always): samples, derivatives [times, names], and errors [names].
    An error is the largest change since the previous tolerance, which was ten times larger."""
    samples, by = derivatives(tolerance)
    errors = np.full(by.shape[1], math.inf)
    for _ in range(REFINED):
        before, tolerance = by, 0.1 * tolerance
        samples, by = derivatives(tolerance)
        errors = np.abs(by - before).max(axis=0, initial=0.0)
        if np.all(errors <= SETTLED * np.abs(by).max(axis=0, initial=0.0) + least):
            break
    return samples, by, errors


def warn_unsettled(
    names: Sequence[str],
    by: NDArray[np.float64],
    errors: NDArray[np.float64],
    least: NDArray[np.float64] | float,
) -> None:
    """Issue a `SimulationWarning` for each name whose derivative `until_settled` could not accept."""
    largest = np.abs(by).max(axis=0, initial=0.0)
    for name, error, most, enough in zip(names, errors, largest, least + 0.0 * errors, strict=True):
        if not error <= SETTLED * most + enough:
            off = f"may be off by {100.0 * error / most:.2g} % of its largest value"
            said = off if math.isfinite(error) else "cannot be followed to the end, and is NaN from there on"
            warnings.warn(f"the derivative by {name} {said}", SimulationWarning, stacklevel=3)


def internal(of: System) -> list[tuple[int, Any]]:
    """Return pairs of a state's index in the plant and the friction element (record) whose state it is."""
    parts = [part_of(e.law, i) for e in of.plant.elements for i in range(elements(e.law))]
    return list(enumerate(parts, of.bodies))


def _unit(model: Actuator, waveform: Waveform, name: str) -> str:
    quantity = quantity_of(model, waveform, name)
    return unit_for(model, INITIAL.get(name, quantity.unit if quantity else ""))
