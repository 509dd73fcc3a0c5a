"""How soon the rig ramps after somebody asked for a stop, while the panel is busy.

    python -m benchmarks.panel_stops [--stops 1000] [--watchers 20] [--seed 1] [--keep]

`stickslip panel` with the virtual rig in real time (20 kHz, three channels, a process of its own), watched by
20 pages. In turn nothing else is done, recordings are read and uploaded, a fit runs, or all of it. Each stop
is asked for at a random instant of a run, by the button (HTTP) or the key (the page's stream). Its time is
from before it is sent to the instant at which the rig is told to ramp, by the clock that both share.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import threading
import time
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import yaml
from websockets.sync.client import connect

from benchmarks.panel_hour import Busy, Panel
from benchmarks.panel_results import options, record
from benchmarks.panel_watchers import watch

TIMED = Path(__file__).with_name("timed_rig.py")
PHASES = ("nothing else", "files are read and uploaded", "a fit runs", "files and a fit")
TURN, LENGTH = 10, 10.0  # stops of a phase, and s of a run
EARLIEST, LATEST = 0.05, 0.6  # s after which a run is stopped
GOAL = 50.0  # ms
UPLOADED = 2_000_000  # bytes
WAIT = 30.0  # s, a guard


def start(client: httpx.Client) -> None:
    """Arm the output and start the run."""
    client.post("/interlock/arm", json={"why": "study of stops"}).raise_for_status()
    client.post("/bench/start", json={"runs": ["forward"]}).raise_for_status()


def prepare(panel: Panel, client: httpx.Client, told: Path) -> list[str]:
    """Put a run with the timed rig on the bench, record it once, and copy that; the copies' names."""
    from stickslip.panel import server

    content = yaml.safe_load(Path(server.__file__).with_name("experiment.yaml").read_text())
    content["rig"] = {"kind": f"{TIMED}:TimedRig", "options": {"told": str(told)}}
    for end in ("min_position", "max_position"):  # a thousand runs lead further
        content["limits"].pop(end)
    content["channels"].pop("piezo_elongation")
    content["panel"] = content["panel"][2:4]
    content["runs"] = [content["runs"][1]]
    (panel.folder / "stops.yaml").write_text(yaml.safe_dump(content))
    client.post("/bench/load", json={"name": "stops.yaml"}).raise_for_status()
    start(client)
    panel.until(lambda: panel.phase == "running")
    panel.until(lambda: panel.phase in ("done", "failed"))
    made = next(panel.folder.glob("recordings/*/forward*.nc"))
    names = [f"copy_{i}.nc" for i in range(12)]
    for name in names:
        shutil.copy(made, panel.folder / name)
    for path, value in (
        (["runs", 0, "capture", "length"], f"{LENGTH} s"),
        (["runs", 0, "waveform", 0, "fields", "periods"], round(5 * LENGTH)),
    ):
        client.post("/bench/set", json={"path": path, "value": value}).raise_for_status()
    return names


def upload(panel: Panel, wanted: threading.Event, ended: threading.Event) -> None:
    """Upload a file again and again while it is wanted."""
    rows = "time_s,drive_V\n" + "".join(f"{i * 1e-4:.4f},{i % 60}\n" for i in range(UPLOADED // 12))
    with panel.client() as client:
        while not ended.is_set():
            if wanted.wait(1.0):
                client.post("/recordings/upload", params={"name": "mine.csv"}, content=rows)


def ramp_after(told: Path, before: int, asked: float) -> float:
    """Milliseconds from the request to the ramp, which the rig writes down."""
    end = time.monotonic() + WAIT
    while time.monotonic() < end:
        lines = told.read_text().splitlines() if told.exists() else []
        if len(lines) > before:
            return 1e3 * (float(lines[before]) - asked)
        time.sleep(0.005)
    raise AssertionError("no ramp")


def main() -> None:
    """Run it, print and keep the figures."""
    asked = options(__doc__, stops=1000, watchers=20)
    sys.setswitchinterval(1e-3)  # its own threads are not to delay what it times
    chance = random.Random(asked.seed)
    folder = Path(tempfile.mkdtemp(prefix="stickslip-"))
    told = folder / ".ramps"
    panel = Panel(folder, "--use", str(TIMED))
    ours, theirs = multiprocessing.Pipe()
    found: list[tuple[int, str, float, float, float]] = []
    with (
        panel.client() as client,
        connect(f"ws://127.0.0.1:{panel.port}/stream", proxy=None, max_size=2**26) as stream,
    ):
        stream.send(json.dumps({"client": "stopper", "log": 0}))
        threading.Thread(target=lambda: [None for _ in stream], daemon=True).start()
        busy = Busy(panel, prepare(panel, client, told))
        context = multiprocessing.get_context("spawn")
        watching = context.Process(target=watch, args=(panel.port, asked.watchers, 0, theirs))
        watching.start()
        threading.Thread(target=upload, args=(panel, busy.files, busy.ended), daemon=True).start()
        for number in range(asked.stops):
            phase = number // TURN % len(PHASES)
            busy.phase(phase)
            panel.until(lambda: panel.phase in ("stopped", "done"))
            start(client)
            panel.until(lambda: panel.phase == "running")
            button = HTTPConnection("127.0.0.1", panel.port)
            button.request("GET", "/static/style.css")  # a browser keeps its connections
            button.getresponse().read()
            time.sleep(chance.uniform(EARLIEST, LATEST))
            before = len(told.read_text().splitlines())
            way = chance.choice(("button", "key"))
            begun = time.perf_counter()
            if way == "button":
                button.request("POST", "/bench/stop")
            else:
                stream.send(json.dumps({"kind": "emergency_stop"}))
            panel.until(lambda: panel.phase in ("stopping", "stopped"))
            heard = 1e3 * (time.perf_counter() - begun)
            button.close()
            found.append((phase, way, ramp_after(told, before, begun), heard, os.getloadavg()[0]))
            print(number, PHASES[phase], way, *(f"{one:.1f}" for one in found[-1][2:]), file=sys.stderr)
        busy.ended.set()
        ours.send("end")
        ours.recv()
        watching.join()
    panel.process.terminate()
    panel.process.wait(WAIT)
    shutil.rmtree(folder, ignore_errors=True)
    keep(asked, found, busy)


def said(times: list[float]) -> str:
    """A row of the table."""
    over = sum(one > GOAL for one in times)
    return (
        f"{np.median(times):.0f} ms, 95 % below {np.percentile(times, 95):.0f}, 99.9 % below "
        f"{np.percentile(times, 99.9):.0f}, at most {max(times):.0f} ms (of {len(times)}, {over} above "
        f"{GOAL:g} ms)"
    )


def keep(asked: argparse.Namespace, found: list[tuple[int, str, float, float, float]], busy: Busy) -> None:
    """Print and keep the figures."""
    rows = [("beside it", f"{asked.watchers} pages; {busy.read} files read, {busy.fitted} fits begun")]
    for i, name in enumerate(PHASES):
        times = [one[2] for one in found if one[0] == i]
        if times:
            rows.append((f"ramp, {name}", said(times)))
    for way in ("button", "key"):
        rows.append((f"ramp, by the {way}", said([one[2] for one in found if one[1] == way])))
    rows.append(("ramp, all", said([one[2] for one in found])))
    rows.append(("the page is told that it stops", said([one[3] for one in found])))
    load = [one[4] for one in found]
    low, high = np.percentile(load, [33, 67])
    for words, chosen in (
        ("at the lowest loads, a third", [one for one in found if one[4] <= low]),
        ("at the highest loads, a third", [one for one in found if one[4] >= high]),
    ):
        least, most = min(one[4] for one in chosen), max(one[4] for one in chosen)
        times = said([one[2] for one in chosen])
        rows.append((f"ramp, {words}", f"{times}; load {least:.0f} to {most:.0f}"))
    rows.append(("load", f"median {np.median(load):.1f}, at most {max(load):.1f}"))
    numbers: dict[str, Any] = {"stops_ms": [one[2] for one in found]}
    if asked.keep:
        record("stops", rows, numbers)
    else:
        for what, figure in rows:
            print(f"{what}: {figure}")


if __name__ == "__main__":
    main()
