r"""One step of Rodas5P, a stiffly accurate, L-stable Rosenbrock method of order 5 [steinebach2023].

With :math:`W = I/(h\gamma) - J` the stages are

.. math:: W U_i = f\Bigl(t + c_i h,\ q + \sum_{j<i} a_{ij} U_j\Bigr) + \frac1h \sum_{j<i} C_{ij} U_j + h d_i
f_t

the new state is :math:`q + \sum a_{8j} U_j + U_8`, and U_8 is the error estimate. The Jacobian has the
structure of a
contact: positions follow velocities, and each bristle feels only the sliding velocity and itself. So W is
solved
in closed form: bristles and positions are eliminated one by one, and what is left is 2 x 2, for any number of
elements.
"""

from __future__ import annotations

import math

import numpy as np

from .._jit import inlined
from ..friction.law import element, elements, rate
from ..mechanism import (
    FIRST_BRISTLE,
    SLIDER,
    SLIDER_VELOCITY,
    STAGE,
    STAGE_VELOCITY,
    slider_acceleration,
    stage_acceleration,
)
from ..waveform.drive import value_slope_curvature

STAGES = 8
GAMMA = 0.21193756319429014

_A6 = [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946]
A = np.zeros((STAGES, STAGES))
A[1, :1] = [3.0]
A[2, :2] = [2.849394379747939, 0.45842242204463923]
A[3, :3] = [-6.954028509809101, 2.489845061869568, -10.358996098473584]
A[4, :4] = [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641]
A[5, :5] = _A6
A[6, :6] = [*_A6, 1.0]
A[7, :7] = [*_A6, 1.0, 1.0]

C = np.zeros((STAGES, STAGES))
C[1, :1] = [-14.155112264123755]
C[2, :2] = [-17.97296035885952, -2.859693295451294]
C[3, :3] = [147.12150275711716, -1.41221402718213, 71.68940251302358]
C[4, :4] = [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306]
C[5, :5] = [
    24.854864614690072,
    -3.0009227002832186,
    47.4931110020768,
    5.5814197821558125,
    -0.6610691825249471,
]
C[6, :6] = [
    30.91273214028599,
    -3.1208243349937974,
    77.79954646070892,
    34.28646028294783,
    -19.097331116725623,
    -28.087943162872662,
]
C[7, :7] = [
    37.80277123390563,
    -3.2571969029072276,
    112.26918849496327,
    66.9347231244047,
    -40.06618937091002,
    -54.66780262877968,
    -9.48861652309627,
]

# Row k: what stage k gives to the sums of all later stages, a_{ik} in the first half and C_{ik} in the
# second. One # row is two vector registers, so that the sums cost one multiply-add per stage and state.
SPREAD = np.ascontiguousarray(np.hstack([A.T, C.T]))

NODES = np.array(
    [0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0]
)
D = np.array(
    [
        0.21193756319429014,
        -0.42387512638858027,
        -0.3384627126235924,
        1.8046452872882734,
        2.325825639765069,
        0,
        0,
        0,
    ]
)
# Rows of the continuous extension, of order 4.
H = np.array(
    [
        [
            25.948786856663858,
            -2.5579724845846235,
            10.433815404888879,
            -2.3679251022685204,
            0.524948541321073,
            1.1241088310450404,
            0.4272876194431874,
            -0.17202221070155493,
        ],
        [
            -9.91568850695171,
            -0.9689944594115154,
            3.0438037242978453,
            -24.495224566215796,
            20.176138334709044,
            15.98066361424651,
            -6.789040303419874,
            -6.710236069923372,
        ],
        [
            11.419903575922262,
            2.8879645146136994,
            72.92137995996029,
            80.12511834622643,
            -52.072871366152654,
            -59.78993625266729,
            -0.15582684282751913,
            4.883087185713722,
        ],
    ]
)


@inlined
def derivatives(law, v, z, slopes):
    """Slopes of the law at (v, z) by one-sided differences: row 0 dF/dz, row 1 dż/dv, row 2 dż/dz per
    element; returns F and dF/dv. The differences stay on the side of the present direction of sliding."""
    dv = 1e-7 * abs(v) + 1e-11
    if v < 0.0:
        dv = -dv
    total, total_v = 0.0, 0.0
    for e in range(max(elements(law), 1)):
        one = element(law, e)
        force, dz = rate(one, v, z[e])
        force_v, dz_v = rate(one, v + dv, z[e])
        step = math.copysign(1e-7 * abs(z[e]) + 1e-15, z[e])  # outwards: off a bound on which a law stops z
        force_z, dz_z = rate(one, v, z[e] + step)
        slopes[0, e] = (force_z - force) / step
        slopes[1, e] = (dz_v - dz) / dv
        slopes[2, e] = (dz_z - dz) / step
        total += force
        total_v += (force_v - force) / dv
    return total, total_v


@inlined
def factor(mech, g, force_v, normal, slopes, n_elements):
    """What `solve` needs of W = g - J: the inverse of the 2 x 2 matrix that is left, row by row. Row 2 of
    `slopes` becomes 1 / (g - dż/dz), the factor by which each bristle is eliminated."""
    phi = force_v
    for e in range(n_elements):
        slopes[2, e] = 1.0 / (g - slopes[2, e])
        phi += slopes[0, e] * slopes[1, e] * slopes[2, e]
    phi *= normal
    per_g = 1.0 / g
    stage = g + mech.stage_damping + mech.stage_stiffness * per_g
    slider = g + mech.slider_damping + mech.slider_stiffness * per_g
    # The determinant, with the large products of phi that cancel already left out.
    scale = 1.0 / (stage * slider + (stage * mech.mobility + slider * mech.reaction) * phi)
    return (
        (slider + mech.mobility * phi) * scale,
        mech.reaction * phi * scale,
        mech.mobility * phi * scale,
        (stage + mech.reaction * phi) * scale,
    )


@inlined
def solve(mech, per_g, normal, slopes, inverse, n_elements, r):
    """Solve W x = r in place: bristles out, positions out, 2 x 2, and back."""
    rest = 0.0
    for e in range(n_elements):
        rest += slopes[0, e] * r[FIRST_BRISTLE + e] * slopes[2, e]
    rest *= normal
    right_w = r[STAGE_VELOCITY] - mech.stage_stiffness * r[STAGE] * per_g - mech.reaction * rest
    right_s = r[SLIDER_VELOCITY] - mech.slider_stiffness * r[SLIDER] * per_g + mech.mobility * rest
    dw = inverse[0] * right_w + inverse[1] * right_s
    ds = inverse[2] * right_w + inverse[3] * right_s
    r[STAGE] = (r[STAGE] + dw) * per_g
    r[STAGE_VELOCITY] = dw
    r[SLIDER] = (r[SLIDER] + ds) * per_g
    r[SLIDER_VELOCITY] = ds
    for e in range(n_elements):
        r[FIRST_BRISTLE + e] = (r[FIRST_BRISTLE + e] + slopes[1, e] * (dw - ds)) * slopes[2, e]


@inlined
def derivative(law, mech, drive, i, load, j, t, q, direction, n_elements, out):
    """dq/dt at time t into `out`; `direction` is that of a static law."""
    u, du, _ = value_slope_curvature(drive, i, t)
    normal = value_slope_curvature(load, j, t)[0]
    v = (mech.gain * du if mech.kinematic else q[STAGE_VELOCITY]) - q[SLIDER_VELOCITY]
    force = 0.0
    for e in range(n_elements):
        one_force, dz = rate(element(law, e), v, q[FIRST_BRISTLE + e])
        force += one_force
        out[FIRST_BRISTLE + e] = dz
    if n_elements == 0:
        force = rate(element(law, 0), v, direction)[0]
    force *= normal
    out[STAGE], out[STAGE_VELOCITY] = 0.0, 0.0
    if not mech.kinematic:
        out[STAGE] = q[STAGE_VELOCITY]
        out[STAGE_VELOCITY] = stage_acceleration(mech, u, q[STAGE], q[STAGE_VELOCITY], force)
    out[SLIDER] = q[SLIDER_VELOCITY]
    out[SLIDER_VELOCITY] = slider_acceleration(mech, u, q[SLIDER], q[SLIDER_VELOCITY], force)


@inlined
def _size(mech, r, slopes, weight, n_elements):
    """The largest entry of an error vector in metres, or NaN; see `step`."""
    size = 0.0
    for c in range(FIRST_BRISTLE + n_elements):
        term = abs(r[c])
        if c in (STAGE_VELOCITY, SLIDER_VELOCITY):
            term /= mech.rate
        elif c >= FIRST_BRISTLE:
            term *= max(1.0, weight * slopes[0, c - FIRST_BRISTLE])
        size = term if not term <= size else size  # keeps a NaN
    return size


@inlined
def step(law, mech, drive, i, load, j, t, h, q, U, new, stage, slopes, rows, sums, allowed):
    """Advance q by h into `new`; returns the error over `allowed` [m], so that 1 is just allowed.

    An error of a velocity counts as the position it makes at the mechanism's own rate, and one of a bristle
    as what its force makes (which is more, where the contact is stiffer than the stage).

    `U` [8, n] keeps the stages and `rows` [3, n] the continuous extension. `i` and `j` are the segments of
    `drive` and of `load` (the normal force over its reference) that hold for the whole step; `stage`,
    `slopes` and `sums` [n, 16] are work space. Two errors are looked at: the embedded one, and the defect of
    the continuous extension in the middle
    of the step, brought to the scale of the state by W: the first alone is blind where a stiff bristle
    softens within one step (sliding that slows through the Stribeck range).
    """
    n_elements = elements(law)
    n = FIRST_BRISTLE + n_elements
    direction = q[FIRST_BRISTLE] if n_elements == 0 else 0.0
    per_h = 1.0 / h
    per_g = h * GAMMA
    g = 1.0 / per_g
    _, du, ddu = value_slope_curvature(drive, i, t)
    normal, dnormal, _ = value_slope_curvature(load, j, t)
    if mech.kinematic:
        v = mech.gain * du - q[SLIDER_VELOCITY]
        dv_dt = mech.gain * ddu
    else:
        v = q[STAGE_VELOCITY] - q[SLIDER_VELOCITY]
        dv_dt = 0.0
    force, force_v = derivatives(law, v, q[FIRST_BRISTLE:], slopes)
    inverse = factor(mech, g, force_v, normal, slopes, n_elements)

    # Partial derivative by time, through the drive and the normal force.
    dforce_dt = dnormal * force + normal * force_v * dv_dt
    stage_t = 0.0 if mech.kinematic else mech.stage_drive * du - mech.reaction * dforce_dt
    slider_t = mech.slider_drive * du + mech.mobility * dforce_dt

    for c in range(n):
        for m in range(2 * STAGES):
            sums[c, m] = 0.0
    for k in range(STAGES):
        for c in range(n):
            stage[c] = q[c] + sums[c, k]
        derivative(law, mech, drive, i, load, j, t + NODES[k] * h, stage, direction, n_elements, U[k])
        if D[k] != 0.0:
            U[k, STAGE_VELOCITY] += h * D[k] * stage_t
            U[k, SLIDER_VELOCITY] += h * D[k] * slider_t
            for e in range(n_elements):
                U[k, FIRST_BRISTLE + e] += h * D[k] * slopes[1, e] * dv_dt
        for c in range(n):
            U[k, c] += sums[c, STAGES + k] * per_h
        solve(mech, per_g, normal, slopes, inverse, n_elements, U[k])
        for c in range(n):
            u_k = U[k, c]
            for m in range(2 * STAGES):
                sums[c, m] += SPREAD[k, m] * u_k

    for c in range(n):
        new[c] = stage[c] + U[STAGES - 1, c]
    weight = normal * (mech.mobility + mech.reaction) / mech.rate**2
    error = _size(mech, U[STAGES - 1], slopes, weight, n_elements) / allowed
    if not error <= 1.0:
        return error
    dense_rows(U, n, rows)
    interpolate(0.5, q, new, rows, n, stage)
    defect = U[STAGES - 1]  # no longer needed
    derivative(law, mech, drive, i, load, j, t + 0.5 * h, stage, direction, n_elements, defect)
    for c in range(n):
        defect[c] -= (new[c] - q[c] + 0.25 * (rows[1, c] + rows[2, c])) * per_h
    if mech.kinematic:
        defect[STAGE], defect[STAGE_VELOCITY] = 0.0, 0.0
    solve(mech, per_g, normal, slopes, inverse, n_elements, defect)
    return max(error, _size(mech, defect, slopes, weight, n_elements) / allowed)


@inlined
def dense_rows(U, n, rows):
    """The three vectors of the continuous extension of the step that left `U`."""
    for r in range(3):
        for c in range(n):
            value = 0.0
            for m in range(STAGES):
                value += H[r, m] * U[m, c]
            rows[r, c] = value


@inlined
def interpolate(theta, q, new, rows, n, out):
    """The state at a fraction theta of the step."""
    rest = 1.0 - theta
    for c in range(n):
        out[c] = rest * q[c] + theta * (
            new[c] + rest * (rows[0, c] + theta * (rows[1, c] + theta * rows[2, c]))
        )
