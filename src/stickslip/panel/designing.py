"""Answers to the Design page: step map, searches, front, motion, information in a recording."""

from __future__ import annotations

import math
import time
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from .. import design
from ..design.optimised import motion_by
from ..design.waveforms import COUNTS
from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.input_file import Strict, fields_of
from ..quantities.progress import Progress
from ..quantities.records import Quantity, quantities
from ..quantities.units import QuantityError, coordinate_of, unit_for
from ..waveform import PeriodicKnots
from ..waveform.signal import Waveform, shape
from .exploration import Model, Value
from .sets import Sets
from .sliders import Slider, shown, sized

Array = NDArray[np.float64]

# Points of a map along voltage and frequency; tolerance of each step, m.
VOLTAGES, FREQUENCIES, TOLERANCE = 33, 41, 1e-9
# Rows of a map that are computed together: enough for several processors, few enough to check the time.
ROWS = 3
MAP_SECONDS = 10.0  # s of computing for a map, five times what the package's parameter sets need
# Hz: lowest frequency of maps, and highest one unless the stage's natural frequency gives it.
SLOWEST, FASTEST = 5.0, 1000.0
# s: length of the recording for which half-widths are predicted.
RECORDED = 0.4
KNOTS = 8  # knots of a searched drive, unless the page asks for another number
# Relative half-widths from here on are shown as "not identified".
NOT_TOLD = 10.0
# Lowest sampling rate, Hz; samples per period. A fraction samples each period at other phases.
SAMPLED, PER_PERIOD = 2000.0, 20.3
FIELDS = ("amplitude", "frequency", "rise_fraction", "offset")  # of a sawtooth
WANTED = ("sigma_0", "sigma_1", "coulomb_force", "natural_frequency", "damping_ratio")

_LOAD = Quantity("N", "F", "load", minimum=-1e3, maximum=1e3)
_SPREAD = Quantity("N", "", "spread of the load, ±", minimum=0.0, maximum=1e3)
_VOLTAGE = Quantity("V", "", "maximum voltage", above=0.0, maximum=1e4)
_KNOTS = Quantity("", "", "knots of the drive", minimum=COUNTS["knots"][0], maximum=COUNTS["knots"][1])
_NOISE = Quantity("m", "", "noise of a position sample", above=0.0, maximum=1e-3)
# Limits of generator and amplifier that the page asks for.
_LIMITS = ("capacitance", "update_rate", "points", "step", "current", "slew_rate")
_FIELDS: dict[str, Quantity] = {
    "load": _LOAD,
    "voltage": _VOLTAGE,
    "spread": _SPREAD,
    "noise": _NOISE,
    "knots": _KNOTS,
    **{name: quantities(OutputStage)[name] for name in _LIMITS},
}
# Initial value and slider range, for linear actuators. The other fields are typed and may be empty.
_SLIDERS = {
    "load": (0.0, Slider(-1.0, 1.0, "linear")),
    "voltage": (100.0, Slider(5.0, 150.0, "linear")),
    "spread": (0.1, Slider(0.0, 0.5, "linear")),
    "capacitance": (1.8e-6, Slider(1e-8, 1e-4)),
    "noise": (1e-7, Slider(1e-10, 1e-5)),
}


def fields(rotary: bool) -> list[dict[str, Any]]:
    """Return the page's fields for linear or rotary actuators, each with its initial value as `starts`.

    A field with a slider has its range, see `sliders.shown`. A field without one has only unit and meaning;
    `starts` is None for a limit that is not set.
    """
    given = []
    for name, of in _FIELDS.items():
        if name in _SLIDERS:
            starts, slider = _SLIDERS[name]
            given.append(shown(name, of, slider, rotary) | {"starts": sized(starts, of.unit, rotary)})
        else:
            starts = KNOTS if name == "knots" else None
            given.append({"name": name, "unit": of.unit, "meaning": of.meaning, "starts": starts})
    return given


def _checked(model: Actuator, name: str, value: Any) -> float:
    """Return a field's value in the unit of the model, linear or rotary; raises QuantityError if it is
    wrong."""
    quantity = _FIELDS[name]
    return quantity.along(coordinate_of(model)).check(value, name)


class LoadedActuator(Model):
    """An actuator under a load: an external force (or torque) on the end-effector, positive towards +x."""

    load: Value = 0.0

    def loaded(self, sets: Sets) -> Actuator:
        """Return the actuator with the load; raises QuantityError for a wrong value."""
        model = self.actuator(sets)
        return model.replace(external_force=model.external_force + _checked(model, "load", self.load))


class MapRequest(LoadedActuator):
    """Request for a step map from 0 V to the largest voltage."""

    voltage: Value

    def top(self, model: Actuator) -> float:
        """Return the largest voltage [V]; raises QuantityError if the actuator does not allow it."""
        return _taken(model, _checked(model, "voltage", self.voltage))


class TypedValue(LoadedActuator):
    """A number that was typed on the page."""

    name: str
    value: Value

    def check(self, sets: Sets) -> None:
        """Raise QuantityError if the value is out of range for its field, or if there is no such field.

        `sets` are the parameter sets on offer; one of them is the base of the page's actuator.
        """
        model = self.actuator(sets)
        if self.name not in _FIELDS:
            raise QuantityError(f"there is no field {self.name!r:.40}; there are {', '.join(_FIELDS)}")
        value = _checked(model, self.name, self.value)
        if self.name == "voltage":
            _taken(model, value)


def _taken(model: Actuator, volts: float) -> float:
    if volts > model.max_voltage:
        most = f"it must be <= {model.max_voltage:g} V, which the actuator takes"
        raise QuantityError(f"voltage = {volts:g} V is out of range: {most}")
    return volts


class OutputLimits(fields_of(OutputStage, *_LIMITS)):
    """Limits of generator and amplifier, see `OutputStage`."""


class DriveSearch(MapRequest):
    """Request for the fastest drive.

    `spread` [N] is the tolerance of the load, ±; the worst case counts. `output` has the limits of generator
    and amplifier.
    """

    spread: Value = 0.0
    knots: Value = KNOTS
    output: OutputLimits = Field(default_factory=lambda: OutputLimits())

    def asked(self, sets: Sets) -> tuple[Actuator, dict[str, Any]]:
        """Return the model and the arguments that all searches for a drive have in common."""
        model = self.loaded(sets)
        spread, unit = _checked(model, "spread", self.spread), unit_for(model, "N")
        scenarios = [
            design.Scenario(f"{sign}{spread:.4g} {unit}", external_force=model.external_force + change)
            for sign, change in (("-", -spread), ("+", spread))
            if spread
        ]
        top = self.top(model)
        knots = int(_checked(model, "knots", self.knots))
        output = OutputStage(**self.output.given)
        return model, {"knots": knots, "max_voltage": top, "scenarios": scenarios, "output": output}


class FrontRequest(DriveSearch):
    """Request for a front of speed against another goal."""

    against: Literal["current", "ripple"] = "current"


class DesignedDrive(Strict):
    """A sawtooth, or values joined by straight lines, in SI."""

    shape: Literal["Sawtooth", "PeriodicKnots"]
    fields: dict[str, float | list[float]] = Field(max_length=8)

    def waveform(self) -> Any:
        """Return the waveform; raises QuantityError for a wrong value."""
        try:
            return shape(self.shape)(**self.fields)
        except TypeError as error:
            raise QuantityError(f"drive: {error}") from None


class DrivenActuator(LoadedActuator):
    """An actuator and its drive."""

    drive: DesignedDrive


class InformationRequest(DrivenActuator):
    """Request for the information in a recording; `noise` [m, rad] is the error of one sample."""

    noise: Value = 1e-7


def step_map(asked: MapRequest, sets: Sets) -> dict[str, Array]:
    """Return a map of the net step; rows that would take longer than `MAP_SECONDS` are left out.

    Keys: voltage [V], frequency [Hz], net_step [m, rad; voltage x frequency, row by row], status (0: a steady
    step exists) and in_time (1; 0 if rows were left out: their step and status are NaN).
    """
    model = asked.loaded(sets)
    top = asked.top(model)
    last = FASTEST if model.static else min(model.natural_frequency / math.pi, 1e4)
    voltage = np.linspace(top / VOLTAGES, top, VOLTAGES)
    frequency = np.geomspace(SLOWEST, max(last, 2.0 * SLOWEST), FREQUENCIES)
    step, status = np.full((2, VOLTAGES, FREQUENCIES), np.nan)
    begun, done = time.process_time(), 0
    while done < VOLTAGES and (not done or time.process_time() - begun < MAP_SECONDS):
        rows = slice(done, done + ROWS)
        found = design.step_map(model, voltage=voltage[rows], frequency=frequency, tolerance=TOLERANCE)
        grid = found.transpose("voltage", "frequency")
        step[rows], status[rows] = grid.net_step.values, grid.status.values
        done += ROWS
    return {
        "voltage": voltage,
        "frequency": frequency,
        "net_step": step.ravel(),
        "status": status.ravel(),
        "in_time": np.array([float(done >= VOLTAGES)]),
    }


def searched(asked: DriveSearch, sets: Sets, progress: Progress) -> dict[str, Any]:
    """Return the fastest drive and the best sawtooth, with their speeds in each condition."""
    model, common = asked.asked(sets)
    found = design.optimise_waveform(model, goal="speed", progress=progress, **common)
    rows = zip(found.conditions.names, found.values.tolist(), found.sawtooth_values.tolist(), strict=True)
    return {
        "drive": described(found.waveform),
        "sawtooth": described(found.sawtooth),
        "value": found.value,
        "sawtooth_value": found.sawtooth_value,
        "conditions": [dict(zip(("name", "value", "sawtooth"), row, strict=True)) for row in rows],
        "evaluations": found.evaluations,
        "interrupted": found.interrupted,
        "fell_back": found.fell_back,
    }


def front(asked: FrontRequest, sets: Sets, progress: Progress) -> dict[str, Any]:
    """Return drives from slow to fast, with their values of both goals."""
    model, common = asked.asked(sets)
    other: Any = "ripple"
    if asked.against == "current":
        other = design.Current(common["output"].capacitance)
    found = design.waveform_front(model, goals=("speed", other), progress=progress, **common)
    _, second = (name for name in found.table if name != "frequency")
    return {
        "speed": found.table.speed.values.tolist(),
        "speed_unit": str(found.table.speed.attrs["units"]),
        "other": found.table[second].values.tolist(),
        "label": str(found.table[second].attrs["long_name"]),
        "unit": str(found.table[second].attrs["units"]),
        "drives": [described(one) for one in found.waveforms],
        "evaluations": found.evaluations,
        "interrupted": found.interrupted,
    }


def described(waveform: Waveform) -> dict[str, Any]:
    """Return a waveform in the form that `DesignedDrive` reads."""
    fields = {name: getattr(waveform, name) for name in FIELDS if hasattr(waveform, name)}
    if isinstance(waveform, PeriodicKnots):
        fields = {"times": [*waveform.times], "values": [*waveform.values], "period": waveform.period}
    return {"shape": type(waveform).__name__, "fields": fields}


def motion(asked: DrivenActuator, sets: Sets) -> tuple[float, dict[str, Array]]:
    """Return the speed [m/s, rad/s] and two periods of the periodic motion.

    Keys of the second: time [s], drive_voltage [V], end_effector_position [m, rad].
    """
    moved = motion_by(asked.loaded(sets), {"": asked.drive.waveform()}).isel(drive=0)
    volts = np.round(moved.drive_voltage.values, 6)  # rounding errors at the end are not a voltage
    period, x = float(moved.period), moved.end_effector_position.values
    return float(x[-1]) / period, {
        "time": period * np.append(moved.phase.values, 1.0 + moved.phase.values[1:]),
        "drive_voltage": np.append(volts, volts[1:]),
        "end_effector_position": np.append(x, x[-1] + x[1:]),
    }


def told(asked: InformationRequest, sets: Sets) -> dict[str, Any]:
    """Return the half-widths of the parameters from a recording with this drive and from one at 65 V, 5 Hz.

    A half-width is None if the recording does not identify the parameter.
    """
    model = asked.loaded(sets)
    has = {name for name, value in model.friction._asdict().items() if isinstance(value, float) and value > 0}
    has |= set() if model.static else {"natural_frequency", "damping_ratio"}
    waveform = asked.drive.waveform()
    plan = design.plan_experiment(
        model,
        {"this drive": waveform},
        free=[name for name in WANTED if name in has],
        noise=_checked(model, "noise", asked.noise),
        duration=RECORDED,
        sample_rate=max(SAMPLED, PER_PERIOD / waveform.period),
        recordings=1,
    )
    of = plan.dataset
    names = ("name", "value", "unit", "half_width", "default_half_width")
    columns = [of[n].values.tolist() for n in ("parameter", "value", "unit")]
    columns += [[x if x < NOT_TOLD else None for x in of[n].values.tolist()] for n in names[3:]]
    rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
    return {"duration": RECORDED, "parameters": rows}


def from_lowest(waveform: Any) -> Any:
    """Return the same knots, starting at the lowest voltage: the nearest to a rig at rest."""
    if not isinstance(waveform, PeriodicKnots):
        return waveform
    first = int(np.argmin(waveform.values))
    begin, order = waveform.times[first], np.roll(np.arange(len(waveform.times)), -first)
    times = [(waveform.times[i] - begin) % waveform.period for i in order]
    return waveform._replace(times=tuple(times), values=tuple(waveform.values[i] for i in order))
