"""Heartbeat: a run ends when its operator falls silent. All real processes."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from stickslip.quantities.units import QuantityError
from stickslip.recording import open_recording
from stickslip.rig import Home, HostedRig, Limits, Link, VirtualRig, measure
from stickslip.rig.order import Order
from stickslip.rig.protocols import StopRequested
from stickslip.rig.site import Site
from stickslip.rig.supervisor import Supervisor

from rig.laboratory import ACTUATOR, BENCH, IDEAL  # isort: skip
from rig.test_host import DRIVE, LONG, device, idle  # isort: skip

HEARTBEAT = 1.0  # s, long enough for a busy machine
LIMITS = Limits(heartbeat=HEARTBEAT, watchdog=60.0)
PAGE = """
import sys, time
from pathlib import Path
from stickslip.rig import Link

link = Link(Path(sys.argv[1]), "a page")
while True:
    link.ask("beat")
    print("beat", flush=True)
    time.sleep(0.05)
"""
PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, "tests")
from rig.test_heartbeat import LIMITS
from rig.test_host import DRIVE, LONG, device
from rig.laboratory import IDEAL
from stickslip.rig import HostedRig, Link, measure

rig = HostedRig(Link(Path(sys.argv[1]), "a script"), device(True))
tell = lambda doing, done: print(done, flush=True)
measure(rig, DRIVE, IDEAL, LONG, LIMITS, save=Path(sys.argv[2]), progress=tell)
"""


def started(program: str, *arguments: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_page_that_falls_silent_ends_the_run_which_is_kept(tmp_path: Path, how: signal.Signals) -> None:
    folder, silent_from = tmp_path / "rig", list[float]()
    link = Link(folder, "a panel")
    with started(PAGE, folder) as page:
        assert page.stdout is not None
        assert page.stdout.readline()
        rig = HostedRig(link, device(True))
        rig.operated = True

        def silence(_doing: str, done: float) -> None:
            if done * LONG.length > 2.0 * HEARTBEAT and not silent_from:
                os.kill(page.pid, how)
                silent_from.append(done * LONG.length)

        try:
            with pytest.raises(StopRequested, match="the operator's page fell silent for") as caught:
                measure(rig, DRIVE, IDEAL, LONG, LIMITS, save=tmp_path / "run.nc", progress=silence)
        finally:
            page.kill()
    said = re.search(r"silent for ([\d.]+) s", str(caught.value))
    assert said is not None
    assert HEARTBEAT <= float(said[1]) < 2.0 * HEARTBEAT
    kept = open_recording(tmp_path / "unfinished" / "run.nc")
    assert kept.attrs["outcome"] == f"stopped: {caught.value}"
    assert float(kept["time"][-1]) >= silent_from[0], "it went on while the page was there"
    state = link.ask("state")[0]
    assert state["stopped"]["measured"] == pytest.approx(0.0, abs=0.1)
    assert not state["interlock"]["fault"]
    link.close()


def test_a_program_that_falls_silent_has_its_run_ended(tmp_path: Path) -> None:
    link = Link(tmp_path / "rig", "a test")
    with started(PROGRAM, tmp_path / "rig", tmp_path / "run.nc") as program:
        assert program.stdout is not None
        while float(program.stdout.readline() or "nan") <= 0.03:
            pass
        program.send_signal(signal.SIGSTOP)
        idle(link)  # long before the watchdog
        program.send_signal(signal.SIGCONT)
        _, said = program.communicate(timeout=300)
    assert "the program fell silent for" in said
    outcome = open_recording(tmp_path / "unfinished" / "run.nc").attrs["outcome"]
    assert outcome.startswith("stopped: the program fell silent for")
    link.close()


def test_signs_of_life_keep_a_run_and_their_end_ends_it_without_a_fault() -> None:
    one = Supervisor(Home(), lambda: None)
    one.rig = VirtualRig(ACTUATOR, BENCH, real_time=True)
    limits = Limits(heartbeat=HEARTBEAT, watchdog=60.0)
    one.run(Order(limits, ("ideal",), 200_000, 100, None, np.full(200_000, 20.0), operated=True))
    while one.phase == "preparing":
        one.fetch(0.1)
    end = time.monotonic() + 2.0 * HEARTBEAT
    while time.monotonic() < end:
        one.fetch(0.1)
        one.beat()
    assert one.busy
    one.join()
    with pytest.raises(StopRequested, match="the operator's page fell silent"):
        _ = [one.fetch(0.0), one.fetch(0.0)]
    assert one.interlock.state()["state"] == "disarmed"


def test_a_site_can_ask_for_a_heartbeat_and_none_is_shorter_than_a_page_can_keep() -> None:
    assert Site({"heartbeat": 0.3}).narrowed(Limits()).heartbeat == 0.3
    assert Site({"heartbeat": 0.3}).narrowed(Limits(heartbeat=0.2)).heartbeat == 0.2
    with pytest.raises(QuantityError, match="heartbeat"):
        Limits(heartbeat=0.1)
