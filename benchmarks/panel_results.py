"""The figures of the panel's benchmarks, kept in docs/benchmarks/panel.json, and panel.md made of it."""

from __future__ import annotations

import argparse
import json
import os
import textwrap
from datetime import date
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "docs" / "benchmarks"
JSON, PAGE = FOLDER / "panel.json", FOLDER / "panel.md"

HEAD = """# Response times of the panel

Server and browser (headless Chromium without a graphics card) share one machine. All figures:
[panel.json](panel.json).
"""
# Title, description, and the rows that the page shows; panel.json contains all rows. A part without rows is
# not on the page.
ABOUT = {
    "minute": (
        "The first minute",
        "`python -m benchmarks.panel_minute`: open a page, start a walk of 4 s, wait for its end, open "
        "Identify, start a fit.",
        (),
    ),
    "streaming": (
        "The stream",
        "`python -m benchmarks.panel_streaming`: three channels of 20 kHz at 20 times real time, watched by "
        "clients of another process.",
        (),
    ),
    "hour": (
        "An hour with 200 connections",
        "`python -m benchmarks.panel_hour --keep`: the virtual rig in real time, three channels of 20 kHz, "
        "runs started and stopped at random instants, while recordings are read and a fit runs. A stop is "
        "timed from its request to the start of the ramp. A frame is a block of traces that reaches a page.",
        ("connections", "stop, files and a fit", "frames, files and a fit", "memory of the panel"),
    ),
    "stops": (
        "Stops while the panel is busy",
        "`python -m benchmarks.panel_stops --keep`: the virtual rig in real time, watched by 20 pages, "
        "while recordings are read and uploaded and fits run. A stop comes at a random instant, by the "
        "button (HTTP) or the key (the page's stream). It is timed from its request to the rig's command to "
        "ramp. The aim is below 50 ms in 99.9 %. The rig's process and the panel were permitted to raise "
        "their priority; the last row is for another run without this permission.",
        (
            "ramp, all",
            "the page is told that it stops",
            "ramp, at the lowest loads, a third",
            "ramp, at the highest loads, a third",
            "ramp, all, without the permission to raise a priority",
            "load",
        ),
    ),
    "explore": (
        "The sliders of Explore",
        "`python -m benchmarks.panel_explore`: a slider moves in every frame. A picture is a frame with new "
        "curves of an experiment of 1 s. Processor times are sums over server and browser.",
        ("Amplitude", "Mass of the end-effector"),
    ),
}


def options(description: str | None, **defaults: float) -> argparse.Namespace:
    """Return the options of a benchmark's command line: numbers with their defaults, and --keep."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in defaults.items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="write docs/benchmarks/panel.md")
    return parser.parse_args()


def record(section: str, rows: list[tuple[str, str]], numbers: dict[str, Any]) -> None:
    """Keep the figures of a benchmark, and write the page again.

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
    """Write panel.md from the contents of panel.json."""
    parts = [HEAD]
    for name, found in kept.items():
        key, _, word = name.partition(":")
        title, about, shown = ABOUT[key]
        if not shown:
            continue
        heading = f"## {title}, {word.strip()}" if word else f"## {title}"
        parts += [f"{heading}\n\n{textwrap.fill(about, 118)}\n", f"Measured: {found['machine']}.\n"]
        lines = [f"| {what} | {figure} |" for what, figure in found["rows"] if what in shown]
        parts.append("\n".join(["| | |", "|---|---|", *lines]) + "\n")
    PAGE.write_text("\n".join(parts), encoding="utf-8")
