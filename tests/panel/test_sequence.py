"""What happens between a sequence, its runs and requests, in an order that the test decides; no rig."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from stickslip.panel import running
from stickslip.panel.folder import Folder
from stickslip.panel.journal import Journal
from stickslip.panel.live import Live
from stickslip.panel.running import BenchJob, Runner
from stickslip.panel.sequence import Item, QueuedRun, RunSequence, Sequencer
from stickslip.panel.statistics import Statistics

from .conftest import PATIENCE
from .test_stream import Listening

HOUR = 3600.0  # s


class Runs:
    """Stands for the runner and the starter: a run that begins ends when the test says so."""

    def __init__(self) -> None:
        self.also_stop: list[Callable[[], bool]] = []
        self.state: dict[str, Any] = {"phase": "idle"}
        self.busy = self.queued = False
        self.begun, self.end = threading.Semaphore(0), threading.Semaphore(0)

    def start(self, content: dict[str, Any], title: str, slug: str) -> str:
        self.begun.release()
        return title

    def join(self, most: float) -> None:
        assert self.end.acquire(timeout=PATIENCE)
        self.state = {"phase": "done"}


class Rests(Listening):
    """A hub on which one can wait for the rest after a run: it says what is left beside it."""

    def __init__(self) -> None:
        super().__init__()
        self.resting = threading.Event()

    def tell(self, kind: str, **fields: Any) -> None:
        super().tell(kind, **fields)
        if fields.get("left") == HOUR:
            self.resting.set()


class Begun(NamedTuple):
    runs: Runs
    hub: Rests
    sequencer: Sequencer

    def ended(self) -> tuple[str, str]:
        """How, once it has."""
        assert self.sequencer._thread is not None
        self.sequencer._thread.join(PATIENCE)
        return self.sequencer.state["phase"], self.sequencer.state["said"]


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> Iterator[Begun]:
    """A sequence of two runs with an hour between them."""
    runs, hub = Runs(), Rests()
    made = Sequencer(hub, None, runs, runs)  # type: ignore[arg-type]
    monkeypatch.setattr(made, "steps", lambda asked: [QueuedRun({"runs": [{}]}, "step", 0.0, HOUR)] * 2)
    monkeypatch.setattr("stickslip.panel.sequence._left", lambda steps, overhead: 0.0)
    made.start(RunSequence(items=[Item(run="step")]))
    yield Begun(runs, hub, made)
    runs.end.release(2)
    made.join()


def test_the_run_that_goes_on_is_the_last(begun: Begun) -> None:
    assert begun.runs.begun.acquire(timeout=PATIENCE)
    begun.sequencer.end_after()
    state = begun.sequencer.state
    assert (state["phase"], state["said"]) == ("running", "ends after this run")
    begun.runs.end.release()
    assert begun.ended() == ("ended", "ended after 1 of 2")
    begun.sequencer.end_after()  # nothing goes on
    assert begun.ended() == ("ended", "ended after 1 of 2")


def test_between_two_runs_it_ends_at_once(begun: Begun) -> None:
    """The rest takes an hour."""
    begun.runs.end.release()
    assert begun.hub.resting.wait(PATIENCE)
    begun.sequencer.end_after()
    assert begun.ended() == ("ended", "ended after 1 of 2")
    assert not begun.runs.queued


def test_a_stop_at_the_end_of_a_run_does_not_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It found a run that was going on, which then ended, before it could say that the run stops."""
    hub, going = Listening(), threading.Event()
    journal = Journal(hub, Folder(tmp_path))
    statistics = Statistics(hub, journal, tmp_path)
    runner = Runner(hub, Live(hub), journal, tmp_path, None, statistics)  # type: ignore[arg-type]
    monkeypatch.setattr(running, "rigs_of", lambda *_: tmp_path)
    monkeypatch.setattr(runner, "reach", lambda folder: SimpleNamespace(folder=tmp_path))

    def loop(progress: object) -> None:
        going.wait(PATIENCE)

    runner.start(BenchJob("Move", None, tmp_path, tmp_path, [], loop=loop))  # type: ignore[arg-type]

    def late() -> float:
        going.set()
        runner.join(0.3)  # which it does not reach, where it waits for the stop
        return 0.0

    monkeypatch.setattr(running, "time", SimpleNamespace(perf_counter=late, monotonic=time.monotonic))
    runner.stop("stop")
    runner.join(PATIENCE)
    assert runner.state["phase"] == "done"


def test_a_run_may_last_longer_than_one_wait_for_its_end() -> None:
    runs, waits = Runs(), list[float]()
    runs.busy = True

    def join(most: float) -> None:
        waits.append(most)
        runs.busy = len(waits) < 3
        runs.state = {"phase": "running" if runs.busy else "done"}

    runs.join = join  # type: ignore[method-assign]
    made = Sequencer(Rests(), None, runs, runs)  # type: ignore[arg-type]
    assert made._ended(lambda: None) == "done"
    assert len(waits) == 4


def test_a_runner_is_free_again_whatever_fails_at_the_end_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub = Listening()
    journal = Journal(hub, Folder(tmp_path))
    statistics = Statistics(hub, journal, tmp_path)
    runner = Runner(hub, Live(hub), journal, tmp_path, None, statistics)  # type: ignore[arg-type]
    monkeypatch.setattr(running, "rigs_of", lambda *_: tmp_path)
    monkeypatch.setattr(runner, "reach", lambda folder: SimpleNamespace(folder=tmp_path))
    monkeypatch.setattr(threading, "excepthook", lambda failed: None)

    def fails(position: float) -> None:
        raise ValueError("at the end")

    monkeypatch.setattr(statistics, "end", fails)
    for _ in range(2):
        runner.start(BenchJob("Move", None, tmp_path, tmp_path, [], loop=lambda progress: None))  # type: ignore[arg-type]
        runner.join(PATIENCE)
        assert not runner.busy
