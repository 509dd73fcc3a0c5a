"""Coverage of a parameter that is truly zero, by loops of four laws.

Each run has its own noise, and begins with the parameter at a start drawn over four decades. Its interval
must begin at 0, the minimum of the law, and end where the data end it, and those of the others must
hold the truth: ``python -m benchmarks.zero_parameter 20 docs/benchmarks/zero-parameter.json``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stickslip.friction import Elastoplastic, LuGre, MaxwellSlip
from stickslip.identify.loops.fit import identify_loops
from stickslip.recording import make_recording
from stickslip.simulation import friction_response

NOISE = 2e-3  # N
SAMPLES, SPAN, STROKE = 801, 4.0, 60e-6  # of each recording: s, m
DECADES = (-2.0, 2.0)  # of the start, about `NATURAL`
NATURAL = {"sigma_1": 100.0, "sigma_2": 20.0}  # N s/m


class Law(NamedTuple):
    """A law whose parameter `zero` is 0, with what is free besides and tied."""

    truth: Any
    zero: str
    free: tuple[str, ...]
    tied: Mapping[str, str] = {}  # never changed


LAWS = {
    "LuGre, sigma_2": Law(
        LuGre(1e5, 50.0, 0.0, 0.5, 0.5),
        "sigma_2",
        ("sigma_0", "coulomb_force"),
        {"stiction_force": "coulomb_force"},
    ),
    "LuGre, sigma_1": Law(
        LuGre(1e5, 0.0, 20.0, 0.5, 0.5),
        "sigma_1",
        ("sigma_0", "sigma_2", "coulomb_force"),
        {"stiction_force": "coulomb_force"},
    ),
    "elastoplastic, sigma_2": Law(
        Elastoplastic(1e5, 50.0, 0.0, 0.5, 0.5, 2e-6), "sigma_2", ("sigma_0", "coulomb_force")
    ),
    "Maxwell slip, sigma_2": Law(
        MaxwellSlip((6e4, 3e4), (0.2, 0.3), 0.0), "sigma_2", ("strength_1", "strength_2")
    ),
}


def run(law: Law, seed: int) -> dict[str, float]:
    """Return whether the intervals of one fit hold, and the ends of that of the parameter that is 0."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, SPAN, SAMPLES)
    position = STROKE * np.sin(2.0 * np.pi * time / 2.0) * (1.0 + 0.3 * np.sin(1.3 * time))
    force = friction_response(law.truth, time, position).friction_force.values
    force = force + NOISE * random.standard_normal(SAMPLES)
    recording = make_recording(time, {"position": (position, "m"), "friction_force": (force, "N")})
    start = NATURAL[law.zero] * 10.0 ** random.uniform(*DECADES)
    begin = law.truth._replace(**{law.zero: start})
    fit = identify_loops(recording, begin, [law.zero, *law.free], tied=law.tied)
    ends, truth = fit.confidence_intervals(), law.truth._asdict()
    truth |= {f"strength_{i}": x for i, x in enumerate(truth.get("strength", ()), start=1)}
    low, high = ends[law.zero]
    others = [ends[name][0] <= truth[name] <= ends[name][1] for name in law.free]
    return {
        "start": start,
        "low": low,
        "high": high,
        "holds": float(low <= 0.0),
        "others": float(np.mean(others)),
        "silent": float(not (fit.failures or fit.undetermined)),
    }


def table(count: int) -> dict[str, Any]:
    """Return the shares over so many runs of each law."""
    found = {}
    for name, law in LAWS.items():
        runs = [run(law, seed) for seed in range(count)]
        columns = {key: np.array([one[key] for one in runs]) for key in runs[0]}
        found[name] = {
            "runs": count,
            "interval_holds_zero": float(columns["holds"].mean()),
            "intervals_of_others_hold": float(columns["others"].mean()),
            "wrong_and_silent": float(np.mean((columns["holds"] == 0.0) & (columns["silent"] == 1.0))),
            "upper_end_median": float(np.median(columns["high"])),
            "upper_end_least": float(columns["high"].min()),
            "upper_end_greatest": float(columns["high"].max()),
            "unit": "N s/m",
        }
        print(name, found[name], file=sys.stderr, flush=True)
    return found


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    said = json.dumps(table(count), indent=1)
    if len(sys.argv) > 2:
        Path(sys.argv[2]).write_text(said + "\n", encoding="utf-8")
    print(said)
