r"""One step of Rodas5P [steinebach2023] for a stage, a slider and one bristle, in plain scalars.

The method is that of `rodas`, which takes any number of elements and keeps its stages in arrays. Here every
quantity is a local variable that a processor keeps in a register, which makes a step three to four times
quicker, and a thread of a GPU can run the same function.

A step knows on which `side` of v = 0 it began and continues the law smoothly beyond a reversal, so that the
kink of |v| never enters it: it is cut at the reversal afterwards, on its continuous extension.
"""

from __future__ import annotations

from .._jit import fused
from ..friction.law import rate
from ..mechanism import slider_acceleration, stage_acceleration
from . import rodas
from .rodas import GAMMA

# The coefficients as constants of the compiled step.
A = tuple(tuple(map(float, row)) for row in rodas.A)
C = tuple(tuple(map(float, row)) for row in rodas.C)
D = tuple(map(float, rodas.D))
H = tuple(tuple(map(float, row)) for row in rodas.H)
# Where in the step the drive is wanted: at the distinct nodes of the stages, and in the middle.
NODES = (*map(float, rodas.NODES[:6]), 0.5)
MIDDLE, LAST = 6, 5


@fused
def smooth_rate(law, v, z, side):
    """Force and bristle rate on one side of v = 0, continued beyond it by reflection in the point v = 0,
    which keeps value and slope."""
    force, dz = rate(law, abs(v) * side, z)
    if v * side >= 0.0:
        return force, dz
    force_0, dz_0 = rate(law, 0.0, z)
    return 2.0 * force_0 - force, 2.0 * dz_0 - dz


@fused
def plus(p, a, k):
    """p + a k."""
    return (p[0] + a * k[0], p[1] + a * k[1], p[2] + a * k[2], p[3] + a * k[3], p[4] + a * k[4])


@fused
def times(a, k):
    return (a * k[0], a * k[1], a * k[2], a * k[3], a * k[4])


@fused
def sum_of(a, k):
    """The sum of all eight stages, weighted."""
    first = plus(plus(plus(times(a[0], k[0]), a[1], k[1]), a[2], k[2]), a[3], k[3])
    return plus(plus(plus(plus(first, a[4], k[4]), a[5], k[5]), a[6], k[6]), a[7], k[7])


@fused
def slope(law, mech, side, q, u, normal):
    """dq/dt."""
    force, dz = smooth_rate(law, q[1] - q[3], q[4], side)
    force *= normal
    return (
        q[1],
        stage_acceleration(mech, u, q[0], q[1], force),
        q[3],
        slider_acceleration(mech, u, q[2], q[3], force),
        dz,
    )


@fused
def law_slopes(law, v, z, side):
    """F, dF/dv, dF/dz, dż/dv, dż/dz by one-sided differences; outwards in v, and off a bound on z."""
    speed = abs(v)
    dv = side * (1e-7 * speed + 1e-11)
    dz = 1e-7 * abs(z) + 1e-15
    dz = dz if z >= 0.0 else -dz
    force, rate_0 = rate(law, side * speed, z)
    force_v, rate_v = rate(law, side * speed + dv, z)
    force_z, rate_z = rate(law, side * speed, z + dz)
    return (
        force,
        (force_v - force) / dv,
        (force_z - force) / dz,
        (rate_v - rate_0) / dv,
        (rate_z - rate_0) / dz,
    )


@fused
def factor(mech, per_g, normal, force_v, force_z, dz_v, dz_z):
    """What `solved` needs of W = 1/per_g - J: see `rodas.factor`."""
    g = 1.0 / per_g
    per_z = 1.0 / (g - dz_z)
    phi = normal * (force_v + force_z * dz_v * per_z)
    stage = g + mech.stage_damping + mech.stage_stiffness * per_g
    slider = g + mech.slider_damping + mech.slider_stiffness * per_g
    scale = 1.0 / (stage * slider + (stage * mech.mobility + slider * mech.reaction) * phi)
    return (
        per_g,
        normal * force_z * per_z,
        dz_v,
        per_z,
        (slider + mech.mobility * phi) * scale,
        mech.reaction * phi * scale,
        mech.mobility * phi * scale,
        (stage + mech.reaction * phi) * scale,
    )


@fused
def solved(mech, w, r):
    """x of W x = r."""
    per_g, force_z, dz_v, per_z, ww, ws, sw, ss = w
    rest = force_z * r[4]
    right_w = r[1] - mech.stage_stiffness * r[0] * per_g - mech.reaction * rest
    right_s = r[3] - mech.slider_stiffness * r[2] * per_g + mech.mobility * rest
    dw = ww * right_w + ws * right_s
    ds = sw * right_w + ss * right_s
    return ((r[0] + dw) * per_g, dw, (r[2] + ds) * per_g, ds, (r[4] + dz_v * (dw - ds)) * per_z)


@fused
def size(r, per_rate, weight):
    """The largest entry of an error vector in metres, or NaN."""
    position, speed = max(abs(r[0]), abs(r[2])), max(abs(r[1]), abs(r[3]))
    largest = max(max(position, speed * per_rate), abs(r[4]) * weight)
    return largest + 0.0 * (r[0] + r[1] + r[2] + r[3] + r[4])


@fused
def contact_step(law, mech, side, h, q, u, du, normal, dnormal):
    """Advance q = (y, w, x, s, z) by h.

    `u` and `normal` hold drive and normal force (over its reference) at `NODES`, `du` and `dnormal` their
    slopes at the start. Returns the new state, the three vectors of the continuous extension, the error in
    metres (see `rodas.step`), and h over the time that the bristle takes to relax.
    """
    per_h = 1.0 / h
    force, force_v, force_z, dz_v, dz_z = law_slopes(law, q[1] - q[3], q[4], side)
    w = factor(mech, h * GAMMA, normal[0], force_v, force_z, dz_v, dz_z)
    by_time = (
        0.0,
        h * (mech.stage_drive * du - mech.reaction * dnormal * force),
        0.0,
        h * (mech.slider_drive * du + mech.mobility * dnormal * force),
        0.0,
    )

    k0 = solved(mech, w, plus(slope(law, mech, side, q, u[0], normal[0]), D[0], by_time))
    p = plus(q, A[1][0], k0)
    r = plus(times(D[1], by_time), per_h * C[1][0], k0)
    k1 = solved(mech, w, plus(slope(law, mech, side, p, u[1], normal[1]), 1.0, r))
    p = plus(plus(q, A[2][0], k0), A[2][1], k1)
    r = plus(plus(times(D[2], by_time), per_h * C[2][0], k0), per_h * C[2][1], k1)
    k2 = solved(mech, w, plus(slope(law, mech, side, p, u[2], normal[2]), 1.0, r))
    p = plus(plus(plus(q, A[3][0], k0), A[3][1], k1), A[3][2], k2)
    r = plus(plus(times(C[3][0], k0), C[3][1], k1), C[3][2], k2)
    r = plus(times(D[3], by_time), per_h, r)
    k3 = solved(mech, w, plus(slope(law, mech, side, p, u[3], normal[3]), 1.0, r))
    p = plus(plus(plus(plus(q, A[4][0], k0), A[4][1], k1), A[4][2], k2), A[4][3], k3)
    r = plus(plus(plus(times(C[4][0], k0), C[4][1], k1), C[4][2], k2), C[4][3], k3)
    r = plus(times(D[4], by_time), per_h, r)
    k4 = solved(mech, w, plus(slope(law, mech, side, p, u[4], normal[4]), 1.0, r))
    p = plus(plus(plus(plus(plus(q, A[5][0], k0), A[5][1], k1), A[5][2], k2), A[5][3], k3), A[5][4], k4)
    r = plus(plus(plus(plus(times(C[5][0], k0), C[5][1], k1), C[5][2], k2), C[5][3], k3), C[5][4], k4)
    k5 = solved(mech, w, plus(slope(law, mech, side, p, u[LAST], normal[LAST]), per_h, r))
    p = plus(p, 1.0, k5)
    r = plus(plus(plus(times(C[6][0], k0), C[6][1], k1), C[6][2], k2), C[6][3], k3)
    r = plus(plus(r, C[6][4], k4), C[6][5], k5)
    k6 = solved(mech, w, plus(slope(law, mech, side, p, u[LAST], normal[LAST]), per_h, r))
    p = plus(p, 1.0, k6)
    r = plus(plus(plus(times(C[7][0], k0), C[7][1], k1), C[7][2], k2), C[7][3], k3)
    r = plus(plus(plus(r, C[7][4], k4), C[7][5], k5), C[7][6], k6)
    k7 = solved(mech, w, plus(slope(law, mech, side, p, u[LAST], normal[LAST]), per_h, r))
    new = plus(p, 1.0, k7)

    k = (k0, k1, k2, k3, k4, k5, k6, k7)
    rows = (sum_of(H[0], k), sum_of(H[1], k), sum_of(H[2], k))
    # The defect of the continuous extension in the middle of the step.
    middle = at(0.5, q, new, rows)
    change = plus(plus(plus(new, -1.0, q), 0.25, rows[1]), 0.25, rows[2])
    defect = solved(mech, w, plus(slope(law, mech, side, middle, u[MIDDLE], normal[MIDDLE]), -per_h, change))
    per_rate = 1.0 / mech.rate
    weight = max(1.0, normal[0] * force_z * (mech.mobility + mech.reaction) * per_rate * per_rate)
    return new, rows, max(size(k7, per_rate, weight), size(defect, per_rate, weight)), -h * dz_z


@fused
def at(theta, q, new, rows):
    """The state at a fraction theta of a step."""
    rest = 1.0 - theta
    inner = plus(plus(rows[0], theta, rows[1]), theta * theta, rows[2])
    return plus(plus(times(rest, q), theta, new), theta * rest, inner)
