"""The figures of the panel's benchmarks, kept in docs/benchmarks/panel.json, and panel.md made of it."""

from __future__ import annotations

import argparse
import json
import os
from datetime import date
from pathlib import Path
from typing import Any

from .results import filled

FOLDER = Path(__file__).parents[1] / "docs" / "benchmarks"
JSON, PAGE = FOLDER / "panel.json", FOLDER / "panel.md"

# Sections and rows that the page shows; panel.json keeps all.
SHOWN = {
    "hour": ("connections", "stop, files and a fit", "frames, files and a fit", "memory of the panel"),
    "stops": (
        "ramp, all",
        "the page is told that it stops",
        "ramp, at the lowest loads, a third",
        "ramp, at the highest loads, a third",
        "ramp, all, without the permission to raise a priority",
        "load",
    ),
    "explore": ("Amplitude", "Mass of the end-effector"),
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
        section: name of the benchmark.
        rows: what was measured, and the figure with its unit.
        numbers: the same for machines.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    kept = json.loads(JSON.read_text(encoding="utf-8")) if JSON.is_file() else {}
    machine = f"{date.today()}, {os.cpu_count()} processors, load {os.getloadavg()[1]:.1f}"
    kept[section] = {"machine": machine, "rows": rows, **numbers}
    kept = dict(sorted(kept.items()))
    JSON.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    write_page(kept)
    for what, figure in rows:
        print(f"{what}: {figure}")


def write_page(kept: dict[str, Any]) -> None:
    """Write panel.md from the contents of panel.json; the words are those of the page."""
    parts = {}
    for name in SHOWN.keys() & kept.keys():
        found = kept[name]
        rows = [f"| {what} | {figure} |" for what, figure in found["rows"] if what in SHOWN[name]]
        parts[name] = "\n".join([f"Measured: {found['machine']}.", "", "| | |", "|---|---|", *rows])
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), parts, PAGE), encoding="utf-8")
