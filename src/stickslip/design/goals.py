"""Goals of a drive signal as records; each gives one number per signal and condition.

`of(shapes, moved)` returns the numbers [n, conditions] of n polygons and their periodic motion;
`sign` is +1 if the number is to be maximised and -1 if it is to be minimised; `extras` names
results of the motion besides the net step ("ripple", "backward_rate"). Goals of the voltage alone
(current, heat) are the same under all conditions, and belong to the signal at the amplifier's input.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..physics.electronics import Stack
from ..physics.electronics.cycles import half_cycles
from ..quantities.records import Quantity, did_you_mean, record
from ..quantities.units import QuantityError
from .moving import PeriodicMotions
from .polygons import Polygons

Array = NDArray[np.float64]


class Goal(Protocol):
    """Interface of a goal: `label` and `unit` for reports; `sign`, +1 or -1, of a goal to be maximised or
    minimised; `moves`, True if the goal requires motion; `of`, its numbers [n, conditions]."""

    @property
    def label(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def sign(self) -> float: ...
    @property
    def moves(self) -> bool: ...

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array: ...


@record
class Speed(NamedTuple):
    """Goal: largest mean velocity of the end-effector, m/s, towards +x. With `direction` -1, towards -x,
    where the velocity is negative."""

    direction: Annotated[float, Quantity("", "", "+1 or -1", minimum=-1, maximum=1)] = 1.0

    label, unit, moves, swings = "speed", "m/s", True, (1.0,)

    def _check(self) -> None:
        if abs(self.direction) != 1.0:
            raise QuantityError(f"Speed.direction = {self.direction:g} must be +1 or -1")

    @property
    def sign(self) -> float:
        return self.direction

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return moved.steps / shapes.period[:, None]


@record
class StepSize(NamedTuple):
    """Goal: smallest deviation of the net step per period from `size`, m, at any allowed frequency."""

    size: Annotated[float, Quantity("m", "s", "net step that is wanted")]

    label, unit, sign, moves = "distance from the step", "m", -1.0, True

    @property
    def direction(self) -> float:
        return -1.0 if self.size < 0.0 else 1.0

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return np.abs(moved.steps - self.size)


@record
class Current(NamedTuple):
    """Goal: smallest peak current into the piezo, A."""

    capacitance: Annotated[float, Quantity("F", "C", "capacitance of the piezo", above=0)]

    label, unit, sign, moves = "peak current", "A", -1.0, False

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        peak = self.capacitance * np.abs(shapes.slopes()).max(axis=1)
        return np.broadcast_to(peak[:, None], moved.steps.shape)


class Heat(NamedTuple):
    """Goal: smallest mean loss in the piezo stack, W: the hysteresis loss of all closed cycles of the voltage
    in a period (`Stack.cycle_loss`), over the period."""

    stack: Stack

    label, unit, sign, moves = "heat", "W", -1.0, False

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        lost = np.zeros(len(shapes.period))
        for i, volts in enumerate(shapes.volts):
            around = np.roll(volts, -int(np.argmax(volts)))
            swings = half_cycles(np.append(around, around[0]))[0]
            lost[i] = 0.5 * float(np.sum(self.stack.cycle_loss(swings))) / shapes.period[i]
        return np.broadcast_to(lost[:, None], moved.steps.shape)


class Ripple(NamedTuple):
    """Goal: smallest deviation of the end-effector from uniform motion, m, peak to peak."""

    label, unit, sign, moves, extras = "ripple", "m", -1.0, False, ("ripple",)

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return moved.ripple


class BackwardRate(NamedTuple):
    """Goal: smallest backward rate: largest backward motion in a period over the forward motion."""

    label, unit, sign, moves, extras = "backward rate", "", -1.0, True, ("backward_rate",)

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return moved.backward_rate


NAMED: dict[str, Any] = {"speed": Speed(), "ripple": Ripple(), "backward_rate": BackwardRate()}
# Goals that need arguments: the name, and the call in which the user gives the arguments.
OTHERS = {
    "step": "StepSize(size)",
    "current": "Current(capacitance)",
    "heat": "Heat(stack)",
    "tip load": "TipLoad.of_stage(model)",
    "noise": "Noise.of_stage(model)",
}


def extras_of(*goals: Any) -> tuple[str, ...]:
    """Return the names of the results of a motion, besides the net step, that goals need: "ripple",
    "backward_rate"."""
    return tuple(dict.fromkeys(name for goal in goals for name in getattr(goal, "extras", ())))


def direction_of(goal: Any) -> float:
    """Return +1 or -1, the direction of motion that a goal requires; +1 for a goal without motion."""
    return getattr(goal, "direction", 1.0)


def swings_of(goal: Any) -> tuple[float, ...]:
    """Return the amplitudes at which a search for a sawtooth starts, as shares of the voltage range; for the
    speed only 1, the whole range."""
    return getattr(goal, "swings", (1.0, 0.5, 0.25))


def goal_of(given: Any) -> Any:
    """Return the goal with a given name, or a given goal itself.

    Raises:
        QuantityError: no goal is given, the name is unknown, or a goal of this name needs arguments.
    """
    if given is None:
        raise QuantityError(f"a goal is needed: {', '.join(NAMED)}, or one of {', '.join(OTHERS.values())}")
    if isinstance(given, str):
        if given in NAMED:
            return NAMED[given]
        if given in OTHERS:
            raise QuantityError(f"goal {given!r} needs numbers: give design.{OTHERS[given]}")
        known = [*NAMED, *OTHERS]
        raise QuantityError(
            f"goal {given!r} is unknown{did_you_mean(given, known)}; there are {', '.join(known)}"
        )
    if not all(hasattr(given, name) for name in ("of", "sign", "unit", "label", "moves")):
        raise QuantityError(
            f"goal = {given!r:.60} is unknown: give 'speed', or one of {', '.join(OTHERS.values())}"
        )
    return given
