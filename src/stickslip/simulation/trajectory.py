"""Simulation of one trajectory of an actuator or a pulled slider, as a labelled dataset."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.binding import TERMS, ComposedPlant, DriveTable, integrate
from ..engine.outcome import DONE, NO_NUMBER, STEP_TOO_SMALL
from ..physics.actuator import Actuator, PulledSlider
from ..physics.electronics.stack import Stack
from ..physics.end_stops import EndStops
from ..quantities.records import DURATION, SAMPLE_RATE, Quantity, refuse_too_many
from ..quantities.units import (
    QuantityError,
    array_si,
    labelled_for,
    optional_si,
    to_si,
    unit_for,
    with_prefix,
)
from ..recording import make_recording
from ..recording.drive import drive_text
from ..waveform.drive import Drive
from ..waveform.signal import Waveform
from .channels import energy_account, of_stack, variables_of
from .drives import refuse_no_waveform, tables
from .errors import SimulationError, SimulationWarning
from .models import RelativeLoad, System, classic, contact_load
from .refinement import LOOSE, refined
from .state import REST, State, as_text, maker, placed, taken_up
from .stopped import Impact, StoppedRun, labelled_impacts, refuse_end_stops

if TYPE_CHECKING:
    import xarray as xr

COMPLETE = "complete"
TOLERANCE = Quantity("m", "ε", "error that is allowed", above=0, maximum=1e-3)  # no step exceeds 1 mm
_OUTCOMES = {
    STEP_TOO_SMALL: "the steps no longer advance, for they fell below what floating point can resolve. Try "
    "another tolerance, or a drive without jumps",
    NO_NUMBER: "a friction force is infinite or no number. Look for a parameter of the law that is 0 or huge",
}


def simulate(
    model: Actuator | PulledSlider,
    waveform: Waveform,
    duration: float | str | None = None,
    *,
    sample_rate: float | str = 1e3,
    times: ArrayLike | None = None,
    tolerance: float | str = 1e-9,
    load: Waveform | float = 1.0,
    energy: bool = False,
    stack: Stack | None = None,
    end_stops: EndStops | None = None,
    max_steps: int = 20_000_000,
    initial_state: State | xr.Dataset | None = None,
) -> xr.Dataset:
    """Return the trajectory of a model under a drive signal, from rest or from a state.

    Args:
        model: an `Actuator`, or a `PulledSlider`.
        waveform: the drive: V for an actuator, m (the spring's far end) for a pulled slider.
        duration: s, or with a unit ("200 ms"); by default the duration of the waveform.
        sample_rate: samples per second of the output. The solution does not depend on it, but ends with the
            last sample within the duration.
        times: sample times instead, s (or with units: strings such as "5 ms", an array of xarray or pint),
            ascending, from 0 or later.
        tolerance: tolerance of the end-effector's position over the whole trajectory, m. The error is
            estimated by a second run with smaller steps and a finer table of the drive after hysteresis and
            creep; if it is larger, both are refined.
        load: normal force relative to the reference at which the friction parameters hold: a number, or a
            waveform.
        energy: add the energy account (one mode, no `MaxwellCapacitor`): `drive_work`, `friction_work`,
            `stage_dissipation`, `external_work`, `kinetic_energy`, `elastic_energy`, and `energy_defect`,
            which is 0 for an exact solution.
        stack: piezo stack that the drive charges: adds `current`, `charge`, `reactive_power` (into the
            field), `loss_power` and `temperature`, from the start of the drive to the last sample. Within a
            cycle that is not closed at the end of a run, loss and temperature are lower than in a longer run.
            A drive that jumps takes an infinite current: use `physics.electronics.driven` (amplifier) first.
        end_stops: stops between which the end-effector (the mass of a pulled slider) moves. Adds the
            impacts: `impact_velocity` (before each) over "impact_time". Not with `energy`.
        max_steps: largest number of integration steps.
        initial_state: a `State`, or a trajectory to continue: then `duration` counts from its end, and
            samples and drive continue in its time (with its plays and creep). With the same model, drive,
            load and tolerance the result equals one run over both to the last bit (where that needs no
            smaller steps; with hysteresis or creep, whose table depends on the length of the run, within the
            tolerance). Its error is added; the energy account starts again.

    Returns:
        Dataset over "time" (s) with end_effector_position, stage_position, sliding_displacement (m),
        friction_force (N, on the end-effector), drive_voltage or spring_position, velocities (m/s), bristle
        deflections (m). A sample at a jump of drive or load contains the values after it: the drive, the
        force under it, and the deflection including newly pressed contact, which carries no force yet.
        attrs["final_state"]: see `final_state`. attrs["error_estimate"] (m): error of the end-effector's
        position; if it stays above the tolerance, a `SimulationWarning` says so. If the motion could not be
        followed to the end: a `SimulationWarning`, the part until then, and the reason in attrs["outcome"].

    Raises:
        QuantityError: a drive outside the actuator's voltage range, wrong unit, bad times, tolerance or rate;
            a stack, end stops or an energy account that model or drive do not allow.
        SimulationError, TypeError: not even two samples could be computed; wrong type of model or drive.
    """
    tolerance = checked_tolerance(model, tolerance)
    sample_rate = to_si(sample_rate, "Hz", "sample_rate")
    duration = optional_si(duration, "s", "duration")
    begin = taken_up(initial_state, model, waveform)
    wanted = sample_times(waveform, duration, sample_rate, times, begin.time if begin else 0.0)
    charged = {} if stack is None else of_stack(model, stack, waveform, wanted)
    found = follow_model(
        model,
        waveform,
        wanted,
        tolerance=tolerance,
        load=load,
        energy=energy,
        max_steps=max_steps,
        check=True,
        begin=begin,
        end_stops=end_stops,
    )
    if found.times.size < 2:
        raise SimulationError(found.outcome)
    if found.outcome != COMPLETE:
        warnings.warn(found.outcome, SimulationWarning, stacklevel=2)
    elif not found.error - (begin.error_estimate if begin else 0.0) <= tolerance:
        warnings.warn(not_within(found.error, tolerance, model), SimulationWarning, stacklevel=2)
    times, samples = found.times, found.samples
    variables = variables_of(model, samples, found.drive, times, waveform)
    if energy:
        assert isinstance(model, Actuator)
        variables |= energy_account(model, samples, found.work, found.start)
    variables |= {name: (values[: times.size], unit) for name, (values, unit) in charged.items()}
    made = make_recording(times, variables, title=f"simulation of {model.name or type(model).__name__}")
    made.attrs.update(
        outcome=found.outcome,
        tolerance=tolerance,
        error_estimate=found.error,
        steps=found.steps,
        rejected_steps=found.rejected,
        model=repr(model),
        drive=drive_text(waveform),
    )
    if found.final is not None:
        made.attrs["final_state"] = as_text(found.final)
    if end_stops is not None:
        made = made.assign(labelled_impacts(found.impacts))
    return labelled_for(model, made)


class FollowedTrajectory(NamedTuple):
    """A trajectory without labels, up to its end or a failure; `outcome` is COMPLETE or the reason.

    Fields: `times`, s; `samples` [times, columns], see `models.classic`; `work` [times, TERMS], account of
    work, see `engine.binding`, and `start`, the sample at which it starts (both may be empty); `drive`,
    segment table; `steps` accepted and `rejected`; `error`, estimated error of the end-effector's position,
    m; `final`, the last state; `resume`, numbers with which the engine continues; `impacts` on end stops.
    """

    times: NDArray[np.float64]
    samples: NDArray[np.float64]
    work: NDArray[np.float64]
    start: NDArray[np.float64]
    drive: Drive
    outcome: str
    steps: int
    rejected: int
    resume: NDArray[np.float64]
    error: float = math.nan
    final: State | None = None
    impacts: tuple[Impact, ...] = ()


class _TrajectoryRun(NamedTuple):
    """Result of one run of the solver: `samples` in the plant's own columns; `outcome`, see `engine.outcome`;
    time `reached`, s; `place`, last position, m; the other fields are those of `FollowedTrajectory`."""

    drive: Drive
    samples: NDArray[np.float64]
    work: NDArray[np.float64]
    outcome: int
    reached: float
    steps: int
    rejected: int
    resume: NDArray[np.float64]
    place: float
    impacts: tuple[Impact, ...] = ()


class _Task(NamedTuple):
    """A trajectory to compute.

    `tables` is a function from the tolerance [m] of a run to the drive. `start` is the state at the time
    `begins` [s]; `resume`, numbers of the solver, replaces it unless all are 0. With `anew` the energy
    account starts at the first of the `times`, which is not part of the result.
    """

    of: System
    plant: ComposedPlant
    tables: Callable[[float], Drive]
    contact: RelativeLoad
    start: NDArray[np.float64]
    times: NDArray[np.float64]
    energy: bool
    max_steps: int
    begins: float
    resume: NDArray[np.float64]
    anew: bool
    end_stops: EndStops | None = None

    def run(self, tolerance: float, careful: bool = False) -> _TrajectoryRun:
        """Simulate once at a tolerance [m] of the engine; for `careful` see `engine.binding.integrate`."""
        times, q, drive = self.times, self.start.copy(), self.tables(tolerance)
        samples = np.full((times.size, self.plant.columns), np.nan)
        work = np.zeros((times.size if self.energy else 0, TERMS))
        span, resume, impacts = (self.begins, float(times[-1])), self.resume.copy(), ()
        tables = DriveTable(drive), DriveTable(self.contact.drive)
        accuracy = tolerance, careful, self.max_steps
        if self.end_stops is None:
            filled = samples, resume, work if self.energy else None
            found = integrate(self.plant, *tables, q, span, *accuracy, times, *filled)
            outcome, reached, steps, rejected = found
        else:
            run = StoppedRun(self.of, self.end_stops, *tables, *accuracy)
            outcome, reached, steps, rejected, impacts = run.follow(q, span, times, samples)
        place = float(q[self.of.slider])
        return _TrajectoryRun(drive, samples, work, outcome, reached, steps, rejected, resume, place, impacts)

    def distance(self, one: _TrajectoryRun, other: _TrajectoryRun) -> float:
        """Return the largest difference of the end-effector's position between two runs, m; NaN if one does
        not reach the end."""
        if one.outcome != DONE or other.outcome != DONE:
            return math.nan
        column = self.of.slider
        return float(np.abs(one.samples[:, column] - other.samples[:, column]).max())

    def followed(self, run: _TrajectoryRun, error: float = math.nan) -> FollowedTrajectory:
        """Return the part of a run that was computed, with its error [m]; NaN: not estimated."""
        samples, work = classic(self.of, run.samples, run.drive, self.times), run.work
        times, start, text = self.times, np.zeros(0), COMPLETE
        if run.outcome != DONE:
            reason = _OUTCOMES.get(run.outcome, f"more than {self.max_steps} steps were needed")
            along = self.of.contact.along if self.of.contact is not None else None
            if run.outcome == STEP_TOO_SMALL and along is not None and not along.presses(run.place):
                reason = f"the contact lifts off at {with_prefix(run.place, 'm')}, where nothing presses it"
            keep = np.logical_and.accumulate(np.isfinite(samples).all(axis=1))
            reached = float(times[~keep][0]) if run.outcome == NO_NUMBER else run.reached
            text = f"stopped at t = {with_prefix(reached, 's')} of {with_prefix(times[-1], 's')}: {reason}"
            times, samples, work = times[keep], samples[keep], work[keep] if self.energy else work
        if self.anew and times.size:  # drop the first sample, at which the energy account starts
            start, work = samples[0], work - work[0]
            times, samples, work = times[1:], samples[1:], work[1:]
        elif self.energy:
            before = np.zeros((1, run.samples.shape[1]))
            before[0, : self.start.size] = self.start
            start = classic(self.of, before, run.drive, np.array([self.begins or -1.0]))[0]
        counts = run.steps, run.rejected, run.resume, error
        return FollowedTrajectory(times, samples, work, start, run.drive, text, *counts, impacts=run.impacts)


def follow_model(
    model: Actuator | PulledSlider,
    waveform: Waveform,
    times: NDArray[np.float64],
    *,
    tolerance: float = 1e-9,
    load: Waveform | float = 1.0,
    energy: bool = False,
    max_steps: int = 20_000_000,
    check: bool = False,
    begin: State | None = None,
    end_stops: EndStops | None = None,
) -> FollowedTrajectory:
    """Simulate as `simulate`, without labels and warnings, for pictures that are redrawn many times a second.

    Without `check` there is a single run; its error is usually a tenth of the tolerance and not estimated.
    `times` are the sample times, s, and `begin` is the initial state.
    """
    end = float(times[-1])
    contact = contact_load(load, end)
    of = contact.system(model)
    tolerance = checked_tolerance(model, tolerance)
    drives = tables(model, waveform, end, periodic=False)
    table = drives(LOOSE * tolerance if check else tolerance)
    if energy and not (isinstance(model, Actuator) and len(of.stages) < 2 and model.two_port is None):
        raise QuantityError(
            "the energy account is kept for an Actuator whose stage has one mode, without a MaxwellCapacitor"
        )
    begin = begin or REST
    if times[0] < begin.time:
        raise QuantityError(
            f"times [s] start at {times[0]:g} s, before the initial state at {begin.time:g} s"
        )
    plant = ComposedPlant(of.plant)
    resume = np.zeros(plant.resume_size)
    goes_on = end_stops is None and len(begin.resume) == resume.size
    goes_on = goes_on and begin.made_by == maker(of, table, contact.drive, tolerance, begin.time)
    if goes_on:
        resume[:] = begin.resume
    anew = bool(energy and goes_on)
    if anew:
        times = np.append(begin.time, times)
    start = placed(begin, of, contact, table.before)
    refuse_end_stops(model, end_stops, energy, float(start[of.slider]))
    given = times, energy, max_steps, begin.time, resume, anew, end_stops
    task = _Task(of, plant, drives, contact, start, *given)
    if not check:
        return task.followed(task.run(tolerance))
    found = refined(task.run, task.distance, lambda run: run.steps + run.rejected, tolerance)
    made = task.followed(found.run, found.error + begin.error_estimate)
    if made.outcome != COMPLETE:
        return made
    return made._replace(final=_final(of, made, maker(of, table, contact.drive, tolerance, end)))


def _final(of: System, run: FollowedTrajectory, by: str) -> State:
    last, law = run.samples[-1].tolist(), 5 + of.internal
    resume = tuple(run.resume.tolist())
    y, w, x, s = last[:4]
    bristles, further = tuple(last[5:law]), tuple(last[law:])
    return State(float(run.times[-1]), y, w, x, s, bristles, run.error, resume, by, further)


def checked_tolerance(model: Any, tolerance: float | str) -> float:
    """Return a tolerance of a position as a number, m (rad for a rotary model); raise QuantityError if it is
    invalid."""
    return TOLERANCE._replace(unit=unit_for(model, "m")).check(tolerance, "tolerance")


def sample_times(
    waveform: Waveform,
    duration: float | None,
    sample_rate: float,
    times: ArrayLike | None,
    start: float = 0.0,
    numbers: int = 10,
) -> NDArray[np.float64]:
    """Return the sample times [s]: `times` if given, else those of a rate [Hz] and duration [s] from `start`
    [s]. `numbers` is how many numbers are kept per time, to refuse what does not fit into memory.

    Raises:
        QuantityError: too many samples in all, invalid times, or see `simulate`.
    """
    if times is not None:
        made = array_si(times, "s", "times")
        if made.ndim != 1 or made.size < 2 or made[0] < 0.0 or not np.all(np.diff(made) > 0.0):
            raise QuantityError("times [s] must be at least two numbers, ascending, from 0 s or later")
        return made
    refuse_no_waveform(waveform)
    duration, sample_rate = run_time(waveform, duration, start), SAMPLE_RATE.check(sample_rate, "sample_rate")
    asked = f"duration = {duration:g} s at sample_rate = {sample_rate:g} Hz"
    refuse_too_many(duration * sample_rate, asked, numbers)
    count = math.floor(duration * sample_rate * (1.0 + 1e-12) + 1e-9)
    if count < 1:
        raise QuantityError(
            f"duration = {duration:g} s holds no interval at sample_rate = {sample_rate:g} Hz"
        )
    first = start * sample_rate
    if abs(first - round(first)) > 1e-9 * max(first, 1.0):
        return start + np.arange(count + 1) / sample_rate
    made = (round(first) + np.arange(count + 1)) / sample_rate  # exactly the times of a single run from 0
    made[0] = start
    return made


def run_time(waveform: Waveform, duration: float | None, start: float = 0.0) -> float:
    """Return the length of a run, s: the given duration, or from `start` to the end of the waveform.

    Raises:
        QuantityError: a duration that is not finite and above 0, or none for a waveform without an end.
    """
    if duration is not None:
        return DURATION.check(duration, "duration")
    refuse_no_waveform(waveform)
    name, left = type(waveform).__name__, waveform.duration - start
    if not math.isfinite(left):
        raise QuantityError(f"duration is missing: this {name} has no end. Give the duration in seconds")
    if not left > 0.0:
        raise QuantityError(
            f"duration is missing: this {name} ends at {waveform.duration:g} s, "
            f"and the run starts at {start:g} s"
        )
    return left


def not_within(error: float, tolerance: float, model: Any = None, what: str = "the position") -> str:
    """Return the warning for an `error` (NaN: unknown) of `what` above the `tolerance`, m (rad if rotary)."""
    unit = unit_for(model, "m")
    asked = f"the tolerance of {with_prefix(tolerance, unit)} is not shown to hold"
    if math.isnan(error):
        return f"{asked}: a run with smaller steps, which shows the error, could not be followed to the end"
    return f"{asked}: {what} may be off by {with_prefix(error, unit)}, by a run with smaller steps"
