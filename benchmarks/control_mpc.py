"""The end of a move, beside a controller that knows everything: do-mpc as a referee.

python -m benchmarks.control_mpc

The piezo goes from rest to a target 2 um away, the contact sticking, 20 kHz, two ticks of delay. Ours is the
regulator that `tune` gives with its scan; do-mpc's MPC has the plant as it is, or with its stage's frequency
10 % off, and sees the whole state without noise. Writes docs/benchmarks/control-mpc.md; needs `make peers`.
"""

from __future__ import annotations

import json
import math
import subprocess
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.control.loops import Loop, sampled_loop
from stickslip.control.tuning import Tuning
from stickslip.physics.actuator import Actuator

from .control_bench import RATE, TOP, loop, ours
from .results import write_page
from .session import PEERS, ROOT

OUT = ROOT / "docs" / "benchmarks" / "control-mpc.md"
UNIT, TARGET, TICKS, DELAY = 1e-6, 2e-6, 1200, 2
HORIZON, WEIGHT = 80, 1e-5  # ticks; (um/V)^2 of the change of the voltage
WINDOWS = (100e-9, 10e-9, 3e-9)
SCANS = (20e-3, 10e-3, 5e-3)  # s, of which the first is the default
OFF = {"as it is": 1.0, "stage 10 % slower": 0.9, "stage 10 % faster": 1.1}

Array = NDArray[np.float64]


class Row(NamedTuple):
    """A controller on a plant: times [s] to the windows, overshoot [m], s of processor time of an update."""

    name: str
    plant: str
    times: tuple[float, ...]
    overshoot: float
    seconds: float


def row(name: str, plant: str, positions: Array, seconds: float) -> Row:
    off = np.abs(positions - TARGET)
    last = [int(np.flatnonzero(off > w)[-1]) + 1 if (off > w).any() else 0 for w in WINDOWS]
    times = tuple(one / RATE if one < off.size else math.nan for one in last)
    return Row(name, plant, times, max(float(positions.max()) - TARGET, 0.0), seconds)


def scanned(tuning: Tuning, plant: Loop, scan: float) -> tuple[Array, float]:
    """Positions under our regulator, and the time of an update."""
    regulator, ticks = ours(tuning), round(scan * RATE)
    regulator.begin(0.0, 0.0)
    state, found = np.zeros(plant.b.size), []
    spent = 0.0
    for k in range(TICKS):
        found.append(float(plant.c @ state))
        begun = time.process_time()
        share = min((k + 1) / ticks, 1.0)
        wanted = TARGET * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # with the least jerk
        volts = regulator.step(found[-1], wanted, k)
        spent += time.process_time() - begun
        state = plant.a @ state + plant.b * volts
    return np.array(found), spent / TICKS


def scaled(plant: Loop) -> dict[str, Any]:
    """A plant in micrometres and volts, from rest at 0 V."""
    late = plant.b.size - DELAY
    unit = np.concatenate([np.full(late, UNIT), np.ones(DELAY)])
    a, b, c = plant.a * unit / unit[:, None], plant.b / unit, plant.c * unit / UNIT
    return {"a": a.tolist(), "b": b.tolist(), "c": c.tolist(), "start": [0.0] * plant.b.size}


def predicted(plants: list[Loop]) -> tuple[str, list[dict[str, Any]]]:
    """What do-mpc does, with the first plant as its model."""
    problem = {
        "plants": [scaled(one) for one in plants],
        "target": TARGET,
        "horizon": HORIZON,
        "rate": RATE,
        "weight": WEIGHT,
        "volts": [0.0, TOP],
        "ticks": TICKS,
    }
    command = [str(PEERS), "-m", "benchmarks.peers.do_mpc"]
    ended = subprocess.run(
        command, cwd=ROOT, input=json.dumps(problem), capture_output=True, text=True, check=True
    )
    answer = json.loads(ended.stdout[ended.stdout.index('{"version"') :])
    return answer["version"], answer["found"]


def models(base: Actuator) -> dict[str, Actuator]:
    return {
        name: base.replace(natural_frequency=base.natural_frequency * factor) for name, factor in OFF.items()
    }


def main() -> None:
    """See the module."""
    base, tuning, _ = loop()
    plants = {name: sampled_loop(one, RATE, delay=DELAY) for name, one in models(base).items()}
    rows = [
        row(f"ours, scan of {1e3 * scan:g} ms", name, *scanned(tuning, plant, scan))
        for scan in SCANS
        for name, plant in plants.items()
    ]
    version, found = predicted(list(plants.values()))
    rows += [
        row("do-mpc", name, np.array(one["positions"]), one["seconds"])
        for name, one in zip(plants, found, strict=True)
    ]
    print(write_page(OUT, measured(version, rows)))


def measured(version: str, rows: list[Row]) -> dict[str, str]:
    """Return the measured parts of the page."""
    said = " | ".join(f"{1e9 * w:g} nm" for w in WINDOWS[:2])
    lines = [f"| controller | plant | {said} | overshoot | an update takes |", "|" + "---|" * 6]
    for one in rows:
        times = " | ".join("-" if t != t else f"{1e3 * t:.1f} ms" for t in one.times[:2])
        over, update = f"{1e9 * one.overshoot:.1f} nm", f"{1e6 * one.seconds:.0f} us"
        lines.append(f"| {one.name} | {one.plant} | {times} | {over} | {update} |")
    command = (
        f"`python -m benchmarks.control_mpc` (after `make peers`), do-mpc {version}, {HORIZON} ticks ahead"
    )
    return {"command": command, "times": "\n".join(lines)}


if __name__ == "__main__":
    main()
