"""The process that runs one tool: it waits for the session to name a case, times it, and answers.

So all tools run in turn, within the same minutes of a machine that other programs may slow down as well.
NumPy and the standard library only: peers import this.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple


class Timed(NamedTuple):
    """What a tool that runs outside this process says of itself, s."""

    result: Any
    cpu: float
    wall: float


class Case(NamedTuple):
    """A tool, how it is used, and for which problem.

    `make` builds and returns what is timed; `judge` turns its result into fields of a row, the error among
    them. The first run compiles and is not counted; where `once` is set, for a case that takes long, `make`
    compiles all there is, and the first run is the only one.
    """

    tool: str
    method: str
    setting: str
    problem: str
    make: Callable[[], Callable[[], Any]]
    judge: Callable[[Any], dict[str, Any]]
    once: bool = False


def serve(parts: Mapping[str, Callable[[], Iterable[Case]]], packages: Sequence[str]) -> None:
    """Answer the session for the part that the command line names, until it closes the pipe."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what a tool prints must not come between the answers
    cases = list(parts[sys.argv[1]]())
    names = [dict(zip(("tool", "method", "setting", "problem"), case[:4], strict=True)) for case in cases]
    print(json.dumps({"cases": names, "versions": {p: version(p) for p in packages}}), file=answers)
    ready: dict[int, Callable[[], Any]] = {}
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            answer = _turn(cases[asked["case"]], asked["case"], asked["seconds"], ready)
        except Exception as reason:  # the session goes on with the others
            answer = {"failed": f"{type(reason).__name__}: {reason}"}
        print(json.dumps(answer), file=answers)


def _turn(case: Case, number: int, seconds: float, ready: dict[int, Callable[[], Any]]) -> dict[str, Any]:
    answer: dict[str, Any] = {}
    if number not in ready:
        start = time.perf_counter()
        run = case.make()
        first = _timed(run)
        answer["fields"] = case.judge(first.result)
        answer["first_call_s"] = time.perf_counter() - start
        ready[number] = run
        if case.once:
            return answer | {"cpu": [first.cpu], "wall": [first.wall]}
    cpu, wall = _repeat(ready[number], seconds)
    return answer | {"cpu": cpu, "wall": wall}


def _timed(run: Callable[[], Any]) -> Timed:
    cpu, wall = time.process_time(), time.perf_counter()
    result = run()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return result if isinstance(result, Timed) else Timed(result, cpu, wall)


def _repeat(run: Callable[[], Any], seconds: float) -> tuple[list[float], list[float]]:
    """CPU and wall times of runs until the seconds are used; at least one run, at most 25."""
    gc.collect()
    end = time.perf_counter() + seconds
    runs = [_timed(run)]
    while len(runs) < 25 and time.perf_counter() < end:
        runs.append(_timed(run))
    return [r.cpu for r in runs], [r.wall for r in runs]
