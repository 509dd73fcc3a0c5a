"""A drive known by its samples, against the waveform they were taken from; and what samples cannot show."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from stickslip.identify.recorded.recorded_drive import RecordedDrive, recorded_drive
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError, RecordingWarning, make_recording
from stickslip.simulation.drives import checked_drive
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine, Triangle
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest, Step
from stickslip.waveform.signal import Waveform

RATE, COUNT = 1e3, 900
# Between two samples of 1 kHz, for nothing real keeps to the clock of the recorder.
LATE = 0.0513


def late(waveform: Waveform) -> Sequence:
    return Sequence((Rest(1.0, float(waveform.range()[0])), LATE), (waveform, 2.0))


def sampled(waveform: Waveform, noise: float = 0.0) -> RecordedDrive:
    t = np.arange(COUNT) / RATE
    u = waveform.value(t) + noise * np.random.default_rng(0).standard_normal(t.size)
    return recorded_drive(make_recording(7.0 + t, {"drive_voltage": u}), "the walk")


def differences(found: RecordedDrive, truth: Waveform) -> np.ndarray:
    """At times within the recording, between its samples and at them, none within 0.1 ns of a break."""
    t = (np.arange(1, 37 * (COUNT - 1)) / 37) / RATE
    near = np.abs(t[:, None] - truth.breaks(1.0)[None, :]).min(axis=1) < 1e-10
    return (found.value(t) - truth.value(t))[~near]


@pytest.mark.parametrize(
    ("waveform", "jumps"),
    [
        (late(Sawtooth(65.0, 5.0, periods=3)), 3),
        (late(Sawtooth(65.0, 7.3, offset=4.0)), 6),
        (late(Sawtooth(65.0, 100.0)), 84),
        (
            late(
                Sequence(Sawtooth(65.0, 20.0, periods=4), Rest(0.1), ReverseSawtooth(65.0, 20.0, periods=4))
            ),
            8,
        ),
    ],
    ids=["between", "7.3 Hz", "100 Hz", "there and back"],
)
def test_jumps_are_where_the_slopes_beside_them_point(waveform: Waveform, jumps: int) -> None:
    message = (
        f"of the walk .* {jumps} times, first after 7.* Taken: {jumps} as jumps at the instants .* the drive"
    )
    with pytest.warns(RecordingWarning, match=message):
        found = sampled(waveform)
    assert np.abs(differences(found, waveform)).max() < 1e-9
    assert found.drive(np.inf).before == waveform.value(0.0)
    assert (found.unit, found.period, found.duration) == ("V", None, pytest.approx(0.899))


@pytest.mark.parametrize(
    ("waveform", "error"),
    [
        (late(Triangle(65.0, 5.0)), 1e-9),
        (late(Sawtooth(65.0, 5.0, rise_fraction=1 - 5 * 3.7e-3)), 1e-9),
        (late(Cycloid(65.0, 5.0, rise_fraction=0.8)), 2e-3),
        (Sine(30.0, 20.0, offset=30.0), 1e-2),  # the kink at its start is not all a sample can tell
        (Multisine((1.0, 2.0, 1.5), (13.0, 29.0, 41.0), (0.0, 1.0, 2.0)), 1e-3),
    ],
    ids=["triangle", "flank of 3.7 ms", "cycloid", "sine", "multisine"],
)
def test_what_the_samples_show_is_found_without_a_word(waveform: Waveform, error: float) -> None:
    assert np.abs(differences(sampled(waveform), waveform)).max() < error


def test_noise_is_no_flank_and_hides_none() -> None:
    sampled(Sine(30.0, 20.0, offset=30.0), noise=0.05)
    sampled(Rest(1.0, 30.0), noise=0.05)
    saw = late(Sawtooth(65.0, 5.0, periods=3))
    with pytest.warns(RecordingWarning, match="Taken: 3 as jumps at the instants"):
        found = sampled(saw, noise=0.01)
    for jump in saw.breaks(1.0)[2:]:
        assert np.abs(found.start - jump).min() < 1e-4


@pytest.mark.parametrize(
    ("waveform", "words"),
    [
        (Step(60.0, delay=0.2004), "1 as jumps at the sample after them"),
        (late(Sawtooth(65.0, 5.0, rise_fraction=1 - 5 * 5e-4, periods=3)), "3 as lines between the samples"),
    ],
    ids=["a step", "a flank of half an interval"],
)
def test_what_the_samples_do_not_show_is_said(waveform: Waveform, words: str) -> None:
    with pytest.warns(RecordingWarning, match=words):
        found = sampled(waveform)
    t = np.arange(COUNT) / RATE
    np.testing.assert_allclose(found.value(t), waveform.value(t), atol=1e-9)


def test_a_flank_within_one_interval_is_never_passed_over() -> None:
    """However short it is and wherever it lies: a jump is assumed, and that is said."""
    for fall in (1e-5, 4e-4):
        for begin in (0.05, 0.0502):
            saw = Sawtooth(65.0, 5.0, rise_fraction=1 - 5 * fall, periods=3)
            with pytest.warns(RecordingWarning, match="give it as the drive"):
                sampled(Sequence((Rest(1.0), begin), (saw, 2.0)))


def test_a_recording_without_a_drive_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"the walk has no drive_voltage \[V\]"):
        recorded_drive(make_recording([0.0, 1.0], {"voltage": [0.0, 1.0]}), "the walk")
    with warnings.catch_warnings(), pytest.raises(RecordingError, match="has 2 samples"):
        recorded_drive(make_recording([0.0, 1.0], {"drive_voltage": [0.0, 1.0]}), "the walk")


def test_a_converters_steps_are_one_line_and_jumps_take_their_time() -> None:
    """A sawtooth in steps of 78 mV: a handful of pieces, within a step of the line; falls at 3e5 V/s."""
    t = np.arange(900) * 1e-3
    u = np.floor(Sawtooth(65.0, 5.0).value(t) / 0.078 + 0.5) * 0.078
    with pytest.warns(RecordingWarning, match="as jumps"):
        found = recorded_drive(make_recording(t, {"drive_voltage": u}), "the walk", slew_rate=3e5)
    assert found.start.size < 30
    inside = t[(t % 0.2 > 1e-3) & (t % 0.2 < 0.199)]
    np.testing.assert_allclose(found.value(inside), Sawtooth(65.0, 5.0).value(inside), atol=0.08)
    fall = 0.2 + 65.0 / 3e5 * np.array([0.1, 0.5, 0.9])
    np.testing.assert_allclose(found.value(fall), 65.0 * np.array([0.9, 0.5, 0.1]), atol=0.5)


def test_noise_of_a_monitor_is_no_drive_out_of_range() -> None:
    """The amplifier gives 0 V and more; what is recorded of it dips below by its noise."""
    model = load_actuator("kang2007").replace(stage_reaction=False)
    time = np.arange(600) * 1e-3
    random = np.random.default_rng(0)
    sawtooth = 65.0 * (time * 5.0 % 1.0)
    volts = sawtooth + 0.05 * random.standard_normal(time.size)
    assert volts.min() < model.min_voltage
    recording = make_recording(time, {"drive_voltage": volts, "end_effector_position": 0.0 * time})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        drive = recorded_drive(recording, "it")
        assert drive.range()[0] >= model.min_voltage
        assert drive.range()[1] == pytest.approx(65.0, rel=0.02)
        checked_drive(model, drive, 0.5, periodic=False, tolerance=1e-9)
        below = recording.assign(drive_voltage=recording["drive_voltage"] - 3.0)
        with pytest.raises(QuantityError, match="out of range"):
            checked_drive(model, recorded_drive(below, "it"), 0.5, periodic=False, tolerance=1e-9)
