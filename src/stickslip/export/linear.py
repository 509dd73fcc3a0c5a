"""The step method of stickslip.c about a state of the contact, as a matrix: what becomes of a small error."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ..friction import breakaway, element, elements, rate
from ..mechanism import slider_acceleration, stage_acceleration
from ..simulation.models import mechanism
from ..simulation.sticking import slopes

Matrix = NDArray[np.float64]

# Of a state: position and velocity of the stage (of its first mode) and of the end-effector, the bristles as
# one, then position and velocity of each further mode of the stage.
Y, W, X, S, Z, MORE = range(6)


class Contact(NamedTuple):
    """Slopes of a contact, its bristles taken as one: F = force_z z + force_v v, dz/dt = a v + b z.

    `rests` is the true rest of a law without presliding, which holds v = 0.
    """

    force_z: float = 0.0  # N/m
    force_v: float = 0.0  # N s/m
    a: float = 0.0
    b: float = 0.0  # 1/s
    rests: bool = False


class Method:
    """The step method: the linear motion over a step, and what the friction force does to it.

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
        a[Y, W] = a[X, S] = 1.0
        zero = 0.0, 0.0, 0.0
        for row, accelerate in ((W, stage_acceleration), (S, slider_acceleration)):
            rest = accelerate(mech, *zero, 0.0)
            a[row, row - 1] = accelerate(mech, 0.0, 1.0, 0.0, 0.0) - rest
            a[row, row] = accelerate(mech, 0.0, 0.0, 1.0, 0.0) - rest
            push[row] = accelerate(mech, *zero, 1.0) - rest
        a[W, Y] *= getattr(model, "stiffening", 1.0)
        for row, (_, omega, zeta, mass) in zip(self.stage[1:], modes, strict=True):
            a[row, row + 1], a[row + 1, row], a[row + 1, row + 1] = 1.0, -(omega**2), -2.0 * zeta * omega
            push[row + 1] = -1.0 / mass if mech.reaction else 0.0
        # A force that is not known acts on each body: shape (size, 2), of the stage and of the end-effector.
        self.forces = np.zeros((self.size, 2))
        self.forces[[i + 1 for i in self.stage], 0] = [abs(push[i + 1]) or mech.mobility for i in self.stage]
        self.forces[S, 1] = mech.mobility
        whole = np.zeros((self.size + 1, self.size + 1))
        whole[:-1, :-1], whole[:-1, -1] = a * h, push * h
        over = np.asarray(expm(whole), np.float64)
        self.free, self.push = over[:-1, :-1], over[:-1, -1]
        self.sliding, self.speed = np.zeros(self.size), np.zeros(self.size)
        self.sliding[self.stage], self.sliding[X] = 1.0, -1.0
        self.speed[[i + 1 for i in self.stage]], self.speed[S] = 1.0, -1.0
        if mech.kinematic:  # y = C u at the end, at constant speed until then
            self.free[[Y, W]], self.free[W, Y] = 0.0, -1.0 / h
        mobility = -np.sum(push[[i + 1 for i in self.stage]]) + push[S]
        ratio = mobility * slopes(model.friction)[0] * h**2
        self.implicit = ratio / (12.0 + ratio)

    def after(self, contact: Contact) -> Matrix:
        """What becomes of a small error of the state within a step, shape (size, size)."""
        h, implicit, same = self.h, self.implicit, np.eye(self.size)
        made: Matrix = self.free.copy()
        if self.clamped or contact.rests:  # the end-effector goes as the stage does
            if not self.clamped:
                made -= self.push[:, None] * (self.speed @ self.free) / (self.speed @ self.push)
            made[X] = same[X] + (self.sliding + same[X]) @ (made - same)
            made[S] = (self.speed + same[S]) @ made
            return made
        # Of V, as of the bristle, the mean over the step and its end, weighted: V + mobility F = V_free.
        v_free = (1.0 - implicit) / h * (self.sliding @ (self.free - same))
        v_free += implicit * (self.speed @ self.free)
        mobility = -((1.0 - implicit) / h * self.sliding + implicit * self.speed) @ self.push
        x = max(h * contact.b, -1e9)
        whole, mean = h * np.array([1.0 - 0.5 * x, 0.5 - 0.5 * x]) / (1.0 - x + 0.5 * x**2)
        at = implicit * whole + (1.0 - implicit) * mean
        force = contact.force_z * (1.0 + at * contact.b) * same[Z]
        by_v = contact.force_v + contact.force_z * at * contact.a
        v = (v_free - mobility * force) / (1.0 + mobility * by_v)
        made += self.push[:, None] * (force + by_v * v)
        made[Z] = (1.0 + whole * contact.b) * same[Z] + whole * contact.a * v
        return made


def contacts(law: Any, h: float, mobility: float) -> tuple[list[Contact], float]:
    """In which states a contact can be: sticking at some deflections, sliding at some speeds; and about the
    force that it holds, N.

    Args:
        law: of friction.
        h: s, the step.
        mobility: 1/kg, what the force does to the sliding velocity.
    """
    parts = [element(law, i) for i in range(max(elements(law), 1))]
    if elements(law) == 0:
        most = max(breakaway(law), 1e-6)
        made = [Contact(rests=True)]
        for v in (share * mobility * most * h for share in (0.03, 0.3, 3.0, 30.0)):
            slope = (rate(law, 1.001 * v, 1.0)[0] - rate(law, 0.999 * v, 1.0)[0]) / (0.002 * v)
            made.append(Contact(0.0, slope))
        return made, most
    far = [_still(one, 1e-9) for one in parts]
    longest = max(far)
    most = sum(rate(one, 1e-9, z)[0] for one, z in zip(parts, far, strict=True))
    made = []
    for share in (0.0, 0.25, 0.5, 0.75, 0.95):
        at = [min(share * longest, z) for z in far]
        made += [_slopes(parts, at, v, rest=True) for v in (1e-6, -1e-6)]
    for v in (share * longest / h for share in (0.03, 0.3, 3.0, 30.0)):
        made.append(_slopes(parts, [_still(one, v) for one in parts], v, rest=False))
    return made, max(most, 1e-6)


def _still(one: Any, v: float) -> float:
    """The deflection at which sliding at v [m/s] leaves the bristle, m."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rate(one, v, middle)[1] > 0.0 else (low, middle)
    return high


def _slopes(parts: list[Any], at: list[float], v: float, rest: bool) -> Contact:
    """Of all elements as one, at rest on the way to v [m/s], or sliding at v."""
    force_z = force_v = taken = given = 0.0
    for one, z in zip(parts, at, strict=True):
        d, other = 1e-6 * max(at) + 1e-15, 0.0 if rest else 0.999 * v
        force, dz = rate(one, v, z)
        still = 0.0 if rest else v
        stiffness = (rate(one, still, z + d)[0] - rate(one, still, z)[0]) / d
        force_z += stiffness
        force_v += (force - rate(one, other, z)[0]) / (v - other)
        taken += stiffness * (dz - rate(one, other, z)[1]) / (v - other)
        given += 0.0 if rest else stiffness * (dz - rate(one, v, z - d)[1]) / d
    return Contact(force_z, force_v, taken / force_z, given / force_z)
