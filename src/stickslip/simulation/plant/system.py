r"""Equations of a system: linear modes of bodies, and elements that act on or between them.

.. math::

   \ddot q_m &= b_m u(t) + a_m - c_m \dot q_m - k_m q_m + \sum_e p_{em} f_e \\
   s_e &= \sum_m \left( h_{em} \dot q_m + g_{em} q_m \right) + d_e u + d'_e \dot u + \sum_{i<e} l_{ei} f_i \\
   f_e &= N_e(t)\,F_e(s_e, z_e), \qquad \dot z_e = \dot Z_e(s_e, z_e) - \frac{\max(\dot N_e, 0)}{N_e} z_e

q_m is the position of mode m and u the drive; element e has the input s_e, the states z_e and the output f_e,
and F_e and Z_e are the functions of its record. `Mode` and `Element` name the coefficients. A body is one
mode (a rigid slider: k = 0) or several, whose positions add up; a body that follows the drive has none, and
enters an element through d' (its velocity). An element is a record with one ``rate(record, s, z)``, chosen by
its type (see `friction.law`): a friction contact, whose input is the sliding velocity and whose output is a
force; or anything with scalar states between an input and an output (a lag, an amplifier, creep, a
controller).

With k = ωₙ², c = 2ζωₙ, b = Cωₙ², p = -1/m and 1/m_e this is the thesis's model [kang2007, eq. 3.20-3.25].

A coefficient that is None is zero, and the engine then omits its term, which saves computing time.

The last term is the effect of a changing normal force on a contact: newly loaded area carries no tangential
force (F stays, z falls in proportion), unloaded area loses its share in proportion (z stays) [mindlin1953].
It assumes a stiffness in proportion to the normal force: rough surfaces of many asperities. A contact whose
normal force changes along the stroke, N_e(t, x), or whose stiffness follows it with another power, has
`along` (see `friction.normal_force`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...friction.law import elements
from ...friction.normal_force import NormalForce
from ...quantities.records import numbers_in, with_numbers


class Mode(NamedTuple):
    """One linear mode of a body, per unit of its mass.

    Fields: `stiffness` k [1/s²], `damping` c [1/s], `drive` b [m/s² per unit of the drive], and
    `acceleration` a [m/s²] by the constant forces (rad instead of m for a rotary actuator).
    """

    stiffness: float
    damping: float
    drive: float
    acceleration: float


class Element(NamedTuple):
    """Element of a plant, such as a friction contact; the letters are those of the module's equations.

    Attributes:
        law: record of the element, such as a friction law.
        velocity: h, coefficients of the velocities, one per mode, or None.
        push: p, acceleration [m/s²] per unit of output (per N for a contact), one per mode, or None.
        normal: N, constant factor of the output: the relative normal force of a contact.
        loaded: 1.0 if the normal force varies with the load, or None.
        drive_rate: d', coefficient of the rate of the drive, or None.
        drive: d, coefficient of the drive, or None.
        position: g, coefficients of the positions, one per mode, or None.
        feed: l, coefficients of the outputs of earlier elements, or None.
        along: `NormalForce` as a function of the position of the last mode that the element pushes; no other
            element may push that mode.
    """

    law: Any
    velocity: tuple[float | None, ...]
    push: tuple[float | None, ...]
    normal: float = 1.0
    loaded: float | None = None
    drive_rate: float | None = None
    drive: float | None = None
    position: tuple[float | None, ...] | None = None
    feed: tuple[float | None, ...] | None = None
    along: NormalForce | None = None


class Plant(NamedTuple):
    """A system of modes and elements. `rate` [rad/s] makes a velocity comparable with a position in the error
    control: the error of a velocity is divided by it.

    Its state is a row of numbers: position and velocity of each mode, then the states of each element.
    """

    modes: tuple[Mode, ...]
    elements: tuple[Element, ...]
    rate: float


def state_size(plant: Plant) -> int:
    """Return the number of states of a plant: two per mode, and those of the elements."""
    return 2 * len(plant.modes) + sum(elements(e.law) for e in plant.elements)


def values_of(plant: Plant, count: int = 1) -> NDArray[np.float64]:
    """Return all numbers of a plant, [count, numbers], in the order of its fields, without those that are
    None.

    A number of the plant that is an array [count] gives each row its own value; others are the same in all
    rows. `with_values` takes a row.
    """
    found = list(numbers_in(plant))
    if count == 1 and all(isinstance(value, float) for value in found):
        return np.array([found])
    made = np.empty((count, len(found)))
    for k, value in enumerate(found):
        made[:, k] = value
    return made


def with_values(plant: Plant, values: NDArray[np.float64]) -> Plant:
    """Return a plant with the layout of `plant` and the numbers `values` [numbers], in the order of
    `values_of`, unchecked."""
    return with_numbers(plant, iter(values.tolist()))


def speeds(plant: Plant, q: NDArray[np.float64], u: float, rate: float) -> list[float]:
    """Return the input s of each element (m/s for a contact; see the module), without the terms of other
    elements.

    Args:
        plant: the plant.
        q: state [states].
        u, rate: drive, V, and its rate, V/s.
    """
    positions, velocities = q[0 : 2 * len(plant.modes) : 2], q[1 : 2 * len(plant.modes) : 2]

    def along(shares: Sequence[float | None] | None, values: NDArray[np.float64]) -> float:
        return sum((share or 0.0) * value for share, value in zip(shares or (), values, strict=False))

    return [
        along(e.velocity, velocities)
        + along(e.position, positions)
        + (e.drive or 0.0) * u
        + (e.drive_rate or 0.0) * rate
        for e in plant.elements
    ]
