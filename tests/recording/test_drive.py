"""The waveform that a recording names comes back as it was put out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stickslip.physics.actuator import load_actuator
from stickslip.recording import make_recording, open_recording, save_recording
from stickslip.recording.drive import drive_text, named_drive
from stickslip.rig import Capture, Channel, Limits, VirtualRig, load_bench, measure
from stickslip.simulation import simulate
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Chirp, Rest, Step


def recording(drive: str):
    made = make_recording(np.arange(20) * 1e-3, {"drive_voltage": np.arange(20.0)})
    return made.assign_attrs(drive=drive)


@pytest.mark.parametrize(
    "waveform",
    [
        Step(60.0),
        Sawtooth(65.0, 5.0, periods=8),
        Sequence(Rest(0.1), Sawtooth(65.0, 5.0, periods=2), Rest(0.5), ReverseSawtooth(65.0, 5.0, periods=2)),
        Sequence((Cycloid(30.0, 20.0, 0.5), 0.2), (Chirp(10.0, 5.0, 50.0, 0.3), 0.1), (Sine(5.0, 3.0), 1.0)),
        Multisine((5.0, 2.0), (10.0, 30.0)),
        Sampled(np.array([0.0, 0.1, 0.25]), np.array([1.0, 2.0, 0.1 + 0.2]), "hold", period=0.5),
        PeriodicKnots(np.array([0.0, 0.1]), (-5.0, 65.0), 0.2, smooth=True, periods=3),
    ],
    ids=lambda waveform: type(waveform).__name__,
)
def test_waveforms_come_back(waveform) -> None:
    read = named_drive(recording(drive_text(waveform)))
    assert repr(read) == repr(waveform)
    t = np.linspace(0.0, 1.0, 301)
    np.testing.assert_array_equal(read.value(t), waveform.value(t))


def test_what_names_none_is_none() -> None:
    for text in (
        "",
        "a sawtooth of 65 V",
        '{"waveform": "Sawtooth", "amplitude": 65.0, "freq',
        '{"waveform": "Sawtooth", "amplitude": -1.0, "frequency": 0.0}',
        '{"waveform": "Sawtooth", "amplitude": "open"}',
        '{"waveform": "Sinus", "amplitude": 1.0}',
        '{"waveform": "Mine", "waveform_of": "/tmp/own.py"}',
        "[1.0, 2.0]",
        "[" * 5000,
    ):
        assert named_drive(recording(text)) is None


def test_the_whole_of_a_long_one_is_kept_in_a_file(tmp_path: Path) -> None:
    times = np.arange(50_000) * 1e-5
    drive = Sampled(times, np.random.default_rng(3).uniform(0.0, 65.0, times.size))
    save_recording(recording(drive_text(drive)), tmp_path / "long.nc")
    read = named_drive(open_recording(tmp_path / "long.nc"))
    np.testing.assert_array_equal(read.values, drive.values)
    np.testing.assert_array_equal(read.times, drive.times)


def test_a_simulation_and_a_measurement_carry_theirs() -> None:
    drive = Sequence(Rest(0.01), Sawtooth(20.0, 100.0, periods=2))
    actuator = load_actuator("kang2007")
    bench = load_bench("kang2007-bench")
    channels = {"drive_voltage": Channel("drive")}
    measured = measure(VirtualRig(actuator, bench), drive, channels, Capture(0.03, 1e-3), Limits())
    for made in (simulate(actuator, drive, 0.03), measured):
        assert json.loads(made.attrs["drive"])["parts"][1][0]["frequency"] == 100.0
        assert repr(named_drive(made)) == repr(drive)
