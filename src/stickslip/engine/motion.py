"""A friction law under a prescribed motion, by the engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..friction.law import element, elements
from ._abi import ffi
from .binding import Array, called, doubles, sized
from .law_of import EngineLaw, law_of
from .laws import parameters
from .library import library


def follow_position(
    law: Any,
    time: Array,
    position: Array,
    load: Array,
    z: Array,
    tolerance: float,
    proportional: bool,
    samples: Array,
) -> int:
    """Compute the force of a law at each sample of a motion.

    Args:
        law: friction law record.
        time, position: [n], n >= 2, s and m; linear in between.
        load: [n], normal force over the reference, linear in between; 0 or more.
        z: states [elements] at the first sample, m, replaced by those at the last one; for a static law one
            number, the force that it carries over its breakaway force.
        tolerance: m, on each deflection over each step.
        proportional: True: deflections stay when the normal force rises, and the force changes in proportion.
            False: newly loaded area carries no force, so that deflections fall.
        samples: [n, 1 + elements] (at least two columns), filled with force (N) and states; at a sample, the
            force is that of the interval that ends there (at the first: that starts there).

    Returns:
        Number of samples reached: n, or fewer where the law could not be followed.

    Raises:
        TypeError, ValueError: an array does not fit, see `binding.integrate`.
        BaseException: whatever a user's law in Python has raised.
    """
    count, states = time.size, elements(law)
    sizes = {"position": count, "load": count, "z": max(states, 1), "samples": count * (1 + max(states, 1))}
    for (name, size), array in zip(sizes.items(), (position, load, z, samples), strict=True):
        sized(name, array, size)
    if count < 2:
        raise ValueError(f"a motion has two samples at least, not {count}")
    made, numbers = _taken(law)
    task: Any = ffi.new("struct stickslip_motion *")
    task.law, task.elements, task.count = made.pointer, states, count
    task.parameters, task.load = doubles(numbers, "parameters"), doubles(load, "load")
    task.time, task.position = doubles(time, "time"), doubles(position, "position")
    task.state, task.samples = doubles(z, "z", True), doubles(samples, "samples", True)
    task.tolerance, task.proportional = tolerance, proportional
    reached: Any = ffi.new("int64_t *")
    called(library().stickslip_follow_motion, [made], task, reached)
    return reached[0]


def forces_at(law: Any, velocity: Array, states: Array, force: Array) -> None:
    """Compute the force of a law [N] at given velocities [n], m/s, and states [n, elements], m (a static law
    has one column, the direction of sliding, 1 or -1). The result is written into `force` [n].

    `follow_position` instead gives the force of the interval before each sample, whose velocity is half an
    interval late. In a fit, this delay would act like damping.

    Raises:
        TypeError, ValueError: an array does not fit, see `binding.integrate`.
    """
    made, numbers = _taken(law)
    width = max(elements(law), 1)
    sized("states", states, velocity.size * width)
    sized("force", force, velocity.size)
    task: Any = ffi.new("struct stickslip_forces *")
    task.law, task.elements, task.count = made.pointer, elements(law), velocity.size
    task.parameters, task.velocity = doubles(numbers, "parameters"), doubles(velocity, "velocity")
    task.states, task.force = doubles(states, "states"), doubles(force, "force", True)
    called(library().stickslip_compute_forces, [made], task)


def _taken(law: Any) -> tuple[EngineLaw, Array]:
    """Return the engine's law of the elements of a friction law, and the parameters of all elements in one
    array."""
    return law_of(element(law, 0)), np.array(parameters(law), dtype=float)
