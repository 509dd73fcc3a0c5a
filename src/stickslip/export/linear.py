"""Linearise the motion over one step about a state of the contact, for the observer's gain.

The result is the matrix that propagates a small error of the state over the step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..friction import breakaway, element, elements, rate
from ..simulation.models import mechanism, stage_mode

Matrix = NDArray[np.float64]

# Indices of the state vector: position Y and velocity W of the stage (first mode), position X and velocity S
# of the end-effector, deflection Z of all bristles as one. From MORE on: position and velocity of each of the
# stage's further modes.
Y, W, X, S, Z, MORE = range(6)
# Largest ratio of a step to a bristle's relaxation time, which limits the matrix whose exponential is
# computed. A faster bristle is slowed down to this ratio; it still reaches its equilibrium within a step.
_FASTEST = 1e4


class ContactSlopes(NamedTuple):
    """Linearised friction, with all bristles as one: F = force_z z + force_v v, dz/dt = a v + b z.

    F is the friction force, v the sliding velocity and z the deflection of the bristle, each as a small
    change. `rests` is True for a contact without presliding that sticks, where v = 0 replaces the equations.
    For a rotary actuator m is rad, and N is N m.
    """

    force_z: float = 0.0  # change of friction force per deflection, N/m
    force_v: float = 0.0  # change of friction force per sliding velocity, N s/m
    a: float = 0.0
    b: float = 0.0  # rate of change of the deflection per deflection, 1/s; negative: the bristle relaxes
    rests: bool = False


class Method:
    """Linearised motion of stage, end-effector and bristle; `after` adds the contact and gives a step's
    matrix.

    `size` is the number of components of the state, `stage` has the indices of the stage's positions, one for
    each mode. `clamped` is True if the end-effector is fixed to the stage, `kinematic` if the stage follows
    the input exactly. `motion` is the matrix from the state to its rate of change without friction. `push` is
    the rate of change of the state per friction force, and `forces` the same for unit forces on stage and
    end-effector. `speed` times the state is the sliding velocity, stage minus end-effector.

    Args:
        model: actuator or pulled slider.
        h: duration of the step, s.
    """

    def __init__(self, model: Any, h: float) -> None:
        mech = mechanism(model)
        further = getattr(model, "further_modes", None)
        modes = further.rows if further is not None else []
        self.h, self.clamped, self.kinematic = h, mech.clamped, mech.kinematic
        self.size = MORE + 2 * len(modes)
        self.stage = [Y, *range(MORE, self.size, 2)]
        a, push = np.zeros((self.size, self.size)), np.zeros(self.size)
        stiffer = getattr(model, "stiffening", 1.0)
        a[Y, W] = 0.0 if mech.kinematic else 1.0
        a[W, Y], a[W, W], push[W] = -mech.stage_stiffness * stiffer, -mech.stage_damping, -mech.reaction
        a[X, S], a[S, X], a[S, S], push[S] = 1.0, -mech.slider_stiffness, -mech.slider_damping, mech.mobility
        for row, (gain, omega, zeta, mass) in zip(self.stage[1:], modes, strict=True):
            mode = stage_mode(gain, omega, zeta)
            a[row, row + 1], a[row + 1, row], a[row + 1, row + 1] = 1.0, -mode.stiffness, -mode.damping
            push[row + 1] = -1.0 / mass if mech.reaction else 0.0
        # Accelerations by a unit force on the stage and on the end-effector, shape (size, 2).
        self.forces = np.zeros((self.size, 2))
        self.forces[[i + 1 for i in self.stage], 0] = [abs(push[i + 1]) or mech.mobility for i in self.stage]
        self.forces[S, 1] = mech.mobility
        self.speed = np.zeros(self.size)
        self.speed[[i + 1 for i in self.stage]], self.speed[S] = 1.0, -1.0
        self.motion, self.push = a, push

    def after(self, contact: ContactSlopes) -> Matrix:
        """Return the matrix that propagates a small error of the state over a step, shape (size, size).

        `contact` is the linearised contact, from `contacts`.
        """
        a, push, start = self.motion.copy(), self.push, np.eye(self.size)
        if self.kinematic:  # the stage's position is given by the input, so its errors vanish
            start[[Y, W]] = 0.0
        if self.clamped:  # the end-effector is fixed to the stage, so its position is the sum of all modes
            made = np.asarray(scipy.linalg.expm(a * self.h), np.float64) @ start
            made[X], made[S] = made[self.stage].sum(axis=0), made[[i + 1 for i in self.stage]].sum(axis=0)
            return made
        if contact.rests:  # friction stops an error of the sliding velocity at once, and keeps it zero
            keeps = np.eye(self.size) - np.outer(push, self.speed) / (self.speed @ push)
            return np.asarray(scipy.linalg.expm(keeps @ a * self.h) @ keeps @ start, np.float64)
        shrinks = min(_FASTEST / max(-contact.b * self.h, 1e-300), 1.0)
        a += np.outer(push, contact.force_v * self.speed)
        a[:, Z] += push * contact.force_z
        a[Z], a[Z, Z] = contact.a * shrinks * self.speed, contact.b * shrinks
        return np.asarray(scipy.linalg.expm(a * self.h) @ start, np.float64)


def contacts(law: Any, h: float, mobility: float) -> tuple[list[ContactSlopes], float]:
    """Linearise a contact in several states: sticking at some deflections, and sliding at some speeds.

    Args:
        law: friction law.
        h: duration of the step, s, which determines the sliding speeds.
        mobility: acceleration of the end-effector per friction force, 1/kg, or 1/(kg m^2) for a rotary one;
            used only for a law without presliding.

    Returns:
        The linearised contact in each state, and the largest friction force of the contact at low speed, N,
        or N m for a rotary actuator.
    """
    parts = [element(law, i) for i in range(max(elements(law), 1))]
    if elements(law) == 0:
        most = max(breakaway(law), 1e-6)
        made = [ContactSlopes(rests=True)]
        for v in (share * mobility * most * h for share in (0.03, 0.3, 3.0, 30.0)):
            slope = (rate(law, 1.001 * v, 1.0)[0] - rate(law, 0.999 * v, 1.0)[0]) / (0.002 * v)
            made.append(ContactSlopes(0.0, slope))
        return made, most
    far = [_still(one, 1e-9) for one in parts]
    longest = max(far)
    most = sum(rate(one, 1e-9, z)[0] for one, z in zip(parts, far, strict=True))
    made = []
    for share in (0.0, 0.25, 0.5, 0.75, 0.95):
        at = [min(share * longest, z) for z in far]
        for v in (1e-6, -1e-6):
            stuck = _slopes(parts, at, v, rest=True)
            # Without relaxation, an error of a bristle's deflection would oscillate for ever. In a real
            # contact even slow sliding renews the bristles, so the error decays over a sliding distance of
            # the largest deflection.
            made.append(stuck._replace(b=min(stuck.b, -abs(v) / longest)))
    for v in (share * longest / h for share in (0.03, 0.3, 3.0, 30.0)):
        made.append(_slopes(parts, [_still(one, v) for one in parts], v, rest=False))
    return made, max(most, 1e-6)


def _still(one: Any, v: float) -> float:
    """Return the deflection of a bristle in steady sliding at v > 0 [m/s], by bisection from 0 to 1 m.

    `one` is an element of the friction law.
    """
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rate(one, v, middle)[1] > 0.0 else (low, middle)
    return high


def _slopes(parts: list[Any], at: list[float], v: float, rest: bool) -> ContactSlopes:
    """Linearise all elements of a contact as one.

    Args:
        parts: the elements of the law.
        at: deflection of each element, m.
        v: sliding velocity, m/s.
        rest: if True, the derivatives by velocity are secants from rest to v; otherwise tangents at v.
    """
    force_z = force_v = taken = given = 0.0
    for one, z in zip(parts, at, strict=True):
        d, other = 1e-6 * max(at) + 1e-15, 0.0 if rest else 0.999 * v
        force, dz = rate(one, v, z)
        still = 0.0 if rest else v
        stiffness = (rate(one, still, z + d)[0] - rate(one, still, z)[0]) / d
        force_z += stiffness
        force_v += (force - rate(one, other, z)[0]) / (v - other)
        taken += stiffness * (dz - rate(one, other, z)[1]) / (v - other)
        given += stiffness * (dz - rate(one, v, z - d)[1]) / d
    return ContactSlopes(force_z, force_v, taken / force_z, given / force_z)
