"""Drives after a piezo by brute force, for `benchmarks.oracle`: dense samples, joined by lines.

Plays follow their definition, Duhem models are integrated in steps of at most 5 mV, and each lag of creep in
steps of at most a tenth of its time constant. Only the waveform's values are the package's. A
`MaxwellCapacitor` under a voltage feels the stage: all equations are solved in steps of one length.
"""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

import stickslip as ss
from stickslip.physics.piezo import BoucWen, MaxwellCapacitor, PrandtlIshlinskii

from . import oracle

Array = NDArray[np.float64]
PER_PERIOD = 2_000  # samples; twice as many are compared
STEP = 5e-3  # V, of Duhem models


class Lines(NamedTuple):
    """A voltage in lines: from `first` [n] at `start` [n], s, with the slope `slope` [n]."""

    start: Array
    first: Array
    slope: Array

    def rows(self) -> list[tuple[float, float, float, float, float, float]]:
        return [(t, c, s, 0.0, 0.0, 0.0) for t, c, s in zip(*(a.tolist() for a in self), strict=True)]


@njit(cache=True)
def _plays(u, threshold, weight, out):
    z = np.zeros(threshold.size)
    for n in range(u.size):
        out[n] = 0.0
        for k in range(z.size):
            z[k] = max(u[n] - threshold[k], min(u[n] + threshold[k], z[k]))
            out[n] += weight[k] * z[k]


@njit(cache=True)
def _slope(p, u, h, way):
    """Bouc-Wen; with p[3] the loss grows with the square of the voltage."""
    return p[0] - (p[1] * way * (1.0 + p[3] * u * u) + p[2] * math.copysign(1.0, h)) * h


@njit(cache=True)
def _duhem(u, p, out):
    h, at = 0.0, 0.0
    for n in range(u.size):
        count = max(1, math.ceil(abs(u[n] - at) / STEP))
        du = (u[n] - at) / count
        way = 1.0 if du > 0.0 else -1.0
        for k in range(count):
            first = du * _slope(p, at + k * du, h, way)
            h += 0.5 * (first + du * _slope(p, at + (k + 1) * du, h + first, way))
        at = u[n]
        out[n] = at - h


@njit(cache=True)
def _creep(t, h, tau, share, out):
    for i in range(tau.size):
        x = 0.0
        out[0] += share[i] * x
        for n in range(1, t.size):
            length = t[n] - t[n - 1]
            count = max(1, math.ceil(10.0 * length / tau[i]))
            d, rise = length / count, (h[n] - h[n - 1]) / count
            for k in range(count):
                begin, middle = h[n - 1] + k * rise, h[n - 1] + (k + 0.5) * rise
                a = (begin - x) / tau[i]
                b = (middle - x - 0.5 * d * a) / tau[i]
                c = (middle - x - 0.5 * d * b) / tau[i]
                e = (begin + rise - x - d * c) / tau[i]
                x += d / 6.0 * (a + 2.0 * b + 2.0 * c + e)
            out[n] += share[i] * x


def after(piezo: Any, waveform: Any, end: float, samples: int) -> Lines:
    """The drive after a piezo, from 0 V on."""
    table = waveform.drive(end)
    breaks = table.start[table.start < end]
    t = np.unique(np.concatenate([np.linspace(0.0, end, samples + 1), breaks]))
    ends = np.nextafter(t[1:], 0.0)
    given = np.column_stack([waveform.value(t[:-1]), waveform.value(ends)]).ravel()
    times = np.column_stack([t[:-1], t[1:]]).ravel()
    h = given.copy()
    hysteresis = piezo.hysteresis
    if isinstance(hysteresis, PrandtlIshlinskii):
        _plays(given, np.array(hysteresis.thresholds), np.array(hysteresis.weights), h)
    elif hysteresis is not None and not isinstance(hysteresis, MaxwellCapacitor):
        p = (*hysteresis, 0.0) if isinstance(hysteresis, BoucWen) else (*hysteresis[:2], 0.0, hysteresis[2])
        _duhem(given, np.array(p), h)
    made = h.copy()
    if piezo.creep is not None:
        _creep(times, h, np.array(piezo.creep.time_constants), np.array(piezo.creep.shares), made)
    return Lines(t[:-1], made[::2], (made[1::2] - made[::2]) / np.diff(t))


@njit(cache=True)
def _two_port(start, first, slope, body, law, width, share, force, times, steps, out):
    """A stage, LuGre friction and stop operators on e = u + force y, from rest, in steps of one length."""
    q, z, E, before = np.zeros(5), np.zeros(5), np.zeros(width.size), 0.0
    K, at = np.zeros((4, 5)), 0
    out[0] = 0.0
    for n in range(1, times.size):
        h = (times[n] - times[n - 1]) / steps
        for s in range(steps):
            t = times[n - 1] + s * h
            for stage in range(4):
                part = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
                z[:] = q + part * h * K[stage - 1] if stage else q
                tau = t + part * h
                while stage < 3 and at + 1 < start.size and start[at + 1] <= tau:
                    at += 1
                u = first[at] + slope[at] * (tau - start[at])
                e, held = u + force * z[0], 0.0
                for j in range(width.size):
                    held += share[j] * min(max(E[j] + e - before, -width[j]), width[j])
                v = z[1] - z[3]
                g = law[3] + (law[4] - law[3]) * math.exp(-((v / law[5]) ** 2))
                dz = v - law[0] * abs(v) / g * z[4]
                F = law[0] * z[4] + law[1] * dz + law[2] * v
                K[stage, 0], K[stage, 2], K[stage, 4] = z[1], z[3], dz
                K[stage, 1] = body[0] * (u - held) - body[1] * z[1] - body[2] * z[0] - body[3] * F
                K[stage, 3] = body[4] * F
            q += h / 6.0 * (K[0] + 2.0 * K[1] + 2.0 * K[2] + K[3])
            u = first[at] + slope[at] * (t + h - start[at])
            e = u + force * q[0]
            for j in range(width.size):
                E[j] = min(max(E[j] + e - before, -width[j]), width[j])
            before = e
        out[n] = q[2]


def _stops(port: MaxwellCapacitor) -> tuple[Array, Array]:
    """Widths and shares of the stops under a voltage. Between the charges at which two elements slip, the
    charge follows e by the capacitance of the elements that stick, in series with C_0."""
    k, reach = np.array(port.stiffnesses), np.array(port.breakaways) / np.array(port.stiffnesses)
    width, share, e, q = [], [], 0.0, 0.0
    for j in range(k.size):
        sticks = 1.0 / (1.0 / port.capacitance + k[j:].sum())
        slides = 1.0 / (1.0 / port.capacitance + k[j + 1 :].sum())
        e, q = e + (reach[j] - q) / sticks, reach[j]
        width.append(e)
        share.append((slides - sticks) / port.capacitance)
    return np.array(width), np.array(share)


def truth(a: ss.Actuator, waveform: Any, load: Any, times: Array, rate: float) -> oracle.Truth:
    """The trajectory of an actuator with a piezo. The doubt contains by how much twice as many samples move
    the trajectory: corners of the lines may drive a contact that is near breakaway."""
    clock, end, piezo = time.perf_counter(), float(times[-1]), a.piezo
    assert piezo is not None
    port, count = piezo.hysteresis, PER_PERIOD * max(1, round(end * rate / (2.0 * math.pi)))
    if isinstance(port, MaxwellCapacitor) and not port.charge_drive:
        return _two_port_truth(a, waveform, times, clock, count)
    stiffer = 1.0
    if isinstance(port, MaxwellCapacitor):
        stiffer += a.gain**2 * a.stage_mass * a.natural_frequency**2 / port.capacitance
    coarse, found = (
        oracle.truth(a, after(piezo, waveform, end, n), load, times, rate, stiffer=stiffer)
        for n in (count, 2 * count)
    )
    off = float(np.max(np.abs(found.position - coarse.position)))
    doubt = found.doubt + (off if math.isfinite(off) else math.inf)
    return found._replace(doubt=doubt, seconds=time.perf_counter() - clock)


def _two_port_truth(a: ss.Actuator, waveform: Any, times: Array, clock: float, count: int) -> oracle.Truth:
    law: Any = a.friction
    assert a.piezo is not None
    drive = after(a.piezo, waveform, float(times[-1]), count)
    omega, m = a.natural_frequency, a.stage_mass
    reaction = 1.0 / m if a.stage_reaction else 0.0
    body = np.array(
        [a.gain * omega**2, 2 * a.damping_ratio * omega, omega**2, reaction, 1 / a.end_effector_mass]
    )
    k = a.gain * m * omega**2 / a.piezo.hysteresis.capacitance
    fastest = max(omega, math.sqrt(law.sigma_0 * (reaction + body[4])), (law.sigma_1 + law.sigma_2) * body[4])
    fastest = max(fastest, law.sigma_0 * omega * a.gain * 200.0 / law.coulomb_force)
    steps = max(20, math.ceil(20.0 * fastest * (times[1] - times[0])))
    rows: list[Array] = []
    for finer in (1, 2, 4):
        out = np.empty(times.size)
        _two_port(*drive, body, np.array(law[:6]), *_stops(a.piezo.hysteresis), k, times, finer * steps, out)
        rows.append(out)
    doubt = float(np.max(np.abs(rows[2] - rows[1])))
    doubt = doubt if np.all(np.isfinite(rows[2])) else math.inf
    return oracle.Truth(
        rows[2], doubt, math.isfinite(doubt), time.perf_counter() - clock, f"fixed {4 * steps}"
    )
