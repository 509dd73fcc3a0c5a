"""What the drive of a recording is taken for: named by it, recognised in its channel, or its samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.recording.drive import drive_text
from stickslip.recording.shown_drive import shown_drive
from stickslip.recording.taken_drive import taken_drive
from stickslip.waveform import Rest, ReverseSawtooth, Sequence, Triangle


@pytest.mark.parametrize("seed", range(8))
def test_a_noisy_monitor_still_shows_its_waveform(seed: int) -> None:
    """Up to 0.3 V of noise; sizes and rates that are not round, a begin between samples, a trigger."""
    random = np.random.default_rng([46, seed])
    kind = (ss.Sawtooth, ReverseSawtooth, Triangle, ss.Sine)[seed % 4]
    drive = kind(
        random.choice([-1.0, 1.0]) * random.uniform(20.0, 90.0), random.uniform(2.0, 40.0), periods=4
    )
    rate, rest, noise = random.choice([4e3, 10e3]), random.uniform(0.02, 0.2), random.choice([0.02, 0.1, 0.3])
    time = np.arange(round((rest + 4.8 / drive.frequency) * rate)) / rate
    volts = Sequence(Rest(rest), drive).value(time) + noise * random.standard_normal(time.size)
    taken = taken_drive(ss.make_recording(time - 0.05, {"drive_voltage": (volts, "V")}))
    assert taken is not None
    assert taken.whole
    assert isinstance(taken.waveform, kind)
    assert taken.waveform.amplitude == pytest.approx(drive.amplitude, abs=0.4 * noise)
    assert taken.waveform.frequency == pytest.approx(drive.frequency, rel=1e-3)
    # Within the jump's sample, and else as far as the noise of the fastest part lets it be told.
    assert taken.begin + 0.05 == pytest.approx(rest, abs=1.0 / rate)
    assert taken.residual == pytest.approx(noise, rel=0.15)


def recording(volts: Any, time: Any, drive: Any = None) -> Any:
    made = ss.make_recording(time, {"drive_voltage": (volts, "V")})
    return made if drive is None else made.assign_attrs(drive=drive_text(drive))


def test_the_attribute_counts_first_and_only_where_the_channel_agrees() -> None:
    time = np.arange(4000) * 2.5e-4
    own = Sequence(ss.Sawtooth(65.0, 5.0, periods=2), Rest(0.1), ReverseSawtooth(65.0, 5.0, periods=2))
    volts = Sequence(Rest(0.06), own).value(time) + 0.02 * np.random.default_rng(1).standard_normal(time.size)
    taken = taken_drive(recording(volts, time, own))
    assert taken is not None
    assert taken.whole
    assert taken.named
    assert taken.begin == pytest.approx(0.06, abs=5e-5)
    assert "named by the recording; residual 20 mV rms" in taken.said()
    endless = ss.Sawtooth(65.0, 5.0)
    found = taken_drive(recording(Sequence(Rest(0.06), (endless, 2.0)).value(time), time, endless))
    assert found is not None
    assert found.said().startswith("Sawtooth 65 V, 5 Hz, named by the recording")
    alone = taken_drive(recording(volts, time))
    assert alone is not None
    assert alone.waveform is None
    assert alone.said() == "the samples of drive_voltage, which are none of the usual waveforms"
    other = Sequence(Rest(0.06), ss.Sawtooth(55.0, 5.0, periods=4)).value(time)
    taken = taken_drive(recording(other, time, own))  # it was another drive, after all
    assert taken is not None
    assert not taken.named
    assert taken.waveform == ss.Sawtooth(55.0, 5.0, periods=4)


def test_flanks_that_the_samples_show_are_not_replaced_by_jumps() -> None:
    time = np.arange(8000) * 1e-4
    volts = Sequence(Rest(0.05), ss.Sawtooth(65.0, 10.0, periods=5)).value(time)
    limited = volts.copy()
    for i in range(1, limited.size):
        limited[i] = limited[i - 1] + np.clip(volts[i] - limited[i - 1], -8.0, 8.0)  # 80 V/ms
    taken = taken_drive(recording(limited, time))
    assert taken is not None
    assert not taken.whole
    assert taken.said().startswith("the samples of drive_voltage, which differ from Sawtooth 65 V, 10 Hz")
    taken = taken_drive(recording(limited, time), slew_rate=8e4)
    assert taken is not None
    assert taken.whole


@pytest.mark.parametrize("late", [0.0, 0.3, 0.7])
def test_the_drive_that_a_channel_shows(late: float) -> None:
    time = np.arange(4000) * 0.5e-3
    for drive in (
        ss.Step(60.0),
        ss.Step(-20.0, offset=10.0),
        ss.Sawtooth(65.0, 20.0, periods=8),
        ss.Sawtooth(65.0, 20.0, offset=5.0, periods=3),
        ReverseSawtooth(35.5, 5.0, periods=2),
        Triangle(10.0, 10.0, periods=4),
        ss.Sine(30.0, 12.5, offset=40.0, periods=5),
    ):
        volts = Sequence(Rest(0.1 + late * 0.5e-3, level=drive.offset), (drive, 1.8)).value(time)
        volts += 0.01 * np.random.default_rng(7).standard_normal(time.size)
        found = shown_drive(ss.make_recording(time, {"drive_voltage": (volts, "V")}))
        assert found is not None, drive
        begins, waveform, _ = found
        assert waveform == drive
        assert begins == pytest.approx(0.1 + late * 0.5e-3, abs=1.5e-3)


@pytest.mark.parametrize("drive", [ss.Sawtooth(65.0, 20.0, periods=8), ss.Sine(30.0, 12.5, offset=40.0)])
def test_a_drive_that_begins_with_the_first_sample(drive: Any) -> None:
    time = 0.3 + np.arange(2000) * 0.5e-3
    recording = ss.make_recording(time, {"drive_voltage": (drive.value(time - 0.3), "V")})
    begins, waveform, _ = shown_drive(recording) or (math.nan, None, 0.0)
    assert begins == 0.3
    assert type(waveform) is type(drive)
    assert waveform == drive._replace(periods=waveform.periods)


def test_a_drive_that_is_none_of_the_usual_ones_is_not_named() -> None:
    time = np.arange(2000) * 1e-3
    rounded = np.minimum(65.0 * np.abs(np.sin(2 * np.pi * 2 * np.maximum(time - 0.1, 0.0))), 40.0)
    assert shown_drive(ss.make_recording(time, {"drive_voltage": (rounded, "V")})) is None


@pytest.mark.parametrize("seed", range(12))
def test_a_channel_of_anything_is_answered(seed: int) -> None:
    """Noise, levels, spikes, few samples: no waveform is named that the channel does not show."""
    random = np.random.default_rng([46, seed])
    count = int(random.integers(3, 300))
    volts = (
        random.standard_normal(count),
        np.where(random.random(count) > 0.5, 1.0, 0.0),
        np.abs(random.standard_cauchy(count)),
        np.cumsum(random.standard_normal(count)),
    )[seed % 4]
    time = np.cumsum(random.uniform(0.5, 1.5, count)) * 1e-3
    taken = taken_drive(ss.make_recording(time, {"drive_voltage": (volts, "V")}), slew_rate=1e3)
    assert taken is None or taken.said()
    assert taken is None or count < 20 or not taken.whole


@pytest.mark.parametrize(("kind", "rest"), [(ss.Sawtooth, 0.0), (ss.Sawtooth, 0.1), (ReverseSawtooth, 0.1)])
def test_a_recording_may_end_one_sample_after_the_last_jump(kind: Any, rest: float) -> None:
    drive = kind(75.0, 20.0, periods=8)
    last = round((rest + 0.4) * 4e3)
    for count in range(last - 1, last + 4):  # of samples; `last + 1` ends with the jump
        time = np.arange(count) / 4e3
        waveform = Sequence(Rest(rest), drive) if rest else drive
        taken = taken_drive(ss.make_recording(time, {"drive_voltage": (waveform.value(time), "V")}))
        assert taken is not None
        assert taken.whole, (count, taken.said())
        assert taken.waveform == drive
