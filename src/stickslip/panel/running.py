"""The run that goes on: an experiment in a thread of its own, whoever watches, until its end or a stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..experiment.cells import Cell
from ..experiment.file import ExperimentFile
from ..experiment.running import record_experiment
from ..rig import Rig, RigError, WatchedRig
from ..rig.measurement import POSITION
from .journal import Journal
from .live import Live
from .stream import Hub

Sees = Callable[[dict[str, NDArray[np.float64]]], None]


class StopRequested(RigError):
    """Somebody pressed stop."""


class Arrived(RigError):
    """A run that was only to move somewhere is there."""


class Job(NamedTuple):
    """What to run: an experiment, the folder that its paths begin in, where recordings go, its channels.

    `goal` sees the position since home and the blocks, and raises `Arrived` when the run has done what it was
    for.
    """

    title: str
    file: ExperimentFile
    folder: Path
    out: Path
    columns: list[dict[str, str]]
    goal: Callable[[float, dict[str, NDArray[np.float64]]], None] | None = None
    finished: Callable[[], None] | None = None


class Runner:
    """Runs one job at a time. `position` is where the end-effector is, m from home, as far as was seen."""

    def __init__(self, hub: Hub, live: Live, journal: Journal) -> None:
        self._hub, self._live, self._journal = hub, live, journal
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._stop: tuple[str, float] | None = None
        self._told = 0.0
        self._busy = False
        self.position = 0.0
        self._start = 0.0  # position at which the present recording began
        self.state: dict[str, Any] = {
            "number": 0,
            "phase": "idle",
            "title": "",
            "doing": "",
            "done": 0.0,
            "remaining": None,
        }

    @property
    def busy(self) -> bool:
        """Whether a job is running."""
        return self._busy

    def start(self, job: Job) -> None:
        """Start a job; raises RigError while another runs."""
        with self._lock:
            if self.busy:
                raise RigError("a run is going on: stop it first")
            self._stop, self._busy = None, True
            self._thread = threading.Thread(target=self._run, args=(job,), name="rig", daemon=False)
            number = self.state["number"] + 1
            self._state(
                number=number, phase="preparing", title=job.title, doing="checking", done=0.0, remaining=None
            )
            self._thread.start()

    def stop(self, why: str) -> bool:
        """Ask the run to end with a ramp to 0 V; at once, whoever asks. Whether there was one."""
        if not self.busy:
            return False
        if self._stop is None:
            self._stop = (why, time.perf_counter())
            self._state(phase="stopping")
        return True

    def join(self) -> None:
        """Wait for the end of the run."""
        if self._thread is not None:
            self._thread.join()

    def home_here(self) -> None:
        """Call the present position home."""
        self.position = self._start = 0.0
        self._state()

    def _run(self, job: Job) -> None:
        self._journal(f"{job.title}: started")
        phase = "failed"
        try:
            recorded = record_experiment(
                job.file,
                job.folder,
                job.out,
                partial(self._progress, time.monotonic()),
                label=job.title,
                watch=partial(self._watched, job),
            )
            self._journal(f"{job.title}: finished, {_counted(len(recorded))} in {job.out.name}")
            phase = "done"
        except Arrived as arrived:
            self._journal(f"{job.title}: {arrived}")
            phase = "done"
        except StopRequested as stopped:
            self._journal(f"{job.title}: {stopped}; what was finished is kept", "warning")
            phase = "stopped"
        except Exception as error:
            known = isinstance(error, ValueError | OSError | RigError | MemoryError)
            said = str(error) if known else f"unexpected {type(error).__name__}"
            self._journal(f"{job.title}: {said}", "error")
        finally:
            if job.finished is not None:
                job.finished()
            self._busy = False  # before it is told: who hears of the end may start again
            self._state(phase=phase, doing="", done=float(phase == "done"), remaining=None)

    def _watched(self, job: Job, cell: Cell, rig: Rig) -> Rig:
        rate = rig.capabilities.sample_rate

        def armed(samples: int, before: int) -> None:
            self._start = self.position
            self._live.begin(f"{job.title}: {cell.name}", job.columns, rate, samples, before)
            self._state(phase="preparing", doing=cell.name)  # a virtual rig computes before it puts out

        def sees(block: dict[str, NDArray[np.float64]]) -> None:
            if self._stop is not None:
                raise StopRequested(self._stop[0])
            if not any(one.size for one in block.values()):
                return
            if self.state["phase"] == "preparing":
                self._state(phase="running")
            position = block.get(POSITION)
            if position is not None:
                if cell.channels[POSITION].zero:
                    block = {**block, POSITION: position + self._start}
                if not cell.actuator.clamped:
                    self.position = float(block[POSITION][-1])
            self._live.add(block)
            if job.goal is not None:
                job.goal(self.position, block)

        def stopping() -> None:
            if self._stop is not None:
                why, asked = self._stop
                waited = f"{1e3 * (time.perf_counter() - asked):.1f} ms after the request"
                ramp = "ramp to 0 V began" if self._live.begun else "before anything was put out,"
                self._journal(f"{why}: {ramp} {waited}", "warning")

        return WatchedRig(rig, cell.channels, armed, sees, stopping)

    def _progress(self, begun: float, doing: str, done: float) -> None:
        now = time.monotonic()
        if now - self._told < 0.1 and doing == self.state["doing"]:
            return
        self._told = now
        # The first moments say little: a run may have to be computed before it begins.
        remaining = (now - begun) * (1.0 - done) / done if done > 0.02 else None
        self._state(doing=doing, done=done, remaining=remaining)

    def _state(self, **changes: Any) -> None:
        self.state = {**self.state, **changes}
        self._hub.tell("run", **self.state, position=self.position)


def _counted(count: int) -> str:
    return f"{count} recording{'s' if count != 1 else ''}"
