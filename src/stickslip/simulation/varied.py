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
    """A ratio that replaces a field of a law in fits, because other fields bound it: field = ratio × scale. A
    ratio that is not varied stays constant.

    Attributes:
        field: name of the bounded field.
        scale: function from the fields of the law, by name, to the scale.
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


# Prefixes of the names of the piezo's numbers ("piezo_weight_2"), and of the numbers of a normal force that
# changes along the stroke ("normal_force_slope").
PIEZO = "piezo_"
NORMAL = "normal_force_"
NORMAL_FIELDS = {NORMAL + field: field for field in NormalForce._fields}


def law_of(model: Any) -> Any:
    """Return the friction law of a system, or the law itself."""
    return model if is_law(model) else model.friction


def ratios_of(law: Any) -> dict[str, Ratio]:
    return {name: r for name, r in RATIOS.items() if {r.field, *r.needs} <= {*law._fields}}


def element_of(law: Any, name: str) -> tuple[str, int] | None:
    """Return field and index (from 0) of a name such as "stiffness_2"; None if the law has no such
    element."""
    match = re.fullmatch(r"(\w+)_(\d+)", name)
    values = getattr(law, match[1], None) if match and match[1] in law._fields else None
    if not match or not isinstance(values, tuple) or not 1 <= int(match[2]) <= len(values):
        return None
    return match[1], int(match[2]) - 1


def free_names(model: Any) -> list[str]:
    """Return the names of a model's values that may be free in a fit.

    They are the scalar fields of law and model, values of elements ("stiffness_2"), the ratios in `RATIOS`,
    and values of the normal force ("normal_force_slope").
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
    """Return the model with a normal force along the stroke, here uniform, if one of the names varies such a
    force and the model has none. Then all varied models have the same structure."""
    if any(name in NORMAL_FIELDS for name in names) and model.normal_force is None:
        return model.replace(normal_force=NormalForce())
    return model


def piezo_names(model: Any) -> list[str]:
    """Return the names of the numbers of an actuator's piezo that may vary, such as "piezo_weight_2",
    "piezo_share_1" and "piezo_capacitance"; empty without a piezo model."""
    return [name for part in _parts(model) for name in _names_of_part(part)]


def drive_names(model: Any) -> list[str]:
    """Return the names of the piezo's numbers that change the voltage after hysteresis and creep; none for a
    `MaxwellCapacitor`, which is part of the plant."""
    return [] if getattr(model, "two_port", None) is not None else piezo_names(model)


def model_names(model: Any) -> list[str]:
    """Return the names of a model that may vary: as `free_names`, and the numbers of its piezo."""
    return [*free_names(model), *piezo_names(model)]


def _parts(model: Any) -> list[Any]:
    """Return the records of the model's piezo, hysteresis and creep, without those that are None."""
    return [part for part in getattr(model, "piezo", None) or () if part is not None]


def _names_of_part(part: Any) -> list[str]:
    return [PIEZO + name for name in record_names(part)]


def _part_of(model: Any, name: str) -> Any:
    """Return the record of the piezo (hysteresis or creep) that has the named number; None if neither has
    it."""
    return next((part for part in _parts(model) if name in _names_of_part(part)), None)


def changed_fields(model: Any, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return all fields of the law, and the changed fields of the model, after setting `values` (numbers by
    name). They are not checked.

    A field of `RATIOS` that is not among the values keeps its ratio. Values may be arrays of one length.
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
    """Return the piezo of the model after setting those of `values` (by name) that belong to it; they are not
    checked."""

    def changed(part: Any) -> Any:
        names = _names_of_part(part)
        put = {name.removeprefix(PIEZO): value for name, value in values.items() if name in names}
        return tuple.__new__(type(part), put_in(part, put).values())

    parts = [None if part is None else changed(part) for part in model.piezo]
    return tuple.__new__(type(model.piezo), parts)


def checked_piezo(piezo: Any) -> Any:
    """Return the piezo after the checks of its records; raise QuantityError for invalid values."""
    return type(piezo)(*(None if part is None else type(part)(*part) for part in piezo))


def with_values(model: Any, values: Mapping[str, float]) -> Any:
    """Return the model with these values; a field of `RATIOS` that is not among them keeps its ratio.

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
    """Return the names of a record's numbers that may vary: scalar fields, and entries of lists
    ("value_3")."""
    names = []
    for field in quantities(type(record)) if hasattr(record, "_fields") else ():
        value = getattr(record, field)
        if isinstance(value, tuple):
            names += [f"{_singular(field)}_{i + 1}" for i in range(len(value))]
        elif field != "periods" and value is not None:  # `periods` is a count
            names.append(field)
    return names


def record_field(record: Any, name: str) -> tuple[str, int | None]:
    """Return field and index (from 0) of a name such as "value_3"; the index is None for a scalar field.

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
    """Return the value of a record with this name."""
    field, index = record_field(record, name)
    value = getattr(record, field)
    return float(value if index is None else value[index])


def put_in(record: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the record by name, after setting `values` (by name, see `record_names`); they are
    not checked."""
    fields = record._asdict()
    for name, value in values.items():
        field, index = record_field(record, name)
        old = fields[field]
        fields[field] = value if index is None else (*old[:index], value, *old[index + 1 :])
    return fields


def value_of(model: Any, name: str, waveform: Any = None) -> float:
    """Return the number with this name, from the model, or else from the waveform."""
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
    """Return the quantity (unit, bounds) of a named value of the model or waveform; None for a ratio or a
    factor."""
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


@cache  # called once per field and member of an ensemble
def _singular(field: str) -> str:
    return re.sub("sses$", "sss", re.sub("ies$", "ys", field)).removesuffix("s")


def refused_table(row: Any, waveform: Any, end: float | None, periodic: bool) -> str:
    """Return the reason why a member's waveform `row` has no table up to `end` [s]; empty if it has one."""
    period = getattr(row, "period", None)
    if periodic:
        return "" if period is not None else f"this {type(waveform).__name__} has no period"
    count = min(end or math.inf, row.duration) / period if period else 0.0
    if count > MOST_PERIODS:
        return f"{count:,.0f} periods of {period:g} s: a drive is tabulated over up to {MOST_PERIODS:,}"
    return ""
