"""Trajectories of the actuator by SciPy, one smooth piece after the other: the oracle of the solver.

Stage and end-effector as two masses, in newtons, with the laws of `reference`. Where a law has a corner
(static friction at rest, a bristle at its limit) the pieces end there, by SciPy's own event location.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import reference

Array = NDArray[np.float64]
Drive = Callable[[float], float]
FINE = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-15}

STATIC = ("Coulomb", "CoulombViscous", "StictionCoulombViscous", "Stribeck")
CORNERED = ("ResetIntegrator", "MaxwellSlip")


class Bodies:
    """m y'' = k (C u - y) - c y' - F and m_e x'' = F + F_axial, of an actuator's record."""

    def __init__(self, a: Any) -> None:
        self.m, self.m_e = a.stage_mass, a.end_effector_mass
        self.k = a.stage_mass * a.natural_frequency**2
        self.c = 2 * a.damping_ratio * math.sqrt(self.k * self.m)
        self.stroke, self.reaction = a.gain, 1.0 if a.stage_reaction else 0.0
        self.axial = a.external_force - a.end_effector_mass * 9.80665 * math.sin(a.incline)

    def drive_force(self, u: float, y: float, w: float) -> float:
        """Of piezo and guide on the stage, N."""
        return self.k * (self.stroke * u - y) - self.c * w

    def holding(self, u: float, y: float, w: float) -> float:
        """Contact force [N] with which both accelerate alike."""
        alike = self.drive_force(u, y, w) / self.m - self.axial / self.m_e
        return alike / (1 / self.m_e + self.reaction / self.m)

    def slopes(self, u: float, q: Array, force: float) -> list[float]:
        """Of y, y', x_e, x_e'."""
        y, w, _, s = q[:4]
        stage = (self.drive_force(u, y, w) - self.reaction * force) / self.m
        return [w, stage, s, (force + self.axial) / self.m_e]


def sawtooth(amplitude: float, frequency: float, periods: int) -> list[tuple[float, float, Drive]]:
    """Pieces (start, end, u) of a sawtooth that jumps down at the end of each period."""
    return [
        (k / frequency, (k + 1) / frequency, lambda t, k=k: amplitude * (t * frequency - k))
        for k in range(periods)
    ]


def trajectory(actuator: Any, pieces: list[tuple[float, float, Drive]], times: Array) -> Array:
    """y, y', x_e, x_e' at the times [4, n], from rest at 0 V; the drive is smooth within each piece."""
    bodies, law = Bodies(actuator), actuator.friction
    name = type(law).__name__
    advance = _static if name in STATIC else _cornered if name in CORNERED else _smooth
    q = _loaded(bodies, law)
    found = np.full((4, times.size), np.nan)
    for start, end, u in pieces:
        q = advance(bodies, law, u, start, end, q, times, found)
    return found


def _loaded(bodies: Bodies, law: Any) -> Array:
    """At rest with 0 V: the contact carries the axial force, by equal deflection of its elements."""
    held = -bodies.axial
    q = np.zeros(4)
    q[0] = q[2] = -bodies.reaction * held / bodies.k
    if type(law).__name__ in STATIC:
        return q
    limit = reference.largest_deflection(law)
    stiffness = np.array(getattr(law, "stiffness", [getattr(law, "sigma_0", 0.0)]))

    def deflection(d: float) -> Array:
        return np.clip(d, -limit, limit)

    d = brentq(lambda d: stiffness @ deflection(d) - held, -limit.max(), limit.max(), xtol=1e-20, rtol=1e-14)
    return np.append(q, deflection(d))


def _record(solution: Any, times: Array, found: Array) -> None:
    inside = (times >= solution.t[0]) & (times <= solution.t[-1])
    if inside.any():
        found[:, inside] = solution.sol(times[inside])[:4]


def _smooth(
    bodies: Bodies, law: Any, u: Drive, t: float, end: float, q: Array, times: Array, found: Array
) -> Array:
    def motion(t: float, q: Array) -> Array:
        force, dz = reference.rate(law, q[1] - q[3], q[4:])
        return np.concatenate([bodies.slopes(u(t), q, force), dz])

    piece = solve_ivp(motion, (t, end), q, dense_output=True, **FINE)
    _record(piece, times, found)
    return piece.y[:, -1]


def _cornered(
    bodies: Bodies, law: Any, u: Drive, t: float, end: float, q: Array, times: Array, found: Array
) -> Array:
    """Elements that are elastic until their limit, and there slide until the velocity changes sign."""
    limit = reference.largest_deflection(law)
    if type(law).__name__ == "MaxwellSlip":
        stiffness, damping, viscous = np.array(law.stiffness), 0.0, law.sigma_2
    else:
        stiffness, damping, viscous = np.array([law.sigma_0]), law.sigma_2, 0.0

    def motion(t: float, q: Array, slides: Array) -> Array:
        v = q[1] - q[3]
        dz = np.where(slides, 0.0, v)
        force = (stiffness * q[4:] + damping * dz).sum() + viscous * v
        return np.concatenate([bodies.slopes(u(t), q, force), dz])

    def corners(slides: Array, v: float) -> list[Callable[..., float]]:
        def turns(t: float, q: Array, slides: Array) -> float:
            return q[1] - q[3]

        def reaches(e: int, side: float) -> Callable[..., float]:
            return lambda t, q, slides: side * q[4 + e] - limit[e]

        events: list[Any] = [reaches(e, side) for e in np.flatnonzero(~slides) for side in (1.0, -1.0)]
        for event in events:
            event.terminal, event.direction = True, 1
        if slides.any():
            turns.terminal, turns.direction = True, -math.copysign(1.0, v)
            events.append(turns)
        return events

    slides = np.zeros(limit.size, dtype=bool)
    v = q[1] - q[3]
    slides = (np.abs(q[4:]) >= limit * (1 - 1e-9)) & (q[4:] * v > 0)
    while t < end:
        events = corners(slides, v if v != 0 else q[4:][slides].sum())
        piece = solve_ivp(motion, (t, end), q, events=events, args=(slides,), dense_output=True, **FINE)
        _record(piece, times, found)
        t, q = piece.t[-1], piece.y[:, -1].copy()
        if piece.status == 0:
            break
        v = q[1] - q[3]
        if slides.any() and piece.t_events[-1].size:
            slides = np.zeros_like(slides)
            v = 0.0
        else:
            at = (np.abs(q[4:]) >= limit * (1 - 1e-9)) & (q[4:] * v > 0)
            q[4:][at] = np.copysign(limit[at], q[4:][at])
            slides = slides | at
    return q


def _static(
    bodies: Bodies, law: Any, u: Drive, t: float, end: float, q: Array, times: Array, found: Array
) -> Array:
    """Rest, while the contact can hold, and sliding one way, until the velocity comes back to zero."""
    most = reference.largest_force_at_rest(law)

    def resting(t: float, q: Array) -> list[float]:
        return bodies.slopes(u(t), q, bodies.holding(u(t), q[0], q[1]))

    def breaks_away(t: float, q: Array) -> float:
        return abs(bodies.holding(u(t), q[0], q[1])) - most

    def sliding(t: float, q: Array, way: float) -> list[float]:
        return bodies.slopes(u(t), q, reference.rate(law, q[1] - q[3], np.array([way]))[0])

    def stops(t: float, q: Array, way: float) -> float:
        return way * (q[1] - q[3])

    breaks_away.terminal, breaks_away.direction = True, 1  # type: ignore[attr-defined]
    stops.terminal, stops.direction = True, -1  # type: ignore[attr-defined]
    way = math.copysign(1.0, q[1] - q[3]) if q[1] != q[3] else 0.0
    while t < end:
        if way == 0.0:
            needed = bodies.holding(u(t), q[0], q[1])
            if abs(needed) > most * (1 - 1e-12):
                way = math.copysign(1.0, needed)
        if way == 0.0:
            piece = solve_ivp(resting, (t, end), q, events=breaks_away, dense_output=True, **FINE)
        else:
            piece = solve_ivp(sliding, (t, end), q, events=stops, args=(way,), dense_output=True, **FINE)
        _record(piece, times, found)
        t, q = piece.t[-1], piece.y[:, -1].copy()
        if piece.status == 1 and way != 0.0:
            q[3], way = q[1], 0.0
    return q
