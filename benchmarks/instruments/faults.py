"""Faults of real instruments, each of a random size, put into a recording of true positions.

A fault has a size in the unit of `Fault.unit`; `recorded` returns the samples that the instrument gives.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .simulator import Motion

# Sizes are drawn between these limits, uniform in the logarithm.
SIZES: dict[str, tuple[float, float, str]] = {
    "none": (1.0, 1.0, ""),
    "hum": (2e-9, 60e-9, "m, amplitude at 50 Hz and its third harmonic"),
    "drift": (5e-9, 100e-9, "m, standard deviation of 1/f noise"),
    "outliers": (50e-9, 5e-6, "m, of one sample in a hundred"),
    "jump": (50e-9, 633e-9, "m, once"),
    "freeze": (3e-3, 40e-3, "s, once"),
    "jitter": (0.02, 0.4, "of a sample, standard deviation"),
    "asymmetry": (0.01, 0.2, "of the Coulomb force, forward against backward"),
    "unevenness": (0.01, 0.2, "of the Coulomb force, along the surface"),
    "missing": (0.005, 0.1, "of all samples"),
    "quantisation": (2e-9, 200e-9, "m, step of the converter"),
    "reaction": (1.0, 1.0, "the friction acts back on the stage"),
    "viscous": (0.5, 20.0, "N s/m, viscous friction that the model leaves out"),
    "stiction": (1.05, 1.5, "stiction over Coulomb force that the model leaves out"),
}
PLANT = ("asymmetry", "unevenness", "reaction", "viscous", "stiction")  # of the actuator, not the instrument

SINGLE = ("outliers", "jump", "freeze", "missing")  # may be in one recording alone


class Recorded(NamedTuple):
    """Samples as an instrument gives them: time [s], position [m] and voltage [V], each shape (n,)."""

    time: np.ndarray
    position: np.ndarray
    voltage: np.ndarray


def recorded(
    motion: Motion,
    length: float,
    interval: float,
    noise: float,
    delay: float,
    fault: tuple[str, float],
    random: np.random.Generator,
) -> Recorded:
    """Return samples over `length` s with white noise [m], a delay of the sensor [s], and one fault."""
    kind, size = fault
    t = np.arange(round(length / interval)) * interval
    taken = t + interval * size * random.standard_normal(t.size) if kind == "jitter" else t
    x = motion.at(np.maximum(taken - delay, 0.0)) + noise * random.standard_normal(t.size)
    u = motion.voltage(t) + 5e-3 * random.standard_normal(t.size)
    made = _FAULTS.get(kind)
    if made is not None:
        x = made(t, x, size, random)
    kept = random.random(t.size) >= size if kind == "missing" else np.full(t.size, True)
    kept[:2] = True
    return Recorded(t[kept], x[kept], u[kept])


def _hum(t: np.ndarray, x: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    first, third = 2 * np.pi * random.random(2)
    w = 2 * np.pi * 50.0
    return x + size * (np.sin(w * t + first) + 0.3 * np.sin(3 * w * t + third))


def _drift(t: np.ndarray, x: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    n = 2 * t.size
    lines = np.fft.rfftfreq(n, 1.0)
    spectrum = random.standard_normal(lines.size) + 1j * random.standard_normal(lines.size)
    spectrum[1:] /= np.sqrt(lines[1:])
    spectrum[0] = 0.0
    drift = np.fft.irfft(spectrum, n)[: t.size]
    return x + size * drift / drift.std()


def _outliers(t: np.ndarray, x: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    return x + np.where(random.random(t.size) < 0.01, size * random.standard_normal(t.size), 0.0)


def _jump(t: np.ndarray, x: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    at = random.uniform(0.1, 0.9) * t[-1]
    return x + np.where(t > at, size * random.choice([-1.0, 1.0]), 0.0)


def _freeze(t: np.ndarray, x: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    at = random.uniform(0.1, 0.9) * t[-1]
    first = int(np.searchsorted(t, at))
    return np.where((t >= at) & (t < at + size), x[first], x)


def _quantised(t: np.ndarray, x: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    return size * np.round(x / size)


_FAULTS: dict[str, Callable[[np.ndarray, np.ndarray, float, np.random.Generator], np.ndarray]] = {
    "hum": _hum,
    "drift": _drift,
    "outliers": _outliers,
    "jump": _jump,
    "freeze": _freeze,
    "quantisation": _quantised,
}
