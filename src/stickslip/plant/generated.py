"""The equations of `system` as straight-line code in local variables, one set of functions per layout.

What a processor keeps in registers cannot be a loop over arrays, and what loops over tuples of different
records cannot be compiled; so the text of each function is made once per layout, from the one form of the
equations in `dynamics` and `kinematics`. In kernels the functions are chosen by the type of the plant; as
plain Python, by the plant itself.
"""

from __future__ import annotations

import functools
import inspect
import itertools
import math
from collections.abc import Callable
from typing import Any

from .._jit import FUSED, overload_with, record_class
from ..friction.law import (
    bounded,
    branch_at,
    branch_left,
    branch_of,
    breakaway,
    element,
    law_slopes,
    rate,
    reversal_kink,
    smooth_rate,
    ticked_state,
    with_branch,
)
from ..friction.normal_force import along, kept, leaning, softening, uniform
from ..friction.static import static_slope
from . import dynamics, kinematics
from .system import Layout, layout_of, with_values

SOURCES = dynamics.SOURCES | kinematics.SOURCES
_ARGUMENTS: dict[str, tuple[str, ...]] = {}  # of each function, by its name
# What the text calls.
_NAMES = {
    "inf": math.inf,
    "floor": math.floor,
    "sqrt": math.sqrt,
    "ticked_state": ticked_state,
    "breakaway": breakaway,
    "rate": rate,
    "along": along,
    "softening": softening,
    "kept": kept,
    "leaning": leaning,
    "uniform": uniform,
    "element": element,
    "smooth_rate": smooth_rate,
    "law_slopes": law_slopes,
    "static_slope": static_slope,
    "reversal_kink": reversal_kink,
    "bounded": bounded,
    "branch_at": branch_at,
    "branch_left": branch_left,
    "branch_of": branch_of,
    "with_branch": with_branch,
}


@functools.cache
def _made(name: str, layout: Layout) -> Callable[..., Any]:
    """The function of this name for a layout."""
    names = dict(_NAMES)
    exec(compile(_text(name, layout), f"<{name} of {layout}>", "exec"), names)
    return names[name]


def _text(name: str, layout: Layout) -> str:
    text = SOURCES[name](layout)
    head = f"def {name}({', '.join(_ARGUMENTS[name])}):"
    return "\n    ".join([head, *text.lines, f"return {text.result}"]) + "\n"


def source(name: str, plant: Any) -> str:
    """The text of a generated function, to be read."""
    return _text(name, layout_of(plant))


def _generated(stub: Callable[..., Any]) -> Any:
    """What a function of a plant becomes: its text for the layout, compiled into each kernel."""
    name = stub.__name__

    @functools.wraps(stub)
    def plain(plant: Any, *args: Any) -> Any:
        return _made(name, layout_of(plant))(plant, *args)

    def chosen(plant: Any, *args: Any) -> Any:
        return _made(name, layout_of(plant))

    _ARGUMENTS[name] = tuple(inspect.signature(stub).parameters)
    arguments = ", ".join(_ARGUMENTS[name])
    typed: dict[str, Any] = {"chosen": chosen}
    exec(f"def typing({arguments}): return chosen({arguments})", typed)
    overload_with(plain, FUSED)(typed["typing"])
    return plain


@_generated
def slope(plant: Any, sides: Any, q: Any, u: Any, normal: Any) -> Any:
    """dq/dt, and the outputs of the elements. `sides` [elements]: on which side of v = 0 each contact
    slides, 0 where it is held; `u` and `normal`: drive and load with their derivatives by time."""


@_generated
def factor(plant: Any, sides: Any, q: Any, u: Any, normal: Any, per_g: Any) -> Any:
    """What `solved` needs of W = 1/per_g - J, the partial derivative of dq/dt by time, the weights of an
    error of each element's states [m], and how fast its fastest state relaxes [1/s]."""


@_generated
def solved(plant: Any, sides: Any, w: Any, r: Any) -> Any:
    """x of W x = r: bodies eliminated, then elements against each other, and back."""


@_generated
def speeds(plant: Any, q: Any, u: Any) -> Any:
    """The input of each element, without what other elements feed into it; 0 for the one of a plant without
    any."""


@_generated
def relative_speeds(plant: Any, q: Any) -> Any:
    """As `speeds`, the part that is linear in the state."""


@_generated
def size(plant: Any, r: Any, weights: Any) -> Any:
    """The largest entry of an error vector in metres, or NaN."""


@_generated
def settled(plant: Any, q: Any, u: Any, local: Any) -> Any:
    """The state with each internal state put on a bound that it moves towards and is within `local` [m]
    of."""


@_generated
def kinks(plant: Any, q: Any, beyond: Any) -> Any:
    """By how much the rates of each contact's states jump in slope at v = 0, at the speed `beyond` [m/s]."""


@_generated
def brought(plant: Any, q: Any, u: Any, e: Any, speed: Any) -> Any:
    """The state with the input of contact e brought to this speed by an impulse of its own."""


@_generated
def riding(plant: Any, sides: Any, q: Any, u: Any, begun: Any, u_begun: Any) -> Any:
    """The state with the bodies of held contacts where they were to each other at the state `begun`,
    exactly."""


@_generated
def breakaways(plant: Any, q: Any, normal: Any) -> Any:
    """Largest force of each static contact at rest [N]; infinite for the others."""


@_generated
def statics(plant: Any) -> Any:
    """1.0 for each element that is a set-valued contact, 0.0 for the others."""


@_generated
def contacts(plant: Any) -> Any:
    """1.0 for each element with a kink at zero input, 0.0 for the others."""


@_generated
def drift_apart(plant: Any, q: Any, other: Any) -> Any:
    """The largest difference of two states but for the positions that nothing holds, m."""


@_generated
def gone(plant: Any, q: Any, begun: Any, apart: Any) -> Any:
    """How far the positions that nothing holds have moved, if more than `apart`; 0 for all else."""


@_generated
def unloaded(plant: Any, q: Any, ratio: Any) -> Any:
    """The state after the load of each loaded element jumped; it was `ratio` times the new one."""


@_generated
def state_of(plant: Any, values: Any) -> Any:
    """The state as a tuple, from the first numbers of an array."""


@_generated
def drive_rates(plant: Any) -> Any:
    """The share of du/dt in the input of each element."""


@_generated
def follows_drive(plant: Any) -> Any:
    """Whether a contact has a body that follows the drive."""


@_generated
def unrest(plant: Any, dq: Any, u: Any) -> Any:
    """The largest acceleration, with what the slope of the drive adds to it within 1/rate, m/s²."""


@_generated
def jolt(plant: Any, u: Any) -> Any:
    """What a change u of the drive and its derivatives adds to an acceleration within 1/rate, m/s²; infinite
    where a contact moves with the drive."""


@_generated
def moves_freely(plant: Any) -> Any:
    """Whether a body can be anywhere, so that a period may repeat further on."""


@_generated
def branched(plant: Any) -> Any:
    """Whether a law has branches (see `friction.law.Branches`)."""


@_generated
def on_branches(plant: Any, sides: Any, q: Any, v: Any, dv: Any) -> Any:
    """The sides with the branches on which the states are, at speeds `v` that change by `dv`."""


@_generated
def branches_hold(plant: Any, sides: Any, q: Any, v: Any, dv: Any) -> Any:
    """Whether all states are still on the branches that the sides tell."""


@_generated
def decay(plant: Any, lasts: Any) -> Any:
    """By what part a vibration on the bristles of a contact that sticks decays within a radian, at least; 1
    within the time `lasts` [s]."""


@_generated
def sampled(plant: Any) -> Any:
    """Whether there are elements that change at ticks."""


@_generated
def next_tick(plant: Any, t: Any) -> Any:
    """When the next sampled element is due after t, s; infinite where there is none."""


@_generated
def ticked(plant: Any, q: Any, u: Any, t: Any) -> Any:
    """The state after the ticks of the sampled elements that are due at t."""


@_generated
def no_sides(plant: Any) -> Any:
    """A tuple of zeros, one per element, at least one."""


def _maker(plant: Any) -> Callable[..., Any]:
    """The function of a plant's Numba type that makes such a plant from its numbers."""
    names: dict[str, Any] = {}
    count = itertools.count()

    def text(kind: Any) -> str:
        if hasattr(kind, "types") or hasattr(kind, "count"):
            inner = ", ".join(text(one) for one in kind) + ("," if len(kind) == 1 else "")
            if record_class(kind) is None:
                return f"({inner})"
            name = f"Record{len(names)}"
            names[name] = record_class(kind)
            return f"{name}({inner.rstrip(',')})"
        return "None" if str(kind) == "none" else f"values[{next(count)}]"

    return eval(f"lambda plant, values: {text(plant)}", names)


@overload_with(with_values, FUSED)
def _with_values(plant: Any, values: Any) -> Any:
    return _maker(plant)


@functools.cache
def _combination(size: int) -> Callable[..., Any]:
    entries = ", ".join(f"p[{i}] + a * k[{i}]" for i in range(size))
    return eval(f"lambda p, a, k: ({entries},)")


def plus(p: Any, a: float, k: Any) -> Any:
    """p + a k, of states."""
    return _combination(len(p))(p, a, k)


@overload_with(plus, FUSED)
def _plus(p: Any, a: Any, k: Any) -> Any:
    return _combination(len(p))


@functools.cache
def _product(size: int) -> Callable[..., Any]:
    return eval(f"lambda a, k: ({', '.join(f'a * k[{i}]' for i in range(size))},)")


def times(a: float, k: Any) -> Any:
    """a k, of states."""
    return _product(len(k))(a, k)


@overload_with(times, FUSED)
def _times(a: Any, k: Any) -> Any:
    return _product(len(k))


@functools.cache
def _replacement(size: int) -> Callable[..., Any]:
    entries = ", ".join(f"value if i == {i} else row[{i}]" for i in range(size))
    return eval(f"lambda row, i, value: ({entries},)")


def replaced(row: Any, i: int, value: float) -> Any:
    """The row with another number at i."""
    return _replacement(len(row))(row, i, value)


@overload_with(replaced, FUSED)
def _replaced(row: Any, i: Any, value: Any) -> Any:
    return _replacement(len(row))
