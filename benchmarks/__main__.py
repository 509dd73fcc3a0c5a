"""python -m benchmarks [PART ...]: measure, and renew `docs/benchmarks/`; all parts take about ten minutes.

Peers need their environment (`make peers`); without it, their rows say so.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stickslip.report.figures.style import svg

from . import accuracy, campaign, pictures, results, startup, tables
from .ours.ensemble import MEMBERS
from .session import PEERS, ROOT, Row, Tool, measure, peer
from .truth import TRUTH

OUT = ROOT / "docs" / "benchmarks"

Part = Callable[[], tuple[list[Row], dict[str, str]]]


def _trajectory() -> tuple[list[Row], dict[str, str]]:
    names = ("numbalsoda", "fixed_step", "sundae", "casadi", "scipy", "jax", "octave")
    return measure("trajectory", [Tool("benchmarks.ours.trajectory"), *map(peer, names)], rounds=8)


def _steady() -> tuple[list[Row], dict[str, str]]:
    return measure("steady", [Tool("benchmarks.ours.steady"), peer("numbalsoda")], rounds=4)


def _ensemble() -> tuple[list[Row], dict[str, str]]:
    if not TRUTH.exists() and PEERS.exists():
        TRUTH.parent.mkdir(parents=True, exist_ok=True)
        command = [str(PEERS), "-m", "benchmarks.peers.lanes", "truth", str(TRUTH)]
        subprocess.run(command, cwd=ROOT, check=True, timeout=120)
    devices = f"--xla_force_host_platform_device_count={os.cpu_count()}"
    tools = [
        Tool("benchmarks.ours.ensemble"),
        *map(peer, ("lanes", "numbalsoda")),
        peer("jax", {"XLA_FLAGS": devices}),
    ]
    rows, versions = measure("ensemble", tools, rounds=5, most=4.0)
    for members in MEMBERS:  # one after the other, each in a process that held no more before
        name = f"ensemble-{members}"
        rows += measure(name, [Tool("benchmarks.ours.ensemble")], rounds=2, most=2.0)[0]
    return rows, versions


def _fit() -> tuple[list[Row], dict[str, str]]:
    return measure("fit", [Tool("benchmarks.ours.fit"), peer("fitting")], rounds=3, most=1.0)


def _campaign() -> tuple[list[Row], dict[str, str]]:
    campaign.prepare()
    tools = [Tool("benchmarks.ours.campaign"), peer("campaign")]
    return measure("campaign", tools, rounds=3, most=4.0, patience=900.0)


PARTS: dict[str, Part] = {
    "trajectory": _trajectory,
    "steady": _steady,
    "ensemble": _ensemble,
    "fit": _fit,
    "campaign": _campaign,
    "accuracy": accuracy.measure_accuracy,
    "startup": startup.measure_startup,
}


def main() -> None:
    """Run the parts, put their rows into the file of results, and draw the page anew."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all, if left out")
    parser.add_argument("--out", type=Path, default=OUT)
    asked = parser.parse_args()
    unknown = [part for part in asked.parts if part not in PARTS]
    if unknown:
        parser.error(f"no such part: {', '.join(unknown)}")
    file = asked.out / "results.json"
    for part in asked.parts or PARTS:
        start = time.monotonic()
        rows, versions = PARTS[part]()
        results.record(file, part, rows, versions, time.monotonic() - start)
        print(f"{part}: {time.monotonic() - start:.0f} s", file=sys.stderr)
    _draw(results.load(file), asked.out)


def _draw(found: dict[str, Any], out: Path) -> None:
    (out / "README.md").write_text(tables.page(found))
    if "trajectory" in found:
        picture = pictures.work_precision(found["trajectory"]["rows"])
        (out / "work-precision.svg").write_text(svg(picture) + "\n")
    if "ensemble" in found:
        (out / "scaling.svg").write_text(svg(pictures.scaling(found["ensemble"]["rows"])) + "\n")


if __name__ == "__main__":
    main()
