r"""One step of Rodas5P [steinebach2023] for any plant, in plain scalars.

With :math:`W = I/(h\gamma) - J` the stages are

.. math:: W U_i = f\Bigl(t + c_i h,\ q + \sum_{j<i} a_{ij} U_j\Bigr) + \frac1h \sum_{j<i} C_{ij} U_j + h d_i
f_t

the new state is :math:`q + \sum a_{8j} U_j + U_8`, and U_8 is the error estimate. Every quantity is a local
variable that a processor keeps in a register, and a thread of a GPU can run the same function.

A step knows on which side of v = 0 each contact slides and continues its law smoothly beyond a reversal, so
that the kink of |v| never enters it: it is cut at the reversal afterwards, on its continuous extension.
"""

from __future__ import annotations

from .._jit import fused
from ..plant.generated import factor, plus, size, slope, solved, times
from .rodas5p import GAMMA, A, C, D, H


@fused
def sum_of(a, k):
    """The sum of all eight stages, weighted."""
    first = plus(plus(plus(times(a[0], k[0]), a[1], k[1]), a[2], k[2]), a[3], k[3])
    return plus(plus(plus(plus(first, a[4], k[4]), a[5], k[5]), a[6], k[6]), a[7], k[7])


# From how many times that it relaxes within a step on a bristle is stiff: below, the embedded error sees it.
STIFF = 1.0


@fused
def _largest(row):
    most = row[0]
    for e in range(1, len(row)):
        most = max(most, row[e])
    return most


@fused
def take(plant, sides, h, q, u, n):
    """Advance the state q by h.

    `u` and `n` hold drive and normal force with their derivatives at the nodes (see `channels.at_nodes`).
    Returns the new state, the three vectors of the continuous extension, the error in metres, and for each
    element h over the time that its fastest state takes to relax.

    Two errors are looked at: the embedded one, and the defect of the continuous extension in the middle of
    the step, brought to the scale of the state by W: the first alone is blind where a stiff bristle softens
    within one step (sliding that slows through the Stribeck range).
    """
    per_h = 1.0 / h
    w, t, weights, fast = factor(plant, sides, q, u[0], n[0], h * GAMMA)
    t = times(h, t)

    k0 = solved(plant, sides, w, plus(slope(plant, sides, q, u[0], n[0])[0], D[0], t))
    p = plus(q, A[1][0], k0)
    r = plus(times(D[1], t), per_h * C[1][0], k0)
    k1 = solved(plant, sides, w, plus(slope(plant, sides, p, u[1], n[1])[0], 1.0, r))
    p = plus(plus(q, A[2][0], k0), A[2][1], k1)
    r = plus(plus(times(D[2], t), per_h * C[2][0], k0), per_h * C[2][1], k1)
    k2 = solved(plant, sides, w, plus(slope(plant, sides, p, u[2], n[2])[0], 1.0, r))
    p = plus(plus(plus(q, A[3][0], k0), A[3][1], k1), A[3][2], k2)
    r = plus(plus(times(C[3][0], k0), C[3][1], k1), C[3][2], k2)
    r = plus(times(D[3], t), per_h, r)
    k3 = solved(plant, sides, w, plus(slope(plant, sides, p, u[3], n[3])[0], 1.0, r))
    p = plus(plus(plus(plus(q, A[4][0], k0), A[4][1], k1), A[4][2], k2), A[4][3], k3)
    r = plus(plus(plus(times(C[4][0], k0), C[4][1], k1), C[4][2], k2), C[4][3], k3)
    r = plus(times(D[4], t), per_h, r)
    k4 = solved(plant, sides, w, plus(slope(plant, sides, p, u[4], n[4])[0], 1.0, r))
    p = plus(plus(plus(plus(plus(q, A[5][0], k0), A[5][1], k1), A[5][2], k2), A[5][3], k3), A[5][4], k4)
    r = plus(plus(plus(plus(times(C[5][0], k0), C[5][1], k1), C[5][2], k2), C[5][3], k3), C[5][4], k4)
    k5 = solved(plant, sides, w, plus(slope(plant, sides, p, u[5], n[5])[0], per_h, r))
    p = plus(p, 1.0, k5)
    r = plus(plus(plus(times(C[6][0], k0), C[6][1], k1), C[6][2], k2), C[6][3], k3)
    r = plus(plus(r, C[6][4], k4), C[6][5], k5)
    k6 = solved(plant, sides, w, plus(slope(plant, sides, p, u[5], n[5])[0], per_h, r))
    p = plus(p, 1.0, k6)
    r = plus(plus(plus(times(C[7][0], k0), C[7][1], k1), C[7][2], k2), C[7][3], k3)
    r = plus(plus(plus(r, C[7][4], k4), C[7][5], k5), C[7][6], k6)
    k7 = solved(plant, sides, w, plus(slope(plant, sides, p, u[5], n[5])[0], per_h, r))
    new = plus(p, 1.0, k7)

    k = (k0, k1, k2, k3, k4, k5, k6, k7)
    rows = (sum_of(H[0], k), sum_of(H[1], k), sum_of(H[2], k))
    error, fast = size(plant, k7, weights), times(h, fast)
    if _largest(fast) < STIFF:
        return new, rows, error, fast
    middle = at(0.5, q, new, rows)
    change = plus(plus(plus(new, -1.0, q), 0.25, rows[1]), 0.25, rows[2])
    defect = solved(plant, sides, w, plus(slope(plant, sides, middle, u[6], n[6])[0], -per_h, change))
    return new, rows, max(error, size(plant, defect, weights)), fast


@fused
def at(theta, q, new, rows):
    """The state at a fraction theta of a step."""
    rest = 1.0 - theta
    inner = plus(plus(rows[0], theta, rows[1]), theta * theta, rows[2])
    return plus(plus(times(rest, q), theta, new), theta * rest, inner)
