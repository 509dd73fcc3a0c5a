"""Actuators, piezos and chains as numbers of results.json, and read from there again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import registry
from ..actuator import Actuator, StageModes
from ..chain import Chain
from ..friction import NormalForce
from ..piezo import Piezo
from ..records import quantities
from ..units import QuantityError


def model_numbers(model: Actuator) -> dict[str, Any]:
    """An actuator for results.json, whole: `model_of` makes it again.

    Infinite fields, which are the defaults, are left out.
    """
    found = {
        "actuator": _fields(model),
        **registry.laws.written(type(model.friction)),
        "friction": _fields(model.friction),
    }
    for name in ("normal_force", "further_modes"):
        if (part := getattr(model, name)) is not None:
            found[name] = _fields(part)
    return found if model.piezo is None else {**found, "piezo": piezo_numbers(model.piezo)}


def piezo_numbers(piezo: Piezo) -> dict[str, Any]:
    """Hysteresis and creep for results.json, whole."""
    return {
        part: {**registry.piezos.written(type(one)), "values": _fields(one)}
        for part, one in piezo._asdict().items()
        if one is not None
    }


def piezo_of(numbers: Mapping[str, Any]) -> Piezo:
    """The piezo of `piezo_numbers`, from what was read from results.json."""
    return Piezo(
        **{part: registry.piezos.of_results(one)(**_values(one["values"])) for part, one in numbers.items()}
    )


def chain_numbers(chain: Chain) -> dict[str, Any]:
    """For results.json; an infinite slew rate, which is the default, is left out."""
    return _fields(chain)


def chain_of(numbers: Mapping[str, Any]) -> Chain:
    """From what was read from results.json; of a fit of walks, its delay and offset."""
    if "signal_chain" in numbers:
        return Chain(**_values(numbers["signal_chain"]))
    known = numbers.get("parameters", {})
    return Chain(**_values({k: v for k, v in known.items() if k in ("delay", "offset")}))


def _fields(record: Any) -> dict[str, Any]:
    known, found = quantities(type(record)), {}
    for name, value in record._asdict().items():
        if isinstance(value, bool | str):
            found[name] = value
        elif name in known and value is not None and np.all(np.isfinite(value)):
            found[name] = {"value": value, "unit": known[name].unit}
    return found


def model_of(numbers: Mapping[str, Any]) -> Actuator:
    """The actuator of `model_numbers`, from what was read from results.json.

    Raises:
        QuantityError: it is none.
    """
    try:
        friction = registry.laws.of_results(numbers)(**_values(numbers["friction"]))
        piezo = piezo_of(numbers["piezo"]) if "piezo" in numbers else None
        along = NormalForce(**_values(numbers["normal_force"])) if "normal_force" in numbers else None
        modes = StageModes(**_values(numbers["further_modes"])) if "further_modes" in numbers else None
        own = {"friction": friction, "piezo": piezo, "normal_force": along, "further_modes": modes}
        return Actuator(**_values(numbers["actuator"]), **own)
    except (KeyError, TypeError, AttributeError) as error:
        raise QuantityError(
            f"there is no actuator in the results ({type(error).__name__}: {error})"
        ) from error


def _values(fields: Mapping[str, Any]) -> dict[str, Any]:
    values = {k: v["value"] if isinstance(v, Mapping) else v for k, v in fields.items()}
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
