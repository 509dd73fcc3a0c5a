"""Damaged files of the rig's folder, full disks, wrong rigs of one's own: nothing is lost, and it is told."""

from __future__ import annotations

import errno
import json
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.quantities import registry
from stickslip.recording import open_recording
from stickslip.rig import (
    Capture,
    Channel,
    Home,
    HostedRig,
    LimitError,
    Limits,
    Link,
    Rig,
    RigError,
    VirtualRig,
    armed,
    measure,
)
from stickslip.rig import samples as of_samples
from stickslip.rig.description import own_device
from stickslip.rig.gate import Gate, PositionInput
from stickslip.rig.protocols import Capabilities
from stickslip.rig.reaching import greeted
from stickslip.rig.samples import recover
from stickslip.rig.turns import LoopRig
from stickslip.waveform.periodic import Sawtooth

from rig.laboratory import ACTUATOR, BENCH, IDEAL, INDUCTIVE  # isort: skip

GOOD = {"readings": {"ideal": [1e-6, 2e-6]}, "position": 3e-6, "origin": 4e-6}
HOMES = {
    "cut": json.dumps(GOOD)[:30].encode(),
    "empty": b"",
    "binary": bytes(range(256)),
    "UTF-16": json.dumps(GOOD).encode("utf-16"),
    "another": b"[1, 2]",
    "deep": b"[" * 100_000,
    "NaN": json.dumps(GOOD | {"readings": {"ideal": [float("nan"), 0.0]}}).encode(),
    "infinite": json.dumps(GOOD | {"origin": float("inf")}).encode(),
    "long": json.dumps(GOOD | {"position": 10**400}).encode(),
    "large": b" " * 200_000,
}


@pytest.mark.parametrize("content", HOMES.values(), ids=HOMES)
def test_a_damaged_home_is_refused_for_end_stops_count_from_it(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "home.json"
    assert Home.load(path).readings == {}
    path.write_bytes(content)
    with pytest.raises(
        RigError, match=r"home\.json is damaged \(.*\), and end stops count from what it says"
    ):
        Home.load(path)
    assert path.read_bytes() == content
    path.write_text(json.dumps(GOOD))
    assert Home.load(path).readings == {"ideal": (1e-6, 2e-6)}


def test_files_that_keep_the_rigs_process_from_starting_are_named(tmp_path: Path) -> None:
    (tmp_path / "home.json").mkdir()
    with pytest.raises(RigError, match=r"ended at once \(1\): .*home\.json is damaged \(no plain file"):
        Link(tmp_path, "a test")
    (tmp_path / "home.json").rmdir()
    (tmp_path / "rig.json").mkdir()
    with pytest.raises(RigError, match=r"Is a directory: .*rig\.json"):
        Link(tmp_path, "a test")
    (tmp_path / "rig.log").unlink()
    (tmp_path / "rig.log").mkdir()
    with pytest.raises(OSError, match=r"rig\.log"):
        Link(tmp_path, "a test")


@pytest.mark.parametrize(
    "content",
    [
        *(b"", b"[1]", b"null", b"3", b'"x"', b"[" * 100_000, bytes(range(256))),
        *(b'{"port": 1}', b'{"token": "x", "port": null}', b'{"token": "x", "port": 99999999}'),
        *(b'{"token": "x", "port": Infinity}', b'{"token": "x", "port": 1' + b"0" * 400 + b"}"),
    ],
)
def test_where_a_damaged_file_says_that_a_process_is_there_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "rig.json").write_bytes(content)
    assert greeted(tmp_path, "a test") is None


def test_a_pipe_holds_nobody_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "rig.json")
    asked = threading.Thread(target=greeted, args=(tmp_path, "a test"), daemon=True)
    asked.start()
    asked.join(60.0)
    assert not asked.is_alive()


CAN = Capabilities("a rig", 1e3, 1e3, 0.0, 100.0, 1e-3, 10_000, {"gauge": "V"})


class Constant:
    """A rig whose gauge reads 0 V, and then something else."""

    capabilities = CAN

    def __init__(self, reading: float) -> None:
        self.reading = reading

    def load(self, volts: np.ndarray) -> None: ...

    def arm(self, inputs: tuple[str, ...], samples: int) -> None: ...

    def begin(self, inputs: tuple[str, ...]) -> list[float]:
        return [0.0]

    def exchange(self, volts: float) -> list[float]:
        return [self.reading]

    def step(self, measured: float, target: float, tick: int) -> float:
        return 0.0


@pytest.mark.parametrize("reading", [1e77, -1e300])
def test_a_position_that_is_no_number_is_beyond_each_end_stop(reading: float) -> None:
    """Two calibrations of order five make nan of a reading that is finite."""
    rig: Any = Constant(reading)
    position = PositionInput("gauge", INDUCTIVE)
    limits = Limits(min_position=-1e-6, max_position=1e-6)
    gate = Gate(rig, limits, CAN)
    gate.load(np.zeros(10))
    gate.arm(("gauge",), 10, position, 2)
    gate.take(np.zeros((1, 3)))
    said = r"the input 'gauge' reads .*e\+.*, from which comes a position of (nan|-?inf): stopped"
    with pytest.raises(LimitError, match=said):
        gate.take(np.full((1, 3), reading))
    home = Home()
    loop = LoopRig(rig, rig, position, home, limits)
    loop.load(np.zeros(10))
    loop.arm(("gauge",), 10)
    loop.start()
    assert loop.fetch().shape == (1, 1)
    with pytest.raises(LimitError, match=said):
        loop.fetch()
    assert home.position == 0.0


@pytest.mark.parametrize("block", [None, "late", [[0.0]], np.zeros(3), np.zeros((2, 3))])
def test_what_a_rig_gives_must_be_samples(block: Any) -> None:
    rig: Any = Constant(0.0)
    gate = Gate(rig, Limits(), CAN)
    gate.arm(("gauge",), 10)
    with pytest.raises(RigError, match=r"a rig: fetch gave .*, not an array \[1, n\]"):
        gate.take(block)


OWN = """
import numpy as np
from stickslip.quantities import registry
from stickslip.rig import Capabilities, RigError


@registry.rigs.add
class Wrong:
    def __init__(self, at=""):
        self.at = at
        rates = np.float32(1e3), np.int64(1000)
        self.capabilities = Capabilities("wrong", *rates, 0.0, 100.0, 1e-3, np.int64(100_000), {"drive": "V"})
        self.fail("init")

    def fail(self, at):
        if at in self.at.split():
            raise {"Exit": SystemExit, "Rig": RigError}.get(self.at.split()[-1], ValueError)("it is " + at)

    def load(self, volts): self.fail("load")
    def arm(self, inputs, samples): self.samples = samples
    def start(self): self.fail("start")

    def fetch(self):
        self.fail("fetch")
        return np.random.default_rng(1).random((1, self.samples))

    def stop(self, slew): self.fail("stop")
    def close(self): self.fail("close")
    def told(self, runs): return {"gain": object() if "odd" in self.at else np.float32(3)}
"""


def test_rigs_of_ones_own_that_are_wrong(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    kind = registry.rigs.find(f"{tmp_path / 'own.py'}:Wrong")
    drive, capture = Sawtooth(65.0, 20.0, rise_fraction=0.8), Capture(0.1, 1e-3, 0.02)

    def recorded(link: Link, at: str) -> Any:
        rig: Rig = HostedRig(link, own_device(kind, {"at": at}))
        with armed("a test"):
            return measure(
                rig, drive, {"drive_voltage": Channel("drive")}, capture, Limits(max_voltage=100.0)
            )

    link, other = Link(tmp_path / "rig", "a test"), Link(tmp_path / "rig", "another")
    assert recorded(link, "").attrs["gain"] == 3.0  # its numbers are NumPy's
    for at, said in (
        ("stop", "it is stop"),  # all samples are there, but not known to be at 0 V
        ("stop Rig", "it is stop"),
        ("close stop", "it is stop"),
        ("init", "it is init"),
        ("init Exit", "it is init"),
        ("fetch Exit", "it is fetch"),
        ("fetch stop", "it is fetch.*The stop failed too .it is stop.: switch the amplifier off"),
        ("odd", "<object .* is no text, number or list"),
    ):
        with pytest.raises(RigError, match=said) as caught:
            recorded(link, at)
        assert str(caught.value).count("stop failed too") <= 1
        assert not getattr(caught.value, "__notes__", [])
        if link.ask("state")[0]["interlock"]["state"] == "fault":  # not of one that was not even opened
            link.ask("acknowledge", why="it was meant")
        assert recorded(other, "").attrs["outcome"] == "complete"  # nobody holds it
        recorded(other, "close")
    link.close()
    other.close()


class Failed(RigError):
    """What ends a run."""


def stopped(doing: str, done: float) -> None:
    if done > 0.5:
        raise Failed("the cable is out")


def test_what_there_is_of_a_run_has_the_room_that_was_kept_for_it(tmp_path: Path, monkeypatch: Any) -> None:
    """A disk with room for the run and no more."""
    kept = []

    def saved(recording: Any, target: Path) -> Path:
        kept.extend(file.stat().st_size for file in tmp_path.glob(".walk.*.samples"))
        return save(recording, target)

    save = of_samples.save_recording
    monkeypatch.setattr(of_samples, "save_recording", saved)
    rig, drive = VirtualRig(ACTUATOR, BENCH), Sawtooth(65.0, 20.0)
    with pytest.raises(Failed) as caught:
        measure(rig, drive, IDEAL, Capture(1.0, 1e-3), Limits(), save=tmp_path / "walk.nc", progress=stopped)
    assert 2 * 8 * 10_000 < kept[0] < 2 * 8 * 12_000, "half of the run's 20,000 samples"
    assert caught.value.kept == tmp_path / "unfinished" / "walk.nc"  # type: ignore[attr-defined]
    assert not list(tmp_path.glob(".*"))


def test_samples_that_do_not_become_a_recording_are_left(tmp_path: Path, monkeypatch: Any) -> None:
    def full(recording: Any, target: Path) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device", str(target))

    rig, drive = VirtualRig(ACTUATOR, BENCH), Sawtooth(65.0, 20.0)
    with monkeypatch.context() as patched:
        patched.setattr(of_samples, "save_recording", full)
        for _ in range(2):
            with pytest.raises(Failed) as caught:
                measure(
                    rig, drive, IDEAL, Capture(1.0, 1e-3), Limits(), save=tmp_path / "a.nc", progress=stopped
                )
            assert "could not be saved, its samples are left" in caught.value.__notes__[0]
    made = recover(tmp_path)
    assert [path.relative_to(tmp_path).as_posix() for path in made] == [
        "unfinished/a.nc",
        "unfinished/a-2.nc",
    ]
    recording = open_recording(made[0])
    assert recording.sizes["time"] > 400
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize(
    ("count", "text"), [(5, b"[" * 100_000), (5, b'{"capture": "x"}'), (2**62, b"{}"), (5, b"[1]")]
)
def test_samples_that_cannot_be_read_are_left_as_they_are(tmp_path: Path, count: int, text: bytes) -> None:
    path = tmp_path / ".walk.0123456789abcdef.samples"
    path.write_bytes(of_samples._HEAD.pack(count, len(text)) + text + bytes(800))
    assert recover(tmp_path) == []
    assert path.exists()


def test_a_run_is_known_by_its_identity_and_its_lock_not_by_numbers_and_times(tmp_path: Path) -> None:
    """A number of a process that is in use again, and a clock that was set back, lose nothing."""
    capture, made = Capture(0.2, 1e-3), []
    rig, drive = VirtualRig(ACTUATOR, BENCH), Sawtooth(65.0, 20.0)

    def kept(_doing: str, done: float) -> None:
        """What the disk would hold had the program been killed now; nobody takes it while it goes on."""
        if done > 0.5 and not made:
            (samples,) = tmp_path.glob(".a.*.samples")
            assert recover(tmp_path, 0.0) == []
            made.append((samples.name, samples.read_bytes()))

    finished = measure(rig, drive, IDEAL, capture, Limits(), save=tmp_path / "a.nc", progress=kept)
    name, content = made[0]
    assert name == f".a.{finished.attrs['run_id']}.samples"
    own, other = tmp_path / name, tmp_path / ".a.0123456789abcdef.samples"
    for one in (own, other):
        one.write_bytes(content)
        os.utime(one, (1.0, 1.0))  # long before the recording
    (recovered,) = recover(tmp_path)
    assert open_recording(recovered).attrs["run_id"] == "0123456789abcdef", "that of no recording"
    assert not own.exists(), "its recording is there"
    assert not other.exists()
    assert recover(tmp_path) == []
