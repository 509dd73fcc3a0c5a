"""Loops of other models than the one that is fitted: Bouc-Wen by Runge-Kutta steps, Preisach relays."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import signal

import stickslip as ss

Array = NDArray[np.float64]

RATE, STROKE, HIGH = 200.0, 39e-6, 150.0


def sine(seconds: float, middle: float = 0.0, phase: float = 0.0, begin: float = 0.0) -> Array:
    """A sine of 1 Hz and `HIGH`, V, from the time `begin` [s] on."""
    time = begin + np.arange(round(RATE * seconds)) / RATE
    return middle + HIGH * np.sin(2.0 * np.pi * time + phase)


def bouc_wen(drive: Array, alpha: float = 0.4, beta: float = 0.012, gamma: float = 0.004) -> Array:
    """u - h, V, from rest at 0 V, in a hundred steps of Heun's method a sample."""
    h, before, found = 0.0, 0.0, []
    for u in drive:
        step, up = (u - before) / 100.0, np.sign(u - before)
        for _ in range(100):
            first = alpha - beta * up * h - gamma * abs(h)
            there = h + step * first
            h += 0.5 * step * (first + alpha - beta * up * there - gamma * abs(there))
        before = u
        found.append(u - h)
    return np.array(found)


def preisach(drive: Array, lean: float, lag: float = 0.0) -> Array:
    """Relays on a triangle of thresholds, more of them by `lean` at high voltages, from the state without
    history; then a first-order lag [s]."""
    at = (np.arange(80) + 0.5) / 40.0 - 1.0
    up, down = (x[np.greater_equal.outer(at, at)] for x in np.meshgrid(at, at, indexing="ij"))
    weight = np.exp(-(up - down) / 0.3) * (1.0 + 0.5 * lean * (up + down))
    weight *= 0.4 / weight.sum()
    state, found = np.where(up + down > 0.0, -1.0, 1.0), []
    for u in drive / (1.1 * HIGH):
        state[u >= up], state[u <= down] = 1.0, -1.0
        found.append(u + weight @ state)
    made = np.array(found)
    if lag:
        b, a, _ = signal.cont2discrete(([1.0], [lag, 1.0]), 1.0 / RATE, "foh")
        made = signal.lfilter(np.ravel(b), a, made - made[0]) + made[0]
    return made


def record(drive: Array, shape: Array, seed: int = 0) -> xr.Dataset:
    """A recording of a stroke of `STROKE`, with noise of 0.05 % of it, its zero anywhere."""
    noise = 5e-4 * STROKE * np.random.default_rng(seed).standard_normal(shape.size)
    position = STROKE * (shape - shape[0]) / np.ptp(shape) + noise - 7e-6
    time = np.arange(drive.size) / RATE
    return ss.make_recording(time, {"drive_voltage": (drive, "V"), "stage_position": (position, "m")})
