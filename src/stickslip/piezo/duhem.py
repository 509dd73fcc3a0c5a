r"""Hysteresis of your own on the drive, in the form of Duhem [oh2005]: one function, dh/du.

.. math:: H[u] = u - h, \qquad \frac{dh}{du} = s(u, h, \operatorname{sign} \dot u), \qquad y = C H[u]

h [V] is what the hysteresis takes from the voltage u; it is 0 at 0 V at first. A model is a record and its
slope s. Rate-independent: how fast the voltage moves does not matter, only where it turns. On each way h is
integrated by Runge-Kutta's formula of fourth order, in steps that are halved until both halves agree with the
whole. `BoucWen` is of this form too, and has its ways in closed form.

Valid where s is finite for every voltage that occurs; else h is NaN, and drives are refused. With s below 1
the stroke follows each way. Models with more memory than one number (plays, Preisach's relays) have not this
form.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import registry
from .._jit import compiled, kernel, overload, record_class
from .operators import REST, samples

Array = NDArray[np.float64]

# V, of h over one step; how often a way is halved at most, and the steps after which a slope has no solution.
EXACT, HALVINGS, MOST_STEPS = 1e-9, 40, 100_000


class _Implementation(NamedTuple):
    slope: Callable[..., Any]
    way: Callable[..., Any] | None
    corner: Callable[..., Any] | None


_ARGUMENTS = {
    "slope": ("model", "u", "h", "up"),
    "way": ("model", "h", "u", "goal"),
    "corner": ("model", "h", "u", "goal"),
}
_IMPLEMENTATIONS: dict[type, _Implementation] = {}


def register(
    model_type: type,
    slope: Callable[..., Any],
    *,
    way: Callable[..., Any] | None = None,
    corner: Callable[..., Any] | None = None,
) -> None:
    """Make a record a piezo model, known by its name from then on.

    Args:
        model_type: the record, a ``typing.NamedTuple``.
        slope: ``slope(model, u, h, up) -> dh/du``, up being 1.0 or -1.0, a plain function that Numba can
            compile.
        way: ``way(model, h, u, goal) -> h`` after a way of the voltage from u to the goal, in closed form;
            left out, the slope is integrated.
        corner: ``corner(model, h, u, goal) -> u`` where h comes to 0 on that way, for a slope that jumps
            there; the goal where it does not.

    Raises:
        TypeError: the record is no named tuple, or the arguments of a function have other names than above.
    """
    name, made = model_type.__name__, _Implementation(slope, way, corner)
    if not hasattr(model_type, "_fields"):
        raise TypeError(f"{name} is no record: a piezo model is a typing.NamedTuple, one field per parameter")
    for role, function in zip(made._fields, made, strict=True):
        expected = _ARGUMENTS[role]
        if function is not None and tuple(inspect.signature(function).parameters) != expected:
            raise TypeError(f"{name}: {role} must be a function of ({', '.join(expected)}), named so")
    _IMPLEMENTATIONS[model_type] = made
    registry.piezos.add(model_type)


def is_duhem(candidate: object) -> bool:
    """Whether the object is a record registered here."""
    return type(candidate) in _IMPLEMENTATIONS


def slope(model: Any, u: float, h: float, up: float) -> float:
    """dh/du on a way of the voltage in the direction `up`, 1.0 or -1.0."""
    return _IMPLEMENTATIONS[type(model)].slope(model, u, h, up)


def way(model: Any, h: float, u: float, goal: float) -> float:
    """h [V] after a way of the voltage from u to the goal."""
    return (_IMPLEMENTATIONS[type(model)].way or _integrated)(model, h, u, goal)


def corner(model: Any, h: float, u: float, goal: float) -> float:
    """Where h comes to 0 on the way to the goal [V], and the slope jumps; the goal if nowhere."""
    function = _IMPLEMENTATIONS[type(model)].corner
    return function(model, h, u, goal) if function else goal


def _of(numba_type: Any) -> _Implementation | None:
    return _IMPLEMENTATIONS.get(record_class(numba_type))  # type: ignore[arg-type]


@overload(slope)
def _slope(model: Any, u: Any, h: Any, up: Any) -> Any:
    implementation = _of(model)
    return _plain(implementation.slope) if implementation else None


@overload(way)
def _way(model: Any, h: Any, u: Any, goal: Any) -> Any:
    implementation = _of(model)
    if implementation is None:
        return None
    return _plain(implementation.way or (lambda model, h, u, goal: _integrated(model, h, u, goal)))


@overload(corner)
def _corner(model: Any, h: Any, u: Any, goal: Any) -> Any:
    implementation = _of(model)
    if implementation is None:
        return None
    return _plain(implementation.corner or (lambda model, h, u, goal: goal))


def _plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """Of a compiled function, the one that it was made of."""
    return getattr(function, "py_func", function)


@compiled
def _stepped(model, h, u, du):
    """One step of Runge and Kutta's."""
    up = 1.0 if du > 0.0 else -1.0
    first = slope(model, u, h, up)
    second = slope(model, u + 0.5 * du, h + 0.5 * du * first, up)
    third = slope(model, u + 0.5 * du, h + 0.5 * du * second, up)
    fourth = slope(model, u + du, h + du * third, up)
    return h + du / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


@compiled
def _integrated(model, h, u, goal):
    """h after a way, its slope integrated in steps that are halved where it bends."""
    whole, share = goal - u, 1.0
    done = 0.0  # of the way
    for _ in range(MOST_STEPS):
        if not done < 1.0:
            break
        share = min(share, 1.0 - done)
        at, du = u + done * whole, share * whole
        coarse = _stepped(model, h, at, du)
        half = _stepped(model, h, at, 0.5 * du)
        fine = _stepped(model, half, at + 0.5 * du, 0.5 * du)
        if not math.isfinite(fine):
            break
        if abs(fine - coarse) <= EXACT or share <= 2.0**-HALVINGS:
            h = fine
            done += share
            share *= 2.0
        else:
            share *= 0.5
    return h if done >= 1.0 else math.nan


@kernel
def duhem_response(model, drive, u, h, out):
    """H at each sample, from the drive u and the state h on."""
    for k in range(drive.size):
        h = way(model, h, u, drive[k])
        u = drive[k]
        out[k] = u - h


def rested(model: Any, drive: float) -> float:
    """h [V] at a drive value [V] that was reached from 0 V, without turning back."""
    found = np.empty(1)
    duhem_response(model, np.array([float(drive)]), 0.0, 0.0, found)
    return float(drive) - float(found[0])


def output(model: Any, drive: ArrayLike, rest: float | str = 0.0) -> Array:
    """H[u] [V], shape (n,), of samples of a drive [V] between which it does not turn back.

    Args:
        model: a registered record.
        drive: shape (n,).
        rest: V at which it rested before the first sample, reached from 0 V.

    Raises:
        QuantityError: a sample, or rest, is no finite voltage.
    """
    at, u = REST.check(rest, "rest"), samples(drive, "drive")
    found = np.empty(u.size)
    duhem_response(model, u, at, rested(model, at), found)
    return found
