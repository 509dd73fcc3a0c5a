"""One state of the Explore page: actuator and drive, the simulated motion, and Python code for it."""

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
from ..waveform.drive import evaluate
from ..waveform.signal import Waveform
from . import piezo_sliders
from .sets import PACKAGE, Sets
from .sliders import law_types, shapes

# Number of sampling points: over the whole time, over the last period (drawn as the friction loop), and over
# the ring-down after each break (jump or corner) of the drive, for the whole time and for the last period.
POINTS, LOOP_POINTS, RING_POINTS, LOOP_RING_POINTS = 1200, 200, 40, 300
# Length of a ring-down times the stage's natural frequency [rad/s]: about six periods of vibration.
RING_TIME = 40.0
MOST_RINGS = 50  # breaks of the drive, the last ones, with a finer grid after them
MOST_PERIODS = 10_000  # of the drive, in one simulation
LONGEST = 100.0  # s, longest simulation
TOLERANCE = 1e-9  # m, or rad for rotary actuators: error of simulated positions
MOST_STEPS = 500_000  # integration steps of a simulation: about a second of computing
CURVE_POINTS = 25  # points of a curve of the step over amplitude or frequency
CURVE_SECONDS = 1.0  # s, after which the rest of a curve is left out

_LENGTH = Quantity("s", "T", "length of the experiment", above=0, maximum=LONGEST)

Value = float | str | bool
Array = NDArray[np.float64]


class Model(Strict):
    """An actuator in a request of the page. Values are in SI or texts with units; infinity is "inf".

    `set` names a parameter set. `model` has changed fields of `Actuator` and of `piezo_sliders`; fields that
    are left out keep the set's values. `friction` has all fields of the friction law `law`; those of its
    elements are "stiffness_1", "strength_1" and so on.
    """

    set: str = Field(max_length=100)
    model: dict[str, Value] = Field(default_factory=dict, max_length=20)
    law: str
    friction: dict[str, Value] = Field(max_length=80)

    def actuator(self, sets: Sets = PACKAGE) -> Actuator:
        """Return the actuator of the request; raises QuantityError for a wrong value.

        `sets` finds its parameter set: by default only those of the package.
        """
        base = sets.actuator(self.set)
        changes: dict[str, Any] = dict(self.model)
        if "natural_frequency" in changes and base.blocked_force_per_volt is not None:
            changes["blocked_force_per_volt"] = None  # only for a stage without dynamics
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
            if field in known:  # here, as the law alone would expect linear units
                quantity = known[field].along(ANGLE if rotary else LENGTH)
                value = quantity.check(given, f"{self.law}.{name}")
            if element:
                elements.setdefault(field, {})[int(element[2])] = value
            else:
                fields[name] = value
        fields |= {name: [v for _, v in sorted(values.items())] for name, values in elements.items()}
        return law(**fields)


class SliderState(Model):
    """State of the page: an actuator, the drive's `shape` (name of a waveform) and its fields in `waveform`,
    and the `duration` of the simulation [s]."""

    shape: str
    waveform: dict[str, Value] = Field(max_length=20)
    duration: Value

    def experiment(self, sets: Sets = PACKAGE) -> tuple[Actuator, Waveform, float]:
        """Return the actuator, its drive and the duration [s]; raises QuantityError for a wrong value."""
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
    """Return sampling times [s, increasing] for the page's plots, and the start of the last whole period [s].

    The grid is even over the whole time and finer over the last period, for the friction loop. It is finest
    just after each of the last `MOST_RINGS` breaks of the drive, where the stage vibrates. The start is 0
    without a whole period.
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
    """A trajectory as arrays [times], in SI; `problem` says why it ends early ("" if it does not).

    `loop` has the indices of the first sample of the last period and of the first sample after that period
    (0 and the number of samples for a drive without a period). `unit` is that of positions: m, or rad for
    rotary actuators.
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
    """Simulate the state of the page and return the trajectory.

    Raises SimulationError if fewer than two samples can be computed, QuantityError for a wrong value.
    """
    actuator, waveform, duration = state.experiment(sets)
    wanted, last = sample_times(actuator, waveform, duration)
    found = follow_model(actuator, waveform, wanted, tolerance=TOLERANCE, max_steps=MOST_STEPS)
    if found.times.size < 2:
        raise SimulationError(found.outcome)
    end = last + (_period(waveform) or duration)
    first, after = np.searchsorted(found.times, [last * (1 - 1e-12), end * (1 + 1e-12)])
    y, _, x, _, force = found.samples[:, :5].T
    drive = evaluate(waveform.drive(duration), found.times)[0]  # before hysteresis and creep of the piezo
    problem = "" if found.outcome == COMPLETE else found.outcome
    loop, unit = (int(first), int(after)), unit_for(actuator, "m")
    return ShownMotion(found.times, drive, y, x, force, loop, problem, unit)


def mean_speed(state: SliderState, found: ShownMotion, sets: Sets = PACKAGE) -> float | None:
    """Return the mean speed [m/s, or rad/s] from the end of the first to the end of the last whole period.

    `found` is the trajectory that `motion` computed for `state`.

    Both instants have the same phase of the drive, so elastic deflection does not count. None if there are
    fewer than two periods. For a drive without a period: from the first to the last sample.
    """
    _, waveform, _ = state.experiment(sets)
    period, time, position = _period(waveform), found.time, found.end_effector_position
    if period is None:
        return float((position[-1] - position[0]) / (time[-1] - time[0]))
    whole = math.floor(time[-1] / period * (1 + 1e-12))
    if whole < 2:
        return None
    first, last = np.interp([period, whole * period], time, position)
    return float((last - first) / ((whole - 1) * period))


def step_curves(state: SliderState, sets: Sets = PACKAGE) -> dict[str, Array]:
    """Return the steady step per period [m, or rad] over amplitude [V] and over frequency [Hz].

    Keys: amplitude, step_over_amplitude, frequency, step_over_frequency, step (one value, of the present
    drive) and in_time (1, or 0 if points were left out because they take too long). A step is NaN if there is
    no steady stepping, if the voltage leaves the actuator's range, or if the point was left out. All arrays
    are empty for a drive without a period, an amplitude or a frequency.
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
    # Points are dense around the stage's resonance, where the step changes most.
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
    """Return a Python script that simulates the state of the page with the public functions of stickslip."""
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
    model = f'ss.load_actuator("{state.set}")'  # a saved set: its path is relative to the panel's folder
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
    """Return the line that imports a user's own law, waveform or hysteresis model; "" for the package's."""
    place = registry.origin(kind)
    if kind.__module__.startswith("own_"):
        return f"{kind.__name__} = ss.registry.use_file({place!r}).{kind.__name__}"
    return f"from {kind.__module__} import {kind.__name__}" if place else ""


def _literal(value: Any) -> str:
    return f'float("{value}")' if isinstance(value, float) and not math.isfinite(value) else repr(value)
