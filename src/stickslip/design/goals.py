"""Goals of a drive signal as records, each with one number per signal and condition; their choice by name.

The method `of(shapes, moved)` of a goal returns these numbers [n, conditions], SI, for n polygons of the
voltage and their periodic motions. `sign` is +1 if the number is to be maximised and -1 if it is to be
minimised. `extras` names the results of the motion that the goal needs besides the net step ("ripple",
"backward_rate"). Goals of the voltage alone (current, heat) are the same under all conditions, and belong to
the signal at the amplifier's input.
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
    """Interface of a goal.

    `label` and SI `unit` (of a linear actuator) are for reports; `sign` is +1 for a goal to be maximised, -1
    for one to be minimised; `moves` is True if the goal is only reached by motion. `of` returns its numbers
    [n, conditions] for n polygons.
    """

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
    """Goal: largest mean velocity of the end-effector towards +x, m/s, or rad/s for a rotary actuator.

    With `direction` -1 the motion is towards -x, and the velocity is negative.
    """

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
    """Goal: smallest deviation of the net step per period from `size`, at any allowed frequency. Both are in
    m, or rad for a rotary actuator; a negative size is a step towards -x."""

    size: Annotated[float, Quantity("m", "s", "net step that is wanted")]

    label, unit, sign, moves = "distance from the step", "m", -1.0, True

    @property
    def direction(self) -> float:
        return -1.0 if self.size < 0.0 else 1.0

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return np.abs(moved.steps - self.size)


@record
class Current(NamedTuple):
    """Goal: smallest peak current into the piezo, A: its capacitance times the steepest slope of the
    voltage."""

    capacitance: Annotated[float, Quantity("F", "C", "capacitance of the piezo", above=0)]

    label, unit, sign, moves = "peak current", "A", -1.0, False

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        peak = self.capacitance * np.abs(shapes.slopes()).max(axis=1)
        return np.broadcast_to(peak[:, None], moved.steps.shape)


class Heat(NamedTuple):
    """Goal: smallest mean power loss in the piezo `stack`, W: the hysteresis losses of all closed voltage
    cycles within a period (`Stack.cycle_loss`), divided by the period."""

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
    """Goal: smallest deviation of the end-effector from uniform motion within a period, peak to peak, m, or
    rad for a rotary actuator."""

    label, unit, sign, moves, extras = "ripple", "m", -1.0, False, ("ripple",)

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return moved.ripple


class BackwardRate(NamedTuple):
    """Goal: smallest backward rate, 0 to 1: the largest backward motion within a period divided by the
    forward motion (net step plus backward motion)."""

    label, unit, sign, moves, extras = "backward rate", "", -1.0, True, ("backward_rate",)

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        return moved.backward_rate


NAMED: dict[str, Any] = {"speed": Speed(), "ripple": Ripple(), "backward_rate": BackwardRate()}
# Goals that have no default because they need arguments: name, and the call with its arguments for a message.
OTHERS = {
    "step": "StepSize(size)",
    "current": "Current(capacitance)",
    "heat": "Heat(stack)",
    "tip load": "TipLoad.of_stage(model)",
    "noise": "Noise.of_stage(model)",
}


def extras_of(*goals: Any) -> tuple[str, ...]:
    """Return the names of the results of a motion that the given goals need besides the net step: "ripple",
    "backward_rate", each once."""
    return tuple(dict.fromkeys(name for goal in goals for name in getattr(goal, "extras", ())))


def direction_of(goal: Any) -> float:
    """Return +1 or -1, the direction of motion that a goal requires; +1 for a goal without motion."""
    return getattr(goal, "direction", 1.0)


def swings_of(goal: Any) -> tuple[float, ...]:
    """Return the swings at which a search for a sawtooth starts, as shares of the allowed voltage range.

    For the speed this is only 1, the whole range; for other goals also a half and a quarter of the range.
    """
    return getattr(goal, "swings", (1.0, 0.5, 0.25))


def goal_of(given: Any) -> Any:
    """Return a goal that the user has given by name ("speed", "ripple", "backward_rate") or as a record.

    Raises:
        QuantityError: `given` is None, an unknown name, the name of a goal that needs arguments, or no goal.
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
