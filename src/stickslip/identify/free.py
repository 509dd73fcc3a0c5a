"""Which values of a model are free, where they start and how far they may go."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..estimate.parameter import Parameter
from ..records import did_you_mean, quantities
from ..simulation.varied import element_of, law_of, ratios_of
from ..units import QuantityError, to_si

Bounds = Mapping[str, tuple[float | str, float | str]]

# How far from its start a parameter may end, as a factor either way.
REACH = 30.0


def parameter(model: Any, name: str, bounds: Bounds) -> Parameter:
    """The parameter of that name (one of `free_names`), starting at the model's value.

    On a logarithmic scale and within a factor `REACH` of the start, unless bounds that reach down to zero or
    below are given.

    Raises:
        QuantityError: it starts at zero without bounds, or the bounds are wrong.
    """
    law = law_of(model)
    element, ratio = element_of(law, name), ratios_of(law).get(name)
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


def with_prior(p: Parameter, priors: Bounds) -> Parameter:
    """The parameter with what is known of it: value and standard deviation, in SI or as strings."""
    if p.name not in priors:
        return p
    value, deviation = (to_si(given, p.unit, f"prior of {p.name}") for given in priors[p.name])
    return p._replace(prior=(value, deviation))


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
