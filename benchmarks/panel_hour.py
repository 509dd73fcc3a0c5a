"""An hour of the panel at its limits: 200 connections, runs that are watched by 100 pages and stopped again
and again, also while files are read and fits run.

    python -m benchmarks.panel_hour [--minutes 60] [--watchers 100] [--others 99] [--seed 1] [--keep]

`stickslip panel` with the virtual rig in real time (20 kHz, three channels, a process of its own). Minute by
minute in turn nothing else is done, files are read, a fit runs, or both. A stop is timed from before its
request is sent to the begin of the ramp: the whole way there and back over HTTP, and what the panel says it
took from there to the begin of the ramp.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from benchmarks.panel_results import options, record
from benchmarks.panel_watchers import watch

PHASES = ("nothing else", "files are read", "a fit runs", "files and a fit")
TURN, LONGEST = 60.0, 20.0  # s of a phase, and of a run
EARLIEST, LATEST = 1.5, 9.0  # s after which it is stopped
WAIT = 120.0  # s, a guard
COPIES = 12  # of a recording, read in turn: more than the panel keeps open
FREE = ["sigma_0", "sigma_1", "coulomb_force"]


def resident(process: int) -> float:
    """Memory of a process, MB; 0 where it is gone."""
    with suppress(OSError):
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    return 0.0


class Panel:
    """The command on a folder, and what its stream says of the run and in the log."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        served = ["panel", str(folder), "--port", "0", "--no-browser"]
        command = [sys.executable, "-m", "stickslip", *options, *served]
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        # A session of its own, as from a terminal of its own: clients are not to share its processor time.
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
        )
        assert self.process.stdout is not None
        found = re.search(r"http://127.0.0.1:(\d+)/", self.process.stdout.readline())
        assert found is not None, "the panel did not start"
        self.port = int(found[1])
        self.phase, self.lines, self.news = "", list[str](), threading.Condition()
        threading.Thread(target=self._listen, daemon=True).start()

    def client(self) -> httpx.Client:
        """One that may start runs."""
        return httpx.Client(
            base_url=f"http://127.0.0.1:{self.port}", headers={"X-Client": "driver"}, timeout=WAIT
        )

    def _listen(self) -> None:
        while True:
            try:
                with connect(f"ws://127.0.0.1:{self.port}/stream", proxy=None, max_size=2**26) as stream:
                    stream.send(json.dumps({"client": "driver", "log": 0}))
                    for message in stream:
                        if isinstance(message, str):
                            self._take(json.loads(message))
            except (OSError, WebSocketException):
                time.sleep(0.2)

    def _take(self, said: dict[str, Any]) -> None:
        with self.news:
            if said["kind"] == "run":
                self.phase = said["phase"]
            if said["kind"] == "log":
                self.lines += [one["text"] for one in said["entries"]]
            self.news.notify_all()

    def until(self, what: Callable[[], bool]) -> None:
        """Wait for news that make it true."""
        with self.news:
            assert self.news.wait_for(what, WAIT), f"{self.phase}: {self.lines[-3:]}"


def stop(panel: Panel, client: httpx.Client) -> tuple[float, float]:
    """Stop the run that goes on; ms that the request was under way, there and back, and from its arrival to
    the begin of the ramp."""
    before = len(panel.lines)
    begun = time.perf_counter()
    assert client.post("/bench/stop").json() == {"stopped": True}
    there = 1e3 * (time.perf_counter() - begun)
    panel.until(lambda: any("ramp to 0 V began" in one for one in panel.lines[before:]))
    line = next(one for one in panel.lines[before:] if "ramp to 0 V began" in one)
    said = re.search(r"began ([\d.]+) ms", line)
    assert said is not None, line
    panel.until(lambda: panel.phase == "stopped")
    return there, float(said[1])


class Busy:
    """What else the panel does: `files` and `fits` say whether it does; counts of what was done."""

    def __init__(self, panel: Panel, names: list[str]) -> None:
        self.files, self.fits, self.ended = threading.Event(), threading.Event(), threading.Event()
        self.read = self.fitted = 0
        self._panel, self._names = panel, names
        for work in (self._read, self._fit):
            threading.Thread(target=work, daemon=True).start()

    def phase(self, number: int) -> None:
        """Begin the phase of this number."""
        for event, on in ((self.files, number in (1, 3)), (self.fits, number in (2, 3))):
            (event.set if on else event.clear)()

    def _read(self) -> None:
        with self._panel.client() as client:
            while self.files.wait() and not self.ended.is_set():
                name = self._names[self.read % len(self._names)]
                client.post("/recordings/show", json={"name": name}).raise_for_status()
                if self.read % 10 == 0:
                    client.get("/history").raise_for_status()
                    client.get("/recordings/export", params={"name": name, "kind": "mat"}).raise_for_status()
                self.read += 1

    def _fit(self) -> None:
        with self._panel.client() as client:
            known = client.get("/api/explore/choices").json()["sets"]["kang2007"]
            asked = {"set": "kang2007", "law": "LuGre", "friction": known["friction"]["LuGre"], "free": FREE}
            while not self.ended.is_set():
                on = self.fits.wait(1.0)
                phase = client.get("/api/identify/state").json()["phase"]
                if on and phase != "running":
                    name = self._names[self.fitted % len(self._names)]
                    client.post(
                        "/api/identify/start", json={**asked, "recordings": [name]}
                    ).raise_for_status()
                    self.fitted += 1
                elif not on and phase == "running":
                    client.post("/api/identify/cancel").raise_for_status()
                time.sleep(0.2)


def prepare(panel: Panel, client: httpx.Client) -> list[str]:
    """Record a walk, copy it for whoever reads, and put a longer run on the bench; the copies' names."""
    client.post("/bench/start", json={"runs": ["walk"]}).raise_for_status()
    panel.until(lambda: panel.phase == "running")
    panel.until(lambda: panel.phase == "done")
    walk = next(panel.folder.glob("recordings/*/walk*.nc"))
    names = [f"copy_{i}.nc" for i in range(COPIES)]
    for name in names:
        shutil.copy(walk, panel.folder / name)
    changes: list[tuple[list[str | int], Any]] = [
        (["runs", 1, "capture", "length"], f"{LONGEST} s"),
        (["runs", 1, "waveform", 0, "fields", "periods"], round(5 * LONGEST)),
    ]
    for path, value in changes:
        client.post("/bench/set", json={"path": path, "value": value}).raise_for_status()
    return names


def main() -> None:
    """Run it, print and keep the figures."""
    asked = options(__doc__, minutes=60.0, watchers=100, others=99)
    sys.setswitchinterval(1e-3)  # its own threads are not to delay what it times
    chance = random.Random(asked.seed)
    panel = Panel(Path(tempfile.mkdtemp(prefix="stickslip-")))
    ours, theirs = multiprocessing.Pipe()
    with panel.client() as client:
        busy = Busy(panel, prepare(panel, client))
        context = multiprocessing.get_context("spawn")
        watching = context.Process(target=watch, args=(panel.port, asked.watchers, asked.others, theirs))
        watching.start()
        rig = int(json.loads((panel.folder / ".rig" / "rig.json").read_text())["pid"])
        begun = time.monotonic()
        stops: list[tuple[int, float, float]] = []
        memory: list[tuple[float, float, float, float]] = []
        while (now := time.monotonic() - begun) < 60.0 * asked.minutes:
            number = int(now / TURN) % len(PHASES)
            busy.phase(number)
            panel.until(lambda: panel.phase in ("stopped", "done"))
            client.post("/bench/start", json={"runs": ["forward"]}).raise_for_status()
            panel.until(lambda: panel.phase == "running")
            time.sleep(chance.uniform(EARLIEST, LATEST))
            stops.append((number, *stop(panel, client)))
            memory.append((now, resident(panel.process.pid), resident(rig), os.getloadavg()[0]))
            print(*(f"{one:.1f}" for one in (*memory[-1], *stops[-1][1:])), file=sys.stderr, flush=True)
        busy.ended.set()
        ours.send("end")
        seen = ours.recv()
        watching.join()
    panel.process.terminate()
    panel.process.wait(WAIT)
    keep(asked, begun, stops, np.array(memory), seen, busy)


def keep(
    asked: argparse.Namespace,
    begun: float,
    stops: list[tuple[int, float, float]],
    memory: Any,
    seen: dict[str, Any],
    busy: Busy,
) -> None:
    """Print and keep the figures."""
    half = len(memory) // 2
    slopes = [float(np.polyfit(memory[half:, 0], memory[half:, i], 1)[0]) * 3600 for i in (1, 2)]
    rows = [
        (
            "connections",
            f"{asked.watchers + asked.others + 1} for {asked.minutes:.3g} min: {asked.watchers + 1} pages "
            f"that watch, let go {seen['fell']} times; {asked.others} others, {seen['answers'][0]} answers, "
            f"{seen['answers'][1]} failed",
        ),
        ("beside it", f"{busy.read} files read, {busy.fitted} fits begun"),
    ]
    numbers: dict[str, Any] = {"stops_ms": {}, "frames_per_second": {}, "memory_MB": memory[:, 1].tolist()}
    every = [one for page in seen["blocks"] for one in page]
    for i, name in enumerate(PHASES):
        there = [one for phase, one, _ in stops if phase == i]
        times = [one + ramp for phase, one, ramp in stops if phase == i]
        runs = [one for one in every if int((one[0] - begun) / TURN) % len(PHASES) == i]
        rates = [count / (end - first) for first, end, count, _ in runs]
        if not times or not rates:
            continue
        numbers["stops_ms"][name], numbers["frames_per_second"][name] = times, float(np.median(rates))
        over, most = sum(ms > 50.0 for ms in times), max(gap for *_, gap in runs)
        stopped = (
            f"{np.median(times):.0f} ms, 95 % below {np.percentile(times, 95):.0f}, at most "
            f"{max(times):.0f} ms (of {len(times)}, {over} above 50 ms); the request and its answer are "
            f"{np.median(there):.0f} ms of it"
        )
        framed = (
            f"{np.median(rates):.1f}/s for each page, 1 % of pages and runs below "
            f"{np.percentile(rates, 1):.1f}/s; longest gap {most:.2f} s"
        )
        rows += [(f"stop, {name}", stopped), (f"frames, {name}", framed)]
    for name, i, slope in (("panel", 1, slopes[0]), ("rig's process", 2, slopes[1])):
        figures = (
            f"{memory[0, i]:.0f} MB at first, {memory[half, i]:.0f} half way, {memory[-1, i]:.0f} at last; "
            f"second half {slope:+.1f} MB/h"
        )
        rows.append((f"memory of the {name}", figures))
    rows.append(("load", f"median {np.median(memory[:, 3]):.1f}, at most {memory[:, 3].max():.1f}"))
    numbers |= {"slope_MB_per_h": slopes}
    if asked.keep:
        record("hour", rows, numbers)
    else:
        for what, figure in rows:
            print(f"{what}: {figure}")


if __name__ == "__main__":
    main()
