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
# Number of voltages of a map that are computed together: enough work for several processors, and few enough
# to check the time between them.
ROWS = 3
MAP_SECONDS = 10.0  # s of processor time for a map, five times what the package's parameter sets need
# Lowest frequency of maps, and highest one for a stage without dynamics, Hz. For others the highest is twice
# the stage's natural frequency.
SLOWEST, FASTEST = 5.0, 1000.0
# Length [s] of the recording for which half-widths of confidence intervals are predicted.
RECORDED = 0.4
KNOTS = 8  # knots of a searched drive, unless the page asks for another number
# Half-widths of at least this many times the parameter's value are shown as "not identified".
NOT_TOLD = 10.0
# Sampling of that recording: lowest rate [Hz] and samples per period. The number per period is not an
# integer, so that each period is sampled at other phases.
SAMPLED, PER_PERIOD = 2000.0, 20.3
FIELDS = ("amplitude", "frequency", "rise_fraction", "offset")  # fields of a sawtooth
# Parameters whose half-widths are predicted, if the actuator has them.
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
# Initial value and slider range of fields with a slider, in SI units of linear actuators. The other fields
# are typed and may be empty.
_SLIDERS = {
    "load": (0.0, Slider(-1.0, 1.0, "linear")),
    "voltage": (100.0, Slider(5.0, 150.0, "linear")),
    "spread": (0.1, Slider(0.0, 0.5, "linear")),
    "capacitance": (1.8e-6, Slider(1e-8, 1e-4)),
    "noise": (1e-7, Slider(1e-10, 1e-5)),
}


def fields(rotary: bool) -> list[dict[str, Any]]:
    """Return the page's input fields for linear or rotary actuators, each with its initial value as `starts`.

    A field with a slider also has the slider's range (see `sliders.shown`); one without has only name, unit
    and meaning. `starts` is None for a limit that is not set. `output` is True for a field of `OutputLimits`.
    """
    given = []
    for name, of in _FIELDS.items():
        if name in _SLIDERS:
            starts, slider = _SLIDERS[name]
            given.append(shown(name, of, slider, rotary) | {"starts": sized(starts, of.unit, rotary)})
        else:
            starts = KNOTS if name == "knots" else None
            given.append({"name": name, "unit": of.unit, "meaning": of.meaning, "starts": starts})
    return [one | {"output": one["name"] in _LIMITS} for one in given]


def _checked(model: Actuator, name: str, value: Any) -> float:
    """Return the value of the field `name` in SI; raises QuantityError if it is wrong or out of range.

    A text must have the unit for a linear or rotary actuator, as `model` is.
    """
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
    """Request for a map of the net step; `voltage` [V] is the largest amplitude of its axis."""

    voltage: Value

    def top(self, model: Actuator) -> float:
        """Return the largest voltage of the request [V]; raises QuantityError if the actuator forbids it."""
        return _taken(model, _checked(model, "voltage", self.voltage))


class TypedValue(LoadedActuator):
    """A number that was typed into the field `name` of the page."""

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
    """Limits of signal generator and amplifier, such as slew rate and current: fields of `OutputStage`."""


class DriveSearch(MapRequest):
    """Request for the drive with the highest speed.

    `spread` [N, or N m] is the tolerance of the load, ±: the lowest speed over loads within it is maximised.
    `knots` is the number of corners of the drive. `output` has the limits of generator and amplifier.
    """

    spread: Value = 0.0
    knots: Value = KNOTS
    output: OutputLimits = Field(default_factory=OutputLimits)

    def asked(self, sets: Sets) -> tuple[Actuator, dict[str, Any]]:
        """Return the actuator and the keyword arguments that all searches of `design` for a drive share."""
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
    """Request for a Pareto front: highest speed against least amplifier current or least speed ripple."""

    against: Literal["current", "ripple"] = "current"


class DesignedDrive(Strict):
    """A drive: a sawtooth, or voltages at given times joined by straight lines; all values in SI."""

    shape: Literal["Sawtooth", "PeriodicKnots"]
    fields: dict[str, float | list[float]] = Field(max_length=8)

    def waveform(self) -> Any:
        """Return the waveform; raises QuantityError for a wrong value."""
        try:
            return shape(self.shape)(**self.fields)
        except TypeError as error:
            raise QuantityError(f"drive: {error}") from None


class DrivenActuator(LoadedActuator):
    """Request with an actuator, its load and its drive."""

    drive: DesignedDrive


class InformationRequest(DrivenActuator):
    """Request for how well a recording with a drive identifies the parameters.

    `noise` [m, rad] is the standard deviation of one position sample.
    """

    noise: Value = 1e-7


def step_map(asked: MapRequest, sets: Sets) -> dict[str, Array]:
    """Return a map of the net step per period; its computation stops after `MAP_SECONDS`.

    Keys: voltage [V], frequency [Hz], net_step [m, rad], status (0: a steady step exists) and in_time (1, or
    0 if voltages were left out: their step and status are NaN). Step and status are flat arrays, with all
    frequencies of the first voltage first.
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
    """Return the fastest drive and the best sawtooth, with their speeds at each load; see `DesignedDrive`."""
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
    """Return the drives of a Pareto front, from slow to fast, with their values of both goals.

    The second goal's values are `other`, with `label` and `unit`.
    """
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
    """Return a waveform as a dictionary with the fields of `DesignedDrive`."""
    fields = {name: getattr(waveform, name) for name in FIELDS if hasattr(waveform, name)}
    if isinstance(waveform, PeriodicKnots):
        fields = {"times": [*waveform.times], "values": [*waveform.values], "period": waveform.period}
    return {"shape": type(waveform).__name__, "fields": fields}


def motion(asked: DrivenActuator, sets: Sets) -> tuple[float, dict[str, Array]]:
    """Return the mean speed [m/s, rad/s] and two periods of the periodic motion as arrays.

    Their keys: time [s], drive_voltage [V], end_effector_position [m, rad].
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
    """Return the predicted relative half-widths of the parameters' confidence intervals.

    `half_width` belongs to a recording of `RECORDED` seconds with this drive, `default_half_width` to one
    with a sawtooth of 65 V, 5 Hz. None: the recording does not identify the parameter.
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
    """Return a knot waveform shifted in time so that it starts at its lowest voltage.

    That voltage is the nearest to 0 V, at which a rig rests. Other waveforms are returned unchanged.
    """
    if not isinstance(waveform, PeriodicKnots):
        return waveform
    first = int(np.argmin(waveform.values))
    begin, order = waveform.times[first], np.roll(np.arange(len(waveform.times)), -first)
    times = [(waveform.times[i] - begin) % waveform.period for i in order]
    return waveform._replace(times=tuple(times), values=tuple(waveform.values[i] for i in order))
