"""Samples at a jump of drive or load: all of them after it, for every law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from friction.samples import ALL, BRISTLE, STATIC, name
from stickslip.friction import StictionCoulombViscous

KANG = ss.load_actuator("kang2007")
every_law = pytest.mark.parametrize("law", ALL, ids=name)
each_seed = pytest.mark.parametrize("seed", [1])
SOON = 1e-11  # s
# Periods within a fiftieth of the tolerance of 1 nm are copies: of the force of the stiffest bristles, N.
COPIED = 0.02e-9 * 1.6e6
DAMPED = ("sigma_1", "sigma_2")


def around(jumps: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([[0.0], jumps - SOON, jumps, jumps + SOON]))


def largest(law: Any) -> float:
    """Force of a static law that begins to slide, N."""
    falls_at_once = isinstance(law, StictionCoulombViscous)
    return law.coulomb_force if falls_at_once else getattr(law, "stiction_force", law.coulomb_force)


def split(found: Any, channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Before, at and after each jump."""
    return tuple(found[channel].values[1:].reshape(-1, 3).T)


@every_law
@each_seed
def test_a_sample_at_a_jump_of_the_drive_is_after_it(law: Any, seed: int) -> None:
    """Of the copies of a period too: at exact times of samples, 0.2 s apart, it was up to 7 times the
    stiction."""
    volts, frequency = np.random.default_rng(seed).uniform([40.0, 4.0], [90.0, 60.0])
    jumps = np.arange(1, 9) / frequency
    model, saw = KANG.replace(friction=law), ss.Sawtooth(volts, frequency)
    found = ss.simulate(model, saw, times=around(jumps), tolerance=1e-9)
    before, now, after = split(found, "friction_force")
    np.testing.assert_allclose(now, after, rtol=1e-3, atol=COPIED)
    if law in STATIC:
        np.testing.assert_allclose(now, -largest(law), rtol=1e-5)  # it lets go
    else:
        np.testing.assert_allclose(now, before, rtol=1e-3, atol=COPIED)
    np.testing.assert_allclose(split(found, "drive_voltage")[1], 0.0, atol=1e-9)


@every_law
@each_seed
def test_a_sample_at_a_jump_of_the_load_is_after_it(law: Any, seed: int) -> None:
    """Newly pressed contact carries no force: what is elastic in it goes on; what is viscous, or the law of
    one that slides, is of the new load at once. A load that falls takes its part of the force with it."""
    rng = np.random.default_rng(seed)
    period = 0.02
    jumps = period * (np.arange(4) + rng.uniform(0.05, 0.2, 4))
    loads = np.array([1.0, 1.7, 0.8, 2.0, 0.6]) * rng.uniform(0.9, 1.1)
    load = ss.Sampled(np.append(0.0, jumps), loads, "hold")
    model = KANG.replace(friction=law)
    found = ss.simulate(
        model, ss.Sawtooth(65.0, 1.0 / period), times=around(jumps), load=load, tolerance=1e-8
    )
    before, now, after = split(found, "friction_force")
    np.testing.assert_allclose(now, after, rtol=1e-3, atol=1e-6)
    if law in BRISTLE:
        for channel in (c for c in found if str(c).startswith("bristle")):
            earlier, here, later = split(found, str(channel))
            np.testing.assert_allclose(here, later, rtol=1e-4, atol=1e-12)
            share = np.minimum(loads[:-1] / loads[1:], 1.0)
            np.testing.assert_allclose(here, earlier * share, rtol=1e-4, atol=1e-12)
        if not any(getattr(law, field, 0.0) for field in DAMPED):
            share = np.minimum(loads[1:] / loads[:-1], 1.0)
            np.testing.assert_allclose(now, before * share, rtol=1e-4, atol=1e-6)
