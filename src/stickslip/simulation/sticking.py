"""Linear model of an actuator while its contact sticks: from the voltage to the positions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction import element, elements, rate
from ..physics.actuator import Actuator
from ..quantities.units import QuantityError
from .models import system

Array = NDArray[np.float64]

# Deflection [m] and velocity [m/s] for the difference quotients in `slopes`, small compared with presliding.
_DEFLECTION, _VELOCITY = 1e-9, 1e-6


def slopes(law: Any) -> tuple[float, float]:
    """Return stiffness ∂F/∂z [N/m] and damping ∂F/∂v [N s/m] of a friction law at rest, by difference
    quotients, summed over the elements of the law; F is the force, z the deflection, v the velocity."""
    stiffness = damping = 0.0
    for i in range(elements(law)):
        one = element(law, i)
        rest = rate(one, 0.0, 0.0)[0]
        stiffness += (rate(one, 0.0, _DEFLECTION)[0] - rest) / _DEFLECTION
        damping += (rate(one, _VELOCITY, 0.0)[0] - rest) / _VELOCITY
    return stiffness, damping


class Sticking(NamedTuple):
    """Linear model ẋ = A x + B u of an actuator, with the position of the end-effector C x.

    Fields: `a` (n, n), `b` (n,) and `c` (n,) with n states; voltage u in V, positions in m (rad), t in s.
    """

    a: Array
    b: Array
    c: Array


def sticking(model: Actuator) -> Sticking:
    """Return the linear model of an actuator about rest. Its states are position [m] and velocity [m/s] of
    each mode of the stage, then of the end-effector (not if it is clamped).

    Hysteresis and creep of the piezo are left out: its gain is the actuator's.

    Raises:
        QuantityError: the model is not an actuator, its stage is static, its piezo is a `MaxwellCapacitor`,
            or its contact has no presliding.
    """
    if not isinstance(model, Actuator) or model.static or model.two_port is not None:
        raise QuantityError("a linear model is that of an Actuator whose stage has a natural_frequency")
    of = system(model)
    modes, contact = of.plant.modes, of.contact
    size = 2 * len(modes)
    a, b, c = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for m, mode in enumerate(modes):
        a[2 * m, 2 * m + 1] = 1.0
        a[2 * m + 1, 2 * m], a[2 * m + 1, 2 * m + 1] = -mode.stiffness, -mode.damping
        b[2 * m + 1] = mode.drive
    if contact is None:
        c[list(of.stages)] = 1.0
        return Sticking(a, b, c)
    stiffness, damping = (contact.normal * one for one in slopes(contact.law))
    if not stiffness > 0.0:
        raise QuantityError(
            f"a {type(contact.law).__name__} contact has no presliding: it has no linear model"
        )
    force = np.zeros(size)
    for m, share in enumerate(contact.velocity):
        force[2 * m], force[2 * m + 1] = stiffness * (share or 0.0), damping * (share or 0.0)
    for m, push in enumerate(contact.push):
        a[2 * m + 1] += (push or 0.0) * force
    c[of.slider] = 1.0
    return Sticking(a, b, c)
