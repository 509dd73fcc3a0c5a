"""Fields of the pages Explore, Design and Move: unit, meaning and slider range of each.

Units, symbols, meanings and allowed values are those of the records. The slider ranges are chosen here, as
for typical actuators; a typed value may be outside. Rotary actuators have the ranges of linear ones,
converted with the radius `ARM`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Literal, NamedTuple

from ..friction import LuGre
from ..identify.comparison.laws import example_laws
from ..physics.actuator import Actuator
from ..quantities import registry
from ..quantities.records import Quantity, quantities, sequences
from ..quantities.units import ANGLE, Coordinate, QuantityError, unit_for
from . import piezo_sliders
from .sets import PACKAGE, Sets


class Slider(NamedTuple):
    """Range of a slider, from `low` to `high` in SI units.

    On a logarithmic slider the left end means 0 if `zero` is True, and the right end infinity if `infinite`
    is True.
    """

    low: float
    high: float
    scale: Literal["log", "linear"] = "log"
    zero: bool = False
    infinite: bool = False


_MODEL = {
    "gain": Slider(1e-8, 1e-6),
    "natural_frequency": Slider(1e2, 1e5, infinite=True),
    "damping_ratio": Slider(1e-3, 2.0, zero=True),
    "stage_mass": Slider(1e-3, 10.0),
    "end_effector_mass": Slider(1e-3, 10.0),
    "external_force": Slider(-1.0, 1.0, "linear"),
    "incline": Slider(-math.pi / 2, math.pi / 2, "linear"),
    "stage_reaction": Slider(0, 1, "linear"),
    "clamped": Slider(0, 1, "linear"),
}
_PIEZO = {"hysteresis": Slider(0.0, 0.5, "linear"), "creep": Slider(0.0, 0.05, "linear")}
_FRICTION = {
    "sigma_0": Slider(1e4, 1e9),
    "sigma_1": Slider(1e-1, 1e4, zero=True),
    "sigma_2": Slider(1e-2, 1e3, zero=True),
    "coulomb_force": Slider(1e-3, 1e2),
    "stiction_force": Slider(1e-3, 1e2),
    "stribeck_velocity": Slider(1e-6, 1.0),
    "damping_velocity": Slider(1e-4, 10.0, infinite=True),
    "exponent": Slider(0.1, 10.0),
    "breakaway_deflection": Slider(1e-9, 1e-4, zero=True),
    "stiction_excess": Slider(0.0, 2.0, "linear"),
    "stiction_ratio": Slider(1.0, 3.0, "linear"),
    "attraction_rate": Slider(1.0, 1e6),
    "stiffness": Slider(1e4, 1e9),
    "strength": Slider(1e-3, 1e2),
}
_WAVEFORM = {
    "amplitude": Slider(0.0, 150.0, "linear"),
    "frequency": Slider(0.1, 2e3),
    "rise_fraction": Slider(0.05, 1.0, "linear"),
    "fall_fraction": Slider(0.05, 1.0, "linear"),
    "phase": Slider(-math.pi, math.pi, "linear"),
    "offset": Slider(0.0, 150.0, "linear"),
    "delay": Slider(0.0, 1.0, "linear"),
    "rate": Slider(1.0, 1e5),
    "rise_time": Slider(1e-4, 1.0, infinite=True),
    "start_frequency": Slider(0.1, 2e3, zero=True),
    "end_frequency": Slider(0.1, 2e3, zero=True),
    "duration": Slider(1e-3, 10.0),
}
DURATION = Slider(1e-2, 10.0)
# Slider ranges by unit, for fields without a range of their own, such as those of a user's own law or
# waveform.
_BY_UNIT = {
    "V": Slider(0.0, 150.0, "linear"),
    "V/s": Slider(1.0, 1e5),
    "Hz": Slider(0.1, 2e3),
    "s": Slider(1e-3, 10.0),
    "rad": Slider(-math.pi, math.pi, "linear"),
    "N": Slider(1e-3, 1e2),
    "N/m": Slider(1e4, 1e9),
    "N s/m": Slider(1e-2, 1e3, zero=True),
    "m": Slider(1e-9, 1e-4, zero=True),
    "m/s": Slider(1e-6, 1.0),
}
# Units of linear actuators for quantities that the page itself shows.
_UNITS = {"position": "m", "speed": "m/s", "force": "N"}
ARM = 0.01  # radius at which values of linear actuators are converted for rotary ones, m
# Exponents of the radius in the conversion of a value to a rotary actuator, by unit: m becomes rad, N becomes
# N m, kg becomes kg m².
_POWERS = {"m": -1, "N": 1, "kg": 2}
_STRIBECK_VELOCITY = 1e-3  # initial Stribeck velocity in laws made for a contact, m/s
_NO_SLIDERS = ("Constant", "Rest")  # waveforms without a change of the voltage
_ELEMENTS = ("stiffness", "strength")  # fields of a law with several values; each value has a slider
# Fields of a law that change together with other fields of the same law, in proportion to the powers given
# here, so that the law stays valid. As in fits, stiction keeps its ratio to sliding friction, and the
# breakaway deflection keeps its ratio to the presliding distance.
TIED = {
    "stiction_force": {"coulomb_force": 1},
    "breakaway_deflection": {"coulomb_force": 1, "sigma_0": -1},
}
# Initial values of waveforms' fields by name, SI.
_BEGIN = {
    "amplitude": 65.0,
    "frequency": 5.0,
    "rate": 150.0,
    "delay": 0.1,
    "start_frequency": 1.0,
    "end_frequency": 50.0,
    "duration": 1.0,
    "rise_time": 0.5,
}


def shapes() -> dict[str, Any]:
    """Return the waveform classes that the page offers, by name; every required field has a slider."""
    return {
        name: one
        for name, one in registry.waveforms.all()
        if name not in _NO_SLIDERS and hasattr(one, "_fields") and _required(one) <= set(_fields_of(one))
    }


def _required(shape: Any) -> set[str]:
    return {field for field in shape._fields if field not in shape._field_defaults}


def _fields_of(shape: Any) -> list[str]:
    """Return the names of a waveform's fields with a slider: single numbers, except the number of periods."""
    return [f for f in quantities(shape) if f != "periods" and f not in sequences(shape)]


def law_types() -> dict[str, Any]:
    """Return the classes of the friction laws that the page offers, by name; every field has a slider."""
    return {
        name: law
        for name, law in registry.laws.all()
        if tuple(quantities(law)) == law._fields and sequences(law) <= set(_ELEMENTS)
    }


def sized(value: float, unit: str, rotary: bool) -> float:
    """Return the value of a rotary actuator that has the effect of a linear actuator's at the radius `ARM`.

    `value` is in `unit`, a linear actuator's SI unit such as "N s/m". It is returned unchanged unless
    `rotary`.
    """
    over, _, under = unit.partition("/")
    power = sum(_POWERS.get(one, 0) for one in over.split()) - sum(
        _POWERS.get(one, 0) for one in under.split()
    )
    return float(f"{value * ARM**power:.12g}") if rotary and power else value


def _slider(quantity: Quantity, own: Slider | None) -> Slider:
    if own is not None:
        return own
    if quantity.unit in _BY_UNIT:
        return _BY_UNIT[quantity.unit]
    low, high = quantity.minimum or quantity.above or 0.0, quantity.maximum or quantity.below or 1.0
    return Slider(low, high if low < high < math.inf else low + 1.0, "linear")


def _middle(slider: Slider) -> float:
    if slider.scale == "log":
        return math.sqrt(slider.low * slider.high)
    return 0.5 * (slider.low + slider.high)


def _around(quantity: Quantity, value: float) -> Slider:
    """Return a slider range around a value of unknown scale: from a tenth to ten times the value.

    The limits of the quantity cut it. A value of 0 or less gives a linear range up to 1.
    """
    if value > 0.0:
        low = max(0.1 * value, quantity.minimum or quantity.above or 0.0)
        most = [end for end in (10.0 * value, quantity.maximum, quantity.below) if end is not None]
        return Slider(low, min(most), zero=quantity.minimum == 0.0)
    return Slider(min(2.0 * value, -1.0), 1.0, "linear")


def choices(offered: Sets = PACKAGE) -> dict[str, Any]:
    """Return all choices of the page, in JSON types (infinity is "inf").

    Keys:

    - "sets": for each parameter set its title, unit of positions, "model" (values of the actuator's fields)
      and "law" (name of its friction law). "friction" has the values of every law for the same contact.
      "piezo" has the sliders of a hysteresis model without play operators. A set whose law has no sliders is
      left out;
    - "by_unit": for "m" and "rad" (linear and rotary actuators), see `_kind`;
    - "shapes": fields of each waveform, and "start": their initial values;
    - "tied": see `TIED`;
    - "duration": the field for the duration of the simulation.
    """
    sets, known, drives = {}, law_types(), shapes()
    for name, (title, actuator) in offered.offered().items():
        law = type(actuator.friction).__name__
        # A user's own law without sliders cannot be shown.
        if law not in known:
            continue
        laws = laws_like(actuator.friction, known, actuator.rotary)
        laws[law] = actuator.friction
        bent = piezo_sliders.values(actuator.piezo)
        sets[name] = {
            "title": title,
            "unit": unit_for(actuator, "m"),
            "model": {field: plain(getattr(actuator, field)) for field in _model(actuator.rotary)} | bent,
            "piezo": [
                shown(f, q, _around(q, bent[f])) for f, q in piezo_sliders.own_fields(actuator.piezo).items()
            ],
            "law": law,
            "friction": {kind: values_of(example) for kind, example in laws.items()},
        }
    ranges = {
        name: {f: _slider(quantities(shape)[f], _WAVEFORM.get(f)) for f in _fields_of(shape)}
        for name, shape in drives.items()
    }
    start = {
        name: {f: _middle(slider) for f, slider in ranges[name].items()} | shape._field_defaults | _BEGIN
        for name, shape in drives.items()
    }
    # Their offset is in the middle of a piezo stack's voltage range, because they also swing below it.
    for swinging in ("Sine", "Chirp"):
        start[swinging] |= {"offset": 75.0}
    return {
        "sets": sets,
        "by_unit": {
            unit: _kind(known, unit == "rad") for unit in {one["unit"]: None for one in sets.values()}
        },
        "shapes": {
            name: [
                _described(shape, f, slider) | {"meaning": f.replace("_", " ")}
                for f, slider in ranges[name].items()
            ]
            for name, shape in drives.items()
        },
        "start": {name: {f: plain(start[name][f]) for f in ranges[name]} for name in drives},
        "tied": TIED,
        "duration": {
            "name": "duration",
            "unit": "s",
            "symbol": "T",
            "meaning": "length of the experiment",
            **DURATION._asdict(),
        },
    }


def _model(rotary: bool) -> dict[str, Slider]:
    """Return the sliders of an actuator's fields by name; a rotary actuator has no incline."""
    return {field: slider for field, slider in _MODEL.items() if not (rotary and field == "incline")}


def _kind(known: dict[str, Any], rotary: bool) -> dict[str, Any]:
    """Return "units" of the page's quantities, and the fields of "model" and of each law in "laws".

    All are for linear, or for rotary actuators. `known` are the classes of the laws by name.
    """
    return {
        "units": {name: ANGLE.unit(unit) if rotary else unit for name, unit in _UNITS.items()},
        "model": [
            *(_described(Actuator, field, slider, rotary) for field, slider in _model(rotary).items()),
            *(shown(field, piezo_sliders.FIELDS[field], slider) for field, slider in _PIEZO.items()),
        ],
        "laws": {
            name: [
                _described(law, f, _slider(q, _FRICTION.get(f)), rotary) for f, q in quantities(law).items()
            ]
            for name, law in known.items()
        },
    }


def settings(starts: Any, names: Sequence[str], along: Coordinate) -> list[dict[str, Any]]:
    """Return some fields of a record as the page's fields: "name", "unit", "meaning", initial value "starts".

    Args:
        starts: record of a linear actuator with the initial values, which are converted for rotary ones.
        names: names of the record's fields.
        along: `LENGTH` for linear, `ANGLE` for rotary actuators.
    """
    known = quantities(type(starts))
    return [
        {
            "name": name,
            "unit": along.unit(known[name].unit),
            "meaning": known[name].meaning,
            "starts": sized(getattr(starts, name), known[name].unit, along is ANGLE),
        }
        for name in names
    ]


def laws_like(law: Any, known: dict[str, Any], rotary: bool = False) -> dict[str, Any]:
    """Return a law of each known type, by name, with parameters of the same contact as `law`.

    A type is left out if it does not accept the values found for it.

    Args:
        law: friction law of the contact.
        known: classes of the laws, by name.
        rotary: True for a rotary actuator.
    """
    contact = law
    if not isinstance(law, LuGre):
        force = getattr(law, "coulomb_force", sized(0.5, "N", rotary))
        stiffness = getattr(law, "sigma_0", sized(1.4e6, "N/m", rotary))
        contact = LuGre(stiffness, getattr(law, "sigma_1", sized(35.0, "N s/m", rotary)), 0.0, force, force)
    speed = sized(_STRIBECK_VELOCITY, "m/s", rotary)
    examples = example_laws(contact, stribeck_velocity=speed, sigma_2=0.0)
    found = {type(one).__name__: one for one in examples.values()}
    for name, kind in known.items():
        if name not in found:
            with suppress(QuantityError, TypeError):  # a user's own law may refuse these values
                found[name] = kind(**_values_like(kind, contact, rotary))
    return found


def _values_like(kind: Any, contact: LuGre, rotary: bool) -> dict[str, Any]:
    """Return values for the fields of a user's own law with the class `kind`, by name.

    A value is that of the field of the same name in `contact`, else the field's default, else the middle of
    its slider.
    """
    shared = {f: value for f, value in contact._asdict().items() if f in kind._fields}
    return {
        f: kind._field_defaults.get(f, sized(_middle(_slider(q, _FRICTION.get(f))), q.unit, rotary))
        for f, q in quantities(kind).items()
    } | shared


def values_of(law: Any) -> dict[str, Any]:
    """Return the values of a law by name of their slider: "stiffness_1" for the first of several elements."""
    found = {}
    for field, value in law._asdict().items():
        if isinstance(value, tuple):
            found |= {f"{field}_{i}": v for i, v in enumerate(value, 1)}
        else:
            found[field] = plain(value)
    return found


def plain(value: Any) -> Any:
    """Return the value in a JSON type: infinity becomes "inf", other values are returned unchanged."""
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _described(record: Any, field: str, slider: Slider, rotary: bool = False) -> dict[str, Any]:
    quantity = quantities(record).get(field)
    if quantity is None:
        meaning = {
            "stage_reaction": "friction acts back on the stage",
            "clamped": "end-effector fixed to the stage",
        }[field]
        return {"name": field, "switch": True, "meaning": meaning}
    return shown(field, quantity, slider, rotary)


def shown(field: str, quantity: Quantity, slider: Slider, rotary: bool = False) -> dict[str, Any]:
    """Return a field as pages read it, a dictionary with "name", "unit", "symbol", "meaning" and its slider.

    The fields of the slider are "low", "high", "scale", "zero" and "infinite". `quantity` and `slider` are
    for linear actuators; for `rotary` units and range are converted.
    """
    ends = {name: sized(getattr(slider, name), quantity.unit, rotary) for name in ("low", "high")}
    return {
        "name": field,
        "unit": ANGLE.unit(quantity.unit) if rotary else quantity.unit,
        "symbol": quantity.symbol,
        "meaning": quantity.meaning,
        **slider._replace(**ends)._asdict(),
    }
