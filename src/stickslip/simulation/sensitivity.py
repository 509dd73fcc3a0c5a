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

REFERENCE = RelativeLoad()  # the normal force at which the parameters hold
INITIAL = {  # names of the parts of the initial state, with their units
    "initial_stage_position": "m",
    "initial_stage_velocity": "m/s",
    "initial_end_effector_position": "m",
    "initial_end_effector_velocity": "m/s",
    "initial_bristle_deflection": "m",
}
BY_ROW = "initial row "  # internal name: this prefix and an index mean the initial value of that state
# Derivatives are accepted if they change by less than SETTLED times the largest value in time when the
# tolerance is divided by ten; REFINED is the largest number of such divisions.
SETTLED, REFINED = 0.01, 4
# A damping below this fraction of mass times natural frequency (even 0) is changed as if it had that value.
LEAST_DAMPING = 1e-3
DAMPING = ("N s/m", ANGLE.unit("N s/m"))  # units of a damping


class NeighbouringModels(NamedTuple):
    """A model and its neighbours (one slightly changed value each), for derivatives by differences.

    Attributes:
        values, states: parameters and initial state, a row per neighbour; `steps` are the changed amounts.
        drives, periods: drive and period [s] (0: none) of each neighbour; None if all have the same drive.
        itself: drive table of the unchanged model, with the same segments as the neighbours' drives.
        breaks: times of jumps of the normal force, s; all neighbours start a segment at these times.
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
    """Return the index of the state whose initial value a name means; None for any other name."""
    if name.startswith(BY_ROW):
        return int(name.removeprefix(BY_ROW))
    return row_of(of, name.removeprefix("initial_")) if name in INITIAL else None


def _small(of: System, row: int) -> float:
    """Return the change of an initial value for a derivative (m or m/s), small compared with the motion; for
    a stop operator of a piezo, large compared with the accuracy of its bound."""
    if row >= of.bodies:
        return 1e-13 if row < of.inner else 1e-10
    return 1e-9 if row % 2 else 1e-12


def refuse_law(model: Actuator) -> None:
    """Raise QuantityError if the motion is not a smooth function of the parameters."""
    if model.clamped:
        return
    if elements(model.friction) == 0:
        raise QuantityError(
            f"derivatives are for a law with internal states; {type(model.friction).__name__} has none, "
            "and its motion is no smooth function of its parameters: difference `simulate` instead"
        )
    if has_jumps(model.friction):
        raise QuantityError(
            "derivatives need a law whose force does not jump at the start of sliding, as it does with this "
            f"{type(model.friction).__name__} does (stiction_ratio above 1, a reset): difference `simulate` "
            "instead"
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
    """Return the neighbours of a model at a given state, one for each name.

    With `before` [V], each neighbour starts at rest under this voltage. With a `waveform`, simulated up to
    `end` [s], names may be its fields, and the neighbour has its own drive; if `settled`, the drive is one
    period after many. Tables are accurate to the tolerance [m]. The rows `slipping` of the state are on the
    bounds of each neighbour.

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
            if row >= of.bodies:  # towards 0, because the deflection may be at a bound
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
    n = len(names)  # without names, the tables below keep their number of columns
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
    """Return the change of a value for a derivative: a millionth, or more for a small damping."""
    least = LEAST_DAMPING * model.end_effector_mass * model.natural_frequency
    if abs(value) < least < math.inf:
        quantity = quantity_of(model, None, name)
        if quantity is not None and quantity.unit in DAMPING:
            return DIFFERENCE * least
    return DIFFERENCE * (abs(value) or 1.0)


def _with_law(of: System, law: Any) -> System:
    """Return the system with another law of the same type in the contact."""
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
    """Integrate a model with its neighbours; return samples, and derivatives of position and last state.

    Shapes: derivatives [times, names] and [states, names]; samples as in `engine.binding.integrate`. `state`
    is replaced by the last state. With `over_period` each neighbour continues to the end of its own period.

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
    trajectory (see `engine.near`), so it contains no noise of the error control. Derivatives may need smaller
    steps than the position: they are computed at a tenth of the tolerance, a hundredth and so on, until two
    agree within a hundredth of the largest value.

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
        derivative since ten times the tolerance. If it still exceeds a hundredth after four attempts, a
        `SimulationWarning` names the parameter.

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
    if of.itself is not None:  # the same segments as the neighbours; with creep, they depend on the end
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
    """Return the names of parameters as a list; raise QuantityError for anything else."""
    given = parameters if isinstance(parameters, Collection) and not isinstance(parameters, str) else [None]
    if not all(isinstance(name, str) for name in given):
        raise QuantityError(f"parameters = {parameters!r} must be a list of names")
    return list(given)


def until_settled(
    derivatives: Callable[[float], tuple[NDArray[np.float64], NDArray[np.float64]]],
    tolerance: float,
    least: NDArray[np.float64] | float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return samples, derivatives [times, names] and their errors [names] of the function `derivatives`, at
    the first tolerance at which they settle. Errors below `least` [names] do not matter."""
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
    """Warn, by name, of parameters whose derivatives `by` [times, names] have too large `errors` [names]."""
    largest = np.abs(by).max(axis=0, initial=0.0)
    for name, error, most, enough in zip(names, errors, largest, least + 0.0 * errors, strict=True):
        if not error <= SETTLED * most + enough:
            off = f"may be off by {100.0 * error / most:.2g} % of its largest value"
            said = off if math.isfinite(error) else "cannot be followed to the end, and is NaN from there on"
            warnings.warn(f"the derivative by {name} {said}", SimulationWarning, stacklevel=3)


def internal(of: System) -> list[tuple[int, Any]]:
    """Return index and element record of each state that belongs to an element, as pairs."""
    parts = [part_of(e.law, i) for e in of.plant.elements for i in range(elements(e.law))]
    return list(enumerate(parts, of.bodies))


def _unit(model: Actuator, waveform: Waveform, name: str) -> str:
    quantity = quantity_of(model, waveform, name)
    return unit_for(model, INITIAL.get(name, quantity.unit if quantity else ""))
