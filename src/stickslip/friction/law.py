r"""Interface of a friction law, for every engine.

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
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from .. import registry
from .._jit import compiled, fused, overload, record_class
from .fields_read import refuse_unknown_fields


class Branches(NamedTuple):
    """The branches of a law whose rate jumps or kinks where its state meets a curve: a step stays on one,
    smoothly continued, and is cut where it leaves it. For laws that are the same in both directions: all take
    the `speed` |v|, its `growth` d|v|/dt and `z` in the direction of sliding.

    ``choose(law, speed, growth, z) -> 0, 1, 2 or 3``; ``rate(law, speed, z, branch) -> (F, ż)``;
    ``left(law, speed, growth, z, branch)``, negative where the branch ends.
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
    """Make a record a friction law, known by its name from then on.

    Args:
        law_type: the record, a ``typing.NamedTuple``.
        rate: ``rate(law, v, z) -> (F, ż)``, a plain function that Numba can compile; none for a composed
            law, whose elements have it.
        breakaway: ``breakaway(law) -> N``, for a static law only.
        elements: ``elements(law) -> int``, for a composed law only, with `element`.
        element: ``element(law, i) -> record`` of the i-th element, itself registered.
        project: ``project(law, z) -> z``, where the law bounds its state (a reset); applied after each step.
        tick: ``tick(law, v, z) -> z``, for a sampled element with a field `period` [s]: called at each
            multiple of it, with the input of that instant; between the ticks the state stays (its ż is 0).
        branches: of a law whose rate is smooth only in parts, see `Branches`; `rate` stays the whole law.
        smooth: the record is no friction contact but an element without a kink at v = 0: a lag, an
            amplifier, creep, a controller (see `plant.system`); its input v and output F are in whatever unit
            its maker says.
        named: false for the elements of a composed law, which nobody names.

    Raises:
        TypeError: the record is no named tuple, there is not either `rate` or `elements` with `element`, the
            arguments of a function have other names than above, or it reads a field that the record lacks.
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
    """Whether the object is a record registered as a friction law."""
    return type(candidate) in _IMPLEMENTATIONS


def is_static(law_type: type) -> bool:
    """Whether records of this type are set-valued at rest."""
    return _IMPLEMENTATIONS[law_type].breakaway is not None


def is_sampled(law_type: type) -> bool:
    """Whether records of this type have a state that changes at ticks."""
    return _IMPLEMENTATIONS[law_type].tick is not None


def is_smooth(law_type: type) -> bool:
    """Whether records of this type have no kink at v = 0."""
    return _IMPLEMENTATIONS[law_type].smooth


def has_branches(law: Any) -> bool:
    """Whether the law, or the elements that it is composed of, have branches."""
    return _implementation(element(law, 0)).branches is not None


def has_jumps(law: Any) -> bool:
    """Whether the rate of the law jumps where its state meets a curve: the motion is then no smooth function
    of the parameters. Of laws with branches, those whose ``jumps`` is not False."""
    return bool(getattr(law, "jumps", has_branches(law)))


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


def ticked_state(law: Any, v: float, z: float) -> float:
    """The state of a sampled element after its tick."""
    function = _implementation(law).tick
    return function(law, v, z) if function else z


@overload(ticked_state)
def _ticked_state(law: Any, v: Any, z: Any) -> Any:
    implementation = _of(law)
    return (implementation.tick or (lambda law, v, z: z)) if implementation else None


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


@fused
def branch_of(side, i):
    """The side of a contact that tells the branch of its state i: see `with_branch`."""
    return math.copysign(1.0 + ((int(abs(side)) - 1) >> 2 * i & 3), side)


@fused
def with_branch(side, i, branch):
    """A side, -1 or 1, whose size tells the branches of the contact's states as well: 1 where all are 0, and
    branch times 4^i more for that of state i."""
    return side + math.copysign(float(branch << 2 * i), side)


def rate_on(law: Any, v: float, z: float, side: float) -> tuple[float, float]:
    """`rate` on the branch that the side tells."""
    branches = _implementation(law).branches
    return _branched(law, v, z, side, branches.rate) if branches else rate(law, v, z)


def _branched(law: Any, v: float, z: float, side: float, rate: Callable[..., Any]) -> tuple[float, float]:
    sign = math.copysign(1.0, side)
    force, dz = rate(law, abs(v), sign * z, int(abs(side)) - 1)
    return sign * force, sign * dz


def branch_at(law: Any, side: float, v: float, dv: float, z: float) -> int:
    """The branch of a state at an instant; 0 for a law without any."""
    branches, sign = _implementation(law).branches, math.copysign(1.0, side)
    return branches.choose(law, abs(v), sign * dv, sign * z) if branches else 0


def branch_left(law: Any, side: float, v: float, dv: float, z: float) -> float:
    """Negative where the branch of a state has ended."""
    branches, sign = _implementation(law).branches, math.copysign(1.0, side)
    return branches.left(law, sign * v, sign * dv, sign * z, int(abs(side)) - 1) if branches else 1.0


@overload(rate_on)
def _rate_on(law: Any, v: Any, z: Any, side: Any) -> Any:
    branches = implementation.branches if (implementation := _of(law)) else None
    if branches is None:
        return lambda law, v, z, side: rate(law, v, z)
    of, branched = fused(branches.rate), fused(_branched)
    return lambda law, v, z, side: branched(law, v, z, side, of)


@overload(branch_at)
def _branch_at(law: Any, side: Any, v: Any, dv: Any, z: Any) -> Any:
    branches = implementation.branches if (implementation := _of(law)) else None
    if branches is None:
        return lambda law, side, v, dv, z: 0
    of = fused(branches.choose)
    return lambda law, side, v, dv, z: of(
        law, abs(v), math.copysign(1.0, side) * dv, math.copysign(1.0, side) * z
    )


@overload(branch_left)
def _branch_left(law: Any, side: Any, v: Any, dv: Any, z: Any) -> Any:
    branches = implementation.branches if (implementation := _of(law)) else None
    if branches is None:
        return lambda law, side, v, dv, z: 1.0
    of, sign = fused(branches.left), math.copysign
    return lambda law, side, v, dv, z: of(
        law, sign(1.0, side) * v, sign(1.0, side) * dv, sign(1.0, side) * z, int(abs(side)) - 1
    )


@fused
def smooth_rate(law, v, z, side):
    """Force and rate on one side of v = 0, continued beyond it by reflection in the point v = 0, which keeps
    value
    and slope: the kink of |v| never enters a step, which is cut at the reversal afterwards."""
    force, dz = rate_on(law, math.copysign(v, side), z, side)
    if v * side >= 0.0:
        return force, dz
    force_0, dz_0 = rate_on(law, 0.0, z, side)
    return 2.0 * force_0 - force, 2.0 * dz_0 - dz


@fused
def law_slopes(law, v, z, side):
    """F, dF/dv, dF/dz, dż/dv, dż/dz by one-sided differences: outwards in v from the `side` of v = 0 (0: of
    no contact, by v itself), and off a bound on z."""
    at = math.copysign(v, side) if side != 0.0 else v
    dv = math.copysign(1e-5 * abs(at) + 1e-11, side)
    dz = math.copysign(1e-5 * abs(z) + 1e-15, z)
    force, rate_0 = rate_on(law, at, z, side)
    force_v, rate_v = rate_on(law, at + dv, z, side)
    force_z, rate_z = rate_on(law, at, z + dz, side)
    return (
        force,
        (force_v - force) / dv,
        (force_z - force) / dz,
        (rate_v - rate_0) / dv,
        (rate_z - rate_0) / dz,
    )


@fused
def reversal_kink(law, z, beyond):
    """By how much dż/dv jumps at v = 0, times the speed `beyond` [m/s]."""
    return abs(rate(law, beyond, z)[1] + rate(law, -beyond, z)[1])


@fused
def bounded(law, z, towards):
    """z put on a bound of the law that it moves towards and is within an error of; else the steps would
    shrink before it for ever, for the rate jumps there."""
    ahead = z + towards
    bound = project(law, ahead)
    return bound if bound != ahead else project(law, z)


@compiled
def force(law: Any, v: float, z: Any) -> float:
    """Total friction force [N]; `z` holds the internal states (of a static law: the direction)."""
    total = 0.0
    for i in range(max(elements(law), 1)):
        total += rate(element(law, i), v, z[i])[0]
    return total
