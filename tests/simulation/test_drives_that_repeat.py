"""Knots and samples with a period, where steady stepping takes the period from them."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.friction import Coulomb
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import simulate, steady_step
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Sawtooth, Sine, Triangle
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence

ACTUATOR = load_actuator("kang2007")


@pytest.mark.parametrize(
    "waveform",
    [
        PeriodicKnots([0, 0.1998], [0, 65], 0.2, periods=4),
        Sampled([0, 0.1998], [0, 65], period=0.2),
    ],
    ids=["counted knots", "sampled"],
)
def test_steady_step_is_that_of_the_same_sawtooth(waveform) -> None:
    same = steady_step(ACTUATOR, Sawtooth(65, 5, rise_fraction=0.999))
    assert abs(same) > 1e-6  # it walks
    assert steady_step(ACTUATOR, waveform) == pytest.approx(same, abs=1e-11)


def test_steady_step_does_not_ask_where_the_period_begins() -> None:
    late = PeriodicKnots([0.05, 0.0503], [65, 0], 0.2, smooth=True)
    early = PeriodicKnots([0, 0.0003], [65, 0], 0.2, smooth=True)
    step = steady_step(ACTUATOR, early)
    assert abs(step) > 1e-6
    assert steady_step(ACTUATOR, late) == pytest.approx(step, abs=1e-9)


def test_samples_without_a_period_have_no_steady_step() -> None:
    with pytest.raises(QuantityError, match="Sampled has no period"):
        steady_step(ACTUATOR, Sampled([0, 1], [0, 65]))


SAW = Sawtooth(20.0, 1000.0, rise_fraction=0.8)


@pytest.mark.parametrize(
    ("drive", "load"),
    [
        (Multisine((5.0, 5.0), (1000.0, 2000.0), offset=20.0), 1.0),
        (SAW, Sine(0.1, 1000.0, offset=1.0, phase=0.3)),
        (SAW, Triangle(0.1, 500.0, offset=1.0)),
        (PeriodicKnots([0, 0.0005], [0, 20], 0.001), Sine(0.1, 2000.0, offset=1.0)),
    ],
    ids=["multisine", "load as fast", "load half as fast", "load of another table"],
)
def test_periods_of_every_drive_and_load_are_copied(drive, load) -> None:
    """So a long run takes no more steps than a short one, and ends where its periods lead."""
    given = {"sample_rate": 1e3, "load": load, "tolerance": 1e-8}
    short, long = (simulate(ACTUATOR, drive, n * 1e-3, **given) for n in (100, 1000))
    assert long.attrs["steps"] <= 5.0 * short.attrs["steps"]
    x = long["end_effector_position"].values
    np.testing.assert_allclose(x[:101], short["end_effector_position"].values, atol=2e-8)
    step = (x[1000] - x[500]) / 500.0
    assert x[1000] - x[900] == pytest.approx(100.0 * step, abs=1e-8)


def test_a_load_that_does_not_repeat_with_the_drive_is_followed() -> None:
    load = Sine(0.1, 707.1, offset=1.0)
    short, long = (simulate(ACTUATOR, SAW, n * 1e-3, load=load, sample_rate=1e3) for n in (20, 80))
    assert long.attrs["steps"] > 5.0 * short.attrs["steps"]


def test_pulses_of_another_width_are_followed_and_not_copied() -> None:
    """Periods that differ in where their segments begin alone; the motion has come to rest before each."""
    period = 0.125

    def pulse(width: float) -> Sampled:
        times = np.array([0.0, 0.125, width, width + 0.125, 1.0])
        return Sampled(period * times, [0.0, 40.0, 40.0, 0.0, 0.0])

    narrow, wide = pulse(0.25), pulse(0.625)
    walk = Sequence(*[(narrow, period)] * 4, *[(wide, period)] * 4)
    stage = ACTUATOR.replace(friction=Coulomb(0.5))
    found = simulate(stage, walk, duration=8 * period, sample_rate=8 / period).stage_position.values
    up = found[4::8] > 0.9 * found.max()  # in the middle of each period
    assert up.tolist() == [False] * 4 + [True] * 4
