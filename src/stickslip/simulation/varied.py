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
    """A field that a law bounds by other fields: it equals `value * scale`, and is constant unless it is
    free."""

    field: str
    scale: Callable[[Mapping[str, float]], float]
    needs: tuple[str, ...]
    lower: float
    upper: float  # default end of a search
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


# Prefix of the names of values of the piezo, and of values of the normal force along the stroke.
PIEZO = "piezo_"
NORMAL = "normal_force_"
NORMAL_FIELDS = {NORMAL + field: field for field in NormalForce._fields}


def law_of(model: Any) -> Any:
    """Return the friction law of a system, or the law itself."""
    return model if is_law(model) else model.friction


def ratios_of(law: Any) -> dict[str, Ratio]:
    return {name: r for name, r in RATIOS.items() if {r.field, *r.needs} <= {*law._fields}}


def element_of(law: Any, name: str) -> tuple[str, int] | None:
    """Return field and index of a name such as "stiffness_2"; None if the law has no such element."""
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
    """Return the model with a uniform normal force along the stroke added, if a name belongs to a normal
    force and the model has none. Then models that differ in such a value have the same type."""
    if any(name in NORMAL_FIELDS for name in names) and model.normal_force is None:
        return model.replace(normal_force=NormalForce())
    return model


def piezo_names(model: Any) -> list[str]:
    """Return the names of the values of an actuator's piezo: "piezo_weight_2", "piezo_share_1",
    "piezo_capacitance"."""
    return [name for part in _parts(model) for name in _names_of_part(part)]


def drive_names(model: Any) -> list[str]:
    """Return the names of the piezo's numbers that change the drive of the stage."""
    return [] if getattr(model, "two_port", None) is not None else piezo_names(model)


def model_names(model: Any) -> list[str]:
    """Return the names of a model that may vary: as `free_names`, and the numbers of its piezo."""
    return [*free_names(model), *piezo_names(model)]


def _parts(model: Any) -> list[Any]:
    """Return hysteresis and creep of the model's piezo, as far as it has them."""
    return [part for part in getattr(model, "piezo", None) or () if part is not None]


def _names_of_part(part: Any) -> list[str]:
    return [PIEZO + name for name in record_names(part)]


def _part_of(model: Any, name: str) -> Any:
    """Return the part of the piezo that has the named number, or None."""
    return next((part for part in _parts(model) if name in _names_of_part(part)), None)


def changed_fields(model: Any, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the fields of the law, and the changed fields of the system, with these values, unchecked.

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
    """Return the piezo of the model with those of the values that belong to it, unchecked."""

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
    """Return the names of a record that may vary: its numbers, and those in its lists ("value_3")."""
    names = []
    for field in quantities(type(record)) if hasattr(record, "_fields") else ():
        value = getattr(record, field)
        if isinstance(value, tuple):
            names += [f"{_singular(field)}_{i + 1}" for i in range(len(value))]
        elif field != "periods" and value is not None:  # `periods` is a count
            names.append(field)
    return names


def record_field(record: Any, name: str) -> tuple[str, int | None]:
    """Return field and index of a name such as "value_3"; the index is None for a scalar field."""
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
    """Return the fields of the record with these values, unchecked."""
    fields = record._asdict()
    for name, value in values.items():
        field, index = record_field(record, name)
        old = fields[field]
        fields[field] = value if index is None else (*old[:index], value, *old[index + 1 :])
    return fields


def value_of(model: Any, name: str, waveform: Any = None) -> float:
    """Return the named number of the model, else of the waveform."""
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


@cache  # called again for each member's fields
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
