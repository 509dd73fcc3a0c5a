"""Extreme parameters: a right answer, a refusal or a warning, in a bounded number of steps."""

from __future__ import annotations

import math
import warnings
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

import stickslip as ss

MOST = 300_000  # steps of one run


class Drawn(NamedTuple):
    actuator: ss.Actuator
    waveform: Any
    duration: float
    tolerance: float


def drawn(number: int) -> Drawn:
    """Decades of everything, among them no damping, no drive and next to no friction; the laws take turns."""
    rng = np.random.default_rng([41, number])

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    force = log(1e-4, 50.0) if rng.random() < 0.85 else 1e-12
    stiffness, mass = log(1e3, 1e10), log(1e-6, 10.0)
    damping = 0.0 if rng.random() < 0.5 else 2.0 * math.sqrt(stiffness * mass) * log(1e-3, 1.0)
    laws = (
        ss.Coulomb(force),
        ss.Stribeck(force, 1.3 * force, 1e-3, 0.0),
        ss.Dahl(stiffness, force),
        ss.LuGre(stiffness, damping, 0.0, force, 1.3 * force, log(1e-5, 1e-1)),
        ss.ResetIntegrator(stiffness, force / stiffness, 0.2, damping),
        ss.Elastoplastic(stiffness, damping, 0.0, force, 1.2 * force, 0.5 * force / stiffness, 1e-3),
        ss.MaxwellSlip((stiffness, 0.3 * stiffness), (0.6 * force, 0.4 * force), 0.0, 1.3, 1e-3, 1e3),
    )
    frequency, voltage = log(0.1, 2e5), log(1e-3, 1e3) if rng.random() < 0.9 else 0.0
    actuator = ss.Actuator(
        gain=log(1e-8, 1e-6),
        natural_frequency=2.0 * math.pi * log(10.0, 1e5),
        damping_ratio=0.0 if rng.random() < 0.3 else log(1e-4, 2.0),
        stage_mass=log(1e-6, 10.0),
        end_effector_mass=mass,
        friction=laws[number % len(laws)],
        stage_reaction=bool(rng.random() < 0.5),
    )
    drive = ss.Sawtooth(voltage, frequency, 0.8) if rng.random() < 0.7 else ss.Sine(voltage, frequency)
    return Drawn(actuator, drive, 3.0 / frequency, float(10.0 ** rng.uniform(-14.0, -6.0)))


@cache
def simulated(of: Drawn, tolerance: float) -> tuple[Any, bool]:
    """The trajectory, None where it was refused, and whether a warning or an error said so."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            made = ss.simulate(
                of.actuator,
                of.waveform,
                of.duration,
                sample_rate=20.0 / of.duration,
                tolerance=tolerance,
                max_steps=MOST,
            )
        except (ss.simulation.SimulationError, ss.QuantityError):
            return None, True
    return made, bool(said)


NUMBERS = range(0, 70, 3)  # of the 70 that were tried, with each law


@pytest.mark.parametrize("number", NUMBERS)
def test_right_refused_or_warned_of(number: int) -> None:
    of = drawn(number)
    made, said = simulated(of, of.tolerance)
    if made is None:
        return
    x = made.end_effector_position.values
    assert np.all(np.isfinite(x))
    assert made.attrs["steps"] + made.attrs["rejected_steps"] <= MOST
    if said:
        assert made.attrs["outcome"] != "complete" or not made.attrs["error_estimate"] <= of.tolerance
        return
    finer, unsure = simulated(of, max(0.1 * of.tolerance, 1e-14))
    if not unsure:
        assert np.max(np.abs(x - finer.end_effector_position.values)) < 3.0 * of.tolerance + 1e-14


def test_most_are_right() -> None:
    """That they may be refused or warned of is no way out."""
    assert np.mean([simulated(of, of.tolerance)[1] for of in map(drawn, NUMBERS)]) < 0.15
