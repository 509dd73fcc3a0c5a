"""Maps and drives of random actuators, seeds of searches: ``python -m benchmarks.design PART [FIRST COUNT]``.

- `maps`: points of `step_map` of random actuators against `simulate` run until its periods repeat.
- `drives`: optimised drives of random actuators against the best sawtooth, and against what SciPy's
  differential evolution finds of the same four knots and the frequency, through `steady_steps`.
- `seeds`: `kang2007`, 0 to 100 V, eight knots: the search in one condition, and in 195 (64 draws of Coulomb
  friction, bristle stiffness and natural frequency, each with -0.1, 0 and 0.1 N), by seeds.
- `costs`: processor time of a front of 50 points and of a map of 100 x 100.

Seconds are of processor time, of all threads together. The page is `docs/benchmarks/design.md`.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import differential_evolution

import stickslip as ss
from stickslip import design
from stickslip.design import Scenario
from stickslip.design.limits import allowed
from stickslip.estimate import Posterior
from stickslip.waveform.signal import Waveform

KNOTS, TOP = 4, 100.0  # values within a period; V
GENERATIONS, POPULATION = 60, 15
# Periods that are waited for, at most; what of a net step counts as repeated, m.
MOST_PERIODS, REPEATED = 6400, 2e-12
MADE_OF = {"coulomb_force": 0.1, "sigma_0": 0.2, "natural_frequency": 0.03}  # relative deviations of draws


class Member(NamedTuple):
    """A random actuator with its load on it, and a sawtooth for its map."""

    number: int
    actuator: ss.Actuator
    rise: float

    @property
    def law(self) -> str:
        return type(self.actuator.friction).__name__


def member(number: int) -> Member:
    """The random actuator of this number; the laws take turns."""
    random = np.random.default_rng([17, number])

    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    mass, gain = log(0.01, 0.5), log(0.05e-6, 0.2e-6)
    force = 9.81 * mass * log(0.1, 2.0)  # a preload between a fifth of the weight and four times that
    stuck = force * float(random.uniform(1.0, 1.3))
    stiffness = force / log(0.1e-6, 2e-6)  # it slips after 0.1 to 2 um
    damping = 2.0 * float(random.uniform(0.0, 0.7)) * math.sqrt(stiffness * mass)
    laws: list[Callable[[], Any]] = [
        lambda: ss.LuGre(stiffness, damping, 0.0, force, stuck, log(1e-3, 1e-2)),
        lambda: ss.Elastoplastic(stiffness, damping, 0.0, force, stuck, 0.5 * force / stiffness, 2e-3),
        lambda: ss.Dahl(stiffness, force),
        lambda: ss.MaxwellSlip((0.7 * stiffness, 0.3 * stiffness), (0.5 * force, 0.5 * force)),
        lambda: ss.StictionCoulombViscous(force, stuck, log(1e-2, 1.0)),
    ]
    made = ss.Actuator(
        gain=gain,
        natural_frequency=2.0 * math.pi * log(300.0, 5e3),
        damping_ratio=log(0.02, 0.7),
        stage_mass=log(0.05, 0.5),
        end_effector_mass=mass,
        friction=laws[number % len(laws)](),
        stage_reaction=bool(random.integers(2)),
        external_force=float(random.uniform(-0.3, 0.3)) * force,
        min_voltage=0.0,
        max_voltage=150.0,
    )
    return Member(number, made, float(random.uniform(0.85, 0.98)))


def headed(*names: str) -> None:
    """Print the head of a table."""
    print(f"| {' | '.join(names)} |\n|{'---|' * len(names)}", flush=True)


def settled_step(model: ss.Actuator, drive: Waveform, period: float) -> float:
    """m: net step of a period after so many from rest that it no longer changes; NaN where it still does."""
    periods, before = 50, math.nan
    while periods <= MOST_PERIODS:
        times = np.array([0.0, periods - 1.0, periods]) * period
        x = ss.simulate(model, drive, times=times, tolerance=1e-10)["end_effector_position"].values
        step = float(x[2] - x[1])
        if abs(step - before) <= REPEATED + 1e-6 * abs(step):
            return step
        periods, before = 2 * periods, step
    return math.nan


def compared(of: Member) -> list[dict[str, Any]]:
    """Points of a map of an actuator: three voltages and three frequencies below that of its stage."""
    drive = ss.Sawtooth(1.0, 1.0, of.rise)
    stage = of.actuator.natural_frequency / (2.0 * math.pi)
    hertz = [0.02 * stage, 0.1 * stage, 0.4 * stage]
    found = ss.step_map(of.actuator, drive, voltage=[15.0, 60.0, 140.0], frequency=hertz)
    rows = []
    for volts in found.voltage.values.tolist():
        for f in hertz:
            at = found.sel(voltage=volts, frequency=f)
            step = settled_step(of.actuator, ss.Sawtooth(volts, f, of.rise), 1.0 / f)
            rows.append(
                {"volts": volts, "hertz": f, "map": float(at.net_step), "waited": step,
                 "status": int(at.status), "reason": str(at.reason.item())}
            )  # fmt: skip
    return rows


def maps(first: int, count: int) -> None:
    """Print the table of each law."""
    rows = [(of, row) for of in map(member, range(first, first + count)) for row in compared(of)]
    heads = ("law", "points", "both have a step", "off, median, nm", "95 %, nm", "most, nm", "map alone")
    headed(*heads, "waiting alone")
    for law in [*dict.fromkeys(of.law for of, _ in rows), ""]:
        some = [row for of, row in rows if law in ("", of.law)]
        pairs = np.array([(row["map"], row["waited"]) for row in some])
        there = np.isfinite(pairs)
        off = 1e9 * np.abs(np.diff(pairs[there.all(axis=1)], axis=1))[:, 0]
        alone = [int(np.sum(there[:, i] & ~there[:, 1 - i])) for i in (0, 1)]
        ends = [f"{x:.2g}" for x in (np.median(off), np.quantile(off, 0.95), off.max())]
        print(f"| {law or 'all'} | {len(some)} | {off.size} | {' | '.join(ends)} | {alone[0]} | {alone[1]} |")
    for of, row in rows:
        if not abs(row["map"] - row["waited"]) < 1e-9:
            print(of.number, of.law, row, file=sys.stderr)


def outside(model: ss.Actuator, seed: int, generations: int = GENERATIONS) -> tuple[float, int]:
    """m/s, the fastest that SciPy's differential evolution finds, and how many motions it took."""
    within = allowed(model, None, TOP, None, None)
    span, count = math.log(within.fastest / within.slowest), 0

    def slowness(x: np.ndarray) -> Any:
        nonlocal count
        columns = np.atleast_2d(x.T)
        count += len(columns)
        period = 1.0 / (within.slowest * np.exp(span * columns[:, -1]))
        knots = {f"value_{k + 1}": TOP * columns[:, k] for k in range(KNOTS)}
        knots |= {f"time_{k + 1}": k / KNOTS * period for k in range(1, KNOTS)} | {"period": period}
        start = ss.PeriodicKnots((0.0, 0.25, 0.5, 0.75), (0.0, 1.0, 2.0, 1.0), 1.0)
        steps = ss.steady_steps(model, start, parameters=knots, tolerance=1e-9).net_step.values
        return np.where(np.isfinite(steps), -steps / period, 1.0)

    found = differential_evolution(
        slowness, [(0.0, 1.0)] * (KNOTS + 1), maxiter=generations, popsize=POPULATION, rng=seed,
        vectorized=True, updating="deferred", polish=False, tol=0.0,
    )  # fmt: skip
    return -float(found.fun), count


def searched(number: int) -> dict[str, Any]:
    """Our drive, the best sawtooth and the outside one, of a random actuator."""
    of = member(number)
    found = ss.optimise_waveform(of.actuator, goal="speed", knots=KNOTS, max_voltage=TOP)
    other, count = outside(of.actuator, number)
    return {
        "law": of.law,
        "ours": found.value,
        "sawtooth": found.sawtooth_value,
        "outside": other,
        "motions": (found.evaluations, count),
        "fell_back": found.fell_back,
    }


def drives(first: int, count: int) -> None:
    """Print a row for each actuator."""
    heads = ("", "law", "ours, mm/s", "best sawtooth", "differential evolution", "ours over the best of both")
    headed(*heads, "motions")
    for number in range(first, first + count):
        try:
            row = searched(number)
        except ss.QuantityError as error:
            print(f"| {number} | {member(number).law} | {error} | | | | |", flush=True)
            continue
        best = max(row["sawtooth"], row["outside"])
        speeds = " | ".join(f"{1e3 * row[name]:.4g}" for name in ("ours", "sawtooth", "outside"))
        saw = " (the sawtooth)" if row["fell_back"] else ""
        print(
            f"| {number} | {row['law']} | {speeds} | {row['ours'] / best:.4f}{saw} "
            f"| {row['motions'][0]} and {row['motions'][1]} |",
            flush=True,
        )


def draws(seed: int) -> Posterior:
    """What may differ of the contact, and of the stage, of `kang2007`."""
    random, model = np.random.default_rng([seed, 7]), ss.load_actuator("kang2007")
    own = model._asdict() | model.friction._asdict()
    columns = {
        name: (("chain", "draw"), own[name] * np.exp(share * random.standard_normal((1, 64))))
        for name, share in MADE_OF.items()
    }
    return Posterior(xr.Dataset(columns), xr.Dataset(), True, "", 1.0)


def seeds(first: int, count: int) -> None:
    """Print a row for each seed."""
    model = ss.load_actuator("kang2007")
    loads = [Scenario(external_force=f"{newton} N") for newton in (-0.1, 0.1)]
    common: dict[str, Any] = {"goal": "speed", "knots": 8, "max_voltage": TOP}
    many_of = ("195 conditions, mm/s", "sawtooth", "motions", "over one", "s", "over one")
    headed("seed", "one condition, mm/s", "motions", "s", *many_of, "worse than the sawtooth in")
    for seed in range(first, first + count):
        begun = time.process_time()
        one = ss.optimise_waveform(model, **common, seed=seed)
        between = time.process_time()
        known = {"scenarios": loads, "uncertainty": draws(seed), "draws": 64}
        many = ss.optimise_waveform(model, **common, seed=seed, **known)
        spent = [between - begun, time.process_time() - between]
        worse = int(np.sum(many.values < many.sawtooth_values - 1e-9))
        print(
            f"| {seed} | {1e3 * one.value:.4f} | {one.evaluations} | {spent[0]:.2f} | {1e3 * many.value:.3f} "
            f"| {1e3 * many.sawtooth_value:.3f} | {many.evaluations} "
            f"| {many.evaluations / one.evaluations:.1f} "
            f"| {spent[1]:.1f} | {spent[1] / spent[0]:.1f} | {worse} of {many.values.size} |",
            flush=True,
        )


def costs(first: int, count: int) -> None:
    """Print seconds, the median of so many times."""
    del first
    model, took = ss.load_actuator("kang2007"), []
    for seed in range(count):
        times = [time.process_time()]
        goals = "speed", design.Current(1.8e-6)
        front = design.waveform_front(model, goals=goals, max_voltage=TOP, seed=seed)
        times.append(time.process_time())
        ss.step_map(model, voltage=np.linspace(1.0, TOP, 100), frequency=np.geomspace(5.0, 1000.0, 100))
        times.append(time.process_time())
        took.append(np.diff(times))
        print(seed, len(front.waveforms), front.evaluations, took[-1].round(2), file=sys.stderr, flush=True)
    middle = np.median(took, axis=0)
    print(f"a front of 50: {middle[0]:.2f} s, a map of 100 x 100: {middle[1]:.2f} s of processor time")


PARTS: dict[str, tuple[Callable[[int, int], None], int, int]] = {
    "maps": (maps, 0, 30), "drives": (drives, 0, 30), "seeds": (seeds, 101, 10), "costs": (costs, 0, 3),
}  # fmt: skip

if __name__ == "__main__":
    of, first, count = PARTS[sys.argv[1]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.simulation.SimulationWarning)
        of(*(int(one) for one in sys.argv[2:4])) if len(sys.argv) > 3 else of(first, count)
