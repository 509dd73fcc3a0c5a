"""Offset and delay of the position channel: free where the recordings show them, and said."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
FREE = ["sigma_0", "sigma_1", "coulomb_force"]
NOISE = 60e-9


def walk(rest: float, offset: float = 0.0, late: int = 0, seed: int = 0):
    """At 1 kHz, behind the drive by so many samples; the drive, and what the channel shows."""
    drive = ss.Sawtooth(65.0, 5.0, periods=6)
    if rest:
        drive = ss.waveform.Sequence(ss.waveform.Rest(rest), drive)
    shown = ss.simulate(KANG, drive, rest + 1.15, sample_rate=1e3, tolerance=1e-10)
    x = shown["end_effector_position"].values
    x = np.concatenate([np.full(late, x[0]), x[: x.size - late]])
    x = x + offset + NOISE * np.random.default_rng(seed).standard_normal(x.size)
    return drive, ss.make_recording(shown["time"].values, {"end_effector_position": x}, title="walk")


@pytest.mark.parametrize("rest", [0.1, 0.0], ids=["at rest first", "moving from the first sample on"])
def test_an_offset_is_found_without_being_asked_for(rest: float) -> None:
    """It used to be the friction's: r^2 far below zero, "converged"."""
    drive, recording = walk(rest, offset=5e-5)
    fit = ss.identify_friction(recording, KANG, FREE, drive=drive)
    assert fit.r_squared > 0.9998
    assert fit.values["offset"] == pytest.approx(5e-5, abs=4 * fit.standard_errors["offset"])
    low, high = fit.confidence_intervals(0.999)["coulomb_force"]
    assert low < KANG.friction.coulomb_force < high
    (said,) = fit.remarks
    assert "offset" in said
    assert "free too" in said
    assert said in fit.report()
    assert not fit.failures
    assert ss.verify(fit, recording, drive=drive).r_squared > 0.9998


def test_a_delay_is_found_without_being_asked_for_beside_an_offset() -> None:
    drive, recording = walk(0.1, 1e-6, late=2)
    fit = ss.identify_friction(recording, KANG, FREE, drive=drive)
    assert fit.values["delay"] == pytest.approx(2e-3, abs=4 * fit.standard_errors["delay"])
    assert fit.r_squared > 0.9998
    assert any("delay" in said for said in fit.remarks)


def test_none_is_free_where_the_user_says_so() -> None:
    drive, recording = walk(0.1, offset=5e-5)
    fit = ss.identify_friction(
        recording, KANG, FREE, drive=drive, channel=(), max_evaluations=20, hops=0, diagnose=False
    )
    assert set(fit.values) == set(FREE)
    assert fit.failures


@pytest.mark.parametrize(
    ("seed", "times"),
    [(0, (30.0, 30.0, 0.3)), (4, (1.0, 0.01, 0.3))],
)
def test_from_afar_with_an_offset_the_same_answer(seed: int, times: tuple[float, ...]) -> None:
    """The search without the offset ended anywhere, and the one with it began there: from two of these starts
    at 0.3 times the stiffness, called determined. In the last walk a minimum beside fits as well."""
    law, drive = (4.26e6, 59.5, 1.294), ss.Sawtooth(52.3, 5.0, periods=5)
    truth = KANG.replace(gain=70.8e-9, friction=ss.LuGre(law[0], law[1], 0.0, law[2], law[2]))
    at = np.arange(1050) * 1e-3
    walk = ss.simulate(truth, drive, times=at, tolerance=1e-10)["end_effector_position"].values
    shown = walk - 0.8e-6 + NOISE * np.random.default_rng(seed).standard_normal(at.size)
    recording = ss.make_recording(at, {"end_effector_position": shown}, title="walk")
    away = [x * y for x, y in zip((1.4e6, 34.9, 0.54), times, strict=True)]
    start = truth.replace(friction=ss.LuGre(away[0], away[1], 0.0, away[2], away[2]))
    fit = ss.identify_friction(recording, start, FREE, drive=drive)
    for name, value in zip(FREE, law, strict=True):
        low, high = fit.confidence_intervals(0.999)[name]
        assert low < value < high, name
