"""Walks that cannot be of their drive and model: a factor, a sign."""

from __future__ import annotations

import contextlib
import re
import warnings
from typing import Any

import numpy as np
import pytest

from stickslip.identify.recorded.screen import refuse_inverted, refuse_walk
from stickslip.identify.walk.prediction import Predictor
from stickslip.jobs.analysis.alignment import Aligned, aligned, on_level, said_to_drift, without_drift
from stickslip.jobs.campaign.evaluation import moved
from stickslip.physics.actuator import load_actuator
from stickslip.recording import RecordingError, make_recording
from stickslip.simulation import simulate
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.sequence import Sequence as Parts
from stickslip.waveform.shapes import Rest, Step
from stickslip.waveform.signal import value_at

MODEL = load_actuator("kang2007")
DRIVE = Sawtooth(60.0, 10.0, periods=5)


def walk(scale: float = 1.0, interval: float = 0.5e-3, drive: Any = DRIVE, known: bool = True) -> Aligned:
    """2 of 6 um per period are kept, as a contact would that slips at each jump."""
    time = np.arange(0.0, 0.5, interval)
    u = value_at(drive, time)
    sign = 1.0 if isinstance(drive, Sawtooth) else -1.0
    x = scale * (0.7e-7 * u + sign * 2e-5 * time)
    recording = make_recording(time, {"end_effector_position": x, "drive_voltage": u}, title="walk")
    return Aligned("walk", recording, 0.0, 1e-9, drive if known else None, drive if known else None)


@pytest.mark.parametrize("known", [True, False])
def test_a_walk_as_it_should_be(known: bool) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refuse_walk(moved(walk(known=known)), MODEL)
        refuse_walk(moved(walk(drive=ReverseSawtooth(60.0, 10.0, periods=5), known=known)), MODEL)
        refuse_walk(moved(walk(-1.0, known=known)), MODEL.replace(gain=-MODEL.gain))


def step(sign: float, seed: int) -> Aligned:
    """A ringing stage, clamped, with noise."""
    time, random = np.arange(0.0, 0.2, 1e-4), np.random.default_rng(seed)
    drive, since = Step(random.uniform(5.0, 80.0)), time - random.uniform(0.01, 0.15)
    u = np.where(since >= 0.0, drive.amplitude, 0.0)
    ring = 1.0 - np.exp(-np.maximum(since, 0.0) / 5e-3) * np.cos(3e3 * since)
    x = sign * 1e-7 * u * ring + 2e-8 * random.standard_normal(time.size)
    recording = make_recording(time, {"end_effector_position": x, "drive_voltage": u})
    return Aligned(f"step{seed}", recording, 0.0, 1e-9, None, None, use="step")


def test_steps_against_their_drive_are_refused_with_all_that_are_inverted() -> None:
    """It ended in "gain starts at -1.2e-07 m/V: a parameter ... needs bounds of its own", without a file."""
    back, forth = moved(walk(-1.0)._replace(name="back")), moved(walk()._replace(name="forth"))
    for seed in range(4):
        refuse_inverted([moved(step(1.0, seed))], [back, forth], MODEL)
        with pytest.raises(RecordingError) as refused:
            refuse_inverted([moved(step(1.0, 100)), moved(step(-1.0, seed))], [forth, back], MODEL)
        assert f"[m] of step{seed}, back goes down where drive_voltage [V] goes up" in str(refused.value)
        assert 'units: {end_effector_position: "-1 um"}' in str(refused.value)


@pytest.mark.parametrize("known", [True, False])
def test_a_walk_that_the_stage_cannot_make(known: bool) -> None:
    with pytest.raises(
        RecordingError, match=r"end_effector_position \[m\] of walk spans .* mm.*gain = 105.7 nm/V"
    ):
        refuse_walk(moved(walk(1e3, known=known)), MODEL)
    pushed = MODEL.replace(external_force=0.1)  # that carries it anywhere
    refuse_walk(moved(walk(1e3, known=known)), pushed)


@pytest.mark.parametrize(("interval", "sign"), [(0.1e-3, 1.0), (1e-3, -1.0)])
def test_long_steps_go_against_the_drive_within_a_period(interval: float, sign: float) -> None:
    """It gains 9 um at each edge and soon after it, while the drive falls back; it sticks for the rest."""
    drive = Sawtooth(100.0, 25.0, periods=8) if sign > 0.0 else ReverseSawtooth(100.0, 25.0, periods=8)
    time = np.arange(0.0, 0.32, interval)
    phase = time * 25.0 % 1.0
    creep = np.where(time >= 0.04, 1.0 - np.exp(-phase / 0.02), 1.0)
    x = 0.6e-7 * value_at(drive, time) + sign * 1e-5 * (np.floor(time * 25.0) + 0.9 * creep)
    x += 50e-9 * np.random.default_rng(0).standard_normal(time.size)
    one = make_recording(time, {"end_effector_position": x, "drive_voltage": value_at(drive, time)})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refuse_walk(moved(Aligned("walk", one, 0.0, 1e-9, drive, drive)), MODEL)
    one["end_effector_position"] = -one["end_effector_position"]
    with pytest.raises(RecordingError, match=r"walk goes down where drive_voltage .* inverted"):
        refuse_walk(moved(Aligned("walk", one, 0.0, 1e-9, drive, drive)), MODEL)


@pytest.mark.parametrize("factor", [1.0 / 15.0, 15.0])
def test_a_drive_on_the_other_side_of_the_amplifier(factor: float) -> None:
    one = walk().recording
    one["drive_voltage"] = one["drive_voltage"] * factor
    with pytest.raises(RecordingError, match=r"drive_voltage \[V\] of walk spans .* V, its waveform 60 V"):
        aligned(one, DRIVE, "walk")


@pytest.mark.parametrize("begin", [None, 0.1])
def test_a_drive_begins_after_its_rest(begin: float | None) -> None:
    """The rest before a walk shows bias and noise, and is no first part of it."""
    wanted = Parts(Rest(0.15), DRIVE)
    time = np.arange(0.0, 0.75, 0.5e-3)
    drive = Parts(Rest(0.1), wanted)
    x = 3e-6 + 2e-8 * np.random.default_rng(3).standard_normal(time.size) + 0.7e-7 * value_at(drive, time)
    recorded = make_recording(time, {"end_effector_position": x, "drive_voltage": value_at(drive, time)})
    one = aligned(recorded, wanted, "walk", begin=begin)
    assert one.begin == pytest.approx(0.25, abs=1e-3)
    assert one.noise == pytest.approx(2e-8, rel=0.1)
    assert one.forward is None
    assert one.wanted is not None
    np.testing.assert_allclose(value_at(one.wanted, time), value_at(drive, time), atol=0.7)  # within a sample
    both = aligned(recorded, Parts(Rest(0.15), (DRIVE, 0.2), (DRIVE, 0.3)), "walk", begin=0.1)
    assert both.forward == pytest.approx(0.45)


@pytest.mark.parametrize("known", [True, False])
def test_a_walk_upon_a_voltage_is_predicted_where_it_is(known: bool) -> None:
    """Its position is less its mean before the drive; the model rests where that voltage holds it."""
    drive = Parts(Rest(0.1, 20.0), Sawtooth(40.0, 20.0, offset=20.0, periods=2))
    found = simulate(MODEL, drive, 0.2, sample_rate=5e3)
    noise = 1e-8 * np.random.default_rng(5).standard_normal(found.sizes["time"])
    position = 5e-6 + found["end_effector_position"].values + noise
    channels = {"end_effector_position": position, "drive_voltage": found["drive_voltage"].values}
    recorded = make_recording(found["time"].values, channels)
    one = on_level(aligned(recorded, drive if known else None, "walk"), MODEL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the channel changes too fast for its samples
        left = (
            Predictor(MODEL).predict(one.recording, one.drive) - one.recording["end_effector_position"].values
        )
    assert np.sqrt(np.mean(left**2)) < (1.2e-8 if known else 1e-7)


@pytest.mark.parametrize("seed", [0, 3])
def test_a_waveform_of_other_periods_than_were_driven(seed: int) -> None:
    """Of one too few, noise decides where it fits best: it begins with the first, or is refused."""
    random, time = np.random.default_rng(seed), np.arange(0.0, 0.8, 0.5e-3)
    u = value_at(Parts(Rest(0.15), DRIVE), time) + 0.03 * random.standard_normal(time.size)
    recorded = make_recording(time, {"end_effector_position": 0.7e-7 * u, "drive_voltage": u})
    assert aligned(recorded, DRIVE, "walk").begin == pytest.approx(0.15, abs=1e-3)
    said = r"walk is not the drive .* V on average about t = .*as many periods"
    with pytest.raises(RecordingError, match=said):
        aligned(recorded, DRIVE._replace(periods=6), "walk")
    with contextlib.suppress(RecordingError):
        assert aligned(recorded, DRIVE._replace(periods=4), "walk").begin == pytest.approx(0.15, abs=1e-3)


def test_a_drift_at_rest_is_taken_off_and_said() -> None:
    time, noise = np.arange(0.0, 0.8, 0.5e-3), 2e-8
    u = value_at(Parts(Rest(0.15), DRIVE), time)
    walks = []
    for seed, drift in enumerate([0.0] * 8 + [-1e-6, 5e-8]):  # 5e-8 m/s are 33 nm, hardly more than noise
        x = 0.7e-7 * u + drift * time + noise * np.random.default_rng(seed).standard_normal(time.size)
        recorded = make_recording(time, {"end_effector_position": x, "drive_voltage": u})
        walks.append(without_drift(aligned(recorded, DRIVE, f"walk {seed}")))
    assert [one.name for one in walks if one.drift is not None] == ["walk 8"]
    one = walks[8]
    assert one.drift is not None
    assert abs(one.drift.slope + 1e-6) < 3.0 * one.drift.error < 3e-7
    assert one.noise == pytest.approx(noise, rel=0.1)
    count = one.recording.sizes["time"]
    left = one.recording["end_effector_position"].values - 0.7e-7 * u[:count]
    allowed = one.drift.error * (time[:count] - one.drift.about)
    assert np.all(np.abs(left) < 5.0 * noise + 3.0 * np.abs(allowed))
    (said,) = said_to_drift(walks)
    assert re.match(
        r"walk 8 drifts by -[\d.]+ [nµ]m/s \(standard error [\d.]+ nm/s\) before its drive begins: "
        r"that is taken off all of it, -[56]\d\d nm at its end",
        said,
    )


def test_without_its_channel_a_drive_begins_nowhere() -> None:
    time = np.arange(0.0, 0.5, 0.5e-3)
    recorded = make_recording(time, {"end_effector_position": 0.7e-7 * value_at(DRIVE, time)})
    with pytest.raises(RecordingError, match=r"walk has no drive_voltage \[V\]: .* when it begins"):
        aligned(recorded, DRIVE, "walk")
