"""The observer's gain: that of the stationary Kalman filter of the sticking model in steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

from ..friction import breakaway, element, elements, rate
from ..mechanism import slider_acceleration, stage_acceleration
from ..simulation.models import mechanism
from ..simulation.sticking import slopes

_DEFLECTION, _VELOCITY = 1e-9, 1e-6  # m and m/s, small against presliding


def observer_gain(model: Any, h: float, noise: float) -> NDArray[np.float64]:
    """How stage position and velocity (of its first mode), end-effector position and velocity, bristles, and
    position and velocity of each further mode follow a measured position of the end-effector, shape (5 + 2
    further modes,).

    What the model does not know is taken as white forces of a tenth of the friction on both bodies. A contact
    without presliding, and a stage that follows the input, are not corrected.

    Args:
        model: actuator or pulled slider.
        h: s, the step.
        noise: m, standard deviation of a measured position.
    """
    mech, law = mechanism(model), model.friction
    slopes = _slopes(law)
    friction = breakaway(law) or slopes[2]
    further = getattr(model, "further_modes", None)
    modes = further.rows if further is not None else []
    size = 5 + 2 * len(modes)
    a, pushes = np.zeros((size, size)), np.zeros((size, 2))
    a[0, 1] = a[2, 3] = 1.0
    sliding = np.zeros(size)  # stage velocity less that of the end-effector
    sliding[[1, 3]] = 1.0, -1.0
    sliding[6::2] = 1.0
    zero = np.zeros(3)
    for row, accelerate, first in ((1, stage_acceleration, 0), (3, slider_acceleration, 2)):
        rest = accelerate(mech, *zero, 0.0)
        a[row, first] = accelerate(mech, 0.0, 1.0, 0.0, 0.0) - rest
        a[row, first + 1] = accelerate(mech, 0.0, 0.0, 1.0, 0.0) - rest
        by_force = accelerate(mech, *zero, 1.0) - rest
        a[row] += by_force * slopes[1] * sliding
        a[row, 4] += by_force * slopes[0]
        pushes[row, 0 if row == 1 else 1] = abs(by_force) or mech.mobility
    a[1, 0] *= getattr(model, "stiffening", 1.0)
    for row, (_, omega, zeta, mass) in zip(range(6, size, 2), modes, strict=True):
        by_force = -1.0 / mass if mech.reaction else 0.0
        a[row - 1, row], a[row, row - 1], a[row, row] = 1.0, -(omega**2), -2.0 * zeta * omega
        a[row] += by_force * slopes[1] * sliding
        a[row, 4] += by_force * slopes[0]
        pushes[row, 0] = abs(by_force) or mech.mobility
    a[4] = sliding
    stage = [0, 1, *range(5, size)]
    keep = [2, 3] if elements(law) == 0 or mech.kinematic else stage if mech.clamped else list(range(size))
    if elements(law) == 0 or mech.kinematic:
        a[3] = 0.0  # the friction of a sliding contact is a constant
    # Scaled, for positions and velocities are far apart.
    scale = noise * np.array([1.0, 1.0 / h, 1.0, 1.0 / h, 1.0, *[1.0, 1.0 / h] * len(modes)])[keep]
    part = expm(a[np.ix_(keep, keep)] * h) * scale / scale[:, None]
    q = (pushes * 0.1 * friction * h) @ (pushes * 0.1 * friction * h).T
    q = q[np.ix_(keep, keep)] / np.outer(scale, scale) + 1e-8 * np.eye(len(keep))
    c = np.zeros((1, len(keep)))
    for shown in stage[::2] if mech.clamped else [2]:
        c[0, keep.index(shown)] = 1.0
    p = solve_discrete_are(part.T, c.T, q, np.eye(1))
    gain = np.zeros(size)
    gain[keep] = (p @ c.T / (c @ p @ c.T + 1.0))[:, 0] * scale / noise
    if mech.clamped:
        gain[2], gain[3] = gain[stage[::2]].sum(), gain[stage[1::2]].sum()
    return gain


def _slopes(law: Any) -> tuple[float, float, float]:
    """∂F/∂z [N/m] and ∂F/∂v [N s/m] of the contact at rest, and about the force it slides at [N]."""
    stiffness, damping = slopes(law)
    force = 0.0
    for i in range(elements(law)):
        one, z = element(law, i), 0.0
        for _ in range(200):  # drawn slowly, in steps of a nanometre
            z += _DEFLECTION / _VELOCITY * max(rate(one, _VELOCITY, z)[1], 0.0)
        force += rate(one, _VELOCITY, z)[0]
    return stiffness, damping, max(force, 1e-6)
