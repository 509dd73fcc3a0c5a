"""Sequences of runs: combinations of values of variables, repeats, and rests between runs."""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from fastapi import APIRouter, Request
from pydantic import Field

from ..quantities.input_file import Strict
from ..quantities.units import QuantityError, to_si
from ..rig import RigError
from .control import Control
from .document import BenchDocument
from .running import Runner
from .starting import Starter
from .stream import Client, Hub

MOST_STEPS = 1000  # largest number of runs in a sequence
_OVERHEAD = 1.0  # assumed time that a run takes besides its recordings, until it was measured, s
_ENDS = 600.0  # longest wait for the end of a run, s


class Item(Strict):
    """Part of a sequence: a run, repeated for each combination of the values of its variables.

    `run` is the name of a run of the experiment. `matrix` lists the values of each variable, as texts with
    units, by name. `rest` is the time to wait after each run, in s or a text with a unit; there is no rest
    after a failed run or the last one.
    """

    run: str
    matrix: dict[str, list[str]] = Field(default_factory=dict, max_length=6)
    repeats: int = Field(default=1, ge=1, le=1000)
    rest: str | float = "0 s"


class RunSequence(Strict):
    """Request for a sequence of runs, the parts of which are its `items`, made one after the other.

    `order` is "given" (within an item all repeats of a combination, then the next combination) or "rounds"
    (all combinations of the item once, then all again). With `home_first` the end-effector walks to position
    0 before each run. With `go_on` the sequence continues after a failed run.
    """

    items: list[Item] = Field(min_length=1, max_length=50)
    order: str = Field(default="given", pattern="^(given|rounds)$")
    home_first: bool = False
    go_on: bool = False


class QueuedRun(NamedTuple):
    """One run of a sequence, with a title for pages and the log.

    `content` is the content of an experiment file with this run only. `seconds` is the duration of its
    recordings [s], and `rest` the time to wait after the run [s].
    """

    content: dict[str, Any]
    title: str
    seconds: float
    rest: float


class Sequencer:
    """Runs one sequence at a time, in a thread. A stop of the run, by any page, also ends the sequence.

    `state` is sent to pages: "phase" ("idle", "running", "done", "ended" or "failed"), "at" and "count"
    (number of the current run, of all runs), "title", "left" (remaining time [s], None unless running) and
    "said", a message.
    """

    def __init__(self, hub: Hub, document: BenchDocument, runner: Runner, starter: Starter) -> None:
        self._hub, self._document, self._runner, self._starter = hub, document, runner, starter
        self._lock = threading.Lock()
        self._telling = threading.Lock()  # guards `state`, which the sequence's thread and requests change
        self._ending = threading.Event()  # if set, the sequence and its current run end at once
        self._last = threading.Event()  # if set, no further run starts, and a rest between runs ends
        self._thread: threading.Thread | None = None
        self.state: dict[str, Any] = {
            "phase": "idle",
            "at": 0,
            "count": 0,
            "title": "",
            "left": None,
            "said": "",
        }
        runner.also_stop.append(self._stopped)
        hub.greetings.append(self._greet)

    def steps(self, asked: RunSequence) -> list[QueuedRun]:
        """Return all runs of a sequence in order, each checked without an output.

        Raises:
            ValueError, RigError: a run cannot be recorded (the message starts with its title); a run or
                variable is unknown, a rest is out of range, or there are more than `MOST_STEPS` runs.
        """
        found: list[QueuedRun] = []
        for item in asked.items:
            rest = to_si(item.rest, "s", "rest")
            if not 0.0 <= rest <= 86400.0:
                raise QuantityError(f"rest = {item.rest} is out of range: from 0 s to a day")
            count = item.repeats
            for values in item.matrix.values():
                count *= max(len(values), 1)
            if len(found) + count > MOST_STEPS:
                raise QuantityError(f"{len(found) + count} runs are more than the {MOST_STEPS} of a sequence")
            combinations = list(itertools.product(*(values or [""] for values in item.matrix.values())))
            made = [self._step(item, dict(zip(item.matrix, one, strict=True)), rest) for one in combinations]
            again = range(item.repeats)
            found += [s for s in made for _ in again] if asked.order == "given" else made * item.repeats
        return found

    def _step(self, item: Item, values: dict[str, str], rest: float) -> QueuedRun:
        content = self._document.of_runs([item.run])
        unknown = [name for name in values if name not in content.get("variables", {})]
        if unknown:
            raise QuantityError(f"{unknown[0]!r} is no variable of the experiment")
        shown = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in values.items())
        title = f"{item.run}{f' at {shown}' if shown else ''}"
        content = {**content, "variables": {**content.get("variables", {}), **values}}
        try:
            checked = self._document.check(content)
        except (ValueError, RigError) as error:
            raise type(error)(f"{title}: {error}") from None
        seconds = sum(one.capture.length * one.capture.average for one in checked.cells)
        return QueuedRun(content, title, seconds, rest)

    def start(self, asked: RunSequence) -> int:
        """Start a sequence in a thread; return its number of runs.

        Raises the errors of `steps`, and RigError while a run or a sequence is active.
        """
        steps = self.steps(asked)
        with self._lock:
            if self.state["phase"] == "running" or self._runner.busy:
                raise RigError("a run or a sequence is going on: stop it first")
            self._ending.clear()
            self._last.clear()
            self._starter.queued = True
            self._tell(phase="running", at=0, count=len(steps), title="", said="", left=_left(steps, 0.0))
            self._thread = threading.Thread(target=self._go, args=(steps, asked), name="sequence")
            self._thread.start()
        return len(steps)

    def end_after(self) -> None:
        """End the sequence after the current run, or at once during a rest."""
        with self._telling:
            if self.state["phase"] == "running":
                self._change(said="ends after this run")
                self._last.set()

    def join(self) -> None:
        """End the sequence at once and wait for its thread; the caller stops the run."""
        self._end()
        if self._thread is not None:
            self._thread.join()

    def _stopped(self) -> bool:
        running = self.state["phase"] == "running"
        self._end()
        return running

    def _end(self) -> None:
        self._ending.set()
        self._last.set()

    def _go(self, steps: list[QueuedRun], asked: RunSequence) -> None:
        phase, said = "failed", "it ended by itself"
        try:
            phase, said = self._all(steps, asked)
        finally:
            self._starter.queued = False
            self._tell(phase=phase, said=said, left=None)

    def _all(self, steps: list[QueuedRun], asked: RunSequence) -> tuple[str, str]:
        """Run all runs in order; return the final phase and a message for the page.

        The phase is "done", or "ended" if a user or a run that failed ended the sequence.
        """
        overhead, failed = _OVERHEAD, 0
        for i, step in enumerate(steps):
            if self._last.is_set():
                return "ended", f"ended after {i} of {len(steps)}"
            self._tell(at=i + 1, title=step.title, left=_left(steps[i:], overhead))
            begun = time.monotonic()
            outcome = self._one(step, i, len(steps), asked)
            overhead += 0.5 * (time.monotonic() - begun - step.seconds - overhead)
            if outcome == "done":
                rest = step.rest if i + 1 < len(steps) else 0.0
                self._tell(left=_left(steps[i + 1 :], overhead) + rest)
                self._last.wait(rest)
                continue
            failed += 1
            if not (asked.go_on and outcome == "failed") or self._ending.is_set():
                return "ended", f"{step.title}: {outcome}; ended after {i} of {len(steps)}"
        return "done", f"{len(steps)} runs" + (f", {failed} of them failed" if failed else "")

    def _one(self, step: QueuedRun, i: int, count: int, asked: RunSequence) -> str:
        """Make a run, after the walk to position 0 if the sequence requests it; return its final phase.

        The phase is "done", "stopped" or "failed". A run that cannot start counts as failed, with a notice to
        all pages. The run is number `i` (from 0) of `count`.
        """
        try:
            if asked.home_first and abs(self._runner.position) > 0.0:
                outcome = self._ended(self._starter.home)
                if outcome != "done":
                    return outcome
            (run,) = step.content["runs"]
            notes = f"{run.get('notes', '')} Sequence, {i + 1} of {count}.".strip()
            content = {**step.content, "runs": [{**run, "notes": notes}]}
            title = f"{i + 1} of {count}: {step.title}"
            return self._ended(lambda: self._starter.start(content, title, step.title))
        except (ValueError, RigError, OSError) as error:
            self._hub.tell("notice", text=f"{step.title}: {error}", level="error")
            return "failed"

    def _ended(self, begin: Callable[[], Any]) -> str:
        if self._ending.is_set():
            return "stopped"
        begin()
        if self._ending.is_set():
            # The sequence was ended while the run was starting.
            self._runner.stop("stop")
        while self._runner.busy and not self._ending.is_set():
            self._runner.join(1.0)
        self._runner.join(_ENDS)
        return str(self._runner.state["phase"])

    def _tell(self, **changes: Any) -> None:
        with self._telling:
            self._change(**changes)

    def _change(self, **changes: Any) -> None:
        self.state = {**self.state, **changes}
        self._hub.tell("sequence", **self.state)

    def _greet(self, client: Client, said: dict[str, Any]) -> list[str]:
        return [json.dumps({"kind": "sequence", **self.state})]


def _left(steps: list[QueuedRun], overhead: float) -> float:
    """Return the expected time of runs [s], with the rests between them and `overhead` [s] for each run."""
    return sum(one.seconds + overhead for one in steps) + sum(one.rest for one in steps[:-1])


def sequence_routes(control: Control, sequencer: Sequencer) -> APIRouter:
    """Return the router with the routes that check, start and end a sequence, below "/sequence"; start and
    end need control of the rig."""
    routes = APIRouter(prefix="/sequence")

    @routes.post("/check")
    def check(asked: RunSequence) -> dict[str, Any]:
        steps = sequencer.steps(asked)
        return {
            "count": len(steps),
            "seconds": _left(steps, _OVERHEAD),
            "titles": [one.title for one in steps[:200]],
        }

    @routes.post("/start")
    def start(asked: RunSequence, request: Request) -> dict[str, int]:
        control.need(request.headers.get("x-client", ""))
        return {"count": sequencer.start(asked)}

    @routes.post("/end")
    def end(request: Request) -> dict[str, str]:
        """End the sequence after the current run."""
        control.need(request.headers.get("x-client", ""))
        sequencer.end_after()
        return {"phase": str(sequencer.state["phase"])}

    return routes
