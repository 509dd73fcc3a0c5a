r"""Interface of a friction law, for every engine.

A law is a frozen record (its parameters) and one function in the symbols of its paper,

    F, ż = rate(law, v, z)

with the sliding velocity v [m/s] of the driving body relative to the driven one, the internal state z and the
friction force F [N] on the driven body (positive when v > 0). There are three kinds:

* **bristle laws** (`Dahl`, `ResetIntegrator`, `LuGre`, `Elastoplastic`, or a user's own): z [m] is the mean
  deflection of the contact; the law has one such state.
* **static laws** (`Coulomb`, `CoulombViscous`, `StictionCoulombViscous`, `Stribeck`): no state. `z` is the
  direction of sliding (-1 or +1), ż is 0, and `breakaway` gives the largest force at rest; the solver holds
  the contact at true rest (a set-valued force) until that is exceeded.
* **composed laws** (`MaxwellSlip`): several elements in parallel; `element(law, i)` is the record of the
  i-th, itself a bristle law, and the force is the sum.

Forces are those at the reference normal force; a normal-force input multiplies them (F_C = mu N).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

from ..quantities import registry
from .fields_read import refuse_unknown_fields


class Branches(NamedTuple):
    """Branches of a law: regions of speed and state in which its rate is smooth.

    The rate jumps or has a kink from one branch to the next. An integration step uses the smooth continuation
    of one branch, and is cut where it leaves the branch. This is for laws that are the same in both
    directions: all functions take the `speed`, the magnitude of v [m/s], its rate `growth` [m/s^2], and the
    state `z` in the direction of sliding.

    ``choose(law, speed, growth, z)`` returns the number of the branch, 0 to 3. ``rate(law, speed, z,
    branch)`` returns (F, ż). ``left(law, speed, growth, z, branch)`` returns a number that becomes negative
    where the branch ends.
    """

    choose: Callable[..., Any]
    rate: Callable[..., Any]
    left: Callable[..., Any]


class _Implementation(NamedTuple):
    rate: Callable[..., Any] | None
    breakaway: Callable[..., Any] | None
    elements: Callable[..., Any] | None
    element: Callable[..., Any] | None
    project: Callable[..., Any] | None
    tick: Callable[..., Any] | None
    branches: Branches | None
    smooth: bool


_ARGUMENTS = {
    "tick": ("law", "v", "z"),
    "element": ("law", "i"),
    "project": ("law", "z"),
    "rate": ("law", "v", "z"),
}
_IMPLEMENTATIONS: dict[type, _Implementation] = {}


def register(
    law_type: type,
    rate: Callable[..., Any] | None = None,
    *,
    breakaway: Callable[..., Any] | None = None,
    elements: Callable[..., Any] | None = None,
    element: Callable[..., Any] | None = None,
    project: Callable[..., Any] | None = None,
    tick: Callable[..., Any] | None = None,
    branches: Branches | None = None,
    smooth: bool = False,
    named: bool = True,
) -> None:
    """Register a record as a friction law, which is then available by its name.

    Args:
        law_type: the record, a ``typing.NamedTuple``.
        rate: ``rate(law, v, z) -> (F, ż)``, a plain function; none for a composed
            law, whose elements have it.
        breakaway: ``breakaway(law) -> N``, for a static law only.
        elements: ``elements(law) -> int``, for a composed law only, with `element`.
        element: ``element(law, i) -> record`` of the i-th element, itself registered.
        project: ``project(law, z) -> z``, if the law bounds its state (a reset); applied after each step.
        tick: ``tick(law, v, z) -> z``, for a sampled element with a field `period` [s]: called at each
            multiple of `period`, with the input at that instant; the state is constant in between.
        branches: parts of a law whose rate is only piecewise smooth, see `Branches`; `rate` is the whole law.
        smooth: the record is not a friction contact but an element without a kink at v = 0: a lag, an
            amplifier, creep, a controller (see `simulation.plant.system`); its input v and output F may have
            any unit.
        named: False for the elements of a composed law, which are not available by name.

    Raises:
        TypeError: the record is not a named tuple; `rate`, or `elements` with `element`, is missing; the
            arguments of a function have other names than above; or it reads a field that the record lacks.
    """
    name = law_type.__name__
    if not hasattr(law_type, "_fields"):
        raise TypeError(f"{name} is no record: a law is a typing.NamedTuple with one field per parameter")
    if (elements is None) != (element is None):
        raise TypeError(f"{name}: elements and element go together")
    if (rate is None) != (elements is not None):
        raise TypeError(f"{name}: a law has either a rate, or elements that have one")
    made = _Implementation(rate, breakaway, elements, element, project, tick, branches, smooth)
    for role, function in zip(made._fields[:-2], made[:-2], strict=True):
        expected = _ARGUMENTS.get(role, ("law",))
        if function is not None and tuple(inspect.signature(function).parameters) != expected:
            raise TypeError(f"{name}: {role} must be a function of ({', '.join(expected)}), named so")
        if function is not None:
            refuse_unknown_fields(law_type, function)
    _IMPLEMENTATIONS[law_type] = made
    if named and not smooth:
        registry.laws.add(law_type)


def is_law(candidate: object) -> bool:
    """Return True if the object is a record of a type that was registered, also as an element or `smooth`."""
    return type(candidate) in _IMPLEMENTATIONS


def is_smooth(law_type: type) -> bool:
    """Return True if this type, which must be registered, was registered as `smooth`: no kink at v = 0."""
    return _IMPLEMENTATIONS[law_type].smooth


def has_branches(law: Any) -> bool:
    """Return True if the law, or the first element of a composed law, has `Branches`."""
    return _implementation(element(law, 0)).branches is not None


def has_jumps(law: Any) -> bool:
    """Return True if the rate of the law jumps where its state meets a curve.

    The motion is then not a smooth function of the parameters. This is so for laws with branches, unless
    their ``jumps`` is False.
    """
    return bool(getattr(law, "jumps", has_branches(law)))


def _implementation(law: Any) -> _Implementation:
    try:
        return _IMPLEMENTATIONS[type(law)]
    except KeyError:
        raise TypeError(f"{type(law).__name__} is no friction law: it was never registered") from None


def rate(law: Any, v: float, z: float) -> tuple[float, float]:
    """Return the friction force [N] and the rate ż of the internal state [m/s for a deflection], for a law of
    one element at the sliding velocity v [m/s] and state z [m].

    Raises:
        TypeError: the law is composed (use its elements), or the object is not a law.
    """
    function = _implementation(law).rate
    if function is None:
        raise TypeError(
            f"{type(law).__name__} is composed: its elements have the rate, rate(element(law, i), v, z)"
        )
    return function(law, v, z)


def breakaway(law: Any) -> float:
    """Return the largest force [N] of a static law at rest; 0 for other laws, which have no true rest."""
    function = _implementation(law).breakaway
    return function(law) if function else 0.0


def elements(law: Any) -> int:
    """Return the number of internal states: 0 for a static law, 1 for a bristle law, N for a composed one."""
    implementation = _implementation(law)
    if implementation.elements:
        return implementation.elements(law)
    return 0 if implementation.breakaway else 1


def element(law: Any, i: int) -> Any:
    """Return the record of the i-th element; the law itself unless it is composed."""
    function = _implementation(law).element
    return function(law, i) if function else law


def project(law: Any, z: float) -> float:
    """Return the internal state z [m], limited to the bounds of the law (unchanged if it has none), for a law
    of one element."""
    function = _implementation(law).project
    return function(law, z) if function else z


def force(law: Any, v: float, z: Any) -> float:
    """Return the total friction force [N] of any law.

    Args:
        law: the law.
        v: sliding velocity, m/s.
        z: internal states of all elements, [n]; for a static law the direction of sliding, [1]: 1 or -1.
    """
    total = 0.0
    for i in range(max(elements(law), 1)):
        total += rate(element(law, i), v, z[i])[0]
    return total
