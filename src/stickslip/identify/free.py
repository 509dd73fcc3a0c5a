"""Which values of a model are free: from a record to the parameters of a fit, and back."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ..friction import is_law
from ..records import did_you_mean, quantities
from ..units import QuantityError, to_si
from .result import Parameter, Values

Bounds = Mapping[str, tuple[float | str, float | str]]

# How far from its start a parameter may end, as a factor either way.
REACH = 30.0


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


def _ratios(law: Any) -> dict[str, Ratio]:
    return {name: r for name, r in RATIOS.items() if {r.field, *r.needs} <= {*law._fields}}


def _element(law: Any, name: str) -> tuple[str, int] | None:
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
    names += _ratios(law)
    if not is_law(model):
        names += [field for field in quantities(type(model)) if isinstance(getattr(model, field), float)]
    return names


def parameter(model: Any, name: str, bounds: Bounds) -> Parameter:
    """The parameter of that name (one of `free_names`), starting at the model's value.

    On a logarithmic scale and within a factor `REACH` of the start, unless bounds that reach down to zero or
    below are given.

    Raises:
        QuantityError: it starts at zero without bounds, or the bounds are wrong.
    """
    law = law_of(model)
    element, ratio = _element(law, name), _ratios(law).get(name)
    if ratio is not None and name not in law._fields:
        start = getattr(law, ratio.field) / ratio.scale(law._asdict())
        low, high = _given(bounds, name, "") or (ratio.lower, ratio.upper)
        return Parameter(name, start, low, high, "", log=False)
    owner = law if element or name in law._fields else model
    quantity = quantities(type(owner))[element[0] if element else name]
    start = getattr(law, element[0])[element[1]] if element else getattr(owner, name)
    given = _given(bounds, name, quantity.unit)
    if given is not None:
        return Parameter(name, start, *given, quantity.unit, log=given[0] > 0)
    if not (start > 0 and math.isfinite(start)):
        raise QuantityError(
            f"{name} starts at {start:g} {quantity.unit}".rstrip()
            + ": a parameter that does not start above zero needs bounds of its own"
        )
    least = max(quantity.minimum or 0.0, quantity.above or 0.0)
    most = math.inf if quantity.maximum is None else quantity.maximum
    return Parameter(name, start, max(start / REACH, least), min(start * REACH, most), quantity.unit)


def _given(bounds: Bounds, name: str, unit: str) -> tuple[float, float] | None:
    if name not in bounds:
        return None
    low, high = bounds[name]
    return to_si(low, unit, f"lower bound of {name}"), to_si(high, unit, f"upper bound of {name}")


def check_names(free: Sequence[str], known: Sequence[str], bounds: Bounds) -> None:
    """Raise `QuantityError` unless every free name is known and there once, and every bound is of one."""
    if not free or isinstance(free, str):
        raise QuantityError(f"free = {free!r} must be a list of names, of {', '.join(known)}")
    for name in free:
        if name not in known:
            hint = did_you_mean(name, known)
            raise QuantityError(f"{name!r} cannot be free{hint}: there are {', '.join(known)}")
        if list(free).count(name) > 1:
            raise QuantityError(f"{name!r} is free twice")
    for name in bounds:
        if name not in free:
            raise QuantityError(f"there are bounds for {name!r}, which is not free")


def with_values(model: Any, values: Values) -> Any:
    """The model with these values put in; a field of `RATIOS` that is not among them keeps its ratio.

    Raises:
        QuantityError: a value is out of range.
    """
    law = law_of(model)
    fields, own = law._asdict(), {}
    ratios = {n: r for n, r in _ratios(law).items() if n not in law._fields}
    tied = {r.field: getattr(law, r.field) / r.scale(fields) for r in ratios.values()}
    changed = dict(fields)
    for name, value in values.items():
        element = _element(law, name)
        if name in fields:
            changed[name] = value
            tied.pop(name, None)
        elif name in ratios:
            tied[ratios[name].field] = value
        elif element:
            items = list(changed[element[0]])
            items[element[1]] = value
            changed[element[0]] = tuple(items)
        else:
            own[name] = value
    for ratio in ratios.values():
        if ratio.field in tied:
            changed[ratio.field] = tied[ratio.field] * ratio.scale(changed)
    changed_law = type(law)(**changed)
    return changed_law if is_law(model) else model.replace(friction=changed_law, **own)
