"""P3 by the classical Runge-Kutta method in Numba, sixteen members side by side in vector registers.

No packaged tool, but what Numba can do by hand. `python -m benchmarks.peers.lanes truth FILE` computes the
truth that all are measured by, at a step of 1 us.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial

import numba
import numpy as np

from .. import problems
from ..problems import DAMPING, DRIVE, PERIOD, PERIODS, PROBLEMS, SLOPE, STIFFNESS
from ..truth import judge_members
from ..worker import Case, serve

LANES = 16
SIGMA_1 = PROBLEMS["P1"].sigma_1


@numba.njit(inline="always")
def rates(u, y, w, z, s, sigma_0, per_g, per_mass):
    v = w - s
    dz = v - per_g * abs(v) * z
    return w, DRIVE * u - DAMPING * w - STIFFNESS * y, dz, s, (sigma_0 * z + SIGMA_1 * dz) * per_mass


@numba.njit(fastmath=True, error_model="numpy")
def block(sets, first, net, steps):
    Y, W, Z, X, S = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    stiffness, per_g, per_mass = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for m in range(LANES):
        stiffness[m] = sets[first + m, 0]
        per_g[m] = sets[first + m, 0] / sets[first + m, 1]
        per_mass[m] = 1.0 / sets[first + m, 2]
    h = PERIOD / steps
    a, b = 0.5 * h, h / 6.0
    for _ in range(PERIODS):
        for i in range(steps):
            u0 = SLOPE * (i * h)
            um, u1 = u0 + SLOPE * a, u0 + SLOPE * h
            for m in range(LANES):
                y, w, z, s = Y[m], W[m], Z[m], S[m]
                k, g, r = stiffness[m], per_g[m], per_mass[m]
                y1, w1, z1, x1, s1 = rates(u0, y, w, z, s, k, g, r)
                y2, w2, z2, x2, s2 = rates(um, y + a * y1, w + a * w1, z + a * z1, s + a * s1, k, g, r)
                y3, w3, z3, x3, s3 = rates(um, y + a * y2, w + a * w2, z + a * z2, s + a * s2, k, g, r)
                y4, w4, z4, x4, s4 = rates(u1, y + h * y3, w + h * w3, z + h * z3, s + h * s3, k, g, r)
                Y[m] = y + b * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
                W[m] = w + b * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
                Z[m] = z + b * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
                X[m] += b * (x1 + 2.0 * x2 + 2.0 * x3 + x4)
                S[m] = s + b * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
    net[first : first + LANES] = X


@numba.njit(parallel=True)
def ensemble(sets, steps):
    """Net displacement of each row of sets, whose number is a multiple of the lanes; `steps` per period."""
    net = np.empty(len(sets))
    for q in numba.prange(len(sets) // LANES):
        block(sets, q * LANES, net, steps)
    return net


def members() -> Iterator[Case]:
    sets = problems.parameter_sets()
    for step in (25.0, 10.0, 5.0):
        run = partial(ensemble, sets, round(PERIOD / (step * 1e-6)))
        yield Case(
            "16-lane RK4 in Numba", "fixed step", f"{step:g} us", "P3", partial(partial, run), judge_members
        )


if __name__ == "__main__":
    if sys.argv[1] == "truth":
        np.save(sys.argv[2], ensemble(problems.parameter_sets(), 200_000))
    else:
        serve({"ensemble": members}, ["numba"])
