"""The problems that every tool solves, in SI, and how far off an answer is. NumPy only: peers import this.

The stage of [kang2007] without reaction of the friction on it, a slider, and LuGre friction between them;
states (y, y', z, x, x'), all zero at t = 0:

    y'' + 2 zeta wn y' + wn^2 y = C wn^2 u(t)        v = y' - x'
    z' = v - sigma_0 |v| z / g(v)                    m x'' = sigma_0 z + sigma_1 z'
    g(v) = F_C + (F_S - F_C) exp(-(v/v_s)^2)         u(t) = 65 V frac(5 Hz t)
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Trajectories of an independent solver at a relative tolerance of 1e-13 (see the README beside them).
REFERENCE = Path(__file__).resolve().parents[1] / ".." / "shared" / "reference"

ZETA, WN, GAIN = 0.524, 3303.1, 0.1057e-6
AMPLITUDE, FREQUENCY, PERIODS = 65.0, 5.0, 8
PERIOD = 1.0 / FREQUENCY
SLOPE = AMPLITUDE * FREQUENCY  # V/s, of the drive within a period
STIFFNESS, DAMPING, DRIVE = WN**2, 2.0 * ZETA * WN, GAIN * WN**2

SAMPLES = 200  # per period: one per ms
TAU = np.linspace(0.0, PERIOD, SAMPLES + 1)  # sample times within a period


class Contact(NamedTuple):
    """A LuGre contact and the mass that it moves; `scale` is the size of the states, for tolerances."""

    sigma_0: float
    sigma_1: float
    coulomb_force: float
    stiction_force: float
    stribeck_velocity: float
    mass: float
    scale: tuple[float, ...]


_COULOMB = 0.5401
PROBLEMS = {
    "P1": Contact(1.399e6, 34.9, _COULOMB, _COULOMB, 1e-3, 0.1, (1e-6, 1e-3, 1e-7, 1e-6, 1e-3)),
    "P2": Contact(1e8, 200.0, _COULOMB, 0.7, 1e-3, 0.1, (1e-6, 1e-3, 1e-9, 1e-6, 1e-3)),
}


def reference(problem: str) -> Array:
    """The end-effector's position at 1601 times, one per ms, m."""
    return np.load(REFERENCE / f"reference_{problem}.npz")["xe"]


def error(problem: str, position: Array) -> dict[str, float]:
    """What a row says of a trajectory: how far it is off at worst, m."""
    expected = reference(problem)
    if position.shape != expected.shape:
        raise ValueError(f"{position.shape} positions instead of {expected.shape}")
    return {"max_error_m": float(np.max(np.abs(position - expected)))}


class Steady(NamedTuple):
    """Steady stepping of P1's contact under another stage and drive: rad/s, V, Hz.

    In the last of `periods` from rest the net step is within 1e-10 m of `step` [m], that of DOP853 at a
    relative tolerance of 1e-11 once it has settled, and so was the one before.
    """

    natural_frequency: float
    amplitude: float
    frequency: float
    periods: int
    step: float


STEADY = {
    "P1 at 5 Hz": Steady(WN, AMPLITUDE, FREQUENCY, 3, 2.6723449218e-6),
    "15 kHz stage at 20 kHz": Steady(2.0 * np.pi * 15e3, AMPLITUDE, 20e3, 7645, -9.5036340795e-7),
}


def step_error(problem: str, step: float) -> dict[str, float]:
    """What a row says of a net step, m."""
    return {"net_step_m": step, "max_error_m": abs(step - STEADY[problem].step)}


MEMBERS = 4096


def parameter_sets(members: int = MEMBERS) -> Array:
    """P3: sigma_0, F_C and mass of P1, each log-uniform within 50 %; [members, 3]."""
    p = PROBLEMS["P1"]
    spread = np.random.default_rng(0).uniform(np.log(0.5), np.log(1.5), size=(members, 3))
    return np.array([p.sigma_0, p.coulomb_force, p.mass]) * np.exp(spread)


NOISE = 20e-9  # m
START = (1e6, 30.0, 1.5)  # of the fit: sigma_0, sigma_1, F_C
TRUE = (1.399e6, 34.9, 0.5401)


def noisy_record() -> Array:
    """P4: P1's positions with Gaussian noise, m."""
    exact = reference("P1")
    return exact + NOISE * np.random.default_rng(0).standard_normal(exact.size)


def random_starts(count: int) -> Array:
    """Starts of the fit, each parameter log-uniform within a factor 30 of the truth; [count, 3]."""
    spread = np.random.default_rng(1).uniform(-np.log(30.0), np.log(30.0), size=(count, 3))
    return np.array(TRUE) * np.exp(spread)
