"""A stop is over when there is evidence, and people are told where there is none."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from stickslip.rig import HostedRig, Link, RigError, VirtualRig
from stickslip.rig.description import virtual_device
from stickslip.rig.home import Home
from stickslip.rig.hosted import UNANSWERED, stop_all
from stickslip.rig.limits import Limits
from stickslip.rig.order import Order
from stickslip.rig.protocols import RigWarning, StopRequested
from stickslip.rig.stopping import StopState, follow_stop
from stickslip.rig.supervisor import Supervisor
from stickslip.rig.wire import receive, send

from rig.laboratory import ACTUATOR, BENCH  # isort: skip


WALK = np.tile(np.linspace(0.0, 65.0, 400), 250)  # V, 5 s of a sawtooth


def number_of(link: Link) -> int:
    return json.loads((link.folder / "rig.json").read_text())["pid"]


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Link]:
    made = Link(tmp_path / "rig", "a test")
    yield made
    made.close()


def walking(link: Link) -> HostedRig:
    """A walk of 5 s in real time that goes on."""
    rig = HostedRig(link, virtual_device(ACTUATOR, "kang2007-bench", 3, True))
    rig.guard(Limits(watchdog=100.0), None, 0)
    rig.load(WALK)
    rig.arm(("drive",), 100_000)
    rig.start()
    return rig


def followed(link: Link, told: list[StopState]) -> threading.Thread:
    asked = time.perf_counter()
    arguments = (link.folder, "a test", told.append, lambda: True, asked)
    thread = threading.Thread(target=follow_stop, args=arguments)
    thread.start()
    return thread


def test_a_stop_ends_when_the_monitor_reads_no_voltage(link: Link) -> None:
    walking(link)
    told: list[StopState] = []
    followed(link, told).join(60.0)
    assert told[-1].state == "measured"
    assert abs(told[-1].measured or 0.0) < 1.0
    assert not any(one.alarm for one in told)
    assert "a test; ramped to 0 V, the monitor reads" in (link.folder / "log.jsonl").read_text()


def test_a_rig_that_is_frozen_is_told_of_until_it_answers(link: Link) -> None:
    rig = walking(link)
    process = number_of(link)
    os.kill(process, signal.SIGSTOP)
    try:
        told: list[StopState] = []
        begun = time.monotonic()
        thread = followed(link, told)
        while not told:
            assert time.monotonic() < begun + 60.0
            time.sleep(0.02)
        assert told[0] == StopState("asked", 0.0, None, UNANSWERED)
        with pytest.warns(RigWarning, match=UNANSWERED), pytest.raises(RigError, match=UNANSWERED):
            link.ask("close", within=1.2)
    finally:
        os.kill(process, signal.SIGCONT)
    thread.join(60.0)
    assert told[-1].state == "measured"
    assert told[-1].alarm == ""
    assert rig.phase


def test_all_rigs_are_told_to_stop_though_one_does_not_answer(link: Link, tmp_path: Path) -> None:
    def told(one: Link) -> bool:
        return "the program ends" in (one.folder / "log.jsonl").read_text()

    other = Link(tmp_path / "other", "a test")
    for one in (link, other):
        walking(one)
    os.kill(number_of(link), signal.SIGSTOP)
    try:
        begun = time.monotonic()
        stop_all(1.0)
        assert time.monotonic() - begun < 4.0
        assert told(other)
        assert not told(link)
    finally:
        os.kill(number_of(link), signal.SIGCONT)
    end = time.monotonic() + 60.0
    while not told(link):  # its request waits until it goes on
        assert time.monotonic() < end
        time.sleep(0.02)
    other.close()


def test_a_process_that_is_gone_proves_nothing(link: Link) -> None:
    walking(link)
    os.kill(number_of(link), signal.SIGKILL)
    told: list[StopState] = []
    needed = [True]
    asked = time.perf_counter()
    thread = threading.Thread(
        target=follow_stop, args=(link.folder, "a test", told.append, lambda: needed[0], asked)
    )
    thread.start()
    while not told:
        time.sleep(0.02)
    assert told[0].alarm == UNANSWERED
    needed[0] = False
    thread.join(60.0)
    assert not thread.is_alive()


class Stuck(VirtualRig):
    """A rig whose amplifier keeps its voltage."""

    def monitor(self) -> float:
        return 42.0


def test_a_monitor_that_still_reads_a_voltage_is_an_error() -> None:
    one = Supervisor(Home(), lambda: None)
    one.rig = Stuck(ACTUATOR, BENCH)
    one.run(Order(Limits(), ("drive",), WALK.size, 0, None, WALK))
    one.stop("a test")
    one.join()
    assert "the amplifier's monitor reads 42 V): switch the amplifier off" in one.stopped["failed"]
    with pytest.raises(StopRequested) as caught:
        one.fetch(0.0)
    assert "reads 42 V" in caught.value.__notes__[0]


class Answering:
    """The rig's process, as far as a stop talks to it: it says these phases one after the other, and the last
    one for ever; "gone" ends the connection."""

    def __init__(self, folder: Path, phases: list[str], stopped: dict[str, object]) -> None:
        self._phases, self._stopped = phases, stopped
        self._listening = socket.create_server(("127.0.0.1", 0))
        port = self._listening.getsockname()[1]
        (folder / "rig.json").write_text(json.dumps({"port": port, "token": "a token", "pid": 1}))
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            link, _ = self._listening.accept()
            with link, suppress(OSError, EOFError):
                receive(link)
                send(link, {"pid": 1})
                receive(link)
                if self._phases[0] == "gone":
                    self._next()
                    continue
                send(link, {"stopped": True})
                receive(link)
                send(link, {"phase": self._phases[0], "stopped": self._stopped})
                self._next()

    def _next(self) -> None:
        self._phases = self._phases[1:] or self._phases


def states(folder: Path, phases: list[str], stopped: dict[str, object]) -> tuple[list[StopState], StopState]:
    """What people are told of a stop, and its end."""
    Answering(folder, phases, stopped)
    told: list[StopState] = []
    end = follow_stop(folder, "a test", told.append, lambda: True, time.perf_counter())
    return told, end


def test_a_stop_goes_through_its_states(tmp_path: Path) -> None:
    told, end = states(tmp_path, ["preparing", "running", "running", "stopping", "gone", "idle"], {})
    assert [one.state for one in told] == ["preparing", "delivered", "ramping", "ramped"]
    assert (end.state, end.measured, end.alarm) == ("ramped", None, "")
    assert 0.0 < end.after < 60.0


def test_a_stop_that_failed_is_an_alarm(tmp_path: Path) -> None:
    failed = "the stop failed (the cable is out): switch the amplifier off"
    told, end = states(tmp_path, ["stopping", "idle"], {"failed": failed})
    assert end.state == "ramped"
    assert told[-1].alarm == failed


def test_a_rig_that_answers_but_does_not_ramp_is_an_alarm(tmp_path: Path) -> None:
    told, _ = states(tmp_path, ["running"] * 60 + ["idle"], {"measured": 0.1})
    alarms = [one for one in told if one.alarm]
    assert alarms[0].state == "delivered"
    assert alarms[0].alarm == UNANSWERED
    assert alarms[0].after > 1.0
    assert (told[-1].state, told[-1].measured, told[-1].alarm) == ("measured", 0.1, "")


def test_where_nothing_goes_on_there_is_nothing_to_stop(tmp_path: Path) -> None:
    told: list[StopState] = []
    assert follow_stop(tmp_path, "a test", told.append, lambda: False, time.perf_counter()) == StopState()
    assert not told
