"""Setup of a fit's parameters from the user's arguments: names, initial values, bounds, priors and ties."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..estimate.parameter import REACH, Parameter
from ..estimate.tied import names_in
from ..friction import MaxwellSlip
from ..quantities.records import Quantity, did_you_mean, quantities
from ..quantities.units import LENGTH, Coordinate, QuantityError, to_si, with_unit
from ..simulation import varied
from ..simulation.varied import NORMAL_FIELDS, element_of, free_names, law_of, ratios_of

# Typical sliding speed, m/s. The law's force divided by this speed is the scale of a damping whose initial
# value is zero.
TYPICAL_SPEED = 1e-3

Bounds = Mapping[str, tuple[float | str, float | str]]


class LinearBounds(NamedTuple):
    """Bounds (`lower`, `upper`; SI or strings) of a parameter that is searched on a linear scale, even if
    both are positive. Infinite bounds, the default, are replaced by default bounds with a linear scale."""

    lower: float = -math.inf
    upper: float = math.inf


class SearchRange(NamedTuple):
    """First search range of a parameter from `lower` to `upper`, SI, beyond which the search may continue as
    far as the law allows. With `log` the search coordinate is the logarithm of (value + `shift`), otherwise
    the value.
    """

    lower: float
    upper: float
    shift: float = 0.0
    log: bool = True

    @classmethod
    def of(cls, bounds: Bounds, name: str) -> SearchRange | None:
        """Return the bounds of the named parameter if they are a `SearchRange`; otherwise None."""
        found: Any = bounds.get(name)
        return found if isinstance(found, cls) else None


class Squared(NamedTuple):
    """Bounds (`lower`, `upper`; SI or strings) of a parameter whose search coordinate is its square."""

    lower: float
    upper: float

    @classmethod
    def are(cls, bounds: Bounds, name: str) -> bool:
        """Return True if the bounds of this parameter are `Squared`."""
        return isinstance(bounds.get(name), cls)


def exchangeable(
    law: Any, parameters: Sequence[Parameter], others: Sequence[Parameter]
) -> tuple[tuple[str, ...], ...]:
    """Return the names of stiffness and strength of each element of a Maxwell-slip law that can be exchanged
    with the others; empty for other laws and for fewer than two such elements.

    The force of parallel elements stays the same if two elements are exchanged. An element is included only
    if its stiffness and strength are free, without a prior, and no parameter is tied.

    Args:
        law: friction law.
        parameters: free parameters.
        others: fixed and tied parameters.
    """
    if not isinstance(law, MaxwellSlip) or any(p.tied for p in others):
        return ()
    searched = {p.name for p in parameters if p.prior is None and not p.fixed}
    groups = [(f"stiffness_{i}", f"strength_{i}") for i in range(1, len(law.strength) + 1)]
    found = tuple(group for group in groups if searched.issuperset(group))
    return found if len(found) > 1 else ()


def parameter(model: Any, name: str, bounds: Bounds, along: Coordinate = LENGTH) -> Parameter:
    """Return the named parameter (one of `free_names`) for a fit, with the model's value as initial guess
    (for a missing normal force the middle of the bounds).

    Without bounds the parameter is searched within a factor `REACH` of the initial guess first, and then as
    far as the law allows: down to zero, where it may be zero. For a force or damping whose initial value is
    zero, the range follows from the law's force and `TYPICAL_SPEED`. The scale is logarithmic, unless given
    bounds reach down to zero or below, are `LinearBounds` or `Squared`, or the parameter is a ratio such as
    "stiction_ratio". A `SearchRange` says its own scale.

    Args:
        model: actuator or friction law.
        name: name of the parameter.
        bounds: bounds by parameter name, in SI or as strings.
        along: coordinate of the motion, a length or an angle, which determines units.

    Raises:
        QuantityError: the parameter starts at zero without bounds and its size is unknown, or the bounds are
            wrong.
    """
    start, quantity = value_of(model, name)
    if name in NORMAL_FIELDS and model.normal_force is None and name in bounds:
        low, high = given_bounds(bounds, name, quantity.unit if quantity else "") or (start, start)
        start = 0.5 * (low + high)  # the model has no normal force, and so no initial value
    if quantity is None:
        ratio = ratios_of(law_of(model))[name]
        ends = (ratio.lower, ratio.upper)
        return linear(name, "", start, ends, bounds, (ratio.lower, ratio.most))
    unit = along.unit(quantity.unit)
    given, straight = given_bounds(bounds, name, unit), isinstance(bounds.get(name), LinearBounds)
    least = max(quantity.minimum or 0.0, quantity.above or 0.0)
    most = math.inf if quantity.maximum is None else quantity.maximum
    if (ends := SearchRange.of(bounds, name)) is not None:
        return Parameter(
            name, start, ends.lower, ends.upper, unit, log=ends.log, shift=ends.shift, limits=(least, most)
        )
    if given is not None:
        square = Squared.are(bounds, name)
        return Parameter(
            name, start, *given, unit, log=given[0] > 0 and not (straight or square), square=square
        )
    may_vanish = quantity.minimum == 0.0
    size = _typical(law_of(model), quantity.unit) if may_vanish and start == 0.0 else start
    if not (size > 0 and math.isfinite(size)):
        raise QuantityError(
            f"{name} starts at {start:g} {unit}".rstrip()
            + ": a parameter that does not start above zero needs bounds of its own"
        )
    low, high = 0.0 if may_vanish else max(size / REACH, least), min(size * REACH, most)
    shift = size / REACH if may_vanish and not straight else 0.0
    return Parameter(name, start, low, high, unit, log=not straight, shift=shift, limits=(least, most))


def _typical(law: Any, unit: str) -> float:
    """Return the typical size of a force (unit "N") or damping ("N s/m") whose initial value is zero, SI,
    from the law's Coulomb force (or largest strength); 0 for other units or without such a force."""
    fields = law._asdict()
    force = float(np.max(fields.get("coulomb_force", fields.get("strength", 0.0))))
    return {"N": force, "N s/m": force / TYPICAL_SPEED}.get(unit, 0.0)


def check_motion(model: Any, unit: str) -> None:
    """Raise QuantityError if a model does not suit the unit of the recorded position, "rad" or a length.

    A rotary model needs positions in rad. A model on a slope cannot have positions in rad.
    """
    if getattr(model, "rotary", False) and unit != "rad":
        raise QuantityError(f"the actuator turns (rotary = true), but the position is in {unit or 'm'}")
    if unit == "rad" and getattr(model, "incline", 0.0):
        raise QuantityError("the position is in rad: an actuator that turns has no incline")


def value_of(model: Any, name: str) -> tuple[float, Quantity | None]:
    """Return the model's value, SI, of one of `free_names`, and its `Quantity` (unit and limits); None
    instead of the `Quantity` for a ratio such as "stiction_ratio"."""
    law = law_of(model)
    element, ratio = element_of(law, name), ratios_of(law).get(name)
    if ratio is not None and name not in law._fields:
        return getattr(law, ratio.field) / ratio.scale(law._asdict()), None
    if name in NORMAL_FIELDS:
        return varied.value_of(model, name), varied.quantity_of(model, None, name)
    owner = law if element or name in law._fields else model
    quantity = quantities(type(owner))[element[0] if element else name]
    return (getattr(law, element[0])[element[1]] if element else getattr(owner, name)), quantity


class Said(NamedTuple):
    """Settings of a fit's parameters.

    Attributes:
        free: names of the free parameters.
        bounds: bounds by name.
        priors: value and standard deviation by name.
        tied: expression of each tied parameter, or value with unit of each fixed one, by name.
        values: initial values, SI, of free parameters that were given as a `Parameter`, by name.
    """

    free: list[str]
    bounds: dict[str, Any]
    priors: dict[str, tuple[float | str, float | str]]
    tied: dict[str, str]
    values: dict[str, float]


def said_of(
    free: Sequence[str | Parameter],
    known: NamedValues,
    bounds: Bounds | None = None,
    priors: Bounds | None = None,
    tied: Mapping[str, str] | None = None,
) -> Said:
    """Return the settings of a fit's parameters, in one form whether given by name or in a `Parameter`.

    Args:
        free: names, or `Parameter` objects, which contain initial value, bounds, prior and tie. A fixed or
            tied `Parameter` becomes an entry of `tied`.
        known: values of the model with their units.
        bounds, priors, tied: settings of parameters by name.

    Raises:
        QuantityError: `free` is empty or one text; or a `Parameter` has another unit than the model's, only
            one bound, or settings that are also given by name.
    """
    _check_list(free, known.names)
    said = Said([], dict(bounds or {}), dict(priors or {}), dict(tied or {}), {})
    for one in free:
        if isinstance(one, Parameter):
            _say(said, one, known)
        else:
            said.free.append(one)
    return said


def _say(said: Said, p: Parameter, known: NamedValues) -> None:
    if p.name in known.names and p.unit and with_unit(f"1 {p.unit}") != with_unit(f"1 {known.of(p.name)[1]}"):
        raise QuantityError(f"{p.name} is given in {p.unit}, but is in {known.of(p.name)[1] or '1'}")
    if any(p.name in others for others in (said.bounds, said.priors, said.tied)):
        raise QuantityError(f"{p.name} is said of twice: its Parameter has bounds, prior and tie")
    low = -math.inf if p.log and p.lower == 0.0 and p.limits is None else p.lower
    if math.isfinite(low) != math.isfinite(p.upper):
        raise QuantityError(f"{p.name} has one bound: both are needed, or none")
    if p.tied:
        said.tied[p.name] = p.tied
    elif p.fixed:
        said.tied[p.name] = f"'{p.start!r} {known.of(p.name)[1]}'"
    else:
        said.free.append(p.name)
        said.values[p.name] = p.start
        if p.limits is not None:
            said.bounds[p.name] = SearchRange(p.lower, p.upper, p.shift, p.log)
        elif not p.log:
            said.bounds[p.name] = (Squared if p.square else LinearBounds)(p.lower, p.upper)
        elif math.isfinite(low):
            said.bounds[p.name] = (p.lower, p.upper)
        if p.prior is not None:
            said.priors[p.name] = p.prior


class NamedValues(NamedTuple):
    """Values of a model with their units: all `names`, and a function `of` from a name to the pair of value
    (SI) and unit."""

    names: Sequence[str]
    of: Callable[[str], tuple[float, str]]


def known_of(model: Any, others: Mapping[str, tuple[float, str]], along: Coordinate = LENGTH) -> NamedValues:
    """Return the values of a model's `free_names`, and further values, with their units.

    Args:
        model: actuator or friction law.
        others: further values with their units by name, such as the channel's delay.
        along: coordinate of the motion, a length or an angle, which determines units.
    """

    def of(name: str) -> tuple[float, str]:
        if name in others:
            return others[name]
        value, quantity = value_of(model, name)
        return value, along.unit(quantity.unit if quantity else "")

    return NamedValues([*free_names(model), *others], of)


def beside(free: Sequence[str], tied: Mapping[str, str], known: NamedValues) -> list[Parameter]:
    """Return the parameters that a fit needs besides the free ones: those in `tied`, then the values in their
    expressions that are neither free nor tied, as fixed parameters.

    Args:
        free: names of the free parameters.
        tied: expression of each tied parameter by name, see `estimate.tied`.
        known: all values that an expression may contain.

    Raises:
        QuantityError: a name is unknown, or free and tied at once; or an expression cannot be read.
    """
    needed: dict[str, None] = {}
    for name, expression in tied.items():
        if name not in known.names:
            hint = did_you_mean(name, known.names)
            raise QuantityError(f"{name!r} cannot be tied{hint}: there are {', '.join(known.names)}")
        if name in free:
            raise QuantityError(f"{name!r} is free, and tied to {expression!r}: it can be one of both")
        for other in names_in(expression, name):
            if other not in known.names:
                hint = did_you_mean(other, [n for n in known.names if n != name])
                raise QuantityError(f"{name} is tied to {expression!r}, but there is no {other!r}{hint}")
            needed[other] = None
    found = [Parameter(name, unit=known.of(name)[1], tied=str(text)) for name, text in tied.items()]
    for name in needed:
        if name not in tied and name not in free:
            value, unit = known.of(name)
            found.append(Parameter(name, value, unit=unit, log=False, fixed=True))
    return found


def with_ties(parameters: Sequence[Parameter], tied: Mapping[str, str] | None) -> list[Parameter]:
    """Return the parameters of a fit in their order, with those in `tied` (expressions by name; None: none
    are tied) replaced by tied parameters.

    Raises:
        QuantityError: see `beside`.
    """
    tied = tied or {}
    own = {p.name: p for p in parameters}
    known = NamedValues(list(own), lambda name: (own[name].start, own[name].unit))
    found = {p.name: p for p in beside([n for n in own if n not in tied], tied, known)}
    return [found.get(p.name, p) for p in parameters]


def with_prior(p: Parameter, priors: Bounds) -> Parameter:
    """Return the parameter with its prior from `priors` (value and standard deviation by name, in SI or as
    strings); unchanged if `priors` has none for the parameter."""
    if p.name not in priors:
        return p
    value, deviation = (to_si(given, p.unit, f"prior of {p.name}") for given in priors[p.name])
    return p._replace(prior=(value, deviation))


def check_priors(priors: Bounds, free: Sequence[str], noise: float | None, what: str) -> None:
    """Raise QuantityError if a prior belongs to no free parameter, or if there are priors but no given noise
    (`noise` is None); `what` is the unit and meaning of the noise in the message."""
    for name in priors:
        if name not in free:
            raise QuantityError(f"there is a prior for {name!r}, which is not free{did_you_mean(name, free)}")
    if priors and noise is None:
        raise QuantityError(f"priors weigh against the noise: give noise {what}, too")


def linear(
    name: str,
    unit: str,
    start: float,
    ends: tuple[float, float],
    bounds: Bounds,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Parameter:
    """Return a fit parameter with a linear scale; `start` is moved into its bounds.

    Args:
        name, unit, start: name, unit and initial value, SI.
        ends: first search range, if `bounds` has no bounds for it.
        bounds: bounds by parameter name, in SI or as strings.
        limits: limits of the search beyond `ends`.
    """
    found = SearchRange.of(bounds, name)
    given = given_bounds(bounds, name, unit) if found is None else None
    if given is not None:
        start, square = min(max(start, given[0]), given[1]), Squared.are(bounds, name)
        return Parameter(name, start, *given, unit, log=False, square=square)
    low, high = ends if found is None else (found.lower, found.upper)
    return Parameter(name, min(max(start, low), high), low, high, unit, log=False, limits=limits)


def given_bounds(bounds: Bounds, name: str, unit: str) -> tuple[float, float] | None:
    """Return the bounds (lower, upper) of one parameter, converted to SI; None without bounds for the name,
    or with the default `LinearBounds()`.

    Raises:
        QuantityError: the lower bound is not below the upper one, or a bound has a wrong unit.
    """
    given = bounds.get(name)
    if given is None or (isinstance(given, LinearBounds) and given == LinearBounds()):
        return None
    low, high = (
        to_si(x, unit, f"{end} bound of {name}") for x, end in zip(given[:2], ("lower", "upper"), strict=True)
    )
    if not low < high:
        raise QuantityError(f"bounds of {name} = {tuple(given)}: the lower one comes first, and is less")
    return low, high


def check_names(free: Sequence[str], known: Sequence[str], bounds: Bounds) -> None:
    """Raise `QuantityError` unless `free` is a list of at least one name, every free name is known and given
    once, and every bound belongs to a free name."""
    _check_list(free, known)
    for name in free:
        if name not in known:
            hint = did_you_mean(name, known)
            raise QuantityError(f"{name!r} cannot be free{hint}: there are {', '.join(known)}")
        if list(free).count(name) > 1:
            raise QuantityError(f"{name!r} is free twice")
    for name in bounds:
        if name not in free:
            raise QuantityError(f"there are bounds for {name!r}, which is not free{did_you_mean(name, free)}")


def _check_list(free: Sequence[str | Parameter], known: Sequence[str]) -> None:
    if not free or isinstance(free, str):
        raise QuantityError(f"free = {free!r} must be a list of names, of {', '.join(known)}")
