"""Runs the workers of a part in turn, several rounds, and makes rows of their answers."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import statistics
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PEERS = ROOT / ".venv-peers" / "bin" / "python"

Row = dict[str, Any]


class Tool(NamedTuple):
    """A worker: its module, the interpreter, and what its environment needs to be told."""

    module: str
    python: str = sys.executable
    environment: Mapping[str, str] = {}


def peer(name: str, environment: Mapping[str, str] | None = None) -> Tool:
    return Tool(f"benchmarks.peers.{name}", str(PEERS), environment or {})


class Failed(Exception):
    """Why a worker or one of its cases gave no answer."""


class Worker:
    """A tool's process; `cases` and `versions` as it announces them."""

    def __init__(self, tool: Tool, part: str, patience: float) -> None:
        if not Path(tool.python).exists():
            raise Failed("its environment is not there (make peers)")
        self._tool, self._part = tool, part
        hello = self._start(patience)
        self.cases: list[dict[str, str]] = hello["cases"]
        self.versions: dict[str, str] = hello["versions"]

    def _start(self, patience: float) -> dict[str, Any]:
        tool = self._tool
        self._process = subprocess.Popen(
            [tool.python, "-m", tool.module, self._part],
            cwd=ROOT,
            env={**os.environ, **tool.environment},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=None if "BENCH_VERBOSE" in os.environ else subprocess.DEVNULL,
            text=True,
        )
        return self._answer(patience)

    def ask(self, case: int, seconds: float, patience: float) -> dict[str, Any]:
        if self._process.poll() is not None:  # by another case, which is not to cost this one
            self._start(patience)
        assert self._process.stdin
        try:
            self._process.stdin.write(json.dumps({"case": case, "seconds": seconds}) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise Failed("its process had ended") from None
        answer = self._answer(patience)
        if "failed" in answer:
            raise Failed(answer["failed"])
        return answer

    def _answer(self, patience: float) -> dict[str, Any]:
        assert self._process.stdout
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            if not selector.select(patience):
                self._process.kill()
                self._process.wait()
                raise Failed(f"no answer within {patience:g} s")
        line = self._process.stdout.readline()
        if not line:
            raise Failed(f"its process ended with status {self._process.wait()}")
        return json.loads(line)

    def close(self) -> None:
        """End the process and wait for it."""
        assert self._process.stdin
        with contextlib.suppress(BrokenPipeError):  # it has ended, with a question that was not read
            self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def measure(
    part: str,
    tools: Sequence[Tool],
    rounds: int,
    seconds: float = 0.03,
    most: float = 0.8,
    patience: float = 240.0,
) -> tuple[list[Row], dict[str, str]]:
    """Rows of a part and the versions of what ran.

    Args:
        part: its name, as the workers know it.
        tools: one worker each.
        rounds: how often every case has its turn; tool after tool within a round, case after case.
        seconds: length of a turn; at least one run.
        most: s, of a case in all; a slow one has fewer turns, but at least one.
        patience: s, for one answer, compilation included.
    """
    rows: list[Row] = []
    versions: dict[str, str] = {}
    turns: list[tuple[int, Worker, Row]] = []
    workers: list[Worker] = []
    for tool in tools:
        try:
            worker = Worker(tool, part, patience)
        except Failed as reason:
            name = tool.module.rpartition(".")[2]
            rows.append({"part": part, "problem": "", "tool": name, "not_run": str(reason)})
            continue
        workers.append(worker)
        versions |= worker.versions
        for i, case in enumerate(worker.cases):
            rows.append({"part": part, **case, "cpu": [], "wall": []})
            turns.append((i, worker, rows[-1]))
    turns.sort(key=lambda turn: turn[0])  # one case of each tool after the other
    for number in range(rounds + 1):
        start = time.monotonic()
        for i, worker, row in turns:
            if "not_run" in row or sum(row["wall"]) > most:
                continue
            try:
                answer = worker.ask(i, seconds if number else 0.0, patience)
            except Failed as reason:
                row["not_run"] = str(reason)
                continue
            if "fields" in answer:
                row |= answer["fields"] | {"first_call_s": answer["first_call_s"]}
            row["cpu"] += answer["cpu"]
            row["wall"] += answer["wall"]
        print(f"{part}: round {number} of {rounds}, {time.monotonic() - start:.0f} s", file=sys.stderr)
    for worker in workers:
        worker.close()
    return [_summary(row) for row in rows], versions


def _summary(row: Row) -> Row:
    """Milliseconds over all runs of a case in place of the runs themselves."""
    cpu, wall = row.pop("cpu", []), row.pop("wall", [])
    if "not_run" in row:
        return row
    return row | {
        "repeats": len(cpu),
        "cpu_ms_median": 1e3 * statistics.median(cpu),
        "cpu_ms_min": 1e3 * min(cpu),
        "wall_ms_median": 1e3 * statistics.median(wall),
        "wall_ms_min": 1e3 * min(wall),
    }
