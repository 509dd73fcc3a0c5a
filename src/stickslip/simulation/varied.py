"""Named values of a model that vary in fits and ensembles: reading and changing them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple

from ..friction import NormalForce, is_law
from ..quantities.records import Quantity, quantities, quantities_of
from ..waveform.pieces import MOST_PERIODS


class Ratio(NamedTuple):
    """A ratio that is fitted instead of a field of a friction law, whose range depends on other fields of the
    law: field = ratio × scale. If the ratio is not varied, it stays constant while the other fields vary.

    Attributes:
        field: name of the field.
        scale: function from the values of the law's fields, by name, to the scale, in the unit of the field.
        needs: names of the fields that `scale` uses.
        lower, upper: default bounds of a search for the ratio.
        most: largest valid ratio.
    """

    field: str
    scale: Callable[[Mapping[str, float]], float]
    needs: tuple[str, ...]
    lower: float
    upper: float
    most: float


RATIOS = {
    "stiction_ratio": Ratio(
        "stiction_force", lambda f: f["coulomb_force"], ("coulomb_force",), 1.0, 3.0, math.inf
    ),
    "breakaway_share": Ratio(
        "breakaway_deflection",
        lambda f: f["coulomb_force"] / f["sigma_0"],
        ("coulomb_force", "sigma_0"),
        0.0,
        0.99,
        0.99,
    ),
}


# Prefixes in names of parameters: of the piezo's numbers ("piezo_weight_2"), and of the numbers of a normal
# force that changes along the stroke ("normal_force_slope").
PIEZO = "piezo_"
NORMAL = "normal_force_"
NORMAL_FIELDS = {NORMAL + field: field for field in NormalForce._fields}


def law_of(model: Any) -> Any:
    """Return the friction law of an actuator or a pulled slider; a law is returned itself."""
    return model if is_law(model) else model.friction


def ratios_of(law: Any) -> dict[str, Ratio]:
    return {name: r for name, r in RATIOS.items() if {r.field, *r.needs} <= {*law._fields}}


def element_of(law: Any, name: str) -> tuple[str, int] | None:
    """Return field and index of the number of a law with this name: ("stiffness", 1) for "stiffness_2".
    Return None if the law has no such tuple or too few elements."""
    match = re.fullmatch(r"(\w+)_(\d+)", name)
    values = getattr(law, match[1], None) if match and match[1] in law._fields else None
    if not match or not isinstance(values, tuple) or not 1 <= int(match[2]) <= len(values):
        return None
    return match[1], int(match[2]) - 1


def free_names(model: Any) -> list[str]:
    """Return the names of the numbers that may be free in a fit, of a model or of a friction law alone.

    They are the fields of the law, numbered in tuples ("stiffness_2"), and the ratios in `RATIOS`; for a
    model also its own fields that are floats, and the fields of its normal force ("normal_force_slope").
    """
    law, names = law_of(model), []
    for field, value in law._asdict().items():
        if isinstance(value, tuple):
            names += [f"{field}_{i + 1}" for i in range(len(value))]
        else:
            names.append(field)
    names += ratios_of(law)
    if not is_law(model):
        names += [field for field in quantities(type(model)) if isinstance(getattr(model, field), float)]
        names += NORMAL_FIELDS
    return names


def with_normal_force(model: Any, names: Iterable[str]) -> Any:
    """Return the model with a uniform `NormalForce`, if one of the names is one of its fields, but the model
    has none; otherwise the model unchanged. All varied models then have the same structure."""
    if any(name in NORMAL_FIELDS for name in names) and model.normal_force is None:
        return model.replace(normal_force=NormalForce())
    return model


def piezo_names(model: Any) -> list[str]:
    """Return the parameter names of the numbers of an actuator's piezo, such as "piezo_weight_2",
    "piezo_share_1" and "piezo_capacitance"; empty without a piezo model."""
    return [name for part in _parts(model) for name in _names_of_part(part)]


def drive_names(model: Any) -> list[str]:
    """Return the names of the piezo's numbers on which the drive of the stage depends (the voltage after
    hysteresis and creep); empty for a `MaxwellCapacitor`, which is part of the plant."""
    return [] if getattr(model, "two_port", None) is not None else piezo_names(model)


def model_names(model: Any) -> list[str]:
    """Return the names of a model's numbers that may vary: those of `free_names` and `piezo_names`."""
    return [*free_names(model), *piezo_names(model)]


def _parts(model: Any) -> list[Any]:
    """Return the records in the model's piezo (hysteresis, creep) that are not None; empty without a
    piezo."""
    return [part for part in getattr(model, "piezo", None) or () if part is not None]


def _names_of_part(part: Any) -> list[str]:
    return [PIEZO + name for name in record_names(part)]


def _part_of(model: Any, name: str) -> Any:
    """Return the record of the piezo (hysteresis or creep) that has the number `name`, such as
    "piezo_weight_2"; None for another name."""
    return next((part for part in _parts(model) if name in _names_of_part(part)), None)


def changed_fields(model: Any, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Set values of a model by name, without checks; return two dictionaries by name of field: all fields of
    its friction law, and the changed fields of the model itself.

    Args:
        model: an actuator, a pulled slider or a law.
        values: numbers, or arrays of one length, by the names of `model_names`. If neither a field with a
            ratio (`RATIOS`) nor the ratio is among the names, the ratio stays constant.
    """
    law = law_of(model)
    fields, own = law._asdict(), {}
    ratios = {n: r for n, r in ratios_of(law).items() if n not in law._fields}
    tied = {r.field: getattr(law, r.field) / r.scale(fields) for r in ratios.values()}
    changed, of_piezo = dict(fields), {*piezo_names(model)} & {*values}
    for name, value in values.items():
        if name in fields:
            changed[name] = value
            tied.pop(name, None)
        elif name in ratios:
            tied[ratios[name].field] = value
        elif element := element_of(law, name):
            items = list(changed[element[0]])
            items[element[1]] = value
            changed[element[0]] = tuple(items)
        elif name in NORMAL_FIELDS:
            along = own.get("normal_force", model.normal_force or NormalForce())
            own["normal_force"] = tuple.__new__(
                NormalForce, (along._asdict() | {NORMAL_FIELDS[name]: value}).values()
            )
        elif name not in of_piezo:
            own[name] = value
    for ratio in ratios.values():
        if ratio.field in tied:
            changed[ratio.field] = tied[ratio.field] * ratio.scale(changed)
    if of_piezo:
        own["piezo"] = changed_piezo(model, values)
    return changed, own


def changed_piezo(model: Any, values: Mapping[str, Any]) -> Any:
    """Return the model's piezo with the numbers among `values` that belong to it ("piezo_weight_2"), without
    checks; other names are ignored."""

    def changed(part: Any) -> Any:
        names = _names_of_part(part)
        put = {name.removeprefix(PIEZO): value for name, value in values.items() if name in names}
        return tuple.__new__(type(part), put_in(part, put).values())

    parts = [None if part is None else changed(part) for part in model.piezo]
    return tuple.__new__(type(model.piezo), parts)


def checked_piezo(piezo: Any) -> Any:
    """Construct a piezo again from unchecked records, with all checks; raise QuantityError for an invalid
    value."""
    return type(piezo)(*(None if part is None else type(part)(*part) for part in piezo))


def with_values(model: Any, values: Mapping[str, float]) -> Any:
    """Return the model or law with these values, by the names of `model_names`, checked.

    A field that has a ratio (`RATIOS`) keeps it, unless the field or the ratio is among the names.

    Raises:
        QuantityError: a value is out of range.
    """
    law = law_of(model)
    changed, own = changed_fields(model, values)
    if "piezo" in own:
        own["piezo"] = checked_piezo(own["piezo"])
    if "normal_force" in own:
        own["normal_force"] = NormalForce(*own["normal_force"])
    changed_law = type(law)(**changed)
    return changed_law if is_law(model) else model.replace(friction=changed_law, **own)


def record_names(record: Any) -> list[str]:
    """Return the names of a record's numbers that may vary: scalar fields that are not None, and the numbers
    of tuples by the singular of the field and an index from 1 ("value_3" of `values`); not `periods`."""
    names = []
    for field in quantities(type(record)) if hasattr(record, "_fields") else ():
        value = getattr(record, field)
        if isinstance(value, tuple):
            names += [f"{_singular(field)}_{i + 1}" for i in range(len(value))]
        elif field != "periods" and value is not None:  # a number of periods is whole and cannot vary
            names.append(field)
    return names


def record_field(record: Any, name: str) -> tuple[str, int | None]:
    """Return field and index of the number of a record with this name: ("values", 2) for "value_3"; the index
    is None for a scalar field.

    Raises:
        KeyError: the record has no number of this name.
    """
    match = re.fullmatch(r"(\w+)_(\d+)", name)
    for field in record._fields:
        if field == name:
            return field, None
        if match and match[1] == _singular(field) and isinstance(getattr(record, field), tuple):
            return field, int(match[2]) - 1
    raise KeyError(name)


def record_value(record: Any, name: str) -> float:
    """Return the number of a record with this name (see `record_names`), in SI."""
    field, index = record_field(record, name)
    value = getattr(record, field)
    return float(value if index is None else value[index])


def put_in(record: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return all fields of the record by name, with the numbers `values` (by the names of `record_names`) in
    place of the previous ones, without checks."""
    fields = record._asdict()
    for name, value in values.items():
        field, index = record_field(record, name)
        old = fields[field]
        fields[field] = value if index is None else (*old[:index], value, *old[index + 1 :])
    return fields


def value_of(model: Any, name: str, waveform: Any = None) -> float:
    """Return the number with this name, in SI: of the model, its law, a ratio, its piezo or normal force; if
    the model has no such name, of the waveform."""
    if waveform is not None and name not in model_names(model):
        return record_value(waveform, name)
    of_law, ratio = law_of(model)._asdict(), ratios_of(law_of(model)).get(name)
    if name in of_law:
        return float(of_law[name])
    if ratio is not None:
        return float(of_law[ratio.field]) / ratio.scale(of_law)
    if element := element_of(law_of(model), name):
        return float(of_law[element[0]][element[1]])
    if (part := _part_of(model, name)) is not None:
        return record_value(part, name.removeprefix(PIEZO))
    if name in NORMAL_FIELDS:
        return float(getattr(model.normal_force or NormalForce(), NORMAL_FIELDS[name]))
    return float(getattr(model, name))


def quantity_of(model: Any, waveform: Any, name: str) -> Quantity | None:
    """Return the `Quantity` (unit, meaning, range) of the number with this name of the model or the waveform;
    None for a number without a unit, such as a ratio or "drive_scale"."""
    if (part := _part_of(model, name)) is not None:
        return quantities(type(part))[record_field(part, name.removeprefix(PIEZO))[0]]
    if name in NORMAL_FIELDS:
        return quantities(NormalForce)[NORMAL_FIELDS[name]]
    if name in record_names(waveform) and name not in free_names(model):
        quantity = quantities(type(waveform))[record_field(waveform, name)[0]]
        return quantity._replace(unit=quantity.unit.replace("V", waveform.unit))
    element = element_of(law_of(model), name)
    known = quantities_of(model) | quantities_of(law_of(model), model)
    return known.get(element[0] if element else name)


@cache  # in an ensemble, the same fields occur in each member
def _singular(field: str) -> str:
    return re.sub("sses$", "sss", re.sub("ies$", "ys", field)).removesuffix("s")


def refused_table(row: Any, waveform: Any, end: float | None, periodic: bool) -> str:
    """Return the reason why a member's waveform cannot be tabulated, or "".

    Args:
        row: waveform of the member.
        waveform: the unvaried waveform, whose type is named in the reason.
        end: end of the table, s; None: the duration of `row`.
        periodic: True if the waveform must have a period; otherwise it must not have too many.
    """
    period = getattr(row, "period", None)
    if periodic:
        return "" if period is not None else f"this {type(waveform).__name__} has no period"
    count = min(end or math.inf, row.duration) / period if period else 0.0
    if count > MOST_PERIODS:
        return f"{count:,.0f} periods of {period:g} s: a drive is tabulated over up to {MOST_PERIODS:,}"
    return ""
