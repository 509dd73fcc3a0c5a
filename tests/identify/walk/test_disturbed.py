"""Faults of instruments in recordings of walks: said where they move the values, allowed for where noise."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss


@pytest.mark.parametrize("fault", ["fringe", "frozen"])
def test_a_position_that_jumps_or_freezes_says_so(fault: str) -> None:
    """An eighth of a wavelength is lost in the third period; or 20 ms have no new sample."""
    truth = ss.load_actuator("kang2007").replace(stage_reaction=False)
    drive = ss.Sawtooth(65.0, 20.0, periods=6)
    walk = ss.simulate(truth, drive, sample_rate=2e3, tolerance=1e-10)
    x = walk["end_effector_position"].values + 10e-9 * np.random.default_rng(11).standard_normal(601)
    if fault == "fringe":
        x[261:] += 79.1e-9
    else:
        x[250:290] = x[250]
    walk["end_effector_position"] = ("time", x, {"units": "m"})
    fit = ss.identify_friction([walk], truth, ["sigma_0", "coulomb_force"], drive=drive, hops=0, channel=())
    said = [
        one
        for one in fit.failures
        if ("jumps by" if fault == "fringe" else "freezes at 0.125 s for 20 ms") in one
    ]
    assert len(said) == 1
    assert "the intervals are not to be trusted" in said[0]
    if fault == "fringe":
        (jump,) = fit.disturbances
        assert jump.when == pytest.approx(0.1305)
        assert jump.size == pytest.approx(79.1e-9, abs=5e-9)
    assert said[0] in fit.report()


def test_jitter_of_the_clock_is_allowed_for() -> None:
    """A fifth of a sampling interval, at random: the samples are those of other instants."""
    truth = ss.load_actuator("kang2007").replace(stage_reaction=False)
    drive = ss.Sawtooth(65.0, 20.0, periods=6)
    fine = ss.simulate(truth, drive, sample_rate=100e3, tolerance=1e-10)
    random, t = np.random.default_rng(3), np.arange(0.0, drive.duration, 2e-4)
    late = np.clip(t + 0.2 * 2e-4 * random.standard_normal(t.size), 0.0, None)
    x = np.interp(late, fine["time"].values, fine["end_effector_position"].values)
    x += 10e-9 * random.standard_normal(t.size)
    volts = np.interp(t, fine["time"].values, fine["drive_voltage"].values)
    walk = ss.make_recording(t, {"end_effector_position": (x, "m"), "drive_voltage": (volts, "V")})
    fit = ss.identify_friction([walk], truth, ["sigma_0", "coulomb_force"], drive=drive, hops=0, channel=())
    assert fit.failures == ()
    (jitter,) = fit.disturbances
    assert jitter.kind == "jitter"
    assert jitter.size == pytest.approx(0.2 * 2e-4, rel=0.2)
    for name, (low, high) in fit.confidence_intervals(0.999).items():
        assert low < getattr(truth.friction, name) < high, name
