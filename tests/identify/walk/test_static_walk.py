"""Pohl's static model: the slow part of every drive, and its fit in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.identify.walk.static import identify_static_walk, slow_part
from stickslip.physics.actuator import load_actuator
from stickslip.recording import make_recording
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest
from stickslip.waveform.slewed import Slewed

FORTH = Sawtooth(60.0, 5.0, periods=3)
BACK = ReverseSawtooth(60.0, 5.0, periods=3)


def slow(drive, times):
    return slow_part(drive.drive(2.0), 2.0)(np.asarray(times, dtype=float))


@pytest.mark.parametrize("rate", [None, 286e3])
def test_each_slow_stroke_carries_by_the_voltage_and_no_jump_does(rate: float | None) -> None:
    walk = Sequence((FORTH, 0.6), (Rest(0.2), 0.2), (BACK, 0.6))
    drive = Slewed(walk, rate) if rate else walk
    # Half a stroke, then whole ones; at rest nothing; back by as much.
    times = [-1.0, 0.1, 0.2 - 1e-9, 0.6 - 1e-9, 0.7, 0.9, 1.399, 1.9]
    expected = [0.0, 30.0, 60.0, 180.0, 180.0, 150.0, 0.3, 0.0]
    late = 0.12 if rate else 1e-6  # V: what a flank of 0.2 ms takes of a stroke
    np.testing.assert_allclose(slow(drive, times), expected, atol=3.0 * late)


def test_its_fit_is_that_of_a_line_over_the_slow_part() -> None:
    time = np.arange(0.0, 0.7, 1e-3)
    noise = 20e-9 * np.random.default_rng(0).standard_normal(time.size)
    x = 0.05e-6 * slow(FORTH, time - 2e-3) + 1e-7 + noise
    recording = make_recording(time, {"end_effector_position": x, "drive_voltage": FORTH.value(time)})
    fit = identify_static_walk(recording, load_actuator("kang2007"), drive=FORTH)
    basis = np.column_stack([slow(FORTH, time - fit.values["delay"]), np.ones(time.size)])
    gain, offset = np.linalg.lstsq(basis, x, rcond=None)[0]
    assert fit.values["gain"] == pytest.approx(gain, rel=1e-6)
    assert fit.values["offset"] == pytest.approx(offset, rel=1e-3)
    assert fit.values["gain"] == pytest.approx(0.05e-6, abs=3.5 * fit.standard_errors["gain"])
    assert fit.values["delay"] == pytest.approx(2e-3, abs=3.5 * fit.standard_errors["delay"])
    assert fit.predict is not None
    assert np.std(fit.predict(recording, FORTH) - x) == pytest.approx(20e-9, rel=0.1)
