"""Values of a model that vary by name: for fits and for ensembles."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

from ..friction import is_law
from ..records import quantities


class Ratio(NamedTuple):
    """A field that a law bounds by others: it is `value * scale`, and keeps its value unless it is free."""

    field: str
    scale: Callable[[Mapping[str, float]], float]
    needs: tuple[str, ...]
    lower: float
    upper: float


RATIOS = {
    "stiction_ratio": Ratio("stiction_force", lambda f: f["coulomb_force"], ("coulomb_force",), 1.0, 3.0),
    "breakaway_share": Ratio(
        "breakaway_deflection",
        lambda f: f["coulomb_force"] / f["sigma_0"],
        ("coulomb_force", "sigma_0"),
        0.0,
        0.99,
    ),
}


def law_of(model: Any) -> Any:
    """The friction law of a system, or the law itself."""
    return model if is_law(model) else model.friction


def ratios_of(law: Any) -> dict[str, Ratio]:
    return {name: r for name, r in RATIOS.items() if {r.field, *r.needs} <= {*law._fields}}


def element_of(law: Any, name: str) -> tuple[str, int] | None:
    """Field and index of "stiffness_2"; None if the law has no such element."""
    match = re.fullmatch(r"(\w+)_(\d+)", name)
    values = getattr(law, match[1], None) if match and match[1] in law._fields else None
    if not match or not isinstance(values, tuple) or not 1 <= int(match[2]) <= len(values):
        return None
    return match[1], int(match[2]) - 1


def free_names(model: Any) -> list[str]:
    """What may be free in a model: the scalar fields of its law and its own, elements, and `RATIOS`."""
    law, names = law_of(model), []
    for field, value in law._asdict().items():
        if isinstance(value, tuple):
            names += [f"{field}_{i + 1}" for i in range(len(value))]
        else:
            names.append(field)
    names += ratios_of(law)
    if not is_law(model):
        names += [field for field in quantities(type(model)) if isinstance(getattr(model, field), float)]
    return names


def changed_fields(model: Any, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fields of the law, and changed fields of the system, with these values put in, unchecked.

    A field of `RATIOS` that is not among the values keeps its ratio. Values may be arrays, of one length.
    """
    law = law_of(model)
    fields, own = law._asdict(), {}
    ratios = {n: r for n, r in ratios_of(law).items() if n not in law._fields}
    tied = {r.field: getattr(law, r.field) / r.scale(fields) for r in ratios.values()}
    changed = dict(fields)
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
        else:
            own[name] = value
    for ratio in ratios.values():
        if ratio.field in tied:
            changed[ratio.field] = tied[ratio.field] * ratio.scale(changed)
    return changed, own


def with_values(model: Any, values: Mapping[str, float]) -> Any:
    """The model with these values put in; a field of `RATIOS` that is not among them keeps its ratio.

    Raises:
        QuantityError: a value is out of range.
    """
    law = law_of(model)
    changed, own = changed_fields(model, values)
    changed_law = type(law)(**changed)
    return changed_law if is_law(model) else model.replace(friction=changed_law, **own)


def waveform_names(waveform: Any) -> list[str]:
    """What may vary in a waveform that is a record: its numbers, and those of its lists ("value_3")."""
    names = []
    for field in quantities(type(waveform)) if hasattr(waveform, "_fields") else ():
        value = getattr(waveform, field)
        if isinstance(value, tuple):
            names += [f"{_singular(field)}_{i + 1}" for i in range(len(value))]
        elif field != "periods" and value is not None:  # a count
            names.append(field)
    return names


def waveform_field(waveform: Any, name: str) -> tuple[str, int | None]:
    """Field and index of "value_3"; no index for a field that is one number."""
    match = re.fullmatch(r"(\w+)_(\d+)", name)
    for field in waveform._fields:
        if field == name:
            return field, None
        if match and match[1] == _singular(field) and isinstance(getattr(waveform, field), tuple):
            return field, int(match[2]) - 1
    raise KeyError(name)


def waveform_value(waveform: Any, name: str) -> float:
    """The number of that name."""
    field, index = waveform_field(waveform, name)
    value = getattr(waveform, field)
    return float(value if index is None else value[index])


def with_field(waveform: Any, name: str, value: float) -> Any:
    """The waveform with another number.

    Raises:
        QuantityError: it is out of range.
    """
    field, index = waveform_field(waveform, name)
    fields = waveform._asdict()
    old = fields[field]
    fields[field] = value if index is None else (*old[:index], value, *old[index + 1 :])
    return type(waveform)(**fields)


@cache  # of each member's fields, again and again
def _singular(field: str) -> str:
    return re.sub("ies$", "ys", field).removesuffix("s")
