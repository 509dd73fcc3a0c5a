r"""What a friction law is, for every engine.

A law is a frozen record (its parameters) and one compiled function in the symbols of its paper,

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

from .._jit import compiled, overload, record_class


class _Implementation(NamedTuple):
    rate: Callable[..., Any] | None
    breakaway: Callable[..., Any] | None
    elements: Callable[..., Any] | None
    element: Callable[..., Any] | None
    project: Callable[..., Any] | None


_ARGUMENTS = {"element": ("law", "i"), "project": ("law", "z"), "rate": ("law", "v", "z")}
_IMPLEMENTATIONS: dict[type, _Implementation] = {}


def register(
    law_type: type,
    rate: Callable[..., Any] | None = None,
    *,
    breakaway: Callable[..., Any] | None = None,
    elements: Callable[..., Any] | None = None,
    element: Callable[..., Any] | None = None,
    project: Callable[..., Any] | None = None,
) -> None:
    """Make a record a friction law.

    Args:
        law_type: the record, a ``typing.NamedTuple``.
        rate: ``rate(law, v, z) -> (F, ż)``, a plain function that Numba can compile; none for a composed
            law, whose elements have it.
        breakaway: ``breakaway(law) -> N``, for a static law only.
        elements: ``elements(law) -> int``, for a composed law only, with `element`.
        element: ``element(law, i) -> record`` of the i-th element, itself registered.
        project: ``project(law, z) -> z``, where the law bounds its state (a reset); applied after each step.

    Raises:
        TypeError: the record is no named tuple, there is not either `rate` or `elements` with `element`, or
            the arguments of a function have other names than above.
    """
    name = law_type.__name__
    if not hasattr(law_type, "_fields"):
        raise TypeError(f"{name} is no record: a law is a typing.NamedTuple with one field per parameter")
    if (elements is None) != (element is None):
        raise TypeError(f"{name}: elements and element go together")
    if (rate is None) != (elements is not None):
        raise TypeError(f"{name}: a law has either a rate, or elements that have one")
    made = _Implementation(rate, breakaway, elements, element, project)
    for role, function in zip(made._fields, made, strict=True):
        expected = _ARGUMENTS.get(role, ("law",))
        if function is not None and tuple(inspect.signature(function).parameters) != expected:
            raise TypeError(f"{name}: {role} must be a function of ({', '.join(expected)}), named so")
    _IMPLEMENTATIONS[law_type] = made


def is_law(candidate: object) -> bool:
    """Whether the object is a record registered as a friction law."""
    return type(candidate) in _IMPLEMENTATIONS


def _of(numba_type: Any) -> _Implementation | None:
    return _IMPLEMENTATIONS.get(record_class(numba_type))  # type: ignore[arg-type]


def _implementation(law: Any) -> _Implementation:
    try:
        return _IMPLEMENTATIONS[type(law)]
    except KeyError:
        raise TypeError(f"{type(law).__name__} is no friction law: it was never registered") from None


def rate(law: Any, v: float, z: float) -> tuple[float, float]:
    """The law's equation: friction force [N] and rate of the internal state, for a law of one element.

    Raises:
        TypeError: the law is composed (ask its elements), or no law at all.
    """
    function = _implementation(law).rate
    if function is None:
        raise TypeError(
            f"{type(law).__name__} is composed: its elements have the rate, rate(element(law, i), v, z)"
        )
    return function(law, v, z)


def breakaway(law: Any) -> float:
    """Largest force [N] of a static law at rest; 0 for the others, which have no true rest."""
    function = _implementation(law).breakaway
    return function(law) if function else 0.0


def elements(law: Any) -> int:
    """Number of internal states: 0 for a static law, 1 for a bristle law, N for a composed one."""
    implementation = _implementation(law)
    if implementation.elements:
        return implementation.elements(law)
    return 0 if implementation.breakaway else 1


def element(law: Any, i: int) -> Any:
    """The record of the i-th element; the law itself unless it is composed."""
    function = _implementation(law).element
    return function(law, i) if function else law


def project(law: Any, z: float) -> float:
    """The internal state put back inside the bounds that the law sets; for a law of one element."""
    function = _implementation(law).project
    return function(law, z) if function else z


def with_fields(law: Any, values: Any) -> Any:
    """A law of the same kind with these values of its fields, unchecked."""
    return tuple.__new__(type(law), values)


@overload(with_fields)
def _with_fields(law: Any, values: Any) -> Any:
    # Spelled out, because compiled code cannot take the fields of a record from an array of any length.
    names = ", ".join(f"values[{i}]" for i in range(len(law)))
    return eval(f"lambda law, values: made({names})", {"made": record_class(law)})


@overload(rate)
def _rate(law: Any, v: Any, z: Any) -> Any:
    implementation = _of(law)
    return implementation.rate if implementation else None


@overload(breakaway)
def _breakaway(law: Any) -> Any:
    implementation = _of(law)
    if implementation is None:
        return None
    return implementation.breakaway or (lambda law: 0.0)


@overload(elements)
def _elements(law: Any) -> Any:
    implementation = _of(law)
    if implementation is None:
        return None
    return implementation.elements or ((lambda law: 0) if implementation.breakaway else (lambda law: 1))


@overload(element)
def _element(law: Any, i: Any) -> Any:
    implementation = _of(law)
    if implementation is None:
        return None
    return implementation.element or (lambda law, i: law)


@overload(project)
def _project(law: Any, z: Any) -> Any:
    implementation = _of(law)
    if implementation is None:
        return None
    return implementation.project or (lambda law, z: z)


@compiled
def force(law: Any, v: float, z: Any) -> float:
    """Total friction force [N]; `z` holds the internal states (of a static law: the direction)."""
    total = 0.0
    for i in range(max(elements(law), 1)):
        total += rate(element(law, i), v, z[i])[0]
    return total
