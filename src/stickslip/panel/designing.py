"""Requests of the Design page and their answers: input fields, step map, search for a drive, Pareto front,
motion, and expected confidence intervals.

A request contains an actuator with its load; only `DesignedDrive` is a drive alone. The functions that answer
a request also take `sets`, the parameter sets on offer, and raise QuantityError or SimulationError for values
that cannot be used.
"""

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

# VOLTAGES, FREQUENCIES: numbers of points of a map along its axes. TOLERANCE: tolerance of each computed
# step, m (or rad).
VOLTAGES, FREQUENCIES, TOLERANCE = 33, 41, 1e-9
# Number of voltages of a map that are computed together, between two checks of the computing time. It gives
# several processors enough work.
ROWS = 3
# Processor time after which the rest of a map is left out, s. It is five times what the package's parameter
# sets need.
MAP_SECONDS = 10.0
# SLOWEST: lowest frequency of a map, Hz. FASTEST: highest frequency, Hz, for a stage without dynamics. For a
# stage with dynamics the highest frequency is twice its natural frequency, at most 10 kHz and at least twice
# SLOWEST.
SLOWEST, FASTEST = 5.0, 1000.0
# Length of the recording for which `told` predicts confidence intervals, s.
RECORDED = 0.4
KNOTS = 8  # default number of corners (knots) per period of the drive that a search finds
# Relative half width of a confidence interval (half width over value) from which on the page shows the
# parameter as "not identified".
NOT_TOLD = 10.0
# Sampling of the recording for which `told` predicts intervals. SAMPLED: lowest rate, Hz. PER_PERIOD:
# smallest number of samples per period of the drive; not an integer, so that each period is sampled at other
# phases.
SAMPLED, PER_PERIOD = 2000.0, 20.3
FIELDS = ("amplitude", "frequency", "rise_fraction", "offset")  # fields of a `Sawtooth` on the page
# Parameters whose confidence intervals `told` predicts, if the actuator has them.
WANTED = ("sigma_0", "sigma_1", "coulomb_force", "natural_frequency", "damping_ratio")

_LOAD = Quantity("N", "F", "load", minimum=-1e3, maximum=1e3)
_SPREAD = Quantity("N", "", "spread of the load, ±", minimum=0.0, maximum=1e3)
_VOLTAGE = Quantity("V", "", "maximum voltage", above=0.0, maximum=1e4)
_KNOTS = Quantity("", "", "knots of the drive", minimum=COUNTS["knots"][0], maximum=COUNTS["knots"][1])
_NOISE = Quantity("m", "", "noise of a position sample", above=0.0, maximum=1e-3)
# Fields of `OutputStage` that the page offers as limits of generator and amplifier.
_LIMITS = ("capacitance", "update_rate", "points", "step", "current", "slew_rate")
_FIELDS: dict[str, Quantity] = {
    "load": _LOAD,
    "voltage": _VOLTAGE,
    "spread": _SPREAD,
    "noise": _NOISE,
    "knots": _KNOTS,
    **{name: quantities(OutputStage)[name] for name in _LIMITS},
}
# Initial value and slider range of the fields with a slider, in SI units of linear actuators. Fields without
# an entry are typed, and may be empty.
_SLIDERS = {
    "load": (0.0, Slider(-1.0, 1.0, "linear")),
    "voltage": (100.0, Slider(5.0, 150.0, "linear")),
    "spread": (0.1, Slider(0.0, 0.5, "linear")),
    "capacitance": (1.8e-6, Slider(1e-8, 1e-4)),
    "noise": (1e-7, Slider(1e-10, 1e-5)),
}


def fields(rotary: bool) -> list[dict[str, Any]]:
    """Return the page's input fields for linear or rotary actuators, in the order of the page.

    Each field has name, unit, meaning and `starts`, its initial value in SI (None: empty). A field with a
    slider also has symbol and slider range, see `sliders.shown`. `output` is True for a field of
    `OutputLimits`.
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
    """Return the value of the page's field `name` in SI.

    The value is a number in SI, or a text with a unit. A text needs the unit for a linear or for a rotary
    actuator, as `model` is. Raises QuantityError for another unit, or a value outside the field's limits.
    """
    quantity = _FIELDS[name]
    return quantity.along(coordinate_of(model)).check(value, name)


class LoadedActuator(Model):
    """Request with an actuator under a load.

    `load` is added to the actuator's external force on the end-effector: N, or N m for rotary actuators,
    positive in the direction of positive positions.
    """

    load: Value = 0.0

    def loaded(self, sets: Sets) -> Actuator:
        """Return the actuator with the load added to its external force; QuantityError for a wrong value."""
        model = self.actuator(sets)
        return model.replace(external_force=model.external_force + _checked(model, "load", self.load))


class MapRequest(LoadedActuator):
    """Request for a map of the net step per period over amplitude, up to `voltage` [V], and frequency."""

    voltage: Value

    def top(self, model: Actuator) -> float:
        """Return the largest voltage [V]; raises QuantityError if it is wrong, or too high for the
        actuator."""
        return _taken(model, _checked(model, "voltage", self.voltage))


class TypedValue(LoadedActuator):
    """Request to check `value`, a number in SI or a text with a unit, typed into the field `name` of the
    page."""

    name: str
    value: Value

    def check(self, sets: Sets) -> None:
        """Raise QuantityError if the value is out of range for its field, or if there is no such field.

        `sets` are the parameter sets on offer. "voltage" must also not exceed the actuator's maximum voltage.
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
    """Limits of signal generator and amplifier, such as slew rate and current: some fields of `OutputStage`.

    A field that is left out is not limited.
    """


class DriveSearch(MapRequest):
    """Request for the drive with the highest speed.

    `spread` [N, or N m for rotary actuators] is half the width of the range of loads. The lowest speed over
    the loads -`spread`, 0 and +`spread` around the given load is maximised. `knots` is the number of corners
    of the drive per period. `voltage` [V] is the largest voltage. `output` has the limits of generator and
    amplifier.
    """

    spread: Value = 0.0
    knots: Value = KNOTS
    output: OutputLimits = Field(default_factory=OutputLimits)

    def asked(self, sets: Sets) -> tuple[Actuator, dict[str, Any]]:
        """Return the actuator under its load, and the keyword arguments of the searches for a drive.

        The arguments are those that `design.optimise_waveform` and `design.waveform_front` share: knots,
        max_voltage, scenarios (the loads at -`spread` and +`spread`; none if `spread` is 0) and output (the
        limits).
        """
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
    """Request for a Pareto front of drives: highest speed against a second goal.

    `against` is the second goal: the least peak current of the amplifier ("current", which needs the piezo's
    capacitance), or the least ripple of the speed ("ripple"). The other fields are those of `DriveSearch`.
    """

    against: Literal["current", "ripple"] = "current"


class DesignedDrive(Strict):
    """Periodic drive: a sawtooth, or voltages joined by straight lines.

    `shape` is the name of the waveform. `fields` are its fields in SI: those of `FIELDS` for "Sawtooth";
    `times` [s], `values` [V] and `period` [s] for "PeriodicKnots".
    """

    shape: Literal["Sawtooth", "PeriodicKnots"]
    fields: dict[str, float | list[float]] = Field(max_length=8)

    def waveform(self) -> Any:
        """Return the waveform as an object; raises QuantityError for an unknown field or a wrong value."""
        try:
            return shape(self.shape)(**self.fields)
        except TypeError as error:
            raise QuantityError(f"drive: {error}") from None


class DrivenActuator(LoadedActuator):
    """Request with an actuator, its load and its periodic drive."""

    drive: DesignedDrive


class InformationRequest(DrivenActuator):
    """Request for the precision of parameters from a recording under a drive.

    `noise` [m, or rad] is the standard deviation of the noise of one position sample.
    """

    noise: Value = 1e-7


def step_map(asked: MapRequest, sets: Sets) -> dict[str, Array]:
    """Return a map of the net step per period over amplitude and frequency of a sawtooth drive.

    Keys: "voltage" [V] and "frequency" [Hz], the axes; "net_step" [m, or rad] and "status" (0: a steady step
    exists; otherwise see `design.step_map`), flat arrays with all frequencies of the first voltage first;
    "in_time", one value: 1, or 0 if the computation was ended after `MAP_SECONDS`. Step and status of the
    remaining voltages are then NaN.
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
    """Search for the drive with the highest speed, and for the best sawtooth; return both and their speeds.

    Keys: "drive" and "sawtooth" (see `described`); "value" and "sawtooth_value", their lowest speeds over all
    loads [m/s, or rad/s]; "conditions", for each load its name and both speeds, "value" and "sawtooth";
    "evaluations", the number of computed periodic motions; "interrupted", True if the search was stopped;
    "fell_back", True if no better drive was found, so that "drive" is the sawtooth.
    """
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
    """Search for the Pareto front of the speed and a second goal; return its drives, from slow to fast.

    Keys: lists over the drives, "drives" (see `described`), "speed" and "other" (second goal); "speed_unit";
    "label" and "unit" of the second goal; "evaluations", the number of computed periodic motions;
    "interrupted", True if the search was stopped.
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
    """Return a waveform in the form of `DesignedDrive`: its name as "shape" and its values in SI as
    "fields"."""
    fields = {name: getattr(waveform, name) for name in FIELDS if hasattr(waveform, name)}
    if isinstance(waveform, PeriodicKnots):
        fields = {"times": [*waveform.times], "values": [*waveform.values], "period": waveform.period}
    return {"shape": type(waveform).__name__, "fields": fields}


def motion(asked: DrivenActuator, sets: Sets) -> tuple[float, dict[str, Array]]:
    """Return the mean speed [m/s, or rad/s] and the curves of two periods of the periodic motion.

    The curves are arrays by name: "time" [s] from 0, "drive_voltage" [V], and "end_effector_position" [m, or
    rad], which is 0 at the start.
    """
    moved = motion_by(asked.loaded(sets), {"": asked.drive.waveform()}).isel(drive=0)
    volts = np.round(moved.drive_voltage.values, 6)  # removes rounding errors, such as 1e-15 V instead of 0
    period, x = float(moved.period), moved.end_effector_position.values
    return float(x[-1]) / period, {
        "time": period * np.append(moved.phase.values, 1.0 + moved.phase.values[1:]),
        "drive_voltage": np.append(volts, volts[1:]),
        "end_effector_position": np.append(x, x[-1] + x[1:]),
    }


def told(asked: InformationRequest, sets: Sets) -> dict[str, Any]:
    """Predict the confidence intervals of the parameters from a recording with the drive of the request.

    Keys: "duration" of the recording, `RECORDED` [s]; "parameters", a list with a dictionary per parameter.
    Its keys are "name", "value" and "unit" (SI), "half_width" (half the width of the interval over the value)
    and "default_half_width". The latter is for a sawtooth of 65 V, or less if the actuator takes less, at
    5 Hz. A half width is None if the recording does not identify the parameter, see `NOT_TOLD`.
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
    """Return a `PeriodicKnots` waveform shifted in time so that it starts at its lowest voltage.

    The lowest voltage is nearest to the 0 V of a rig at rest. Other waveforms are returned unchanged.
    """
    if not isinstance(waveform, PeriodicKnots):
        return waveform
    first = int(np.argmin(waveform.values))
    begin, order = waveform.times[first], np.roll(np.arange(len(waveform.times)), -first)
    times = [(waveform.times[i] - begin) % waveform.period for i in order]
    return waveform._replace(times=tuple(times), values=tuple(waveform.values[i] for i in order))
