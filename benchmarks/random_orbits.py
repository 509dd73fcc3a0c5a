"""python -m benchmarks.random_orbits [COUNT] [--seed S]: `steady_step` beside waiting.

The actuators of `benchmarks.random_actuators` under their periodic drives, at a constant normal force. The
truth is what `simulate` settles into from rest, at a tenth and at a hundredth of the tolerance: where the two
differ, or where it has not settled after so many periods, it is not known. The page is
`docs/benchmarks/random-orbits.md`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import stickslip as ss
from stickslip.simulation import Orbit, SimulationError, steady_orbit

from .random_actuators import LAWS, Member, members, table
from .results import write_page

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "random-orbits.md"
TOLERANCE = 1e-10  # m, of the net step
PERIODS, MOST_STEPS = 300, 3_000_000
SETTLED = 0.1  # of the tolerance: two waits, and what all later periods may add, differ by no more


class Compared(NamedTuple):
    """One member: its step by waiting (NaN: not settled) and by `steady_orbit` (None: it raised), m, and how
    long the latter took, s."""

    member: Member
    waited: float
    orbit: Orbit | None
    seconds: float

    @property
    def found(self) -> bool:
        return self.orbit is not None and self.orbit.converged and self.orbit.error <= TOLERANCE


def repeats(m: Member) -> bool:
    """Whether it has a steady step."""
    return getattr(m.waveform, "period", None) is not None and isinstance(m.load, float)


def _last_steps(m: Member, tolerance: float) -> np.ndarray:
    """Of the last two of so many periods, m; none where the motion cannot be followed."""
    times = np.arange(PERIODS - 2, PERIODS + 1) * m.waveform.period
    try:
        run = ss.simulate(
            m.actuator, m.waveform, times=times, tolerance=tolerance, load=m.load, max_steps=MOST_STEPS
        )
    except SimulationError:
        return np.zeros(0)
    return np.diff(run["end_effector_position"].values)


def waited(m: Member, largest: float) -> float:
    """The step that the motion from rest settles into, m; NaN where it is not known. A disturbance shrinks by
    `largest` in a period."""
    fine, coarse = (_last_steps(m, share * TOLERANCE) for share in (0.01, 0.1))
    if fine.size < 2 or coarse.size < 2:
        return math.nan
    to_come = abs(fine[1] - fine[0]) / max(1.0 - min(largest, 1.0), 1e-12)
    known = max(to_come, abs(fine[1] - coarse[1])) <= SETTLED * TOLERANCE
    return float(fine[1]) if known else math.nan


def compared(m: Member) -> Compared:
    """One member; errors and warnings of both are part of what is found."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begun, orbit = time.perf_counter(), None
        with contextlib.suppress(SimulationError):
            orbit = steady_orbit(m.actuator, m.waveform, tolerance=TOLERANCE, load=m.load)
        seconds = time.perf_counter() - begun
        largest = float(np.max(np.abs(orbit.multipliers), initial=0.0)) if orbit else 0.0
        return Compared(m, waited(m, largest), orbit, seconds)


def _row(name: str, rows: list[Compared]) -> list[str]:
    """Of those that settle: how many are found, and their errors in tolerances."""
    known = [one for one in rows if math.isfinite(one.waited)]
    errors = np.array([abs(one.orbit.step - one.waited) for one in known if one.found and one.orbit])
    errors /= TOLERANCE
    if not errors.size:
        return [name, str(len(known)), "0", "-", "-", "0", "0", "0"]
    quantile = np.quantile(errors, 0.99, method="higher")
    shares = [str(int(np.sum(errors > limit))) for limit in (1.0, 3.0, 10.0)]
    return [name, str(len(known)), str(errors.size), f"{np.median(errors):.2g}", f"{quantile:.3g}", *shares]


HEAD = ("known", "found", "median", "99 %", "> 1", "> 3", "> 10")


def worst(rows: list[Compared]) -> list[dict[str, Any]]:
    """The ten largest errors of the steps found, as rows of the JSON file beside the page."""
    found = [
        (abs(one.orbit.step - one.waited), one, one.orbit)
        for one in rows
        if math.isfinite(one.waited) and one.found and one.orbit
    ]
    return [
        {
            "member": one.member.number,
            "law": one.member.law,
            "waited_nm": float(f"{one.waited * 1e9:.4g}"),
            "found_nm": float(f"{orbit.step * 1e9:.4g}"),
            "largest_multiplier": float(f"{np.abs(orbit.multipliers).max():.3g}"),
        }
        for _, one, orbit in sorted(found, key=lambda item: -item[0])[:10]
    ]


def measured(rows: list[Compared], count: int, seed: int) -> dict[str, str]:
    """Return the measured parts of the page."""
    known = [one for one in rows if math.isfinite(one.waited)]
    unknown = [one for one in rows if not math.isfinite(one.waited)]
    lost, kept = sum(not one.found for one in known), sum(one.found for one in unknown)
    milliseconds = 1e3 * np.median([one.seconds for one in rows])
    return {
        "command": f"`python -m benchmarks.random_orbits {count} --seed {seed}`: "
        f"{len(rows)} actuators; the reference is "
        f"known to a tenth of the tolerance for {len(known)}.",
        "errors": table(["", *HEAD], [_row("all", rows)]),
        "found": f"Of those known, {lost} were not found within the tolerance. "
        f"{kept} of the {len(unknown)} others also "
        f"have a step. A step took {milliseconds:.3g} ms (median).",
    }


def main() -> None:
    """Run the study, print the page and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.random_orbits", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=200, metavar="COUNT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=PAGE)
    asked = parser.parse_args()
    chosen = [m for m in members(asked.count, asked.seed) if repeats(m)]
    rows = [compared(m) for m in chosen]
    text = write_page(asked.out, measured(rows, asked.count, asked.seed), PAGE)
    laws = [_row(name, [one for one in rows if one.member.law == name]) for name in LAWS]
    numbers = {
        "groups": [dict(zip(("group", *HEAD), row, strict=True)) for row in laws],
        "largest_errors": worst(rows),
    }
    asked.out.with_suffix(".json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
