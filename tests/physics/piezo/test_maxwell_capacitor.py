"""The piezo as a two-port: its stop operators against elements that slip, and what it is made from."""

from __future__ import annotations

import numpy as np
import pytest

import reference
from stickslip.physics.piezo import Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError

PLAYS = PrandtlIshlinskii((0.0, 3.0, 8.0, 15.0), (0.8, 0.08, 0.08, 0.04))


def port(random: np.random.Generator) -> MaxwellCapacitor:
    count = int(random.integers(1, 6))
    charge = np.cumsum(random.uniform(1e-6, 2e-5, count))
    stiffness = random.uniform(1e3, 5e4, count)
    capacitance = float(10 ** random.uniform(-7.0, -5.0))
    return MaxwellCapacitor(capacitance, tuple(stiffness), tuple(charge * stiffness))


def of_plays(plays: PrandtlIshlinskii) -> MaxwellCapacitor:
    return MaxwellCapacitor.of_plays(plays, 1e-6, 1e-7, 1e6)


def stopped(width: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Stop operators, sample by sample, [samples, operators]."""
    state, before, found = np.zeros(width.size), 0.0, []
    for e in samples:
        state, before = np.clip(state + e - before, -width, width), e
        found.append(state)
    return np.array(found)


@pytest.mark.parametrize("seed", range(6))
def test_charge_and_voltage_are_those_of_elements_that_slip(seed: int) -> None:
    """From charges and strokes that wander, the voltage by elements in q; back by the stops in e."""
    random = np.random.default_rng(seed)
    one = port(random)
    reach = 3.0 * one.breakaways[-1] / one.stiffnesses[-1]
    charge = np.cumsum(random.normal(0.0, 0.2 * reach, 300))
    stroke = np.cumsum(random.normal(0.0, 1.0, 300))
    voltage = reference.maxwell_capacitor_voltage(one, charge, stroke)
    width, share = one.stops()
    e = voltage + stroke
    found = one.capacitance * (e - stopped(width, e) @ share)
    np.testing.assert_allclose(found, charge, atol=1e-9 * np.abs(charge).max())


@pytest.mark.parametrize("capacitance", [1e-7, 2e-6, 1e-3])
def test_unloaded_it_follows_the_plays_that_it_is_made_of(capacitance: float) -> None:
    """k y = T (q - T y)/C: the charge goes with the stroke, which the plays give."""
    gain, stiffness = 1e-7, 1e6
    one = MaxwellCapacitor.of_plays(PLAYS, capacitance, gain, stiffness)
    drive = np.interp(
        np.arange(400), np.arange(0, 440, 40), np.array([0, 70, 10, 60, -30, 40, 0, 90, 5, 5, 50])
    )
    stroke = gain * PLAYS.output(drive)
    per_volt = gain * stiffness
    charge = (capacitance * stiffness / per_volt + per_volt) * stroke
    found = reference.maxwell_capacitor_voltage(one, charge, per_volt * stroke / capacitance)
    np.testing.assert_allclose(found, drive, atol=1e-9)


def test_what_cannot_be_is_refused() -> None:
    for made, said in (
        (lambda: MaxwellCapacitor(1e-6, (1e4,), (1.0, 2.0)), "one of each"),
        (lambda: MaxwellCapacitor(1e-6, (), ()), "one of each"),
        (lambda: MaxwellCapacitor(1e-6, (1e4, 1e4), (2.0, 1.0)), "must ascend"),
        (lambda: Piezo(MaxwellCapacitor(1e-6, (1e4,), (1.0,)), Creep((1.0,), (0.01,))), "creep"),
        (lambda: of_plays(PLAYS._replace(weights=(0.8, 0.1, 0.1, 0.1))), "sum to 1"),
        (lambda: of_plays(PLAYS._replace(dead_zones=(1.0,), slopes=(0.1,))), "dead"),
        (lambda: MaxwellCapacitor.of_plays(PLAYS, 1e-6, -1e-7, 1e6), "must be > 0"),
    ):
        with pytest.raises(QuantityError, match=said):
            made()
