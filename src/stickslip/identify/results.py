"""Conversion of actuators, piezos and signal chains to numbers with units for results.json, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..friction import NormalForce
from ..parameters.load import SetEntry, build
from ..physics.actuator import Actuator, StageModes
from ..physics.piezo import Piezo
from ..quantities import registry
from ..quantities.records import Quantity, quantities, quantities_of
from ..quantities.units import QuantityError
from ..recording.chain import Chain


def model_numbers(model: Actuator) -> dict[str, Any]:
    """Return an actuator as nested dictionaries for results.json; `model_of` restores the actuator.

    Keys are "actuator", "friction" and, if present, "normal_force", "further_modes" and "piezo", each with
    the fields as {"value", "unit"} (texts, True and False as they are); and the entries that name the law's
    type. Fields without a finite value, which are defaults, are left out.
    """
    found = {
        "actuator": _fields(model),
        **registry.laws.written(type(model.friction)),
        "friction": _fields(model.friction, model),
    }
    for name in ("normal_force", "further_modes"):
        if (part := getattr(model, name)) is not None:
            found[name] = _fields(part, model)
    return found if model.piezo is None else {**found, "piezo": piezo_numbers(model.piezo)}


def piezo_numbers(piezo: Piezo) -> dict[str, Any]:
    """Return a piezo for results.json: for "hysteresis" and "creep" the type and "values", a dictionary of
    fields as {"value", "unit"}; a part that the piezo lacks is left out."""
    return {
        part: {**registry.piezos.written(type(one)), "values": _fields(one)}
        for part, one in piezo._asdict().items()
        if one is not None
    }


def piezo_of(numbers: Mapping[str, Any]) -> Piezo:
    """Return the piezo that `piezo_numbers` has written, from the numbers read from results.json. Raises
    QuantityError if a value is missing, out of range, or in a wrong unit."""
    return Piezo(
        **{
            part: _made(registry.piezos.of_results(one), one["values"], f"piezo.{part}")
            for part, one in numbers.items()
        }
    )


def chain_numbers(chain: Chain) -> dict[str, Any]:
    """Return the fields of a signal chain (amplifier to samples) for results.json, by name, as {"value",
    "unit"}; an infinite slew rate, the default, is left out."""
    return _fields(chain)


def chain_of(numbers: Mapping[str, Any]) -> Chain:
    """Return the signal chain in the numbers of results.json or, if they contain none, a chain with the
    fitted delay and offset among their "parameters".

    Raises:
        QuantityError: a field is missing, out of range, or in a unit that it cannot have.
    """
    if "signal_chain" in numbers:
        fields = numbers["signal_chain"]
        return _made(Chain, fields, "signal_chain", _in_rad(_entries(fields, "signal_chain")))
    known = _entries(numbers.get("parameters", {}), "parameters")
    own = {k: v for k, v in known.items() if k in ("delay", "offset")}
    return build(Chain, own, "parameters", _in_rad(own))


def numbers_of_fit(numbers: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the numbers of the identification in a results.json: all of them or, in the results of a job
    with several steps, those of the step that fitted a model.

    Raises:
        QuantityError: several steps of the job fitted a model.
    """
    if "model" in numbers:
        return numbers
    steps = {
        name: one
        for name, one in numbers.items()
        if isinstance(one, Mapping) and "model" in one and "parameters" in one
    }
    if len(steps) > 1:
        raise QuantityError(
            f"the steps {', '.join(steps)} have fitted a model each: name the results of one, such as "
            "steps/1_identify.json beside this file"
        )
    return next(iter(steps.values()), numbers)


def _in_rad(entries: Mapping[str, Any]) -> bool:
    """Return True if the offset among the fields of a signal chain is an angle."""
    return "offset" in entries and entries["offset"].unit == "rad"


def _fields(record: Any, owner: Any = None) -> dict[str, Any]:
    return _written(quantities_of(record, owner), record._asdict())


def _written(known: Mapping[str, Quantity], values: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, bool | str):
            found[name] = value
        elif name in known and value is not None and np.all(np.isfinite(value)):
            found[name] = {"value": value, "unit": known[name].unit}
    return found


def model_of(numbers: Mapping[str, Any]) -> Actuator:
    """Return the actuator that `model_numbers` wrote, from the numbers read from results.json.

    Raises:
        QuantityError: the numbers are not of an actuator, or a field is missing, out of range, or in a unit
            that it cannot have.
    """
    try:
        turns = numbers["actuator"].get("rotary") is True
        law = registry.laws.of_results(numbers)
        own: dict[str, Any] = {"friction": _made(law, numbers["friction"], "friction", turns)}
        own["piezo"] = piezo_of(numbers["piezo"]) if "piezo" in numbers else None
        for part, of in (("normal_force", NormalForce), ("further_modes", StageModes)):
            own[part] = _made(of, numbers[part], part, turns) if part in numbers else None
        return _made(Actuator, numbers["actuator"], "actuator", turns, **own)
    except (KeyError, TypeError, AttributeError) as error:
        raise QuantityError(
            f"there is no actuator in the results ({type(error).__name__}: {error})"
        ) from error


def _made(record_type: Any, fields: Any, where: str, turns: bool = False, **given: Any) -> Any:
    """Return an object of a record class from the values and units that `_fields` wrote.

    Args:
        record_type: class of the record.
        fields: values and units by name; fields with finite defaults must be present, too.
        where: place in the file for messages.
        turns: True for a rotary actuator, with angles and torques.
        given: further fields of the record, by name.

    Raises:
        QuantityError: a field is missing, out of range, or in a unit that it cannot have.
    """
    entries = _entries(fields, where)
    for name, default in _written(quantities(record_type), record_type._field_defaults).items():
        if name not in entries:
            raise QuantityError(f"{where}: [{name}] is missing")
        if isinstance(default, bool) and not isinstance(entries[name].value, bool):
            raise QuantityError(f"{where}: [{name}] {entries[name].value!r} must be true or false")
    return build(record_type, entries, where, turns, **given)


def _entries(fields: Any, where: str) -> dict[str, SetEntry]:
    """Return the fields of a JSON dictionary (values with units, or plain values) as entries of a parameter
    set, which `build` converts to SI; `where` names the place in messages. Raises QuantityError if `fields`
    is no dictionary."""
    if not isinstance(fields, Mapping):
        raise QuantityError(f"{where} = {fields!r:.60} must hold fields with their values and units")
    return {
        k: SetEntry(v.get("value", math.nan), v.get("unit", "")) if isinstance(v, Mapping) else SetEntry(v)
        for k, v in fields.items()
    }
