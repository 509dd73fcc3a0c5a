"""Why the process that reads files ended decides what is said, and what is remembered."""

from __future__ import annotations

import os
import random
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

import gate.acts as acts
from stickslip.gate.errors import GateBusy, GateError
from stickslip.gate.process import Fence


@pytest.fixture
def fence(monkeypatch: pytest.MonkeyPatch) -> Iterator[Fence]:
    monkeypatch.setenv("PYTHONPATH", str(Path(acts.__file__).parents[1]), prepend=os.pathsep)
    made = Fence()
    yield made
    made.close()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "file.nc"
    path.write_bytes(b"12345")
    return path


def tried(fence: Fence, act: Callable[[Path], object], file: Path) -> GateError:
    with pytest.raises(GateError) as refused:
        fence(act, file, 0.5, 100 * 2**20)
    return refused.value


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (acts.compute, "within 0 s of computing"),
        (acts.allocate, "takes more than the 100 MiB"),
        (partial(acts.end, number=signal.SIGSEGV), r"crashed .* \(SIGSEGV\)"),
        (partial(acts.end, number=signal.SIGABRT), r"crashed .* \(SIGABRT\)"),
    ],
    ids=["computing", "memory", "SIGSEGV", "SIGABRT"],
)
def test_what_is_the_fault_of_a_file_is_remembered_until_it_changes(
    fence: Fence, file: Path, act: Callable[[Path], object], said: str
) -> None:
    for what in (act, acts.size):
        error = tried(fence, what, file)
        assert not isinstance(error, GateBusy)
        assert re.search(said, str(error))
    file.write_bytes(b"1234567")
    assert fence(acts.size, file, 5.0, 100 * 2**20) == 7


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (partial(acts.end, number=signal.SIGKILL), "SIGKILL"),
        (partial(acts.end, number=signal.SIGTERM), "SIGTERM"),
        (acts.leave, "exit code 3"),
    ],
    ids=["SIGKILL", "SIGTERM", "exit"],
)
def test_an_end_from_outside_says_nothing_of_the_file(
    fence: Fence, file: Path, act: Callable[[Path], object], said: str
) -> None:
    for _ in range(2):
        error = tried(fence, act, file)
        assert isinstance(error, GateBusy)
        assert said in str(error)
    assert fence(acts.size, file, 5.0, 100 * 2**20) == 5


def test_no_memory_in_the_machine_is_no_fault_of_the_file(fence: Fence, file: Path) -> None:
    """A function that may have more than there is, and is refused less."""
    with pytest.raises(GateBusy, match="the machine has no memory"):
        fence(acts.refused, file, 5.0, 2**62)
    assert fence(acts.size, file, 5.0, 100 * 2**20) == 5


def test_errors_of_the_function_come_as_they_are(fence: Fence, file: Path) -> None:
    with pytest.raises(FileNotFoundError, match="gone"):
        fence(acts.missing, file, 5.0, 100 * 2**20)
    with pytest.raises(GateError, match="Odd: 5"):
        fence(acts.odd, file, 5.0, 100 * 2**20)


def test_killed_at_any_instant(fence: Fence, tmp_path: Path) -> None:
    """As the system does it when memory is short: each file is read, or may be tried again."""
    files = [tmp_path / f"{i}.nc" for i in range(4)]
    for i, file in enumerate(files):
        file.write_bytes(bytes(i))
    ended, draw = threading.Event(), random.Random(3)

    def kill() -> None:
        while not ended.wait(draw.uniform(0.0, 0.4)):
            process = fence._process
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    until, busy = time.monotonic() + 3.0, 0
    while time.monotonic() < until:
        for i, file in enumerate(files):
            try:
                assert fence(acts.slow_size, file, 5.0, 100 * 2**20) == i
            except GateBusy:
                busy += 1
    ended.set()
    killer.join()
    assert busy > 0
    assert [fence(acts.size, file, 5.0, 100 * 2**20) for file in files] == [0, 1, 2, 3]


def test_it_is_gone_when_its_owner_is(fence: Fence, file: Path) -> None:
    number = fence(acts.process, file, 5.0, 100 * 2**20)
    fence.close()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


def test_a_file_that_becomes_shorter_while_it_is_read_is_tried_again(fence: Fence, file: Path) -> None:
    """The process ends by SIGBUS: the sentence says why, and nothing is remembered of the file."""
    error = tried(fence, acts.cut, file)
    assert isinstance(error, GateBusy)
    assert str(error) == f"{file}: it became shorter while it was read; is it being written? Try again"
    file.write_bytes(b"whole again")
    assert fence(acts.size, file, 5.0, 2**28) == 11


def test_a_relative_path_is_of_the_folder_that_its_owner_works_in(
    fence: Fence, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also after the owner has gone to another folder."""
    fence(acts.size, file, 0.5, 100 * 2**20)
    monkeypatch.chdir(file.parent)
    assert fence(acts.size, Path(file.name), 0.5, 100 * 2**20) == 5


def test_modules_are_imported_outside_the_limits_of_a_file(fence: Fence, file: Path) -> None:
    """OpenBLAS, which comes with SciPy, asks for memory again and again where a limit refuses it."""
    act = partial(acts.imported, name="scipy.linalg")
    assert not fence(act, file, 5.0, 10 * 2**20)
    ready = Fence(["scipy.linalg", "no_such_module"])
    try:
        ready.start()
        assert ready(act, file, 0.5, 10 * 2**20)
    finally:
        ready.close()
