"""python -m benchmarks.random_orbits [COUNT] [--seed S]: `steady_step` beside waiting.

The actuators of `benchmarks.random_actuators` under their periodic drives, at a constant normal force. The
truth is what `simulate`, at a hundredth of the tolerance, settles into from rest; where it has not settled
after so many periods, there is none. The page is `docs/benchmarks/random-orbits.md`.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import stickslip as ss
from stickslip.simulation import Orbit, SimulationError, steady_orbit

from .random_actuators import LAWS, Member, members, table

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "random-orbits.md"
TOLERANCE = 1e-10  # m, of the net step
PERIODS, MOST_STEPS = 300, 3_000_000
SETTLED = 0.1  # of the tolerance: two of the last steps differ by no more


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


def waited(m: Member) -> float:
    """The step that the motion from rest settles into, m; NaN where it does not."""
    times = np.arange(PERIODS - 2, PERIODS + 1) * m.waveform.period
    try:
        run = ss.simulate(
            m.actuator, m.waveform, times=times, tolerance=0.01 * TOLERANCE, load=m.load, max_steps=MOST_STEPS
        )
    except SimulationError:
        return math.nan
    steps = np.diff(run["end_effector_position"].values)
    return float(steps[-1]) if steps.size == 2 and abs(np.diff(steps)[0]) <= SETTLED * TOLERANCE else math.nan


def compared(m: Member) -> Compared:
    """One member; errors and warnings of both are part of what is found."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        truth, begun = waited(m), time.perf_counter()
        try:
            orbit: Any = steady_orbit(m.actuator, m.waveform, tolerance=TOLERANCE, load=m.load)
        except SimulationError:
            orbit = None
        return Compared(m, truth, orbit, time.perf_counter() - begun)


def _row(name: str, rows: list[Compared]) -> list[str]:
    """Of those that settle: how many are found, and their errors in tolerances."""
    known = [one for one in rows if math.isfinite(one.waited)]
    errors = np.array([abs(one.orbit.step - one.waited) for one in known if one.found and one.orbit])
    errors /= TOLERANCE
    quantile = np.quantile(errors, 0.99, method="higher")
    shares = [str(int(np.sum(errors > limit))) for limit in (1.0, 3.0, 10.0)]
    return [name, str(len(known)), str(errors.size), f"{np.median(errors):.2g}", f"{quantile:.3g}", *shares]


def page(rows: list[Compared], count: int, seed: int) -> str:
    """The study as a page."""
    known = [one for one in rows if math.isfinite(one.waited)]
    unknown = [one for one in rows if not math.isfinite(one.waited)]
    laws = [_row(name, [one for one in rows if one.member.law == name]) for name in LAWS]
    worst = [one for one in known if one.found and one.orbit]
    worst.sort(key=lambda one: -abs(one.orbit.step - one.waited))  # type: ignore[union-attr]
    far = [
        [
            str(one.member.number),
            one.member.law,
            f"{one.waited * 1e9:.4g}",
            f"{one.orbit.step * 1e9:.4g}",
            f"{np.abs(one.orbit.multipliers).max():.3g}",
        ]
        for one in worst[:10]
        if one.orbit
    ]
    lost, kept = sum(not one.found for one in known), sum(one.found for one in unknown)
    milliseconds = 1e3 * np.median([one.seconds for one in rows])
    return "\n\n".join(
        [
            "# Random orbits",
            f"`python -m benchmarks.random_orbits {count} --seed {seed}`: of the [random actuators]"
            f"(random-actuators.md), the {len(rows)} under a periodic drive at a constant normal force. "
            f"`steady_step` at {TOLERANCE * 1e9:g} nm, beside the step that `simulate` settles into from "
            f"rest, within {PERIODS} periods and at a hundredth of the tolerance: {len(known)} do. Errors in "
            "tolerances.",
            table(
                ["", "settle", "found", "median", "99 %", "> 1", "> 3", "> 10"], [_row("all", rows), *laws]
            ),
            f"Not found, or not shown to be within the tolerance, and said so: {lost} of those that settle. "
            f"Of the {len(unknown)} that do not settle in {PERIODS} periods {kept} have a step all the same. "
            f"A step took {milliseconds:.3g} ms (median).",
            "## The worst ten of those found",
            table(["member", "law", "waited, nm", "found, nm", "largest multiplier"], far),
        ]
    )


def main() -> None:
    """Run the study, print the page and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.random_orbits", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=200, metavar="COUNT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=PAGE)
    asked = parser.parse_args()
    chosen = [m for m in members(asked.count, asked.seed) if repeats(m)]
    for name in LAWS:  # compiled before they are timed
        compared(next(m for m in chosen if m.law == name))
    text = page([compared(m) for m in chosen], asked.count, asked.seed)
    asked.out.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
