"""Recordings drawn at random: walks whose steps scatter and ring, and a slider whose stiction scatters."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from stickslip.identify.events.pulled import PulledRig
from stickslip.recording import make_recording


def drawn_walk(
    slips: int,
    seed: int,
    *,
    noise: float = 0.0,
    scatter: float = 0.0,
    ring: tuple[float, float, float] = (0.0, 1.0, 1.0),
    samples: int = 200,
) -> xr.Dataset:
    """Steps of 5 um, with scatter (of itself) and a slip back by 1 um, every 20 ms; noise [m]; after each
    slip but the first a ring: amplitude [m], frequency [Hz], decay [1/s]."""
    random = np.random.default_rng(seed)
    period, back = 0.02, 1e-6
    steps = 5e-6 * (1.0 + scatter * random.standard_normal(slips))
    time = np.arange(-0.6, slips + 1.2, 1.0 / samples) * period
    number = np.floor(time / period + 1e-9).astype(int)
    since = time - number * period
    walking = (number >= 0) & (number < slips)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.clip(number, 0, slips)
    rise = np.append(steps, 0.0)[at] + back
    position = reached[at] + np.where(walking, rise * since / period, 0.0)
    amplitude, frequency, decay = ring
    swing = amplitude * np.exp(-decay * since) * np.cos(2.0 * math.pi * frequency * since)
    position += np.where(walking & (number > 0), swing, 0.0)
    position += noise * random.standard_normal(time.size)
    drive = np.where(walking, 60.0 * since / period, 0.0)
    return make_recording(time - time[0], {"end_effector_position": position, "drive_voltage": drive})


def drawn_slider(
    rig: PulledRig, static: float, dynamic: float, events: int, seed: int, *, scatter: float, noise: float
) -> xr.Dataset:
    """The force over the weight where each event's static coefficient is drawn anew, with scatter (of
    itself), by the closed form of rest and slip: half an ellipse about dynamic friction; white noise."""
    random = np.random.default_rng(seed)
    w = rig.natural_frequency
    interval = math.pi / w / 40.0
    times, forces, force, time = [np.zeros(1)], [np.full(1, dynamic)], dynamic, 0.0
    for top in static * (1.0 + scatter * random.standard_normal(events)):
        time += (top - force) / rig.loading_rate
        # From rest, relative to a slider that goes with the spring: F - dynamic = A cos(w t) + B sin(w t).
        a, b = top - dynamic, rig.loading_rate / w
        slip = 2.0 / w * (math.pi - math.atan2(a, b))
        since = np.linspace(0.0, slip, 200)
        swing = dynamic + a * np.cos(w * since) + b * np.sin(w * since)
        times.append(time + since)
        forces.append(swing)
        time, force = time + slip, float(swing[-1])
    at = np.arange(0.0, time, interval)
    ratio = np.interp(at, np.concatenate(times), np.concatenate(forces))
    return make_recording(at, {"force_ratio": (ratio + noise * random.standard_normal(at.size), "")})
