"""When a drive begins, and what an amplifier makes of its jumps."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.identify.recorded.drives import begin_of
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError, make_recording
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Chirp, Rest, Step
from stickslip.waveform.slewed import Slewed

WALK = Sequence(Sawtooth(65.0, 5.0, periods=3), Rest(0.1), ReverseSawtooth(65.0, 5.0, periods=3))


def test_jumps_take_their_time_and_the_rest_stays() -> None:
    rate = 1e5  # 65 V in 0.65 ms
    slewed = Slewed(WALK, rate)
    t = np.linspace(-0.01, 1.5, 40_001)
    u, wanted = slewed.value(t), WALK.value(t)
    assert np.max(np.abs(np.diff(u))) <= rate * np.diff(t)[0] * (1 + 1e-9)
    after_jump = np.zeros(t.size, dtype=bool)
    for jump in (0.2, 0.4, 0.6, 0.7, 0.9, 1.1):
        after_jump |= (t >= jump - 1e-9) & (t < jump + 0.65e-3)
    np.testing.assert_allclose(u[~after_jump], wanted[~after_jump], atol=1e-9)
    taken = 65.0 / (rate + 65.0 * 5.0)  # the output falls at the rate while the next ramp rises
    assert slewed.value(0.2 + 0.5 * taken) == pytest.approx(65.0 - 0.5 * rate * taken, rel=1e-12)
    assert slewed.value(0.2 + taken) == pytest.approx(65.0 * 5.0 * taken, rel=1e-9)
    assert slewed.range() == WALK.range()


@pytest.mark.parametrize(
    "waveform", [Cycloid(30.0, 20.0, 0.5), Chirp(10.0, 5.0, 50.0, 0.3), Multisine((5.0, 2.0), (10.0, 30.0))]
)
def test_curved_pieces_go_on_as_they_were(waveform) -> None:
    slewed = Slewed(Sequence(Rest(0.01, 40.0), (waveform, 0.2)), 1e6)
    t = np.linspace(0.0101, 0.2, 997)
    np.testing.assert_allclose(slewed.value(t), waveform.value(t - 0.01), atol=1e-9)


def test_a_jump_that_takes_too_long_is_refused() -> None:
    with pytest.raises(QuantityError, match="more than there is"):
        Slewed(Sawtooth(65.0, 1000.0), 1e4).drive(0.01)
    with pytest.raises(QuantityError, match="must be > 0 V/s"):
        Slewed(Sawtooth(65.0, 5.0), 0.0)


@pytest.mark.parametrize("begin", [0.0, 0.2, 0.19695, 0.20333])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_the_begin_is_found_between_the_samples(begin: float, noise: float) -> None:
    t = 3.0 + np.arange(2000) * 1e-3
    u = WALK.value(t - 3.0 - begin) + noise * np.random.default_rng(0).standard_normal(t.size)
    recording = make_recording(t, {"drive_voltage": np.where(t - 3.0 < begin, 0.0, u)})
    assert begin_of(recording, WALK, "walk") == pytest.approx(3.0 + begin, abs=2e-4 if noise else 3e-5)


def test_the_begin_of_a_step_is_found_within_an_interval() -> None:
    t = np.arange(1000) * 1e-4
    recording = make_recording(t, {"drive_voltage": np.where(t >= 0.04, 60.0, 0.0)})
    assert begin_of(recording, Step(60.0), "step") == pytest.approx(0.04, abs=1.01e-4)


def test_the_begin_is_found_where_samples_are_missing() -> None:
    t = np.arange(2000) * 1e-3
    kept = np.sort(np.random.default_rng(0).permutation(t.size)[:1300])
    recording = make_recording(t[kept], {"drive_voltage": WALK.value(t[kept] - 0.2)})
    assert begin_of(recording, WALK, "walk") == pytest.approx(0.2, abs=3e-4)


@pytest.mark.parametrize("factor", [1.0 / 15.0, 15.0])
def test_a_channel_before_the_amplifier_is_not_the_drive(factor: float) -> None:
    t = np.arange(2000) * 1e-3
    recording = make_recording(t, {"drive_voltage": factor * WALK.value(t - 0.2)})
    with pytest.raises(RecordingError, match=r"drive_voltage .* of walk is not the drive"):
        begin_of(recording, WALK, "walk")


def test_another_drive_is_refused() -> None:
    t = np.arange(2000) * 1e-3
    recording = make_recording(t, {"drive_voltage": 65.0 * np.sin(40.0 * t) ** 2})
    with pytest.raises(RecordingError, match=r"drive_voltage .* of walk is not the drive"):
        begin_of(recording, WALK, "walk")
