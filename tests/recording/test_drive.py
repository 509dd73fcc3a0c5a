"""The waveform that a recording names comes back as it was put out."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.recording import make_recording
from stickslip.recording.drive import named_drive
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine
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
        PeriodicKnots(np.array([0.0, 0.1]), (-5.0, 65.0), 0.2, smooth=True, periods=3),
    ],
    ids=lambda waveform: type(waveform).__name__,
)
def test_waveforms_come_back(waveform) -> None:
    read = named_drive(recording(repr(waveform)))
    assert repr(read) == repr(waveform)
    t = np.linspace(0.0, 1.0, 301)
    np.testing.assert_array_equal(read.value(t), waveform.value(t))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a sawtooth of 65 V",
        "Sampled(time=array([0., 1.]))",
        "Sawtooth(amplitude=65.0, freq",
        "Sawtooth(amplitude=-1.0, frequency=0.0)",
        "__import__('os').getcwd()",
        "(1.0, 2.0)",
        "Step(amplitude=open)",
    ],
)
def test_what_names_none_is_none(text: str) -> None:
    assert named_drive(recording(text)) is None
