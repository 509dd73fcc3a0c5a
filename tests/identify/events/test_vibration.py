"""The ring after slips: found where there is one, and nothing said where the motion is another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.identify.events.drawn import drawn_walk

import stickslip as ss
from stickslip.identify.events.sawtooth import sawtooth_features


@pytest.mark.parametrize(("fewest", "most"), [(4, 6), (30, 60)])
def test_slow_and_fast_rings(fewest: int, most: int) -> None:
    """Of a ring of 4 to 8 cycles in a period, frequency, amplitude or decay were mostly off."""
    random = np.random.default_rng(fewest)
    for seed in range(2):
        cycles, damping = random.uniform(fewest, most), random.uniform(0.04, 0.2)
        frequency = cycles / 0.02
        decay = damping * 2.0 * math.pi * frequency
        recording = drawn_walk(25, seed, noise=1e-8, ring=(3e-7, frequency, decay), samples=1000)
        found = sawtooth_features(recording).attrs
        assert found["vibration_frequency"] == pytest.approx(frequency, rel=0.02)
        assert found["vibration_decay"] == pytest.approx(decay, rel=0.15)
        start = 24 / 25 * 3e-7 * math.exp(-decay * found["vibration_start"])
        assert found["vibration_amplitude"] == pytest.approx(start, rel=0.1)


@pytest.mark.parametrize("drive_frequency", [50])
def test_a_slide_is_no_ring(drive_frequency: int) -> None:
    """A heavy slider slides on after the jump of the drive, which was taken for a ring of 56 Hz."""
    model = ss.load_actuator("kang2007").replace(
        natural_frequency=2.0 * math.pi * 525.7,
        damping_ratio=0.05,
        stage_reaction=False,
        end_effector_mass=0.1,
    )
    drive = ss.Sawtooth(65.0, drive_frequency, periods=20)
    made = ss.simulate(model, drive, 20.9 / drive_frequency, sample_rate=1000.0 * drive_frequency)
    found = sawtooth_features(made).attrs
    assert found["vibration_frequency"] == pytest.approx(525.7, rel=0.02)
    # While it slides the ring does not decay by its damping.
    assert math.isnan(found["vibration_decay"])


@pytest.mark.parametrize("cycles", [1.5, 2.5])
def test_fewer_than_three_cycles_are_none(cycles: float) -> None:
    recording = drawn_walk(25, 0, noise=1e-8, ring=(3e-7, cycles / 0.02, 20.0), samples=500)
    found = sawtooth_features(recording).attrs
    assert all(math.isnan(found[name]) for name in found if name.startswith("vibration"))


def test_noise_is_no_ring_however_coarse() -> None:
    """At 200 samples a period the search began outside its bounds where noise was strongest at the end."""
    for samples in (40, 200):
        for seed in range(2):
            found = sawtooth_features(drawn_walk(8, seed, noise=5e-8, samples=samples)).attrs
            assert math.isnan(found["vibration_frequency"])
