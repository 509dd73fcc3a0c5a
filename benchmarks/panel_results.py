"""The figures of the panel's benchmarks, kept in docs/benchmarks/panel.json, and panel.md made of it."""

from __future__ import annotations

import json
import os
import textwrap
from datetime import date
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "docs" / "benchmarks"
JSON, PAGE = FOLDER / "panel.json", FOLDER / "panel.md"

HEAD = """# The panel: first paint, first minute, stream, sliders

A real server and a real browser (headless Chromium without a graphics card, 1280 x 720) on the same machine.
No test depends on any of these times; the tests show that what is timed here works.
"""
ABOUT = {
    "minute": (
        "The first minute",
        "`python -m benchmarks.panel_minute`: a page is opened, Start pressed as soon as it is there, "
        "the walk watched to its end (4 s of it are the walk), Identify opened, Start fit pressed. "
        "The emergency stop is timed from the key press in the browser to the instant at which the "
        "rig is told to ramp to 0 V, by the clock of the machine that both are on; up to 50 ms of it "
        "are the rig's block.",
    ),
    "streaming": (
        "The stream",
        "`python -m benchmarks.panel_streaming`: signals of 20 kHz on three channels at 20 times real "
        "time, watched by clients of another process. The slope of the server's memory is that of a "
        "straight line through the second half.",
    ),
    "hour": (
        "An hour with 200 connections",
        "`python -m benchmarks.panel_hour --keep`: `stickslip panel` with the virtual rig in real time, 20 "
        "kHz on three channels; runs are begun and stopped at random instants. Minute by minute in turn "
        "nothing else is done, recordings are read (one after the other, and the history listed), a fit "
        "runs, or both. A stop is timed from before its request is sent: the whole way there and back over "
        "HTTP, and from its arrival to the begin of the ramp. A frame is a block of the running traces that "
        "reaches a page. Panel, rig, fits and all clients share the machine.",
    ),
    "stops": (
        "Stops while the panel is busy",
        "`python -m benchmarks.panel_stops --keep`: `stickslip panel` with the virtual rig in real time, "
        "watched by 20 pages. In turn nothing else is done, recordings are read and uploaded, a fit runs, or "
        "all of it. A stop comes at a random instant, by the button (HTTP) or the key (the page's stream). "
        "Its time is from before it is sent to the instant at which the rig is told to ramp. The request "
        "goes to the rig's process before the panel does anything else, by a connection of its own. What is "
        "left is the machine: how soon the two processes are woken. The aim, below 50 ms in 99.9 %, is not "
        "reached on a machine of two processors whose load is above ten.",
    ),
    "explore": (
        "The sliders of Explore",
        "`python -m benchmarks.panel_explore`: a slider is moved in every frame; a picture is a frame "
        "with new curves of an experiment of 1 s. Processor time is that of all processes, server and "
        "browser.",
    ),
}


def record(section: str, rows: list[tuple[str, str]], numbers: dict[str, Any]) -> None:
    """Keep the figures of a benchmark, and write the page anew.

    Args:
        section: one of `ABOUT`, with a word for the circumstances behind a colon where there are several.
        rows: what was measured, and the figure with its unit.
        numbers: the same for machines.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    kept = json.loads(JSON.read_text(encoding="utf-8")) if JSON.is_file() else {}
    machine = f"{date.today()}, {os.cpu_count()} processors, load {os.getloadavg()[1]:.1f}"
    kept[section] = {"machine": machine, "rows": rows, **numbers}
    kept = dict(sorted(kept.items(), key=lambda item: list(ABOUT).index(item[0].split(":")[0])))
    JSON.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    write_page(kept)
    for what, figure in rows:
        print(f"{what}: {figure}")


def write_page(kept: dict[str, Any]) -> None:
    """panel.md of what panel.json holds."""
    parts = [HEAD]
    for name, found in kept.items():
        key, _, word = name.partition(":")
        title, about = ABOUT[key]
        heading = f"## {title}, {word.strip()}" if word else f"## {title}"
        parts += [f"{heading}\n\n{textwrap.fill(about, 118)}\n", f"Measured: {found['machine']}.\n"]
        lines = [f"| {what} | {figure} |" for what, figure in found["rows"]]
        parts.append("\n".join(["| | |", "|---|---|", *lines]) + "\n")
    PAGE.write_text("\n".join(parts), encoding="utf-8")
