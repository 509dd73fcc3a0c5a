"""Several actuators under one end-effector: each has its own stage, contact and drive.

Contacts that slip one after the other cooperate: the sticking ones hold the end-effector. One plant contains
all actuators, but the engine accepts only one drive. So each piece between two breaks of any drive is a run
of its own: the engine's drive is the time since the break, and the coefficients of the plant contain the
straight line of each actual drive.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..engine.binding import ComposedPlant, DriveTable, integrate
from ..engine.outcome import DONE
from ..friction import elements
from ..physics.actuator import Actuator
from ..quantities.units import QuantityError, labelled_for, optional_si, to_si
from ..recording.schema import STANDARD_NAMES
from ..waveform.drive import Drive, constant, evaluate, segment_at
from ..waveform.signal import Waveform
from .drives import checked_drive
from .errors import SimulationError, SimulationWarning
from .models import System, system
from .plant.system import Element, Mode, Plant
from .refinement import refined
from .trajectory import checked_tolerance, not_within, sample_times

Array = NDArray[np.float64]

MAX_STEPS = 20_000_000  # largest number of integration steps between two breaks of the drives


class Joined(NamedTuple):
    """Plant of several actuators under one end-effector, which is the last mode.

    `stages` contains a tuple for each actuator: the indices of its stage's modes (empty for a static stage).
    """

    plant: Plant
    stages: tuple[tuple[int, ...], ...]

    def over(self, drives: Sequence[Drive], start: float) -> Plant:
        """Return the plant for the time from `start` [s] to the next break of any drive.

        The plant's own drive is the time since `start`, in s. The voltage of each actuator, a straight line
        in this time, is contained in the coefficients of its modes and of its contact.

        Args:
            drives: segment table of each actuator, V.
            start: s.
        """
        modes, contacts = list(self.plant.modes), []
        for drive, own, contact in zip(drives, self.stages, self.plant.elements, strict=True):
            piece = int(segment_at(drive, np.array([start]))[0])
            tau = start - drive.start[piece]
            level, slope = drive.polynomial[piece, :2]
            level += slope * tau
            for m in own:
                of = modes[m]
                modes[m] = Mode(
                    of.stiffness, of.damping, of.drive * slope, of.acceleration + of.drive * level
                )
            rate = contact.drive_rate
            contacts.append(contact if rate is None else contact._replace(drive_rate=rate * slope))
        return self.plant._replace(modes=tuple(modes), elements=tuple(contacts))


def joined(actuators: Sequence[Actuator]) -> Joined:
    """Return the common plant of at least two actuators that share one end-effector.

    Raises:
        QuantityError: fewer than two actuators; or one of them cannot be joined (see `_refuse`).
    """
    if len(actuators) < 2:
        raise QuantityError("actuators: at least two move one end-effector; for one there is simulate")
    first, systems = actuators[0], []
    for i, one in enumerate(actuators):
        if not isinstance(one, Actuator):
            raise QuantityError(f"actuators[{i}] = {one!r:.60} must be an Actuator")
        _refuse(one, first, i)
        systems.append(system(one))
    count = sum(len(of.stages) for of in systems)
    modes, stages, contacts = [], [], []
    for of in systems:
        own = tuple(range(len(modes), len(modes) + len(of.stages)))
        modes += of.plant.modes[: len(own)]
        stages.append(own)
        contacts.append(_moved(of, own, count))
    plant = Plant((*modes, systems[0].plant.modes[-1]), tuple(contacts), max(of.plant.rate for of in systems))
    return Joined(plant, tuple(stages))


def _refuse(one: Actuator, first: Actuator, i: int) -> None:
    """Raise QuantityError for actuator `i` (`one`) if it cannot be joined to the first one.

    Reasons are another mass or force of the end-effector, a clamped end-effector, a piezo model, a normal
    force along the stroke, a law without bristles, or a rotary and a linear actuator.
    """
    where = f"actuators[{i}]"
    for name, value in (("end_effector_mass", one.end_effector_mass), ("axial_force", one.axial_force)):
        if value != getattr(first, name):
            raise QuantityError(
                f"{where}.{name} = {value:g} and actuators[0].{name} = {getattr(first, name):g}: they move "
                "one end-effector; give all of them the same"
            )
    if one.clamped or one.piezo is not None or one.normal_force is not None or one.rotary != first.rotary:
        raise QuantityError(
            f"{where}: a clamped end-effector, a piezo with hysteresis or creep, or a normal force along the "
            "stroke cannot be joined to others; nor what turns to what does not"
        )
    if elements(one.friction) == 0:
        raise QuantityError(
            f"{where}.friction: two contacts of {type(one.friction).__name__} would hold the end-effector at "
            "once; give a law with bristles, such as LuGre"
        )


def _moved(of: System, own: tuple[int, ...], count: int) -> Element:
    """Return the contact of one actuator as an element of the common plant.

    Its coefficients of the other actuators' modes are None; the last coefficient is that of the end-effector.

    Args:
        of: system of the actuator alone.
        own: indices of its stage's modes in the common plant.
        count: number of modes of all stages.
    """
    contact = of.plant.elements[0]

    def over_all(shares: Sequence[float | None]) -> tuple[float | None, ...]:
        made: list[float | None] = [None] * (count + 1)
        for m, share in zip((*own, count), shares, strict=True):
            made[m] = share
        return tuple(made)

    return contact._replace(velocity=over_all(contact.velocity), push=over_all(contact.push or ()))


def simulate_together(
    actuators: Sequence[Actuator],
    waveforms: Sequence[Waveform],
    duration: float | str | None = None,
    *,
    sample_rate: float | str = 1e3,
    times: ArrayLike | None = None,
    tolerance: float | str = 1e-9,
) -> xr.Dataset:
    """Return the trajectory of one end-effector on several actuators, each with its own drive.

    Each stage starts at rest under the voltage of its drive before t = 0, with its contact undeflected, and
    the end-effector at 0.

    Args:
        actuators: at least two, with the same end-effector mass and external force.
        waveforms: V, one per actuator; linear between their breaks (`PeriodicKnots`, sawteeth, `Sampled`).
        duration, sample_rate, times, tolerance: see `simulate`; the default duration is that of the first
            waveform.

    Returns:
        Dataset over "time" (s) with end_effector_position (m) and end_effector_velocity (m/s), and over
        "actuator" and "time" stage_position (m), friction_force (N, of each on the end-effector) and
        drive_voltage (V). attrs["error_estimate"]: m. A `SimulationWarning` if it exceeds the tolerance.

    Raises:
        QuantityError: an actuator that cannot be joined, another number of waveforms, a waveform that is not
            linear between its breaks, or see `simulate`.
        SimulationError: the motion could not be followed to its end.
    """
    of = joined(actuators)
    if len(waveforms) != len(actuators):
        raise QuantityError(
            f"waveforms: {len(actuators)} actuators need as many waveforms, not {len(waveforms)}"
        )
    tolerance = checked_tolerance(actuators[0], tolerance)
    length, rate = optional_si(duration, "s", "duration"), to_si(sample_rate, "Hz", "sample_rate")
    at = sample_times(waveforms[0], length, rate, times, 0.0)
    drives = [
        _straight(a, w, float(at[-1]), i) for i, (a, w) in enumerate(zip(actuators, waveforms, strict=True))
    ]

    def run(level: float, careful: bool) -> _Run:
        return _followed(of, drives, at, level, careful)

    def distance(one: _Run, other: _Run) -> float:
        column = 2 * (len(of.plant.modes) - 1)
        return float(np.abs(one.samples[:, column] - other.samples[:, column]).max())

    found = refined(run, distance, lambda one: one.steps, tolerance)
    if not np.isfinite(found.run.samples).all():
        raise SimulationError("the motion could not be followed to its end: try another tolerance")
    if not found.error <= tolerance:
        warnings.warn(not_within(found.error, tolerance, actuators[0]), SimulationWarning, stacklevel=2)
    return _labelled(of, actuators, drives, at, found.run.samples).assign_attrs(
        title=f"{len(actuators)} actuators under one end-effector",
        tolerance=tolerance,
        error_estimate=found.error,
        steps=found.run.steps,
    )


class _Run(NamedTuple):
    samples: Array
    steps: int


def _straight(model: Actuator, waveform: Waveform, end: float, i: int) -> Drive:
    """Return the segment table [V] up to `end` [s] of the drive of an actuator, which has the index `i`;
    raise QuantityError if the drive is not linear in each segment."""
    table = checked_drive(model, waveform, end, False, math.inf)
    if table.harmonic.size or np.any(table.polynomial[:, 2:]):
        raise QuantityError(
            f"waveforms[{i}]: a {type(waveform).__name__} is not straight between its breaks; give its "
            "samples (Sampled), or PeriodicKnots"
        )
    return table


def _followed(of: Joined, drives: Sequence[Drive], times: Array, tolerance: float, careful: bool) -> _Run:
    """Integrate the common plant from break to break of the drives, from rest.

    Return the samples [times, columns] at `times` [s] (see `engine.binding.integrate`; NaN after a failure),
    and the number of integration steps. `careful`: see `engine.binding.integrate`.
    """
    free = ComposedPlant(of.plant)
    end, samples, steps = float(times[-1]), np.full((times.size, free.columns), np.nan), 0
    starts = np.unique(np.concatenate([drive.start for drive in drives]))
    breaks = [*starts[starts < end].tolist(), end]
    q, filled = np.zeros(free.states), 0
    for drive, own in zip(drives, of.stages, strict=True):
        for m in own:
            q[2 * m] = of.plant.modes[m].drive * drive.before / of.plant.modes[m].stiffness
    load = DriveTable(constant(1.0))
    for start, stop in itertools.pairwise(breaks):
        last = stop == end
        until = int(np.searchsorted(times, stop, "right" if last else "left"))
        since = constant(0.0)._replace(start=np.array([start]), polynomial=np.array([[0.0, 1.0, 0.0, 0.0]]))
        outcome, _, accepted, rejected = integrate(
            ComposedPlant(of.over(drives, start)),
            DriveTable(since),
            load,
            q,
            (start, stop),
            tolerance,
            careful,
            MAX_STEPS,
            times[filled:until],
            samples[filled:until],
        )
        steps, filled = steps + accepted + rejected, until
        if outcome != DONE:
            samples[filled:] = np.nan
            break
    return _Run(samples, steps)


def _labelled(
    of: Joined, actuators: Sequence[Actuator], drives: Sequence[Drive], times: Array, samples: Array
) -> xr.Dataset:
    volts = np.array([evaluate(drive, times)[0] for drive in drives])
    stages = np.array(
        [
            samples[:, [2 * m for m in own]].sum(axis=1) if own else one.gain * u
            for own, one, u in zip(of.stages, actuators, volts, strict=True)
        ]
    )
    slider = 2 * (len(of.plant.modes) - 1)
    force = samples[:, -len(actuators) :].T
    both, time = ("actuator", "time"), ("time",)
    values = {
        "end_effector_position": (time, samples[:, slider]),
        "end_effector_velocity": (time, samples[:, slider + 1]),
        "stage_position": (both, stages),
        "friction_force": (both, force),
        "drive_voltage": (both, volts),
    }
    made = {name: (dims, one, {"units": STANDARD_NAMES[name].unit}) for name, (dims, one) in values.items()}
    about = {"units": "s", "long_name": "time"}
    coords = {"time": (time, times, about), "actuator": np.arange(len(actuators))}
    return labelled_for(actuators[0], xr.Dataset(made, coords))
