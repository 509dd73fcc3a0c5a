"""Slow, obvious versions of what the engine computes: the oracle of the tests.

Written from the papers' equations with NumPy and SciPy, in the papers' own variables (forces where the
package integrates deflections, say), and sharing no code with it. A law is used for its fields only.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]


def stribeck_curve(p: Any, v: float, exponent: float = 2.0) -> float:
    """g(v) of Olsson et al. 1998: Coulomb friction at speed, stiction at rest."""
    fall = np.exp(-(np.abs(v / p.stribeck_velocity) ** exponent))
    return p.coulomb_force + (p.stiction_force - p.coulomb_force) * fall


# ---- F and dz/dt at one (v, z); z is an array, one number per element, and for a static law the direction.


def coulomb(p: Any, v: float, z: Array) -> tuple[float, Array]:
    return p.coulomb_force * z[0], np.zeros(1)


def coulomb_viscous(p: Any, v: float, z: Array) -> tuple[float, Array]:
    return p.coulomb_force * z[0] + p.sigma_2 * v, np.zeros(1)


def stribeck(p: Any, v: float, z: Array) -> tuple[float, Array]:
    return stribeck_curve(p, v, p.exponent) * z[0] + p.sigma_2 * v, np.zeros(1)


def dahl(p: Any, v: float, z: Array) -> tuple[float, Array]:
    """dF/dt of Dahl 1976, F itself as the state."""
    F = p.sigma_0 * z
    s = 1 - F / p.coulomb_force * np.sign(v)
    dF_dt = p.sigma_0 * v * np.abs(s) ** p.exponent * np.sign(s)
    return F[0], dF_dt / p.sigma_0


def reset_integrator(p: Any, v: float, z: Array) -> tuple[float, Array]:
    """Haessig & Friedland 1991."""
    at_end = ((v > 0) & (z >= p.breakaway_deflection)) | ((v < 0) & (z <= -p.breakaway_deflection))
    dz = np.where(at_end, 0.0, v)
    a = np.where(np.abs(z) < p.breakaway_deflection, p.stiction_excess, 0.0)
    return ((1 + a) * p.sigma_0 * z + p.sigma_2 * dz)[0], dz


def lugre(p: Any, v: float, z: Array) -> tuple[float, Array]:
    """Canudas de Wit et al. 1995, with the damping that fades with speed of Olsson et al. 1998."""
    dz = v - np.abs(v) / (stribeck_curve(p, v) / p.sigma_0) * z
    sigma_1 = p.sigma_1 * np.exp(-((v / p.damping_velocity) ** 2))
    return (p.sigma_0 * z + sigma_1 * dz + p.sigma_2 * v)[0], dz


def elastoplastic(p: Any, v: float, z: Array) -> tuple[float, Array]:
    """Dupont et al. 2002, the transition for z > 0 and its mirror image for z < 0."""
    z_max = stribeck_curve(p, v) / p.sigma_0
    z_ba = p.breakaway_deflection
    phase = np.pi * (z * np.sign(z) - (z_max + z_ba) / 2) / (z_max - z_ba)
    alpha = np.select(
        [np.sign(v) != np.sign(z), np.abs(z) <= z_ba, np.abs(z) >= z_max],
        [0.0, 0.0, 1.0],
        (1 + np.sin(phase)) / 2,
    )
    dz = v * (1 - alpha * z / (z_max * np.sign(v))) if v != 0 else np.zeros(1)
    return (p.sigma_0 * z + p.sigma_1 * dz + p.sigma_2 * v)[0], dz


def maxwell_slip(p: Any, v: float, z: Array) -> tuple[float, Array]:
    """Al-Bender et al. 2005, in forces; which element slides is read off its force."""
    k, W = np.array(p.stiffness), np.array(p.strength)
    F = k * z
    F_C = W.sum()
    share = W / F_C
    C = p.attraction_rate * F_C
    strength = F_C * (1 + (p.stiction_ratio - 1) * np.exp(-((v / p.stribeck_velocity) ** 2)))
    slides = (F * np.sign(v) > 0) & (np.abs(F) >= share * strength)
    s = strength * (np.sign(v) if v != 0 else 1.0)
    dF = np.where(slides, np.sign(v) * C * (share - F / s), k * v)
    return F.sum() + p.sigma_2 * v, dF / k


RATES = {
    "Coulomb": coulomb,
    "CoulombViscous": coulomb_viscous,
    "StictionCoulombViscous": coulomb_viscous,
    "Stribeck": stribeck,
    "Dahl": dahl,
    "ResetIntegrator": reset_integrator,
    "LuGre": lugre,
    "Elastoplastic": elastoplastic,
    "MaxwellSlip": maxwell_slip,
}


def rate(law: Any, v: float, z: Array) -> tuple[float, Array]:
    """Force [N] and rate of each internal state of any law."""
    return RATES[type(law).__name__](law, v, np.atleast_1d(np.asarray(z, dtype=float)))


# ---- Closed forms.


def steady_state_force(law: Any, v: float) -> float:
    """Force [N] once the deflection has settled at the constant velocity v != 0."""
    name = type(law).__name__
    if name in ("LuGre", "Elastoplastic"):
        return math.copysign(stribeck_curve(law, v), v) + law.sigma_2 * v
    if name == "Stribeck":
        return math.copysign(stribeck_curve(law, v, law.exponent), v) + law.sigma_2 * v
    if name == "ResetIntegrator":
        return math.copysign(law.sigma_0 * law.breakaway_deflection, v)
    if name == "MaxwellSlip":
        rise = (law.stiction_ratio - 1) * math.exp(-((v / law.stribeck_velocity) ** 2))
        return math.copysign(sum(law.strength) * (1 + rise), v) + law.sigma_2 * v
    return math.copysign(law.coulomb_force, v) + getattr(law, "sigma_2", 0.0) * v


def presliding_stiffness(law: Any) -> float:
    """dF/dx [N/m] of a relaxed contact, moved slowly."""
    name = type(law).__name__
    if name == "MaxwellSlip":
        return sum(law.stiffness)
    if name == "ResetIntegrator":
        return (1 + law.stiction_excess) * law.sigma_0
    return law.sigma_0


def largest_deflection(law: Any) -> Array:
    """Bound of |z| [m], per element."""
    name = type(law).__name__
    if name == "MaxwellSlip":
        return law.stiction_ratio * np.array(law.strength) / np.array(law.stiffness)
    if name == "ResetIntegrator":
        return np.array([law.breakaway_deflection])
    return np.array([getattr(law, "stiction_force", law.coulomb_force) / law.sigma_0])


def largest_force_at_rest(law: Any) -> float:
    """Breakaway force [N] of a static law."""
    return getattr(law, "stiction_force", law.coulomb_force)


# ---- Trajectories under a velocity that is constant by pieces.


def deflections(law: Any, v: Array, dt: Array) -> Array:
    """State at the end of each piece, from z = 0; shape (pieces, elements)."""
    name = type(law).__name__
    if name == "ResetIntegrator":
        return _clipped(v * dt, np.array([law.breakaway_deflection]))
    if name == "MaxwellSlip":
        return _maxwell(law, v, dt)
    one_piece = {"Dahl": _dahl_piece, "LuGre": _lugre_piece, "Elastoplastic": _integrated_piece}[name]
    z, out = 0.0, []
    for velocity, duration in zip(v, dt, strict=True):
        z = one_piece(law, velocity, duration, z)
        out.append([z])
    return np.array(out)


def _dahl_piece(p: Any, v: float, dt: float, z: float) -> float:
    """dF/dx integrated: s = 1 - F sgn(v)/F_C decays over the path, and ends at 0 where alpha < 1."""
    s, path = 1 - p.sigma_0 * z / p.coulomb_force * np.sign(v), p.sigma_0 * abs(v) * dt / p.coulomb_force
    if p.exponent == 1:
        s *= math.exp(-path)
    else:
        power = 1 - p.exponent
        s = max(s**power - power * path, 0.0) ** (1 / power)
    return np.sign(v) * (1 - s) * p.coulomb_force / p.sigma_0


def _lugre_piece(p: Any, v: float, dt: float, z: float) -> float:
    """Exponential approach to the steady deflection."""
    z_ss = stribeck_curve(p, v) / p.sigma_0 * np.sign(v)
    return z_ss + (z - z_ss) * math.exp(-v * dt / z_ss)


def _integrated_piece(law: Any, v: float, dt: float, z: float) -> float:
    piece = solve_ivp(lambda _, y: rate(law, v, y)[1], (0, dt), [z], method="LSODA", rtol=1e-9, atol=1e-17)
    return piece.y[0, -1]


def _clipped(dx: Array, end: Array) -> Array:
    z, out = np.zeros(end.shape), []
    for step in dx:
        z = np.clip(z + step, -end, end)
        out.append(z)
    return np.array(out)


def _maxwell(p: Any, v: Array, dt: Array) -> Array:
    """The paper's element with its flag: at its strength it slides until the velocity changes sign."""
    k, W = np.array(p.stiffness), np.array(p.strength)
    F, slides, before = np.zeros(k.shape), np.zeros(k.shape, dtype=bool), 0.0
    out = []
    for velocity, duration in zip(v, dt, strict=True):
        if velocity * before < 0:
            slides[:] = False
        before = velocity
        h = 1 + (p.stiction_ratio - 1) * math.exp(-((velocity / p.stribeck_velocity) ** 2))
        end = W * h * np.sign(velocity)
        for i in range(k.size):
            left = duration
            if not slides[i]:
                until = max((end[i] - F[i]) / (k[i] * velocity), 0.0)
                if until >= left:
                    F[i] += k[i] * velocity * left
                    continue
                F[i] = max(F[i], end[i]) if velocity > 0 else min(F[i], end[i])
                slides[i] = True
                left -= until
            F[i] = end[i] + (F[i] - end[i]) * math.exp(-p.attraction_rate / h * left)
        out.append(F / k)
    return np.array(out)


def walk_lugre(model: Any, volts: float, frequency: float, periods: int, times: Array) -> Array:
    """End-effector's position [m] of an actuator with LuGre friction under a sawtooth, its load below
    breakaway: five equations, LSODA from jump to jump, from the rest in which the bristle holds."""
    law, k = model.friction, model.natural_frequency**2
    force = model.axial_force
    y = -(-force / model.stage_mass / k if model.stage_reaction else 0.0)
    state, found = np.array([y, 0.0, y, 0.0, -force / law.sigma_0]), np.full(times.size, np.nan)

    def slope(t: float, q: Array, begin: float) -> list[float]:
        f, dz = lugre(law, q[1] - q[3], q[4:])
        u = volts * frequency * (t - begin)
        stage = model.gain * k * u - 2.0 * model.damping_ratio * model.natural_frequency * q[1] - k * q[0]
        stage -= f / model.stage_mass if model.stage_reaction else 0.0
        return [q[1], stage, q[3], (f + force) / model.end_effector_mass, dz[0]]

    for period in range(periods):
        begin, end = period / frequency, (period + 1) / frequency
        inside = (times >= begin) & (times < end)
        done = solve_ivp(
            slope,
            (begin, end),
            state,
            method="LSODA",
            t_eval=[*times[inside], end],
            args=(begin,),
            rtol=1e-10,
            atol=[1e-15, 1e-12, 1e-15, 1e-12, 1e-16],
            max_step=0.05 / frequency,
        )
        found[inside], state = done.y[2, :-1], done.y[:, -1]
    return found


# ---- A piezo


def prandtl_ishlinskii(p: Any, drive: Array, rest: float) -> Array:
    """Play operators by their definition, sample by sample, and dead zones beside them; what the plays see is
    drawn by its corners."""
    ends = [-1e4, *p.dead_zones, 1e4]
    steep = np.cumsum([1.0, *(p.skews or [0.0] * len(p.dead_zones))])
    seen = np.cumsum([0.0, *(steep * np.diff(ends))])
    seen = seen - np.interp(0.0, ends, seen)
    before = np.interp(rest, ends, seen)
    z = [np.sign(before) * max(abs(before) - r, 0.0) for r in p.thresholds]
    found = []
    for u in drive:
        v = float(np.interp(u, ends, seen))
        z = [max(v - r, min(v + r, before)) for r, before in zip(p.thresholds, z, strict=True)]
        plays = sum(w * state for w, state in zip(p.weights, z, strict=True))
        zones = sum(c * max(u - s, 0.0) for s, c in zip(p.dead_zones, p.slopes, strict=True))
        found.append(plays + zones)
    return np.array(found)


def duhem(slope: Callable[[float, float, float], float], drive: Array, rest: float) -> Array:
    """u - h of dh/du = slope(u, h, direction), in steps of at most 10 mV of the drive, by Heun's method."""
    h, u, found = 0.0, 0.0, []
    for goal in (rest, *drive):
        count = max(1, int(np.ceil(abs(goal - u) / 1e-2)))
        du = (goal - u) / count
        for k in range(count):
            first = du * slope(u + k * du, h, np.sign(du))
            h += 0.5 * (first + du * slope(u + (k + 1) * du, h + first, np.sign(du)))
        u = goal
        found.append(u - h)
    return np.array(found[1:])


def bouc_wen(p: Any, drive: Array, rest: float) -> Array:
    """As `duhem`, by the differential equation."""
    return duhem(lambda u, h, up: p.alpha - p.beta * up * h - p.gamma * abs(h), drive, rest)


def lagged(value: Callable[[Array], Array], tau: float, x: float, times: Array) -> Array:
    """First-order lag of a function of time [s], from x on: the integral of exp((s - t)/tau) value(s)/tau, by
    Gauss's formula of sixth order over steps of at most tau/10. The function is smooth between the times."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    found = [x]
    for begin, end in itertools.pairwise(times):
        ends = np.linspace(begin, end, 1 + max(1, math.ceil((end - begin) / (0.1 * tau))))
        step = ends[1] - begin
        late = 0.5 * step * (1.0 - nodes)
        inputs = value(ends[1:, None] - late)
        for u in inputs:
            x = x * math.exp(-step / tau) + 0.5 * step / tau * float(weights * u @ np.exp(-late / tau))
        found.append(x)
    return np.array(found)


def maxwell_capacitor_voltage(p: Any, charge: Array, stroke_voltage: Array) -> Array:
    """Voltage at the terminals for charges from 0 on: each element a spring in q that slips; `stroke_voltage`
    is T y/C_0 [V]."""
    voltages, before, found = np.zeros(len(p.stiffnesses)), 0.0, []
    for q, y in zip(charge, stroke_voltage, strict=True):
        voltages = np.clip(
            voltages + np.array(p.stiffnesses) * (q - before), -np.array(p.breakaways), p.breakaways
        )
        before = q
        found.append(voltages.sum() + q / p.capacitance - y)
    return np.array(found)
