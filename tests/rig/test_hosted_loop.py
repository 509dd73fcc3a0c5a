"""A closed loop in the rig's process: the same to the bit, and safe whatever becomes of who asked for it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.quantities.units import QuantityError
from stickslip.recording import open_recording
from stickslip.rig import (
    ControllerSpec,
    HostedRig,
    LimitError,
    Limits,
    Link,
    RigError,
    VirtualRig,
    regulate,
)
from stickslip.rig.description import virtual_device
from stickslip.rig.gate import PositionInput
from stickslip.rig.home import Home
from stickslip.rig.order import Order
from stickslip.rig.protocols import StopRequested
from stickslip.rig.samples import recover
from stickslip.rig.supervisor import Supervisor
from stickslip.rig.turns import ASKED, AT, WANTED
from stickslip.waveform import Sine

from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip
from rig.own_controllers import ANSWER, PATIENCE, Ramping  # isort: skip


def ramping(**options: object) -> ControllerSpec:
    return ControllerSpec(Ramping, {"slope": 0.05, "top": 40.0, **options})


def device(real_time: bool = False) -> dict:
    return virtual_device(ACTUATOR, "kang2007-bench", 3, real_time)


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Link]:
    made = Link(tmp_path / "rig", "a test")
    yield made
    made.close()


def idle(link: Link) -> None:
    end = time.monotonic() + PATIENCE
    while link.ask("state")[0]["phase"] != "idle":
        assert time.monotonic() < end, "it goes on"
        time.sleep(0.005)


def test_it_is_the_loop_of_a_rig_in_this_process_to_the_bit(link: Link, tmp_path: Path) -> None:
    spec, target = ramping(), Sine("1 um", "50 Hz", unit="m")
    inductive = {
        **CHANNELS,
        "end_effector_position": CHANNELS["end_effector_position"]._replace(filter=None, zero=False),
    }
    seen: list[int] = []
    far = regulate(
        HostedRig(link, device()), spec, target, inductive, Limits(), 0.06, interval="0.1 ms",
        save=tmp_path / "far.nc", sees=lambda block: seen.append(block["asked_voltage"].size),
    )  # fmt: skip
    near = regulate(
        VirtualRig(ACTUATOR, BENCH, seed=3), spec, target, inductive, Limits(), 0.06, interval="0.1 ms"
    )
    for name in near.data_vars:
        np.testing.assert_array_equal(far[name], near[name])
    assert far.sizes["time"] == 600
    assert sum(seen) == 1200
    assert far.attrs["outcome"] == "complete"
    assert far.attrs["limited_updates"] == 0
    assert len(json.loads(far.attrs["calibration"])["end_effector_position"]) == 2
    assert open_recording(tmp_path / "far.nc").identical(far)
    assert link.ask("state")[0]["holder"] == ""


def test_a_controller_ends_it_and_takes_commands(link: Link) -> None:
    rig = HostedRig(link, device())
    told: list[dict] = []

    def sees(block: dict) -> None:
        told.append(rig.said())
        if len(told) == 1:
            with pytest.raises(QuantityError, match="must not be below"):
                rig.command(top=-1.0)
            rig.command(top=12.0)

    made = regulate(rig, ramping(at=3000, does="done"), 0.0, IDEAL, Limits(), 1.0, sees=sees)
    assert made.sizes["time"] == 3001
    assert made.attrs["outcome"] == "complete"
    assert made["asked_voltage"].values[-1] == 12.0
    assert told[-1]["top"] == 12.0
    assert told[-1]["ticks"] == 3001
    with pytest.raises(RigError, match="open the rig first"):
        rig.command(top=1.0)


@contextmanager
def supervised(**options: Any) -> Iterator[tuple[Supervisor, VirtualRig]]:
    """A run that goes on, of a supervisor in this process, so that its rig can be looked at."""
    one, rig = Supervisor(Home(), lambda: None), VirtualRig(ACTUATOR, BENCH, seed=3)
    one.rig = rig
    watchdog = float(options.pop("watchdog", PATIENCE))
    limits = Limits(watchdog=watchdog, max_position=float(options.pop("stop", 1.0)))
    inputs = ("drive", AT, WANTED, ASKED)
    controller = ramping(**options).document()
    one.run(Order(limits, inputs, 10**6, 0, PositionInput("ideal", ()), np.zeros(1), None, controller))
    try:
        yield one, rig
    finally:
        one.stop("the test ends")
        one.join(PATIENCE)


def fetched(one: Supervisor) -> BaseException:
    """What ends the run, while its samples are taken."""
    while True:
        try:
            one.fetch(0.1)
        except BaseException as error:
            return error


def at_rest(rig: VirtualRig) -> bool:
    times, volts = rig.output()
    top = float(volts.max())
    ramp = times[-1] - times[volts > top - 0.1][-1]
    return top > 30.0 and abs(volts[-1]) <= rig.capabilities.step and ramp >= (top - 0.1) / 1000.0


def test_however_it_ends_it_ends_in_the_ramp() -> None:
    for options, words in (
        ({"at": 2000, "does": "raise"}, "failed at update 2000: RuntimeError broken"),
        ({"at": 2000, "does": "nan"}, "asked for nan V at update 2000"),
        ({"slope": 0.02, "stop": 4.1e-6}, "beyond the end stop at 4.1 µm"),
    ):
        with supervised(**options) as (one, rig):
            error = fetched(one)
            assert isinstance(error, LimitError)
            assert words in str(error)
            assert at_rest(rig)


def test_a_stop_and_a_silent_program_end_it() -> None:
    with supervised() as (one, rig):
        while (one.said() or {})["ticks"] < 1500:
            one.fetch(0.1)
        assert one.stop("a stop")
        assert isinstance(fetched(one), StopRequested)
        assert at_rest(rig)
    with supervised(watchdog=0.5) as (one, rig):
        one.join(PATIENCE)  # nobody fetches: the watchdog
        assert not one.busy
        assert at_rest(rig)
        assert "silent" in str(fetched(one))


def test_a_controller_that_never_answers_is_left_behind() -> None:
    ANSWER.clear()
    with supervised(at=2000, does="stall", watchdog=5.0) as (one, rig):
        while (one.said() or {})["ticks"] < 2001:
            one.fetch(0.1)
        end = time.monotonic() + PATIENCE / 2
        while abs(rig.output()[1][-1]) > rig.capabilities.step or rig.output()[1].max() < 30.0:
            assert time.monotonic() < end, "the ramp comes before the answer"
            one.fetch(0.05)
        ANSWER.set()


KILLED = """
import sys, time
from pathlib import Path
from typing import Any
sys.path.insert(0, "tests")
from rig.test_hosted_loop import IDEAL, Limits, Link, HostedRig, device, ramping, regulate
rig = HostedRig(Link(Path(sys.argv[1]), "a script"), device(True))
regulate(rig, ramping(), 5e-6, IDEAL, Limits(), 100.0, save=Path(sys.argv[2]))
"""


def test_kill_9_in_mid_move_ends_in_the_ramp_with_the_recording_whole(link: Link, tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(link.folder), str(tmp_path / "move.nc")]
    ) as program:
        end = time.monotonic() + PATIENCE
        while True:
            files = list(tmp_path.glob(".move.*.samples"))
            if files and int.from_bytes(files[0].read_bytes()[:8], "little") >= 1500:
                break
            assert time.monotonic() < end
            assert program.poll() is None
            time.sleep(0.02)
        program.send_signal(signal.SIGKILL)
        program.wait()
    idle(link)
    while link.ask("state")[0]["holder"]:
        time.sleep(0.01)
    (path,) = recover(tmp_path)
    kept = open_recording(path)
    assert "killed" in kept.attrs["outcome"]
    count = kept.sizes["time"]
    assert count >= 1500
    assert np.all(kept["target_position"] == 5e-6)
    near = regulate(VirtualRig(ACTUATOR, BENCH, seed=3), ramping(), 5e-6, IDEAL, Limits(), (count + 5) / 20e3)
    for name in ("end_effector_position", "asked_voltage", "drive_voltage"):
        np.testing.assert_array_equal(kept[name], near[name][:count])
    HostedRig(link, device()).stop(0.0)  # and others may have the rig


def test_what_cannot_be_closed_is_refused(link: Link) -> None:
    class Here:
        def step(self, measured: float, target: float, tick: int) -> float:
            return 0.0

    with pytest.raises(QuantityError, match="give a ControllerSpec"):
        regulate(HostedRig(link, device()), Here(), 0.0, IDEAL, Limits(), 0.1)
    with pytest.raises(RigError, match="unexpected keyword argument"):
        regulate(HostedRig(link, device()), ramping(colour="red"), 0.0, IDEAL, Limits(), 0.1)
    link.ask("open", device=device(), again=False)
    with pytest.raises(RigError, match="no loop goes on"):
        link.ask("command", what={"top": 1.0})
    with pytest.raises(RigError, match="needs the input"):
        link.ask("run", np.zeros(1), limits={}, inputs=["drive"], samples=9, rest=0, position=None,
                 controller=ramping().document())  # fmt: skip
