"""Friction loops of Maxwell slip in plain NumPy, independent of the package: each element a stop operator."""

from __future__ import annotations

import numpy as np
import xarray as xr

from stickslip.recording import make_recording
from stickslip.recording.datasets import dataset_path


def stops(stiffness, strength, position, ratio, start):
    """Force [N] at each sample; `start`: deflection of all elements at the first one, cut at their bound."""
    k, limit = np.asarray(stiffness), np.asarray(strength) / np.asarray(stiffness)
    z = np.clip(start, -limit, limit)
    force = [k @ z]
    for step in np.diff(position):
        z = np.clip(z + step, -limit, limit)
        force.append(k @ z)
    return np.array(force) * ratio


def made_loops(
    stiffness, strength, *, seed=0, noise=0.0, bias=0.0, curvature=0.0, drift=0.0, begin=0.0,
    asymmetry=0.0, contact_offset=0.0, load_exponent=1.0,
):  # fmt: skip
    """A recording of loops over a few amplitudes, under a normal force that varies about 5 N; the contact
    follows the motion at 40 times the rate of the samples."""
    rng = np.random.default_rng(seed)
    fine = begin + np.linspace(0.0, 3.0, 9601)
    x = 1e-4 * np.sin(2 * np.pi * fine) * (1.0 - 0.2 * np.sin(2.0 * fine))
    force = stops(stiffness, strength, x, 1.0, 0.0)[::40]
    t, x = fine[::40], x[::40]
    normal = 5.0 + 0.5 * np.sin(3.0 * t)
    load = (normal / 5.0) ** load_exponent * (1.0 + drift * (t - begin))
    uneven = contact_offset + asymmetry * np.abs(force) + curvature * force**2
    shown = bias + load * (force + uneven) + noise * rng.standard_normal(t.size)
    channels = {"position": x, "normal_force": normal, "friction_force": shown}
    return make_recording(t, channels, title=f"loops {seed}")


def tribometer(begin: float, end: float) -> xr.Dataset:
    """A part of the measured friction loops, with the sign of the force as its maker says."""
    path = dataset_path("jchristopherson-friction", "test_data_2.txt")
    t, normal, position, force = np.loadtxt(path, skiprows=1, unpack=True)
    part = np.flatnonzero((t > begin) & (t < end))
    channels = {
        "position": (position[part], "mm"),
        "normal_force": (normal[part], "uN"),
        "friction_force": (-force[part], "uN"),
    }
    return make_recording(t[part], channels, title=f"{begin:g} s < t < {end:g} s")
