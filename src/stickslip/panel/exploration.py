"""Answers to the Explore page: the simulated motion of an actuator, its step curves, and Python code.

The page sends its whole state, actuator and drive, with each request.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..physics.actuator import Actuator
from ..quantities import registry
from ..quantities.input_file import Strict
from ..quantities.records import Quantity, quantities
from ..quantities.units import ANGLE, LENGTH, QuantityError, unit_for
from ..simulation import SimulationError, steady_step
from ..simulation.trajectory import COMPLETE, follow_model
from ..simulation.whole_periods import mean_velocity
from ..waveform.drive import evaluate
from ..waveform.signal import Waveform
from . import piezo_sliders
from .sets import PACKAGE, Sets
from .sliders import law_types, shapes

# Numbers of sampling times. POINTS: over the whole time. LOOP_POINTS: over the last period, drawn as the
# friction loop. RING_POINTS, LOOP_RING_POINTS: over the decaying vibration (ring-down) after each break, a
# jump or corner of the drive; the second applies to the last four breaks since the start of the last period.
POINTS, LOOP_POINTS, RING_POINTS, LOOP_RING_POINTS = 1200, 200, 40, 300
# Length of a ring-down, as a multiple of 1 over the stage's natural frequency [rad/s]: about six periods of
# vibration.
RING_TIME = 40.0
MOST_RINGS = 50  # number of breaks of the drive, the last ones, after which times are closest
MOST_PERIODS = 10_000  # largest number of periods of the drive in one simulation
LONGEST = 100.0  # longest simulation, s
TOLERANCE = 1e-9  # tolerance of simulated positions, m (or rad for rotary actuators)
MOST_STEPS = 500_000  # largest number of integration steps of a simulation: about a second of computing
CURVE_POINTS = 25  # number of points of a curve of the step over amplitude or frequency
CURVE_SECONDS = 1.0  # time after which the remaining points of the curves are left out, s

_LENGTH = Quantity("s", "T", "length of the experiment", above=0, maximum=LONGEST)

Value = float | str | bool
Array = NDArray[np.float64]


class Model(Strict):
    """An actuator in a request of the page. Values are numbers in SI or texts with units; infinity is "inf".

    Attributes:
        set: name of a parameter set.
        model: changed fields of `Actuator`, and of the piezo as in `piezo_sliders`; other fields keep the
            set's values.
        law: name of the friction law.
        friction: all fields of the friction law; "stiffness_1", "strength_1" and so on are those of its first
            element.
    """

    set: str = Field(max_length=100)
    model: dict[str, Value] = Field(default_factory=dict, max_length=20)
    law: str
    friction: dict[str, Value] = Field(max_length=80)

    def actuator(self, sets: Sets = PACKAGE) -> Actuator:
        """Return the actuator of the request; raises QuantityError for a wrong value.

        `sets` are the parameter sets on offer, by default those of the package.
        """
        base = sets.actuator(self.set)
        changes: dict[str, Any] = dict(self.model)
        if "natural_frequency" in changes and base.blocked_force_per_volt is not None:
            changes["blocked_force_per_volt"] = None  # only stages without dynamics have it
        own = piezo_sliders.values(base.piezo)
        own |= {field: changes.pop(field) for field in own if field in changes}
        piezo = piezo_sliders.with_values(base.piezo, **own)
        return base.replace(**changes, piezo=piezo, friction=self._friction(base.rotary))

    def _friction(self, rotary: bool) -> Any:
        law = _known(law_types(), self.law, "law")
        fields: dict[str, Any] = {}
        elements: dict[str, dict[int, Value]] = {}
        known = quantities(law)
        for name, given in self.friction.items():
            element = re.fullmatch(r"(stiffness|strength)_(\d{1,3})", name)
            field, value = element[1] if element else name, given
            # Units are checked here, because the law alone would expect the units of linear actuators.
            if field in known:
                quantity = known[field].along(ANGLE if rotary else LENGTH)
                value = quantity.check(given, f"{self.law}.{name}")
            if element:
                elements.setdefault(field, {})[int(element[2])] = value
            else:
                fields[name] = value
        fields |= {name: [v for _, v in sorted(values.items())] for name, values in elements.items()}
        return law(**fields)


class SliderState(Model):
    """State of the Explore page: an actuator, its drive, and the duration of the simulation.

    `shape` is the name of a waveform, and `waveform` has its fields. These and `duration` are numbers in SI,
    or texts with units.
    """

    shape: str
    waveform: dict[str, Value] = Field(max_length=20)
    duration: Value

    def experiment(self, sets: Sets = PACKAGE) -> tuple[Actuator, Waveform, float]:
        """Return the actuator, its drive and the duration [s].

        Raises QuantityError for a wrong value, or for more than `MOST_PERIODS` periods.
        """
        actuator = self.actuator(sets)
        waveform = _known(shapes(), self.shape, "shape")(**self.waveform)
        seconds = _LENGTH.check(self.duration, "duration")
        period = _period(waveform)
        repeats = seconds / period if period else 0.0
        if repeats > MOST_PERIODS:
            raise QuantityError(
                f"duration = {seconds:g} s is out of range: {repeats:.0f} periods are more than the "
                f"{MOST_PERIODS} that are followed here"
            )
        return actuator, waveform, seconds


def _known(kinds: dict[str, Any], name: str, field: str) -> Any:
    if name not in kinds:
        raise QuantityError(f"{field} = {name!r} is unknown; there are {', '.join(kinds)}")
    return kinds[name]


def _period(waveform: Any) -> float | None:
    return getattr(waveform, "period", None)


def sample_times(actuator: Actuator, waveform: Waveform, duration: float) -> tuple[Array, float]:
    """Return sampling times [s] of the page's plots, and the start [s] of the drive's last whole period.

    The increasing times are equidistant over the whole time. They are closer over the last period, for the
    friction loop, and closest just after each of the last `MOST_RINGS` breaks (jumps or corners) of the
    drive, where the stage vibrates. The start is 0 if `duration` [s] contains no whole period.
    """
    period = _period(waveform)
    last = 0.0
    if period is not None and period <= duration:
        last = (math.floor(duration / period * (1 + 1e-12)) - 1) * period
    end = min(last + period, duration) if period else duration
    breaks = np.asarray(waveform.breaks(duration))[-MOST_RINGS:]  # type: ignore[attr-defined]
    reach = min(RING_TIME / min(actuator.natural_frequency, 1e5), period or duration)
    ring, fine = (reach * np.linspace(0.0, 1.0, n) ** 2 for n in (RING_POINTS, LOOP_RING_POINTS))
    grids = (
        np.linspace(0.0, duration, POINTS),
        np.linspace(last, end, LOOP_POINTS),
        (breaks[:, None] + ring).ravel(),
        (breaks[breaks >= last * (1 - 1e-12)][-4:, None] + fine).ravel(),
        np.nextafter(breaks, 0.0),
    )
    times = np.unique(np.concatenate(grids))
    return times[(times >= 0.0) & (times <= duration)], last


class ShownMotion(NamedTuple):
    """Simulated motion: arrays over time, in SI.

    Positions are in `unit`: m, or rad for rotary actuators; the friction is then a torque, N m. `loop` has
    two indices: of the first sample of the last period, and of the first sample after this period. They are 0
    and the number of samples for a drive without a period. `problem` says why the simulation ended early, ""
    if it did not.
    """

    time: Array
    drive_voltage: Array
    stage_position: Array
    end_effector_position: Array
    friction_force: Array
    loop: tuple[int, int]
    problem: str
    unit: str

    @property
    def sliding_displacement(self) -> Array:
        """Return stage position minus end-effector position, in `unit`, shape (times,)."""
        return self.stage_position - self.end_effector_position


def motion(state: SliderState, sets: Sets = PACKAGE) -> ShownMotion:
    """Simulate the state of the page and return the motion, which may end early, see `ShownMotion`.

    `sets` are the parameter sets on offer. Raises SimulationError if fewer than two samples can be computed,
    and QuantityError for a wrong value.
    """
    actuator, waveform, duration = state.experiment(sets)
    wanted, last = sample_times(actuator, waveform, duration)
    found = follow_model(actuator, waveform, wanted, tolerance=TOLERANCE, max_steps=MOST_STEPS)
    if found.times.size < 2:
        raise SimulationError(found.outcome)
    end = last + (_period(waveform) or duration)
    first, after = np.searchsorted(found.times, [last * (1 - 1e-12), end * (1 + 1e-12)])
    y, _, x, _, force = found.samples[:, :5].T
    # Drive voltage, before hysteresis and creep of the piezo act.
    drive = evaluate(waveform.drive(duration), found.times)[0]
    problem = "" if found.outcome == COMPLETE else found.outcome
    loop, unit = (int(first), int(after)), unit_for(actuator, "m")
    return ShownMotion(found.times, drive, y, x, force, loop, problem, unit)


def mean_speed(state: SliderState, found: ShownMotion, sets: Sets = PACKAGE) -> float | None:
    """Return the mean speed of the end-effector, m/s or rad/s, as `mean_velocity` defines it; None for fewer
    than two whole periods of the drive.

    Args:
        state: state of the page.
        found: the motion that `motion` has simulated for this state.
        sets: parameter sets on offer.
    """
    _, waveform, _ = state.experiment(sets)
    return mean_velocity(found.time, found.end_effector_position, waveform)


def step_curves(state: SliderState, sets: Sets = PACKAGE) -> dict[str, Array]:
    """Return the steady step per period [m, or rad] over the amplitude [V] and over the frequency [Hz].

    The drive is otherwise that of the page. Raises QuantityError for a wrong value.

    Returns:
        Arrays by name. "step_over_amplitude" is over "amplitude", "step_over_frequency" over "frequency";
        "step" has one value, for the present drive.
        "in_time" has one value: 1, or 0 if points were left out after `CURVE_SECONDS`.
        A step is NaN if there is no steady step, if the voltage leaves the actuator's range, or if the point
        was left out. All arrays are empty for a drive without a period, an amplitude or a frequency.
    """
    actuator, waveform, _ = state.experiment(sets)
    if _period(waveform) is None or not {"amplitude", "frequency"} <= set(waveform._fields):  # type: ignore[attr-defined]
        names = ("amplitude", "step_over_amplitude", "frequency", "step_over_frequency", "step", "in_time")
        return {name: np.zeros(0) for name in names}
    wave: Any = waveform
    top = actuator.max_voltage - max(getattr(wave, "offset", 0.0), 0.0)
    top = min(top, -actuator.min_voltage) if state.shape == "Sine" and actuator.min_voltage else top
    top = top if math.isfinite(top) and top > 0 else max(150.0, abs(wave.amplitude))
    amplitude = np.linspace(top / CURVE_POINTS, top, CURVE_POINTS)
    highest = min(actuator.natural_frequency / (2 * math.pi), 1e4)
    ends = min(1.0, wave.frequency), max(highest, wave.frequency)
    # Points are closer above `knee`, near the stage's resonance, where the step changes most with frequency.
    knee = min(max(highest / 8.0, ends[0]), ends[1])
    few = CURVE_POINTS // 3
    frequency = np.append(
        np.geomspace(ends[0], knee, few, endpoint=False), np.geomspace(knee, ends[1], CURVE_POINTS - few)
    )
    present = _step(actuator, wave, math.inf)
    give_up = time.monotonic() + CURVE_SECONDS

    def steps(drives: Iterator[Any]) -> Array:
        return np.array([_step(actuator, drive, give_up) for drive in drives])

    return {
        "amplitude": amplitude,
        "step_over_amplitude": steps(_varied(wave, "amplitude", amplitude)),
        "frequency": frequency,
        "step_over_frequency": steps(_varied(wave, "frequency", frequency)),
        "step": np.array([present]),
        "in_time": np.array([float(time.monotonic() <= give_up)]),
    }


def _varied(wave: Any, field: str, values: Array) -> Iterator[Any]:
    return (wave._replace(**{field: float(value)}) for value in values)


def _step(actuator: Actuator, drive: Any, give_up: float) -> float:
    if time.monotonic() > give_up:
        return math.nan
    try:
        return steady_step(actuator, drive, tolerance=TOLERANCE)
    except (SimulationError, QuantityError):
        return math.nan


def python(state: SliderState, sets: Sets = PACKAGE) -> str:
    """Return Python code that simulates the state of the page with the public functions of stickslip.

    Raises QuantityError for a wrong value.
    """
    actuator, waveform, duration = state.experiment(sets)
    base = sets.actuator(state.set)
    changed = {
        field: value
        for field, value in actuator._asdict().items()
        if value != getattr(base, field) and field != "friction"
    }
    arguments = [f"{field}={_literal(value)}" for field, value in changed.items()]
    if actuator.friction != base.friction:
        arguments.append(f"friction={_record(actuator.friction)}")
    model = f'ss.load_actuator("{state.set}")'  # a saved set: to be run in the panel's folder
    if arguments:
        model += ".replace(\n    " + ",\n    ".join(arguments) + ",\n)"
    bent = None if actuator.piezo is None else actuator.piezo.hysteresis
    lines = [
        "import stickslip as ss",
        *(["from stickslip.physics.piezo import *"] if "piezo" in changed else []),
        *(["from stickslip.friction import NormalForce"] if changed.get("normal_force") else []),
        "",
        *dict.fromkeys(filter(None, (_own(type(one)) for one in (actuator.friction, waveform, bent) if one))),
        f"actuator = {model}",
        f"drive = {_record(waveform)}",
        f"trajectory = ss.simulate(actuator, drive, duration={duration!r}, sample_rate=10e3)",
    ]
    if _period(waveform) is not None:
        unit = unit_for(actuator, "m")
        lines.append(f"step = ss.steady_step(actuator, drive)  # {unit} per period")
    return "\n".join(lines) + "\n"


def _record(record: Any) -> str:
    defaults = record._field_defaults
    fields = (
        f"{field}={_literal(value)}"
        for field, value in record._asdict().items()
        if field not in defaults or defaults[field] != value
    )
    kind = type(record)
    room = "" if registry.origin(kind) else f"ss.{kind.__module__.split('.')[1]}."
    return f"{room}{kind.__name__}({', '.join(fields)})"


def _own(kind: type) -> str:
    """Return the import line of a user's own law, waveform or hysteresis model; "" for one of the package.

    `kind` is its class.
    """
    place = registry.origin(kind)
    if kind.__module__.startswith("own_"):
        return f"{kind.__name__} = ss.registry.use_file({place!r}).{kind.__name__}"
    return f"from {kind.__module__} import {kind.__name__}" if place else ""


def _literal(value: Any) -> str:
    return f'float("{value}")' if isinstance(value, float) and not math.isfinite(value) else repr(value)
