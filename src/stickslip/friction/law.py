r"""What a friction law is, for every engine.

A law is a frozen record (its parameters) and one compiled function in the symbols of its paper,

    F, ż = rate(law, v, z)

with the sliding velocity v [m/s] of the driving body relative to the driven one, the internal state z and the
friction force F [N] on the driven body (positive when v > 0). There are three kinds:

* **bristle laws** (`Dahl`, `ResetIntegrator`, `LuGre`, `Elastoplastic`, or a user's own): z [m] is the mean
  deflection of the contact; the law has one such state.
* **static laws** (`Coulomb`, `CoulombViscous`, `StictionCoulombViscous`, `Stribeck`): no state. `z` is the direction
  of sliding (-1 or +1), ż is 0, and `breakaway` gives the largest force at rest; the solver holds the
  contact at true rest (a set-valued force) until that is exceeded.
* **composed laws** (`MaxwellSlip`): several elements in parallel; `element(law, i)` is the record of the i-th, itself
  a bristle law, and the force is the sum.

Forces are those at the reference normal force; a normal-force input multiplies them (F_C = mu N).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from .._jit import compiled, overload, record_class


class _Implementation(NamedTuple):
    rate: Callable[..., Any]
    breakaway: Callable[..., Any] | None
    elements: Callable[..., Any] | None
    element: Callable[..., Any] | None
    project: Callable[..., Any] | None


_IMPLEMENTATIONS: dict[type, _Implementation] = {}


def register(
    law_type: type,
    rate: Callable[..., Any],
    *,
    breakaway: Callable[..., Any] | None = None,
    elements: Callable[..., Any] | None = None,
    element: Callable[..., Any] | None = None,
    project: Callable[..., Any] | None = None,
) -> None:
    """Make a record a friction law.

    Args:
        law_type: the record, a ``typing.NamedTuple``.
        rate: ``rate(law, v, z) -> (F, ż)``, a plain function that Numba can compile; the argument names count.
        breakaway: ``breakaway(law) -> N``, for a static law only.
        elements: ``elements(law) -> int``, for a composed law only, with `element`.
        element: ``element(law, i) -> record`` of the i-th element.
        project: ``project(law, z) -> z``, where the law bounds its state (a reset); applied after each step.

    Raises:
        TypeError: the record is no named tuple, or `elements` comes without `element`.
    """
    if not hasattr(law_type, "_fields"):
        raise TypeError(f"{law_type.__name__} is no record: a law is a typing.NamedTuple with one field per parameter")
    if (elements is None) != (element is None):
        raise TypeError(f"{law_type.__name__}: elements and element go together")
    _IMPLEMENTATIONS[law_type] = _Implementation(rate, breakaway, elements, element, project)


def is_law(candidate: object) -> bool:
    """Whether the object is a record registered as a friction law."""
    return type(candidate) in _IMPLEMENTATIONS


def _of(numba_type: Any) -> _Implementation | None:
    return _IMPLEMENTATIONS.get(record_class(numba_type))  # type: ignore[arg-type]


def rate(law: Any, v: float, z: float) -> tuple[float, float]:
    """The law's equation: friction force [N] and rate of the internal state, for a law of one element."""
    return _IMPLEMENTATIONS[type(law)].rate(law, v, z)


def breakaway(law: Any) -> float:
    """Largest force [N] of a static law at rest; 0 for the others, which have no true rest."""
    implementation = _IMPLEMENTATIONS[type(law)]
    return implementation.breakaway(law) if implementation.breakaway else 0.0


def elements(law: Any) -> int:
    """Number of internal states: 0 for a static law, 1 for a bristle law, N for a composed one."""
    implementation = _IMPLEMENTATIONS[type(law)]
    if implementation.elements:
        return implementation.elements(law)
    return 0 if implementation.breakaway else 1


def element(law: Any, i: int) -> Any:
    """The record of the i-th element; the law itself unless it is composed."""
    implementation = _IMPLEMENTATIONS[type(law)]
    return implementation.element(law, i) if implementation.element else law


def project(law: Any, z: float) -> float:
    """The internal state put back inside the bounds that the law sets."""
    implementation = _IMPLEMENTATIONS[type(law)]
    return implementation.project(law, z) if implementation.project else z


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
    """Total friction force [N]; `z` is the array of internal states (of length 1, the direction, for a static law)."""
    total = 0.0
    for i in range(max(elements(law), 1)):
        total += rate(element(law, i), v, z[i])[0]
    return total
