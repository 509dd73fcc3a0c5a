"""A loop on the virtual rig: limits hold at every update, and however it ends, the output is at 0 V."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.control import Pid, Regulator
from stickslip.quantities.units import QuantityError
from stickslip.recording import open_recording
from stickslip.rig import Capture, Channel, LimitError, Limits, RigError, VirtualRig, measure, regulate
from stickslip.rig.samples import recover
from stickslip.waveform import Sine
from stickslip.waveform.drive import Drive

from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip

LASER = {"drive_voltage": Channel("drive"), "end_effector_position": Channel("interferometer")}


class Asking:
    """Asks for what a function of the tick says."""

    def __init__(self, volts: Callable[[int], float]) -> None:
        self.volts, self.seen = volts, []

    def step(self, measured: float, target: float, tick: int) -> float:
        self.seen.append((measured, target))
        return self.volts(tick)


class Integrating:
    """An integral controller, 40 times slower than its limit."""

    volts, done = 0.0, False

    def step(self, measured: float, target: float, tick: int) -> float:
        self.volts += 0.01 * (target - measured) / ACTUATOR.gain
        self.done = tick >= 2400
        return self.volts


class Lost:
    """A waveform that ends in what is no number."""

    unit = "m"

    def drive(self, duration: float) -> Drive:
        table = Sine(1e-6, 10.0, unit="m").drive(duration)
        return table._replace(polynomial=np.full_like(table.polynomial, math.nan))


@pytest.mark.parametrize("target", [math.nan, math.inf, "nan m", "-inf m", Lost()])
def test_a_target_that_is_no_number_puts_nothing_out(target: Any) -> None:
    rig, asking = VirtualRig(ACTUATOR, BENCH), Asking(lambda tick: 5.0)
    with pytest.raises(QuantityError, match=r"target = .* is not finite at every tick"):
        regulate(rig, asking, target, LASER, Limits(), 0.01)
    assert not asking.seen


def test_a_target_of_a_controller_that_is_lost_ends_the_run_with_its_recording() -> None:
    class Wandering(Asking):
        target = 0.0

        def step(self, measured: float, target: float, tick: int) -> float:
            self.target = math.nan if tick == 100 else 1e-6
            return super().step(measured, target, tick)

    rig = VirtualRig(ACTUATOR, BENCH)
    with pytest.raises(LimitError, match="the target is nan at update 100: stopped") as caught:
        regulate(rig, Wandering(lambda tick: 5.0), 0.0, LASER, Limits(), 0.05)
    recording = caught.value.recording  # type: ignore[attr-defined]
    assert recording.sizes["time"] == 100
    assert np.all(recording["target_position"].values == 1e-6)
    assert at_rest(rig)


def at_rest(rig: VirtualRig) -> bool:
    return abs(rig.output()[1][-1]) <= rig.capabilities.step


def test_a_position_is_reached_and_recorded(tmp_path: Path) -> None:
    rig = VirtualRig(ACTUATOR, BENCH)
    told: list[float] = []
    made = regulate(
        rig, Integrating(), "2 um", LASER, Limits(), 0.2, save=tmp_path / "loop.nc", title="two microns",
        progress=lambda doing, done: told.append(done),
    )  # fmt: skip
    assert made.sizes["time"] == 2401, "it was done"
    assert made["end_effector_position"].values[-1] == pytest.approx(
        2e-6, abs=2.0 * rig.capabilities.step * ACTUATOR.gain
    )
    assert np.all(made["target_position"] == 2e-6)
    np.testing.assert_allclose(made["drive_voltage"][1:], made["asked_voltage"][:-1], atol=0.08)
    assert made.attrs["limited_updates"] == 0 < made.attrs["mean_step"] <= made.attrs["slowest_step"]
    assert at_rest(rig)
    kept = open_recording(tmp_path / "loop.nc")
    assert kept.attrs["outcome"] == "complete"
    assert kept.attrs["title"] == "two microns"
    np.testing.assert_array_equal(kept["asked_voltage"], made["asked_voltage"])
    assert [path.name for path in tmp_path.iterdir()] == ["loop.nc"]
    assert all(0.0 <= one <= 1.0 for one in told)


def test_a_target_may_move_and_positions_count_from_home() -> None:
    rig, asks = VirtualRig(ACTUATOR, BENCH), Asking(lambda tick: 20.0)
    first = regulate(rig, asks, Sine("1 um", "50 Hz", unit="m"), IDEAL, Limits(), 0.02, interval="1 ms")
    assert first.sizes["time"] == 20
    times = np.arange(400) / 20e3
    np.testing.assert_allclose([t for _, t in asks.seen], 1e-6 * np.sin(2 * np.pi * 50 * times), atol=1e-15)
    asks.seen.clear()
    regulate(rig, asks, 0.0, IDEAL, Limits(), 0.002)
    assert asks.seen[0][0] == pytest.approx(rig.origin, abs=0.2e-6)


def test_no_update_is_beyond_a_limit() -> None:
    """Whatever is asked for: voltages and slew, at each update and at the piezo."""
    random = np.random.default_rng(1)
    wild = 400.0 * random.standard_normal(2000)
    wild[200:500], wild[500:700] = 200.0, -200.0
    rig, limits = VirtualRig(ACTUATOR, BENCH), Limits(max_voltage=60.0, max_slew=2e4, stop_slew=1e4)
    made = regulate(rig, Asking(lambda tick: wild[tick]), 0.0, IDEAL, limits, 0.1)
    given = np.append(0.0, made["drive_voltage"].values)
    step = rig.capabilities.step
    assert given.max() <= 60.0 + 0.5 * step
    assert given.min() >= -0.5 * step
    assert given.max() > 59.0
    assert np.abs(np.diff(given)).max() <= 2e4 / 20e3 + step
    assert made.attrs["limited_updates"] > 1500
    _times, volts = rig.output()
    assert volts.max() <= 60.0 + 0.5 * step
    assert volts.min() >= -0.5 * step
    assert at_rest(rig)


def failing(tick_of_failure: int, wrong: Callable[[], float]) -> Asking:
    return Asking(lambda tick: 30.0 if tick < tick_of_failure else wrong())


def test_a_controller_that_fails_ends_in_the_ramp(tmp_path: Path) -> None:
    for k, (wrong, words) in enumerate(
        (
            (lambda: math.nan, "asked for nan V at update 700"),
            (lambda: math.inf, "asked for inf V at update 700"),
            (lambda: 1.0 / 0.0, "failed at update 700: ZeroDivisionError"),
            (lambda: "no", "asked for 'no' V"),
        )
    ):
        rig, path = VirtualRig(ACTUATOR, BENCH), tmp_path / f"{k}.nc"
        with pytest.raises(LimitError, match=words) as caught:
            regulate(rig, failing(700, wrong), 0.0, IDEAL, Limits(), 0.1, save=path)  # type: ignore[arg-type]
        kept = open_recording(tmp_path / "unfinished" / path.name)
        assert kept.sizes["time"] == 700
        assert words in kept.attrs["outcome"]
        assert caught.value.recording.identical(kept)  # type: ignore[attr-defined]
        times, volts = rig.output()
        assert volts.max() == pytest.approx(30.0, abs=0.1)
        ramp = times[-1] - times[volts > 29.9][-1]
        assert 0.03 <= ramp < 0.034, "30 V at 1000 V/s"
        assert at_rest(rig)
        rig.begin(("ideal",))  # and it can be used again
        rig.stop(1000.0)
    assert not list(tmp_path.glob("*.nc"))


def test_a_controller_that_never_answers_is_left_behind() -> None:
    rig, released = VirtualRig(ACTUATOR, BENCH), threading.Event()
    stalls = failing(500, lambda: 30.0 if released.wait(300.0) else 0.0)
    begun = time.monotonic()
    with pytest.raises(LimitError, match="watchdog: nothing came from the controller") as caught:
        regulate(rig, stalls, 0.0, IDEAL, Limits(watchdog=5.0), 0.1)
    assert time.monotonic() - begun < 200.0
    assert caught.value.recording.sizes["time"] == 500  # type: ignore[attr-defined]
    assert at_rest(rig)
    released.set()  # it comes back, and finds nothing that runs
    assert rig.begin(("ideal",))
    rig.stop(1000.0)


def test_samples_that_fail_after_a_controller_was_left_behind_are_a_note(tmp_path: Path) -> None:
    rig, released, hangs = VirtualRig(ACTUATOR, BENCH), threading.Event(), threading.Event()

    def never() -> float:
        hangs.set()
        return 30.0 if released.wait(300.0) else 0.0

    def sees(block: dict[str, Any]) -> None:
        if hangs.is_set():
            raise ValueError("no place to draw")

    limits, path = Limits(watchdog=2.0), tmp_path / "walk.nc"
    with pytest.raises(LimitError, match="watchdog: nothing came from the controller") as caught:
        regulate(rig, failing(550, never), 0.0, IDEAL, limits, 0.1, sees=sees, save=path)
    released.set()
    assert caught.value.__notes__ == ["The last samples failed too: ValueError no place to draw"]
    kept = open_recording(tmp_path / "unfinished" / path.name)
    assert kept.sizes["time"] == 550
    assert caught.value.recording.identical(kept)  # type: ignore[attr-defined]
    assert at_rest(rig)


class Cut(VirtualRig):
    """Whose driver raises an error of its own at the stop."""

    def stop(self, slew: float) -> None:
        super().stop(slew)
        raise OSError("the cable is out")


def test_a_stop_that_fails_in_any_way_is_a_note_and_the_recording_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "walk.nc"
    wrong = failing(550, lambda: math.nan)
    with pytest.raises(LimitError, match="asked for nan V") as caught:
        regulate(Cut(ACTUATOR, BENCH), wrong, 0.0, IDEAL, Limits(), 0.1, save=path)
    assert "The stop failed too (the cable is out): switch the amplifier off" in caught.value.__notes__[0]
    assert open_recording(tmp_path / "unfinished" / path.name).sizes["time"] == 550
    path = tmp_path / "drive.nc"
    with pytest.raises(LimitError, match="beyond") as caught:
        measure(
            Cut(ACTUATOR, BENCH),
            Sine("20 V", "50 Hz", offset="20 V"),
            IDEAL,
            Capture("40 ms", "50 us"),
            Limits(min_position="-1 nm", max_position="1 nm"),
            save=path,
        )
    assert "The stop failed too (the cable is out): switch the amplifier off" in caught.value.__notes__[0]
    assert open_recording(tmp_path / "unfinished" / path.name).sizes["time"] > 1


def test_a_controller_that_cannot_report_keeps_its_recording() -> None:
    class Silent(Asking):
        def told(self) -> dict[str, Any]:
            raise ValueError("nothing to report")

    with pytest.raises(LimitError, match="asked for nan V") as caught:
        regulate(
            VirtualRig(ACTUATOR, BENCH),
            Silent(lambda tick: math.nan if tick == 100 else 1.0),
            *(0.0, IDEAL, Limits(), 0.1),
        )
    assert caught.value.recording.sizes["time"] == 100  # type: ignore[attr-defined]


def test_the_watchdog_waits_for_the_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that goes on by more than it waits, as with a rig that takes long to start."""
    clock, ahead, looks = time.monotonic, [0.0], threading.Semaphore(0)
    monkeypatch.setattr(time, "monotonic", lambda: clock() + ahead[0])

    class Slow(VirtualRig):
        def begin(self, inputs: tuple[str, ...]) -> list[float]:
            ahead[0] = 1000.0
            while looks.acquire(blocking=False):
                pass
            for _ in range(3):  # between them, the silence is looked at
                assert looks.acquire(timeout=300.0)
            return super().begin(inputs)

    rig, calm, limits = Slow(ACTUATOR, BENCH), Asking(lambda tick: 1.0), Limits(watchdog=500.0)
    made = regulate(rig, calm, 0.0, IDEAL, limits, 0.01, progress=lambda *_: looks.release())
    assert made.attrs["outcome"] == "complete"


class Faulty(VirtualRig):
    """Whose first reading is changed from an update on."""

    def __init__(self, change: Callable[[float], float], begin: int = 600) -> None:
        super().__init__(ACTUATOR, BENCH)
        self.change, self.left = change, begin

    def exchange(self, volts: float) -> list[float]:
        found = super().exchange(volts)
        self.left -= 1
        return [self.change(found[0]), *found[1:]] if self.left < 0 else found


SHOWN = {"end_effector_position": Channel("ideal"), "drive_voltage": Channel("drive")}


def test_a_sensor_that_is_lost_frozen_or_jumps_ends_the_run() -> None:
    rising = Asking(lambda tick: min(0.02 * tick, 80.0))
    limits = Limits(min_position=-1e-6, max_position=20e-6)
    for change, words in (
        (lambda x: math.nan, "'ideal' reads nan at sample 601"),
        (lambda x: 1e-6, "frozen: it has read 1e-06 for 2000 updates"),
        (lambda x: x + 30e-6, "beyond the end stop at 20 µm"),
        (lambda x: x - 30e-6, "beyond the end stop at -1 µm"),
    ):
        rig = Faulty(change)
        with pytest.raises(LimitError, match=words) as caught:
            regulate(rig, rising, 0.0, SHOWN, limits, 0.2)
        assert caught.value.recording.sizes["time"] >= 600  # type: ignore[attr-defined]
        assert at_rest(rig)


def test_an_end_stop_holds_though_the_controller_pushes_on() -> None:
    """It walks by 3 um a step; the stop is passed by less than one update's way."""
    rig = VirtualRig(ACTUATOR, BENCH)
    walking = Asking(lambda tick: 65.0 * (tick % 200) / 200)
    with pytest.raises(LimitError, match="beyond the end stop at 20 µm") as caught:
        regulate(rig, walking, 0.0, IDEAL, Limits(max_position=20e-6), 1.0)
    kept = caught.value.recording  # type: ignore[attr-defined]
    assert 19e-6 < kept["end_effector_position"].values.max() <= 20e-6
    assert at_rest(rig)


def test_an_operator_who_ends_it_gets_the_ramp_and_the_recording() -> None:
    class Away(Exception):
        pass

    def away(doing: str, done: float) -> None:
        if done > 1e-5:  # 20 updates
            raise Away

    rig = VirtualRig(ACTUATOR, BENCH)
    endless = Asking(lambda tick: (time.sleep(1e-5), 30.0)[1])
    with pytest.raises(Away) as caught:
        regulate(rig, endless, 0.0, IDEAL, Limits(), 100.0, progress=away)
    kept = caught.value.recording  # type: ignore[attr-defined]
    assert kept.sizes["time"] > 2
    assert "Away" in kept.attrs["outcome"]
    assert at_rest(rig)


KILLED = """
import sys, time
from pathlib import Path
from rig.test_closed_loop import ACTUATOR, BENCH, IDEAL, Asking, Limits, VirtualRig, regulate
slow = Asking(lambda tick: (time.sleep(1e-4), 30.0)[1])
regulate(VirtualRig(ACTUATOR, BENCH), slow, 0.0, IDEAL, Limits(), 200.0, save=Path(sys.argv[1]))
"""


def test_what_was_recorded_outlives_kill_9(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    program = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path / "loop.nc")], env=environment, cwd=tmp_path
    )
    try:
        until = time.monotonic() + 300.0
        while time.monotonic() < until and program.poll() is None:
            files = list(tmp_path.glob(".*.samples"))
            if files and int.from_bytes(files[0].read_bytes()[:8], "little") >= 800:
                break
            time.sleep(0.05)
        program.send_signal(signal.SIGKILL)
    finally:
        program.wait()
    (path,) = recover(tmp_path)
    kept = open_recording(path)
    assert kept.sizes["time"] >= 800
    assert kept["drive_voltage"].values[400] == pytest.approx(30.0, abs=0.1)
    assert "killed" in kept.attrs["outcome"]


def test_what_cannot_be_closed_is_refused_before_a_volt() -> None:
    rig, calm = VirtualRig(ACTUATOR, BENCH), Asking(lambda tick: 1.0)
    for arguments, words in (
        (
            (0.0, {"drive_voltage": Channel("drive")}, Limits(), 0.1),
            "needs the channel end_effector_position",
        ),
        ((0.0, CHANNELS, Limits(), 0.1), "no filter and no zero"),
        ((0.0, IDEAL, Limits(max_duty=0.5), 0.1), "max_duty"),
        ((Sine("1 V", "5 Hz"), IDEAL, Limits(), 0.1), "waveform in m"),
        ((0.0, IDEAL, Limits(), 1e9), "longer than"),
        (("3 V", IDEAL, Limits(), 0.1), "target"),
    ):
        with pytest.raises(QuantityError, match=words):
            regulate(rig, calm, *arguments)  # type: ignore[arg-type]
    assert not calm.seen
    slower = Regulator(Pid(integral=1e6), "10 kHz")
    with pytest.raises(QuantityError, match="rate = 20000 Hz: the controller's Regulator is made for 10000"):
        regulate(rig, slower, 0.0, IDEAL, Limits(), 0.1)
    with pytest.raises(RigError, match="whole drives only"):
        regulate(_Whole(), calm, 0.0, IDEAL, Limits(), 0.1)  # type: ignore[arg-type]


class _Whole:
    capabilities = VirtualRig(ACTUATOR, BENCH).capabilities
