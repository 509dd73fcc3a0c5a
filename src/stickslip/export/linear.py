"""Linearise the motion over one step about a state of the contact: the matrix that propagates a small
error."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..friction import breakaway, element, elements, rate
from ..simulation.models import mechanism, stage_mode

Matrix = NDArray[np.float64]

# Order of the state: position and velocity of the stage (first mode) and of the end-effector, the bristles as
# one, then position and velocity of each further mode of the stage.
Y, W, X, S, Z, MORE = range(6)
# Largest ratio of a step to the relaxation time of a bristle; beyond it the bristle is at its equilibrium.
_FASTEST = 1e4


class ContactSlopes(NamedTuple):
    """Slopes of a contact, its bristles taken as one: F = force_z z + force_v v, dz/dt = a v + b z.

    `rests` is the true rest of a law without presliding, which holds v = 0.
    """

    force_z: float = 0.0  # N/m
    force_v: float = 0.0  # N s/m
    a: float = 0.0
    b: float = 0.0  # 1/s
    rests: bool = False


class Method:
    """Linearised motion of stage, end-effector and bristle over a step, about a state of the contact.

    Args:
        model: actuator or pulled slider.
        h: s, the step.
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
        # An unknown force acts on each body: shape (size, 2), of the stage and of the end-effector.
        self.forces = np.zeros((self.size, 2))
        self.forces[[i + 1 for i in self.stage], 0] = [abs(push[i + 1]) or mech.mobility for i in self.stage]
        self.forces[S, 1] = mech.mobility
        self.speed = np.zeros(self.size)
        self.speed[[i + 1 for i in self.stage]], self.speed[S] = 1.0, -1.0
        self.motion, self.push = a, push

    def after(self, contact: ContactSlopes) -> Matrix:
        """Return the transition of a small error of the state over a step, shape (size, size)."""
        a, push, start = self.motion.copy(), self.push, np.eye(self.size)
        if self.kinematic:  # the stage is where its input is, whatever it was
            start[[Y, W]] = 0.0
        if self.clamped:  # the end-effector moves with the stage
            made = np.asarray(scipy.linalg.expm(a * self.h), np.float64) @ start
            made[X], made[S] = made[self.stage].sum(axis=0), made[[i + 1 for i in self.stage]].sum(axis=0)
            return made
        if contact.rests:  # friction ends an error of the speed at once, and holds
            keeps = np.eye(self.size) - np.outer(push, self.speed) / (self.speed @ push)
            return np.asarray(scipy.linalg.expm(keeps @ a * self.h) @ keeps @ start, np.float64)
        shrinks = min(_FASTEST / max(-contact.b * self.h, 1e-300), 1.0)
        a += np.outer(push, contact.force_v * self.speed)
        a[:, Z] += push * contact.force_z
        a[Z], a[Z, Z] = contact.a * shrinks * self.speed, contact.b * shrinks
        return np.asarray(scipy.linalg.expm(a * self.h) @ start, np.float64)


def contacts(law: Any, h: float, mobility: float) -> tuple[list[ContactSlopes], float]:
    """Return the states in which a contact can be (sticking at some deflections, sliding at some speeds), and
    the force that it can hold, N.

    Args:
        law: friction law.
        h: s, the step.
        mobility: 1/kg, change of the sliding acceleration per force.
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
            # A spring that never slips swings for ever, in no contact: what slides renews its bristles.
            made.append(stuck._replace(b=min(stuck.b, -abs(v) / longest)))
    for v in (share * longest / h for share in (0.03, 0.3, 3.0, 30.0)):
        made.append(_slopes(parts, [_still(one, v) for one in parts], v, rest=False))
    return made, max(most, 1e-6)


def _still(one: Any, v: float) -> float:
    """Return the deflection at which sliding at v [m/s] leaves the bristle unchanged, m."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rate(one, v, middle)[1] > 0.0 else (low, middle)
    return high


def _slopes(parts: list[Any], at: list[float], v: float, rest: bool) -> ContactSlopes:
    """Return the slopes of all elements as one, at rest on the way to v [m/s], or sliding at v."""
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
