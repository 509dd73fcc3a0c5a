r"""The energy account of a trajectory: where the work of the drive went.

Four running integrals, by Gauss-Legendre quadrature on the continuous extension of each step, per unit mass
of the stage for the first two:

.. math:: \int b u \dot y\,dt, \quad \int c \dot y^2\,dt, \quad \int F \dot y\,dt, \quad \int F \dot x_e\,dt

The friction work is the difference of the last two, whatever the bristles store of it included.
"""

from __future__ import annotations

import numpy as np

from .._jit import compiled
from ..friction.law import elements, force
from ..mechanism import FIRST_BRISTLE, SLIDER_VELOCITY, STAGE_VELOCITY, holding_force
from ..waveform.drive import value_slope_curvature
from .rodas import interpolate

TERMS = 4
_NODES, _WEIGHTS = (0.5 * a for a in np.polynomial.legendre.leggauss(5))
_NODES = _NODES + 0.5


@compiled
def add(law, mech, mode, drive, i, load, j, t, h, offset, q, new, rows, n, start, stop, probe, account):
    """Add the part of a step between the fractions `start` and `stop`."""
    width = stop - start
    if width <= 0.0:
        return
    for g in range(_NODES.size):
        theta = start + width * _NODES[g]
        interpolate(theta, q, new, rows, n, probe)
        if elements(law) == 0:
            probe[FIRST_BRISTLE] = q[FIRST_BRISTLE]
        u, du, ddu = value_slope_curvature(drive, i, t + theta * h)
        if mech.kinematic:
            probe[STAGE_VELOCITY] = mech.gain * du
        if mode == 1:
            probe[SLIDER_VELOCITY] = probe[STAGE_VELOCITY]
            contact = holding_force(mech, u, ddu, probe)
        else:
            v = probe[STAGE_VELOCITY] - probe[SLIDER_VELOCITY]
            normal = value_slope_curvature(load, j, t + theta * h)[0]
            contact = normal * force(law, v, probe[FIRST_BRISTLE:])
        weight = _WEIGHTS[g] * width * h
        account[0] += weight * mech.stage_drive * u * probe[STAGE_VELOCITY]
        account[1] += weight * mech.stage_damping * probe[STAGE_VELOCITY] ** 2
        account[2] += weight * contact * probe[STAGE_VELOCITY]
        account[3] += weight * contact * probe[SLIDER_VELOCITY]
