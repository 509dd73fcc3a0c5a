"""Trajectories of a stick-slip actuator by other means than the package's, to hold its accuracy against.

The equations once more, from the papers, in stage position and velocity, sliding displacement r = y - x_e
and sliding velocity v (so that rest is exact). Two solvers, an explicit one of order 8 (DOP853) and an
implicit one of order 9 (Radau IIA, five stages), share the equations and the corners: by what they differ the
oracle doubts itself. Between its corners every law is continued smoothly; a corner (reversal, bound of a
bristle, breakaway at rest, break of the drive) ends a step, and is found by repeating the step.

Under a varying normal force N(t) the friction force is N F(v, z), and each bristle loses max(N', 0)/N z per
second: what is newly pressed together carries no force yet.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import _ivp

Array = NDArray[np.float64]
NAMES = (
    "Coulomb", "CoulombViscous", "StictionCoulombViscous", "Stribeck", "Dahl", "ResetIntegrator", "LuGre",
    "Elastoplastic", "MaxwellSlip",
)  # fmt: skip
STRIBECK, DAHL, RESET, LUGRE, ELASTOPLASTIC, MAXWELL = 3, 4, 5, 6, 7, 8
# Columns of the parameters of a law.
KIND, S0, S1, S2, FC, FS, VS, POWER, BOUND, EXCESS, VD, RATE = range(12)
# ... of the bodies: C w^2, 2 zeta w, w^2, reaction/m, 1/m_e, axial force.
PUSH, DRAG, SPRING, REACTION, MOBILITY, AXIAL = range(6)
# ... of a segment of drive and normal force, each c0 + c1 tau + a sin(omega tau + phase).
START, DRIVE, NORMAL = 0, 1, 6
EXPLICIT, IMPLICIT = 0, 1
DONE, TOO_MANY_STEPS, STUCK = 0, 1, 2

_dop = _ivp.dop853_coefficients  # pyright: ignore[reportAttributeAccessIssue]
A8, B8, C8 = _dop.A[:12, :12].copy(), _dop.B.copy(), _dop.C[:12].copy()
E3, E5 = _dop.E3.copy(), _dop.E5.copy()


def _radau(s: int = 5) -> tuple[Array, Array, float, Array]:
    """Nodes and matrix of Radau IIA, its real eigenvalue, and the embedded formula by stages."""
    p = np.polynomial.Polynomial([0, 1]) ** (s - 1) * np.polynomial.Polynomial([-1, 1]) ** s
    c = np.sort(np.real(p.deriv(s - 1).roots()).astype(float))
    c[-1] = 1.0
    powers = np.arange(s)
    v = c[:, None] ** powers
    a = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(v)
    eigenvalues = np.linalg.eigvals(a)
    g = float(eigenvalues[np.argmin(np.abs(eigenvalues.imag))].real)
    e = np.linalg.solve(v.T, np.where(powers == 0, -g, 0.0))
    return c, a, g, np.asarray(np.linalg.solve(a.T, e), dtype=float)


C9, A9, GAMMA, E9 = _radau()
S = C9.size


@njit(cache=True)
def signal(row, first, tau):
    """Value and slope."""
    angle = row[first + 3] * tau + row[first + 4]
    u = row[first] + row[first + 1] * tau
    du = row[first + 1]
    if row[first + 2] != 0.0:
        u += row[first + 2] * math.sin(angle)
        du += row[first + 2] * row[first + 3] * math.cos(angle)
    return u, du


@njit(cache=True)
def fall(p, v):
    """exp(-|v/v_s|^delta), by which the Stribeck curve falls."""
    x = abs(v) / p[VS]
    return math.exp(-x * x) if p[POWER] == 2.0 or p[KIND] != STRIBECK else math.exp(-(x ** p[POWER]))


@njit(cache=True)
def curve(p, v):
    """g(v), N."""
    return p[FC] if p[FS] <= p[FC] else p[FC] + (p[FS] - p[FC]) * fall(p, v)


@njit(cache=True)
def maxwell_limit(p, k, W, v):
    """Deflection at which an element slides and its slope over v; FS is the ratio of stiction here."""
    if p[FS] <= 1.0:
        return W / k, 0.0
    e = (p[FS] - 1.0) * math.exp(-((v / p[VS]) ** 2))
    return W / k * (1.0 + e), -W / k * e * 2.0 * v / p[VS] ** 2


@njit(cache=True)
def contact(p, k, W, mode, v, q, gain, dz):
    """Force at the reference normal force; the rates of the bristles go into dz. `gain` is max(N', 0)/N."""
    kind, side, z = p[KIND], mode[0], q[4]
    if kind <= STRIBECK:
        dz[0] = 0.0
        g = p[FC] if kind != STRIBECK else curve(p, max(side * v, 0.0))
        return side * g + p[S2] * v
    if kind == MAXWELL:
        force = p[S2] * v
        for i in range(k.size):
            limit, _ = maxwell_limit(p, k[i], W[i], v)
            if mode[1 + i] == 0:
                force += k[i] * q[4 + i]
                dz[i] = v - gain * q[4 + i]
            elif mode[1 + i] == 1:  # on the Stribeck curve
                force += k[i] * side * limit
                dz[i] = 0.0
            else:
                force += k[i] * q[4 + i]
                dz[i] = p[RATE] * W[i] / k[i] * (side - q[4 + i] / limit) - gain * q[4 + i]
        return force
    rate = v
    if kind == DAHL:
        left = 1.0 - side * z * p[S0] / p[FC]
        rate = v * left if p[POWER] == 1.0 else v * math.copysign(abs(left) ** p[POWER], left)
        force = p[S0] * z
    elif kind == RESET:
        if mode[1] == 1:
            dz[0] = 0.0
            return p[S0] * side * p[BOUND]
        force = (1.0 + p[EXCESS]) * p[S0] * z + p[S2] * v
    elif kind == LUGRE:
        rate = v - side * v * p[S0] / curve(p, v) * z
        fade = math.exp(-((v / p[VD]) ** 2)) if p[VD] < math.inf else 1.0
        force = p[S0] * z + p[S1] * fade * rate + p[S2] * v
    else:
        end = curve(p, v) / p[S0]
        if mode[1] == 1:
            phase = math.pi * (side * z - 0.5 * (end + p[BOUND])) / (end - p[BOUND])
            rate = v * (1.0 - 0.5 * (1.0 + math.sin(phase)) * side * z / end)
        elif mode[1] == 2:
            rate = v * (1.0 - side * z / end)
        force = p[S0] * z + p[S1] * rate + p[S2] * v
    dz[0] = rate - gain * z
    return force


@njit(cache=True)
def slopes(t, q, row, body, p, k, W, mode, dq):
    """dq/dt; returns the friction force, N."""
    u, _ = signal(row, DRIVE, t - row[START])
    normal, dnormal = signal(row, NORMAL, t - row[START])
    free = body[PUSH] * u - body[DRAG] * q[1] - body[SPRING] * q[0]
    dq[0] = q[1]
    if mode[0] == 0:
        force = (free - body[AXIAL] * body[MOBILITY]) / (body[MOBILITY] + body[REACTION])
        dq[1] = free - body[REACTION] * force
        dq[2:] = 0.0
        return force
    force = normal * contact(p, k, W, mode, q[3], q, max(dnormal, 0.0) / normal, dq[4:])
    dq[1] = free - body[REACTION] * force
    dq[2] = q[3]
    dq[3] = dq[1] - body[MOBILITY] * (force + body[AXIAL])
    return force


@njit(cache=True)
def margins(t, q, row, body, p, k, W, mode, out, dq):
    """How far each corner still is: of the contact, and of each element; below 0 it is passed.

    `dq` is room for slopes. Rounding is given room here: the modes agree near their corner.
    """
    kind, side = p[KIND], mode[0]
    out[:] = 1.0
    normal, dnormal = signal(row, NORMAL, t - row[START])
    if side == 0:
        force = slopes(t, q, row, body, p, k, W, mode, dq)
        out[0] = normal * p[FS] - abs(force)
        return
    out[0] = side * q[3]
    gain, z = max(dnormal, 0.0) / normal, side * q[4]
    if kind == RESET:
        out[1] = p[BOUND] - z if mode[1] == 0 else side * q[3] - gain * p[BOUND] + 1e-15
    elif kind == ELASTOPLASTIC:
        end = curve(p, q[3]) / p[S0]
        near = 1e-9 * end
        if mode[1] == 0:
            out[1] = p[BOUND] - z + near
        elif mode[1] == 1:
            out[1] = min(z - p[BOUND], end - z) + near
        else:
            out[1] = z - end + near
    elif kind == MAXWELL:
        accelerates = 0.0
        if p[FS] > 1.0 or gain > 0.0:
            slopes(t, q, row, body, p, k, W, mode, dq)
            accelerates = dq[3]
        for i in range(k.size):
            limit, by_v = maxwell_limit(p, k[i], W[i], q[3])
            z = side * q[4 + i]
            if mode[1 + i] == 0:
                out[1 + i] = limit - z
            elif mode[1 + i] == 2:
                out[1 + i] = z - limit * (1.0 - 1e-12)
            else:  # it stays on the curve if the spring would carry it up there, and sliding back down
                rises = by_v * accelerates
                out[1 + i] = side * q[3] - gain * limit - rises + 1e-14
                if p[FS] > 1.0:
                    out[1 + i] = min(out[1 + i], rises + gain * limit + 1e-14)


@njit(cache=True)
def place(t, q, row, body, p, k, W, mode, dq):
    """The mode of each element on this side, from the state."""
    side = mode[0]
    mode[1:] = 0
    if side == 0:
        return
    if p[KIND] == RESET:
        mode[1] = 1 if side * q[4] >= p[BOUND] else 0
    elif p[KIND] == ELASTOPLASTIC:
        end = curve(p, q[3]) / p[S0]
        mode[1] = 0 if side * q[4] <= p[BOUND] else 1 if side * q[4] < end else 2
    elif p[KIND] == MAXWELL:
        for i in range(k.size):
            limit, _ = maxwell_limit(p, k[i], W[i], q[3])
            z = side * q[4 + i] / limit
            mode[1 + i] = 0 if z < 1.0 - 1e-12 else 1 if z <= 1.0 + 1e-12 or p[FS] <= 1.0 else 2


@njit(cache=True)
def write_down(q, p, k, W, mode):
    """The deflections of Maxwell elements on their Stribeck curve, which are not integrated there."""
    if p[KIND] == MAXWELL:
        for i in range(k.size):
            if mode[1 + i] == 1:
                q[4 + i] = mode[0] * maxwell_limit(p, k[i], W[i], q[3])[0]


@njit(cache=True)
def begin(t, q, row, body, p, k, W, mode, dq):
    """Side and modes at a sliding velocity that is zero, or after a break."""
    write_down(q, p, k, W, mode)
    if q[3] != 0.0:
        mode[0] = 1 if q[3] > 0.0 else -1
    elif p[KIND] <= STRIBECK:
        mode[0] = 0
        force = slopes(t, q, row, body, p, k, W, mode, dq)
        normal, _ = signal(row, NORMAL, t - row[START])
        if abs(force) >= normal * p[FS]:
            mode[0] = 1 if force > 0.0 else -1
    else:
        for side in (1, -1):
            mode[0] = side
            place(t, q, row, body, p, k, W, mode, dq)
            slopes(t, q, row, body, p, k, W, mode, dq)
            if dq[3] * side > 0.0:
                break
    place(t, q, row, body, p, k, W, mode, dq)


@njit(cache=True)
def corner(t, q, row, body, p, k, W, mode, out, dq):
    """Pass the corners whose margin is negative."""
    side = mode[0]
    if side == 0:
        force = slopes(t, q, row, body, p, k, W, mode, dq)
        mode[0] = 1 if force > 0.0 else -1
        q[3] = 0.0
        return
    write_down(q, p, k, W, mode)
    if out[0] < 0.0:
        q[3] = 0.0
        begin(t, q, row, body, p, k, W, mode, dq)
    elif p[KIND] == MAXWELL:
        _pass_maxwell(t, q, row, body, p, k, W, mode, out, dq)
    elif p[KIND] == RESET:
        mode[1] = 1 - mode[1]
        q[4] = side * p[BOUND]
    else:
        place(t, q, row, body, p, k, W, mode, dq)


@njit(cache=True)
def _pass_maxwell(t, q, row, body, p, k, W, mode, out, dq):
    """An element that reaches its strength, or leaves it: by the rates on both sides of its curve."""
    normal, dnormal = signal(row, NORMAL, t - row[START])
    gain, side = max(dnormal, 0.0) / normal, mode[0]
    slopes(t, q, row, body, p, k, W, mode, dq)
    accelerates = dq[3]
    for i in range(k.size):
        if out[1 + i] < 0.0:
            limit, by_v = maxwell_limit(p, k[i], W[i], q[3])
            rises = by_v * accelerates
            if side * q[3] - gain * limit - rises <= 0.0:
                mode[1 + i] = 0
            elif p[FS] > 1.0 and rises + gain * limit < 0.0:
                mode[1 + i] = 2
            else:
                mode[1 + i] = 1


@njit(cache=True)
def explicit_step(t, h, q, row, body, p, k, W, mode, scale, new, inner, K):
    """DOP853; error over tolerance, and the state at four inner times by Hermite's polynomial."""
    n = q.size
    slopes(t, q, row, body, p, k, W, mode, K[0])
    for s in range(1, 12):
        for c in range(n):
            d = 0.0
            for j in range(s):
                d += A8[s, j] * K[j, c]
            new[c] = q[c] + h * d
        slopes(t + C8[s] * h, new, row, body, p, k, W, mode, K[s])
    for c in range(n):
        d = 0.0
        for j in range(12):
            d += B8[j] * K[j, c]
        new[c] = q[c] + h * d
    slopes(t + h, new, row, body, p, k, W, mode, K[12])
    worst = 0.0
    for c in range(n):
        e5, e3 = 0.0, 0.0
        for j in range(13):
            e5 += E5[j] * K[j, c]
            e3 += E3[j] * K[j, c]
        size = scale[0, c] + scale[1, c] * max(abs(q[c]), abs(new[c]))
        bottom = math.sqrt(e5 * e5 + 0.01 * e3 * e3)
        e = h * e5 * e5 / bottom / size if bottom > 0.0 else 0.0
        worst = max(worst, abs(e)) if e == e else math.inf
        for i in range(4):
            x = 0.2 * (i + 1)
            inner[i, c] = (
                (1.0 + 2.0 * x) * (1.0 - x) ** 2 * q[c]
                + x * x * (3.0 - 2.0 * x) * new[c]
                + h * x * (1.0 - x) * ((1.0 - x) * K[0, c] - x * K[12, c])
            )
    return worst


@njit(cache=True)
def factor(M, pivots):
    """LU in place."""
    n = M.shape[0]
    for c in range(n):
        best = c
        for r in range(c + 1, n):
            if abs(M[r, c]) > abs(M[best, c]):
                best = r
        pivots[c] = best
        if best != c:
            for j in range(n):
                M[c, j], M[best, j] = M[best, j], M[c, j]
        per = 1.0 / M[c, c]
        for r in range(c + 1, n):
            f = M[r, c] * per
            M[r, c] = f
            if f != 0.0:
                for j in range(c + 1, n):
                    M[r, j] -= f * M[c, j]


@njit(cache=True)
def solve(M, pivots, b):
    n = b.size
    for c in range(n):
        i = pivots[c]
        b[c], b[i] = b[i], b[c]
    for r in range(n):
        for j in range(r):
            b[r] -= M[r, j] * b[j]
    for r in range(n - 1, -1, -1):
        for j in range(r + 1, n):
            b[r] -= M[r, j] * b[j]
        b[r] /= M[r, r]


@njit(cache=True)
def implicit_step(t, h, q, row, body, p, k, W, mode, scale, new, inner, Z, before):
    """Radau IIA of order 9 by simplified Newton.

    `Z` holds the stages of the last step, whose length was `before` (0: none). The error estimate is that of
    an embedded formula of order 5, and so far above the error.
    """
    n = q.size
    f0, f, x = np.empty(n), np.empty(n), np.empty(n)
    J = np.empty((n, n))
    slopes(t, q, row, body, p, k, W, mode, f0)
    x[:] = q
    for c in range(n):
        d = 1e-7 * abs(q[c]) + scale[2, c]
        x[c] = q[c] + d
        slopes(t, x, row, body, p, k, W, mode, f)
        J[:, c] = (f - f0) / d
        x[c] = q[c]
    M = np.zeros((S * n, S * n))
    for i in range(S):
        for j in range(S):
            M[i * n : (i + 1) * n, j * n : (j + 1) * n] = -h * A9[i, j] * J
    for i in range(S * n):
        M[i, i] += 1.0
    pivots = np.empty(S * n, dtype=np.int64)
    factor(M, pivots)
    old = Z.copy()
    Z[:] = 0.0
    if before > 0.0 and h < 3.0 * before:
        for i in range(S):
            at = 1.0 + C9[i] * h / before
            for j in range(S):
                weight = at / C9[j]
                for l in range(S):
                    if l != j:
                        weight *= (at - C9[l]) / (C9[j] - C9[l])
                Z[i] += weight * old[j]
            Z[i] -= old[S - 1]
    F, R = np.empty((S, n)), np.empty(S * n)
    last, contraction, done = math.inf, 0.5, False
    for turn in range(15):
        for i in range(S):
            slopes(t + C9[i] * h, q + Z[i], row, body, p, k, W, mode, F[i])
        for i in range(S):
            for c in range(n):
                d = -Z[i, c]
                for j in range(S):
                    d += h * A9[i, j] * F[j, c]
                R[i * n + c] = d
        solve(M, pivots, R)
        change = 0.0
        for i in range(S):
            for c in range(n):
                d = R[i * n + c]
                Z[i, c] += d
                d = abs(d) / (scale[0, c] + scale[1, c] * abs(q[c]))
                change = max(change, d) if d == d else math.inf
        if turn > 0:
            contraction = max(1e-3, change / last)
            if not contraction < 1.0 and change > 0.02:
                return math.inf
        if contraction / (1.0 - min(contraction, 0.99)) * change < 0.02:
            done = True
            break
        last = change
    if not done:
        return math.inf
    for i in range(4):
        inner[i] = q + Z[i]
    new[:] = q + Z[S - 1]
    E = -h * GAMMA * J
    for c in range(n):
        E[c, c] += 1.0
    factor(E, pivots[:n])
    e = h * GAMMA * f0
    for i in range(S):
        e += E9[i] * Z[i]
    solve(E, pivots[:n], e)
    worst = 0.0
    for c in range(n):
        d = abs(e[c]) / (scale[0, c] + scale[1, c] * max(abs(q[c]), abs(new[c])))
        worst = max(worst, d) if d == d else math.inf
    return worst


@njit(cache=True)
def step(method, t, h, q, row, body, p, k, W, mode, scale, new, inner, Z, K, before):
    if method == EXPLICIT:
        return explicit_step(t, h, q, row, body, p, k, W, mode, scale, new, inner, K)
    return implicit_step(t, h, q, row, body, p, k, W, mode, scale, new, inner, Z, before)


@njit(cache=True)
def locate(method, t, h, q, row, body, p, k, W, mode, scale, new, inner, Z, K, start, end, dq):
    """The first time at which a margin is negative, from above, by steps repeated from t; `new` is the state.

    `start` and `end` are the margins at both ends of the bracket, and change.
    """
    low, high, turn, stretch, lowest = 0.0, h, 0, 1.0, False
    trial, found = new.copy(), np.empty(end.size)
    while turn < 100:
        turn += 1
        x = high
        near = True
        for j in range(end.size):
            if end[j] < 0.0:
                near = near and end[j] > (-1e-17 if mode[0] != 0 or j > 0 else -1e-15)
                part = start[j] / (start[j] - end[j]) if start[j] > 0.0 else 0.0
                x = min(x, low + part * (high - low))
        if near or high - low <= 2e-16 * t + 1e-14 * h:
            break
        x = min(low + (x - low) * stretch, high) if lowest else max(high - (high - x) * stretch, low)
        if turn > 40 or not low + 1e-4 * (high - low) < x < high - 1e-4 * (high - low):
            part = 0.5 if turn > 40 else 0.02
            x = low + part * (high - low) if x < 0.5 * (low + high) else high - part * (high - low)
        step(method, t, x, q, row, body, p, k, W, mode, scale, trial, inner, Z, K, 0.0)
        margins(t + x, trial, row, body, p, k, W, mode, found, dq)
        passed = found.min() < 0.0
        if passed:
            high, end[:], new[:] = x, found, trial
        else:
            low, start[:] = x, found
        stretch = 2.0 * stretch if lowest != passed else 1.0
        lowest = not passed
    return high


@njit(cache=True)
def run(method, rows, body, p, k, W, times, q, scale, most, longest, out):
    """Fill `out` [times, states] from the state q at times[0] = 0; `rows` are the segments."""
    n, m = q.size, q.size - 3
    mode = np.zeros(m, dtype=np.int64)
    new, dq, inner = np.empty(n), np.empty(n), np.empty((4, n))
    Z, K = np.zeros((S, n)), np.empty((13, n))
    start, end, between = np.empty(m), np.empty(m), np.empty(m)
    power = -1.0 / 8.0 if method == EXPLICIT else -1.0 / 6.0
    t, h, steps, sample = times[0], longest, 0, 1
    out[0] = q
    for i in range(rows.shape[0]):
        row = rows[i]
        finish = rows[i + 1, START] if i + 1 < rows.shape[0] else times[-1]
        begin(t, q, row, body, p, k, W, mode, dq)
        before, stalls, events, h = 0.0, 0, 0, min(h, 1e-3 * longest)
        last_event = -1.0
        while t < finish:
            target = min(finish, times[sample])
            h = min(h, 0.05 * longest * 5.0) if mode[0] == 0 else h
            taken = min(h, target - t)
            if taken > 0.5 * (target - t) and taken < target - t:
                taken = 0.5 * (target - t)
            steps += 1
            if steps > most:
                return TOO_MANY_STEPS, steps
            error = step(method, t, taken, q, row, body, p, k, W, mode, scale, new, inner, Z, K, before)
            if not error <= 1.0:
                h = taken * (max(0.1, 0.85 * error**power) if error < 1e200 else 0.2)
                before = 0.0
                if h < 1e-15 * t + 1e-22:
                    return STUCK, steps
                continue
            margins(t + taken, new, row, body, p, k, W, mode, end, dq)
            passed = end.min() < 0.0
            if not passed:
                early = 1.0
                for j in range(4):
                    x = 0.2 * (j + 1) if method == EXPLICIT else C9[j]
                    margins(t + x * taken, inner[j], row, body, p, k, W, mode, between, dq)
                    if between.min() < 0.0 and early == 1.0 and not (q[3] == 0.0 and between[0] < 0.0):
                        early = x
                if early < 1.0 and stalls < 12:
                    stalls += 1
                    h, before = early * taken, 0.0
                    continue
            elif end[0] < 0.0 and q[3] == 0.0 and mode[0] != 0 and stalls < 12:  # to the other side, perhaps
                stalls += 1
                before = 0.0
                if p[KIND] > STRIBECK:
                    mode[0] = -mode[0]
                    place(t, q, row, body, p, k, W, mode, dq)
                if p[KIND] <= STRIBECK or stalls % 2 == 0:
                    h = 0.2 * taken
                continue
            elif events < 30:
                margins(t, q, row, body, p, k, W, mode, start, dq)
                taken = locate(
                    method, t, taken, q, row, body, p, k, W, mode, scale, new, inner, Z, K, start, end, dq
                )
                t += taken
                q[:] = new
                corner(t, q, row, body, p, k, W, mode, end, dq)
                events = events + 1 if t - last_event < 1e-9 * longest else 0
                last_event, stalls, before = t, 0, 0.0
                h = max(min(h, 0.1 * longest), 1e-3 * longest)
                if t >= target:
                    out[sample], sample = q, min(sample + 1, times.size - 1)
                continue
            whole = taken == target - t
            t = target if whole else t + taken
            q[:] = new
            if passed:  # corners that rounding makes, one after the other at one time
                begin(t, q, row, body, p, k, W, mode, dq)
                before = 0.0
            else:
                before = taken
            stalls, events = 0, 0
            grown = taken * min(4.0, 0.85 * max(error, 1e-30) ** power)
            h = max(h, grown) if whole else grown
            if t >= times[sample]:
                out[sample], sample = q, min(sample + 1, times.size - 1)
    return DONE, steps


# ---- From the records to numbers.


class Truth(NamedTuple):
    """Positions of the end-effector at the times [m], by what two solutions differ [m], whether there
    were two at all, seconds taken, and the two methods with their steps."""

    position: Array
    doubt: float
    complete: bool
    seconds: float
    methods: str


def law_numbers(law: Any) -> tuple[Array, Array, Array]:
    """Parameters by the columns above; stiffness and strength of the elements."""
    name = type(law).__name__
    p = np.zeros(12)
    p[KIND] = NAMES.index(name)
    p[POWER], p[VD], p[VS] = getattr(law, "exponent", 2.0), getattr(law, "damping_velocity", math.inf), 1.0
    for column, field in (
        (S0, "sigma_0"), (S1, "sigma_1"), (S2, "sigma_2"), (FC, "coulomb_force"), (VS, "stribeck_velocity"),
        (BOUND, "breakaway_deflection"), (EXCESS, "stiction_excess"), (RATE, "attraction_rate"),
    ):  # fmt: skip
        p[column] = getattr(law, field, p[column])
    p[FS] = getattr(law, "stiction_force", getattr(law, "stiction_ratio", p[FC]))
    k = np.array(getattr(law, "stiffness", (p[S0],)), dtype=float)
    strength = np.array(getattr(law, "strength", (p[FC],)), dtype=float)
    return p, k, strength


def breakaway(law: Any) -> float:
    """Largest force [N] at rest, at the reference normal force."""
    p, _, strength = law_numbers(law)
    if p[KIND] == MAXWELL:
        return float(p[FS] * strength.sum())
    return float((1 + p[EXCESS]) * p[S0] * p[BOUND] if p[KIND] == RESET else p[FS])


def resting_bristles(law: Any, held: float) -> Array:
    """Deflections that carry the force `held`, equal up to each one's bound; all bounds, if it is more."""
    p, k, strength = law_numbers(law)
    if p[KIND] <= STRIBECK:
        return np.zeros(1)
    bound = p[FS] * strength / k if p[KIND] == MAXWELL else p[FS : FS + 1] / p[S0]
    bound = p[BOUND : BOUND + 1] if p[KIND] == RESET else bound
    stiffness = k * (1 + p[EXCESS])
    carried, z = 0.0, np.zeros(k.size)
    for e in np.argsort(bound):  # the next element to come to its bound
        free = bound >= bound[e]
        more = (bound[e] - z[e]) * stiffness[free].sum()
        part = min(1.0, (abs(held) - carried) / more) if more > 0 else 1.0
        z[free] += part * (bound[e] - z[e])
        carried += part * more
        if part < 1.0:
            break
    return np.copysign(z, held)


def waveform_rows(w: Any, end: float) -> list[tuple[float, float, float, float, float, float]]:
    """Segments (start, c0, c1, amplitude, omega, phase), by time from the start; also ends at turns."""
    if isinstance(w, int | float):
        return [(0.0, float(w), 0.0, 0.0, 0.0, 0.0)]
    name = type(w).__name__
    if name == "Lines":  # of `oracle_piezo`
        return w.rows()
    if name == "Step":
        return [(0.0, w.offset + w.amplitude, 0.0, 0.0, 0.0, 0.0)]
    if name == "Ramp":
        hold = (w.delay + w.rise_time, w.offset + w.rate * w.rise_time, 0.0, 0.0, 0.0, 0.0)
        return [(0.0, w.offset, 0.0, 0.0, 0.0, 0.0), (w.delay, w.offset, w.rate, 0.0, 0.0, 0.0), hold]
    T, A = 1.0 / w.frequency, w.amplitude
    if name == "Sine":
        rows = [(0.0, w.offset, 0.0, A, 2 * math.pi * w.frequency, w.phase)]
        for turn in range(math.ceil(2 * end / T) + 1):
            t = (0.25 + 0.5 * turn) * T
            rows.append((t, w.offset, 0.0, A, 2 * math.pi * w.frequency, math.pi * (0.5 + turn) + w.phase))
        return rows
    rows = []
    for turn in range(math.ceil(end / T - 1e-9)):
        if name == "Sawtooth":
            r = w.rise_fraction
            rows.append((turn * T, w.offset, A / (r * T), 0.0, 0.0, 0.0))
            rows.append(((turn + r) * T, w.offset + A, -A / ((1 - r) * T) if r < 1 else 0.0, 0.0, 0.0, 0.0))
        else:
            r = 1 - w.fall_fraction
            rows.append((turn * T, w.offset, A / (r * T) if r > 0 else 0.0, 0.0, 0.0, 0.0))
            rows.append(((turn + r) * T, w.offset + A, -A / ((1 - r) * T), 0.0, 0.0, 0.0))
    return rows


def table(waveform: Any, load: Any, end: float) -> Array:
    """Drive and normal force as rows of one table, up to the end."""
    drive, normal = waveform_rows(waveform, end), waveform_rows(load, end)
    starts = sorted({row[0] for row in (*drive, *normal) if row[0] < end * (1 - 1e-12)})
    rows = []
    begins = [np.array([r[0] for r in one]) for one in (drive, normal)]
    for t in starts:
        row = [t]
        for one, begin in zip((drive, normal), begins, strict=True):
            s, c0, c1, a, omega, phase = one[int(np.searchsorted(begin, t, side="right")) - 1]
            row += [c0 + c1 * (t - s), c1, a, omega, phase + omega * (t - s)]
        rows.append(row)
    return np.array(rows)


def truth(
    actuator: Any,
    waveform: Any,
    load: Any,
    times: Array,
    rate: float,
    most: int = 1_500_000,
    stiffer: float = 1.0,
) -> Truth:
    """The trajectory from rest, twice; `rate` [rad/s] is that of the drive, `stiffer` the factor by which a
    commanded charge stiffens piezo and stage."""
    import time

    clock = time.perf_counter()
    law = actuator.friction
    p, k, strength = law_numbers(law)
    omega, m, m_e = actuator.natural_frequency, actuator.stage_mass, actuator.end_effector_mass
    reaction = 1.0 / m if actuator.stage_reaction else 0.0
    axial = actuator.external_force - m_e * 9.80665 * math.sin(actuator.incline)
    body = np.array(
        [actuator.gain * omega**2, 2 * actuator.damping_ratio * omega, omega**2, reaction, 1 / m_e, axial]
    )
    body[[PUSH, SPRING]] *= stiffer
    rows = table(waveform, load, float(times[-1]))
    normal = signal(rows[0], NORMAL, 0.0)[0]
    z = resting_bristles(law, -axial / normal)
    held = math.copysign(
        min(abs(axial), breakaway(law) * normal), axial
    )  # more than that the stage never feels
    at_rest = np.concatenate([[reaction * held / body[SPRING], 0.0, 0.0, 0.0], z])
    stiffness = k.sum() * (1 + p[EXCESS]) if p[KIND] > STRIBECK else 0.0
    fastest = max(omega * math.sqrt(1 + m_e * reaction), math.sqrt(stiffness * (1 / m_e + reaction)), rate)
    size = float(np.min(np.abs(resting_bristles(law, 1e9)))) if p[KIND] > STRIBECK else 1.0
    found, names = [], []
    for method, tolerance in ((EXPLICIT, 3e-15), (IMPLICIT, 1e-13), (IMPLICIT, 1e-12)):
        if len(found) == 2:
            break
        absolute = np.array([tolerance, tolerance * max(rate, 30.0), tolerance, tolerance * max(rate, 30.0)])
        scale = np.empty((3, 4 + k.size))
        scale[0] = np.append(absolute, np.full(k.size, min(tolerance, 1e5 * tolerance * size)))
        scale[1] = 1e3 * tolerance
        scale[2] = np.append([1e-12, 1e-10, 1e-12, 1e-10], np.full(k.size, 1e-6 * min(size, 1e-6)))
        out = np.full((times.size, at_rest.size), np.nan)
        cap = most if method == EXPLICIT else most // 4
        outcome, steps = run(
            method, rows, body, p, k, strength, times, at_rest.copy(), scale, cap, 1.0 / fastest, out
        )
        if outcome == DONE and np.all(np.isfinite(out)):
            found.append(out[:, 0] - out[:, 2])
            names.append(f"{'explicit' if method == EXPLICIT else 'implicit'} {steps}")
    doubt = float(np.max(np.abs(found[0] - found[1]))) if len(found) == 2 else math.inf
    position = found[0] if found else np.full(times.size, np.nan)
    return Truth(position, doubt, len(found) == 2, time.perf_counter() - clock, ", ".join(names))
