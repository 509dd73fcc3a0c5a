"""The rig's process: what it does when its clients die, stall or meet, and when it dies itself. All real
processes."""

from __future__ import annotations

import gc
import json
import os
import re
import select
import signal
import socket
import stat
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from stickslip.recording import open_recording
from stickslip.rig import Capture, HostedRig, LimitError, Limits, Link, RigError, VirtualRig, measure
from stickslip.rig.description import virtual_device
from stickslip.rig.host import Host
from stickslip.rig.lock import own_folder
from stickslip.rig.order import Order
from stickslip.rig.samples import complete, recover
from stickslip.waveform.periodic import Sawtooth

from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip

DRIVE, CAPTURE = Sawtooth(65.0, 20.0), Capture(0.3, 1e-3, 0.02)
LONG = Capture(20.0, 1e-3, 0.02)

CLIENT = """
import sys
from pathlib import Path
sys.path.insert(0, "tests")
from rig.test_host import DRIVE, LONG, device
from rig.laboratory import IDEAL
from stickslip.rig import HostedRig, Limits, Link, measure

def tell(doing, done):
    print(done, flush=True)

rig = HostedRig(Link(Path(sys.argv[1]), "a script"), device(True))
measure(rig, DRIVE, IDEAL, LONG, Limits(watchdog=float(sys.argv[3])), save=Path(sys.argv[2]), progress=tell)
"""


def device(real_time: bool = False, seed: int = 3) -> dict:
    return virtual_device(ACTUATOR, "kang2007-bench", seed, real_time)


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Link]:
    made = Link(tmp_path / "rig", "a test")
    yield made
    made.close()


@contextmanager
def client(folder: Path, target: Path, watchdog: float = 60.0) -> Iterator[subprocess.Popen[str]]:
    """A program that runs a long recording; gives it once samples come."""
    command = [sys.executable, "-c", CLIENT, str(folder), str(target), str(watchdog)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            while float(process.stdout.readline() or "nan") <= 0.03:
                pass
            yield process
        finally:
            process.kill()


def idle(link: Link) -> None:
    """Wait until nothing runs."""
    begun = time.monotonic()
    while link.ask("state")[0]["phase"] != "idle":
        assert time.monotonic() - begun < 300.0, "it goes on"
        time.sleep(0.005)


def number_of(link: Link) -> int:
    return json.loads((link.folder / "rig.json").read_text())["pid"]


def test_what_it_records_is_what_the_rig_itself_does_bit_for_bit(link: Link) -> None:
    capture = CAPTURE._replace(average=2)
    far = measure(HostedRig(link, device()), DRIVE, CHANNELS, capture, Limits())
    near = measure(VirtualRig(ACTUATOR, BENCH, seed=3), DRIVE, CHANNELS, capture, Limits())
    for name in CHANNELS:
        np.testing.assert_array_equal(far[name], near[name])


def test_a_rig_that_was_stopped_is_given_back_when_the_next_is_opened(tmp_path: Path) -> None:
    """Its samples are 100 MB and more; the error that ended its run holds it."""
    host = Host(tmp_path)
    one = host.supervisor
    gc.disable()
    try:
        host._open(device(), False)
        held = weakref.ref(one.rig)
        one.run(Order(Limits(), ("drive",), 20_000, 200, None, np.zeros(20_000)))
        assert one.stop("a test")
        one.join()
        host._open(device(), False)
        for _ in range(500):  # the thread that watches the run lets go of the rig when it next looks
            if held() is None:
                break
            time.sleep(0.02)
        assert held() is None
    finally:
        gc.enable()


def test_a_program_that_is_killed_has_its_run_stopped_and_its_samples_kept(
    link: Link, tmp_path: Path
) -> None:
    target = tmp_path / "long.nc"
    with client(link.folder, target) as program:
        assert link.ask("state")[0]["holder"].startswith(f"a script (process {program.pid})")
        program.kill()
        idle(link)
    recovered = recover(tmp_path)
    assert [path.relative_to(tmp_path).as_posix() for path in recovered] == ["unfinished/long.nc"]
    kept = open_recording(recovered[0])
    assert kept.attrs["outcome"] == "stopped: the program was killed"
    assert kept.sizes["time"] > 100
    assert not target.exists()
    assert recover(tmp_path) == []
    link.ask("open", device=device(), again=False)  # and others may have the rig


@pytest.mark.parametrize("size", [0, 7])
def test_a_program_that_is_killed_before_its_file_of_samples_says_anything(tmp_path: Path, size: int) -> None:
    begun = tmp_path / ".walk.0123456789abcdef.samples"
    begun.write_bytes(b"\0" * size)
    with pytest.raises(OSError, match="was begun, and no more"):
        complete(begun, 0, np.zeros((1, 3)))
    assert recover(tmp_path) == []
    assert not begun.exists()


def test_a_program_that_is_killed_while_samples_are_under_way_loses_none(link: Link, tmp_path: Path) -> None:
    """It stops taking them in, then dies: the rig's process stores what it had not."""
    target = tmp_path / "long.nc"
    with client(link.folder, target) as program:
        program.send_signal(signal.SIGSTOP)
        (samples,) = tmp_path.glob(".long.*.samples")
        before = int.from_bytes(samples.read_bytes()[:8], "little")
        time.sleep(0.5)
        program.kill()
        program.wait()
        while link.ask("state")[0]["holder"]:
            time.sleep(0.01)
    assert int.from_bytes(samples.read_bytes()[:8], "little") > before + 8000
    kept = open_recording(*recover(tmp_path))
    near = measure(VirtualRig(ACTUATOR, BENCH, seed=3), DRIVE, IDEAL, LONG, Limits())
    count = kept.sizes["time"]
    for name in IDEAL:
        np.testing.assert_array_equal(kept[name], near[name][:count])


def test_a_program_that_stalls_has_its_run_stopped(link: Link, tmp_path: Path) -> None:
    with client(link.folder, tmp_path / "long.nc", 3.0) as program:
        program.send_signal(signal.SIGSTOP)
        idle(link)
        program.send_signal(signal.SIGCONT)
        _, said = program.communicate(timeout=300)
        silent = re.search(r"watchdog: the program that runs it has been silent for ([\d.]+) s", said)
        assert silent is not None, said
        assert float(silent[1]) >= 3.0
    kept = list((tmp_path).glob(".long.*"))
    assert program.returncode == 1
    assert not kept


def test_a_program_whose_rig_dies_keeps_what_it_has(link: Link) -> None:
    def kill(_doing: str, done: float) -> None:
        if done > 0.03:
            os.kill(number_of(link), signal.SIGKILL)

    people_are_told = "the rig's process has ended.*switch the amplifier off"
    with pytest.raises(RigError, match=people_are_told) as caught:
        measure(HostedRig(link, device(True)), DRIVE, IDEAL, LONG, Limits(), progress=kill)
    kept = caught.value.recording  # type: ignore[attr-defined]
    assert kept.sizes["time"] > 100
    again = Link(link.folder, "a test")  # another one takes its place
    measure(HostedRig(again, device()), DRIVE, IDEAL, CAPTURE, Limits())
    again.close()


def test_a_rig_that_freezes_ends_the_run_and_people_are_told(link: Link) -> None:
    frozen: list[float] = []

    def freeze(_doing: str, done: float) -> None:
        if done > 0.03 and not frozen:
            os.kill(number_of(link), signal.SIGSTOP)
            frozen.append(time.monotonic())

    limits = Limits(watchdog=1.0)
    try:
        with pytest.raises(RigError, match="the rig does not answer: switch the amplifier off") as caught:
            measure(HostedRig(link, device(True)), DRIVE, IDEAL, LONG, limits, progress=freeze)
        assert time.monotonic() - frozen[0] >= limits.watchdog
        assert caught.value.recording.sizes["time"] > 100  # type: ignore[attr-defined]
    finally:
        os.kill(number_of(link), signal.SIGKILL)


def test_home_is_known_to_the_next_process(link: Link) -> None:
    limits = Limits(max_position=30e-6)
    rig = HostedRig(link, device())
    measure(rig, DRIVE, IDEAL, CAPTURE, limits)
    assert rig.position is not None
    assert 10e-6 < rig.position < 30e-6
    # Killed: what is known was written when the run ended, and the end-effector is where it is.
    os.kill(number_of(link), signal.SIGKILL)
    again = Link(link.folder, "a test")
    assert again.ask("state")[0]["position"] == rig.position
    assert rig.position < 30e-6
    far = DRIVE._replace(periods=None)
    with pytest.raises(LimitError, match=r"at 3\d\.\d+ µm from home"):
        measure(HostedRig(again, device()), far, IDEAL, CAPTURE._replace(length=1.5), limits)
    again.close()


def test_two_programs_and_a_stop_by_whoever_is_there(link: Link, tmp_path: Path) -> None:
    with client(link.folder, tmp_path / "long.nc") as program:
        with pytest.raises(RigError, match=rf"held by a script \(process {program.pid}\), since \d\d:"):
            HostedRig(link, device())
        assert link.ask("stop", why="the other operator")[0]["stopped"]
        idle(link)
        assert program.wait(300) == 1
    assert not (tmp_path / "long.nc").exists()


def test_only_who_has_the_token_is_heard(link: Link) -> None:
    known = link.folder / "rig.json"
    assert stat.S_IMODE(known.stat().st_mode) == 0o600
    said = json.loads(known.read_text())
    for token in ("", "0" * 64, None):
        with socket.create_connection(("127.0.0.1", said["port"]), timeout=60.0) as other:
            text = json.dumps({"do": "hello", "token": token, "shape": [0]}).encode()
            other.sendall(len(text).to_bytes(4, "little") + text)
            assert other.recv(100) == b""


def test_silent_connections_are_let_go_and_stand_before_no_stop(link: Link) -> None:
    port = json.loads((link.folder / "rig.json").read_text())["port"]
    silent = [socket.create_connection(("127.0.0.1", port), timeout=60.0) for _ in range(60)]
    other = Link(link.folder, "a stop")
    assert other.ask("stop")[0] == {"stopped": False}
    assert not all(lost(one) for one in silent), "while others still wait"
    assert link.ask("state")[0]["phase"] == "idle"
    assert all(one.recv(1) == b"" for one in silent), "silent ones are let go"
    other.close()
    for one in silent:
        one.close()


def lost(link: socket.socket) -> bool:
    """Whether the other end has closed a connection."""
    return bool(select.select([link], [], [], 0.0)[0])


def test_a_folder_that_others_can_reach_or_own_is_refused_by_name(tmp_path: Path) -> None:
    """Whoever makes it first could answer as the rig."""
    folder = tmp_path / "rig"
    folder.mkdir()
    folder.chmod(0o755)
    with pytest.raises(RigError, match=f"{folder} is not used: other users can reach it.*chmod 700"):
        Link(folder, "a test")
    with pytest.raises(OSError, match="other users can reach it"):
        own_folder(folder)
    if os.geteuid() == 0:  # nobody else can give a folder away
        folder.chmod(0o700)
        os.chown(folder, 12345, -1)
        with pytest.raises(RigError, match=f"{folder} is not used: it is of the user 12345"):
            Link(folder, "a test")
    assert not list(folder.iterdir())
    assert own_folder(tmp_path / "new" / "rig").stat().st_mode & 0o777 == 0o700


def test_it_ends_when_nobody_is_there(tmp_path: Path) -> None:
    link = Link(tmp_path / "rig", "a test")
    process = number_of(link)
    link.close()
    end = time.monotonic() + 300.0
    while (tmp_path / "rig" / "rig.json").exists():
        assert time.monotonic() < end
        time.sleep(0.1)
    while os.waitpid(process, os.WNOHANG)[0] == 0:
        assert time.monotonic() < end
        time.sleep(0.05)


def test_nonsense_is_refused_and_it_stays(link: Link) -> None:
    for do, what in [
        ("sing", {}),
        ("open", {"device": {"kind": "hammer"}, "again": False}),
        ("open", {"device": {}, "again": False}),
        ("fetch", {"wait": "long"}),
        ("run", {"limits": {"max_voltage": "much"}, "inputs": [], "samples": 0, "rest": 0, "position": None}),
        (
            "open",
            {
                "device": {
                    "kind": "own",
                    "rig": "redpitaya",
                    "options": {"host": "127.0.0.1", "port": 1, "gain": 1.0, "inputs": {"gauge": 1}},
                },
                "again": False,
            },
        ),
    ]:
        with pytest.raises((RigError, ValueError)):
            link.ask(do, np.zeros(3), **what)
    measure(HostedRig(link, device()), DRIVE, IDEAL, CAPTURE, Limits())


def test_it_is_a_limit_that_refuses_not_the_client(link: Link) -> None:
    """A client that asks for more than the limits it names: the process looks itself."""
    link.ask("open", device=device(), again=False)
    order = {"limits": Limits(max_voltage=50.0)._asdict(), "inputs": ["drive"], "samples": 100, "rest": 0}
    link.ask("run", np.full(100, 60.0), position=None, **order)
    idle(link)
    with pytest.raises(LimitError, match="reaches 60 V"):
        link.ask("fetch", wait=0.5)
