"""Recordings of the virtual rig: against the simulation without it, the specification, and themselves."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import signal

from stickslip.quantities.units import QuantityError
from stickslip.recording import open_recording, save_recording
from stickslip.recording.calibration.storage import from_text
from stickslip.rig import Capture, Channel, Limits, RigError, Trigger, VirtualRig, measure
from stickslip.rig.home import Home
from stickslip.rig.order import Order
from stickslip.rig.protocols import StopRequested
from stickslip.rig.supervisor import Supervisor
from stickslip.simulation import simulate
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Constant, Rest, Step

from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL, INDUCTIVE, quiet  # isort: skip


EDGE = Trigger("drive_voltage", 1.0)
FAST = Capture(length=0.5, interval=50e-6, pre_trigger=0.2, trigger=EDGE)


def test_an_ideal_sensor_sees_the_simulation() -> None:
    """But for the converter's steps of 8 nm, which excite the end-effector on its bristles (0.6 kHz, hardly
    damped), the lag of the amplifier and its current limit."""
    drive = Sawtooth(65.0, 5.0, rise_fraction=0.9, periods=3)
    capture = Capture(length=0.6, interval=1e-3)
    seen = measure(VirtualRig(ACTUATOR, BENCH), drive, IDEAL, capture, Limits())
    truth = simulate(ACTUATOR, drive, 0.599, sample_rate=1e3)
    assert seen["time"].size == 600
    np.testing.assert_allclose(seen["drive_voltage"], truth["drive_voltage"], atol=0.2)
    difference = seen["end_effector_position"] - truth["end_effector_position"]
    assert np.abs(difference.values[:180]).max() < 32e-9
    assert np.abs(difference.values).max() < 100e-9


def test_the_sawtooth_walks_and_the_reverse_sawtooth_brings_it_home() -> None:
    there = Sawtooth(65.0, 20.0, periods=10)
    back = ReverseSawtooth(65.0, 20.0, periods=10)
    rig, capture = VirtualRig(ACTUATOR, BENCH, seed=3), Capture(2.0, 0.25e-3, 0.2, EDGE)
    out = measure(rig, Sequence(there, Rest(0.3), back), CHANNELS, capture, Limits())
    x = out["end_effector_position"]
    away = float(x.sel(time=slice(0.75, 0.95)).mean())
    assert 15e-6 < away < 35e-6
    assert abs(float(x.sel(time=slice(1.6, 1.9)).mean())) < 0.05 * away


def test_quantisation_delay_and_pre_trigger_are_in_the_recording() -> None:
    rig = VirtualRig(ACTUATOR.replace(clamped=True), quiet())
    out = measure(rig, Step(60.0), CHANNELS, FAST, Limits())
    time, drive = out["time"].values, out["drive_voltage"].values
    rise = np.flatnonzero(drive > 30.0)[0]
    assert time[rise] == pytest.approx(0.2)
    assert drive[rise:].max() == pytest.approx(60.0, abs=0.5 * rig.capabilities.step)
    raw = measure(
        rig, Step(60.0), {"drive_voltage": Channel("drive"), "sensor": Channel("inductive")}, FAST, Limits()
    )
    codes = (raw["sensor"].values + 10.0) / (20.0 / 65536)
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-6)
    x = out["end_effector_position"].values
    half = np.flatnonzero(x > 0.5 * x[-100:].mean())[0]
    stage = simulate(ACTUATOR.replace(clamped=True), Step(60.0), 0.01, sample_rate=20e3)[
        "stage_position"
    ].values
    delay = (half - rise - np.flatnonzero(stage > 0.5 * stage[-1])[0]) * 50e-6
    # Sensor 0.7 ms, filter 0.1 ms, current limit 60 V x 1.4 uF / 0.4 A / 2 = 0.1 ms: "0.6 to 1.0 ms".
    assert 0.6e-3 < delay < 1.0e-3
    assert x[-100:].mean() == pytest.approx(0.1057e-6 * 60.0, rel=0.05)


def test_sensor_noise_has_the_spectrum_that_was_specified() -> None:
    channels = {"sensor": Channel("inductive"), "gauge": Channel("strain_gauge")}
    out = measure(
        VirtualRig(ACTUATOR, BENCH, seed=5), Constant(0.0), channels, Capture(20.0, 50e-6), Limits()
    )
    for name, sensor in (("sensor", "inductive"), ("gauge", "strain_gauge")):
        f, power = signal.welch(out[name].values, 20e3, nperseg=2**13)
        # One pole before the converter, and what it lets through from above half the rate.
        pole = signal.butter(1, BENCH.anti_alias.corner, fs=80e3)
        seen = [signal.freqz(*pole, worN=at, fs=80e3)[1] for at in (f, 20e3 - f, 20e3 + f, 40e3 - f)]
        folded = np.sum(np.abs(seen) ** 2, axis=0)
        band = (f > 200.0) & (f < 3e3)
        density = BENCH.sensors[sensor].sensor.noise_density
        steps = 2 * (20.0 / 65536) ** 2 / 12 / 20e3
        assert np.mean((power - steps)[band] / folded[band]) == pytest.approx(density**2, rel=0.06)


def test_the_same_seed_is_the_same_recording_bit_for_bit() -> None:
    def one(seed: int):
        return measure(VirtualRig(ACTUATOR, BENCH, seed=seed), Step(60.0), CHANNELS, FAST, Limits())

    first, again, other = one(1), one(1), one(2)
    for name in CHANNELS:
        np.testing.assert_array_equal(first[name], again[name])
    assert np.all(first["end_effector_position"].values != other["end_effector_position"].values)
    np.testing.assert_array_equal(first["drive_voltage"], other["drive_voltage"])


def test_averaging_takes_the_noise_down_with_the_root() -> None:
    rig = VirtualRig(ACTUATOR, BENCH, seed=1)
    capture = Capture(0.2, 50e-6)
    alone = measure(rig, Constant(0.0), CHANNELS, capture, Limits())["end_effector_position"]
    mean = measure(rig, Constant(0.0), CHANNELS, capture._replace(average=16), Limits())[
        "end_effector_position"
    ]
    assert float(mean.std()) == pytest.approx(float(alone.std()) / 4.0, rel=0.25)


def test_a_recording_says_how_it_was_made(tmp_path) -> None:
    made = measure(VirtualRig(ACTUATOR, BENCH), Step(60.0), CHANNELS, FAST, Limits(), title="t", notes="n")
    read = open_recording(save_recording(made, tmp_path / "r.nc"))
    chain = json.loads(read.attrs["calibration"])["end_effector_position"]
    assert [from_text(json.dumps(part)) for part in chain] == list(INDUCTIVE)
    assert json.loads(read.attrs["capture"])["trigger"]["signal"] == "drive_voltage"
    assert "filter (Butterworth, order 2, 2 kHz)" in read.attrs["processing"]
    assert (read.attrs["title"], read.attrs["notes"]) == ("t", "n")
    assert read["piezo_elongation"].attrs["units"] == "m"


def test_real_time_takes_the_time_it_takes() -> None:
    import time

    rig = VirtualRig(ACTUATOR, BENCH, real_time=True)
    begun = time.monotonic()
    measure(rig, Step(10.0), IDEAL, Capture(0.3, 1e-3, 0.1), Limits())
    assert time.monotonic() - begun >= 0.3


def test_a_fetch_that_waits_is_interrupted_and_hands_out_what_was_played(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import threading
    import time

    monkeypatch.setattr("stickslip.rig.virtual.BLOCK", 60.0)  # s: nobody waits for so long here
    rig = VirtualRig(ACTUATOR, BENCH, real_time=True)
    rig.load(np.full(1000, 5.0))
    rig.arm(("drive",), 60 * 20_000)
    begun = time.monotonic()
    rig.start()
    threading.Timer(0.2, rig.interrupt).start()
    block = rig.fetch()
    assert 0 < block.shape[1] <= (time.monotonic() - begun) * BENCH.sample_rate
    rig.stop(1e3)
    rig.arm(("drive",), 100)  # the next run waits again for its samples
    rig.start()
    assert rig.fetch().shape[1] == 100


def test_a_stop_waits_for_no_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.rig.virtual.BLOCK", 60.0)  # s
    one = Supervisor(Home(), lambda: None)
    one.rig = VirtualRig(ACTUATOR, BENCH, real_time=True)
    one.run(Order(Limits(watchdog=60.0), ("drive",), 60 * 20_000, 100, None, np.full(1000, 5.0)))
    while one.phase == "preparing":
        one.fetch(0.05)
    assert one.stop("a stop")
    one.join(50.0)  # s
    assert not one.busy
    with pytest.raises(StopRequested, match="a stop"):
        _ = [one.fetch(0.0) for _ in range(3)]  # the samples, then why it ended
    assert one.ramp_after is not None
    assert 0.0 <= one.ramp_after < 50.0  # s, where the block is 60 s long


def test_a_rig_says_what_it_cannot_do() -> None:
    with pytest.raises(QuantityError, match="actuator = 'kang2007' must be Actuator"):
        VirtualRig("kang2007", BENCH)  # type: ignore[arg-type]
    with pytest.raises(QuantityError, match="bench = 'kang2007-bench' must be Bench"):
        VirtualRig(ACTUATOR, "kang2007-bench")  # type: ignore[arg-type]
    rig = VirtualRig(ACTUATOR, BENCH)
    with pytest.raises(QuantityError, match=r"drive = 60 is no waveform"):
        measure(rig, 60, CHANNELS, FAST, Limits(max_voltage=100))  # type: ignore[arg-type]
    with pytest.raises(RigError, match="start needs"):
        rig.start()
    with pytest.raises(RigError, match="no input 'nose'"):
        rig.arm(("nose",), 10)
    with pytest.raises(RigError, match="samples"):
        rig.arm(("drive",), 0)
    with pytest.raises(RigError, match="nothing is running"):
        rig.fetch()
    rig.load(np.zeros(10))
    rig.arm(("drive",), 5000)
    rig.start()
    with pytest.raises(RigError, match="load: a run is going on"):
        rig.load(np.zeros(10))
    assert rig.fetch().shape == (1, 400)
    rig.stop(1e3)
    rig.stop(1e3)  # nothing more to do
