"""python -m benchmarks.random_actuators [COUNT] [--seed S]: errors of `ss.simulate`.

Plausible actuators of all laws, over decades of stiffness, mass, voltage and frequency, against the
trajectories of `benchmarks.oracle`, which shares no code with the package. They are kept under `out/`, so
that a second run is of the package only. The page is `docs/benchmarks/random-actuators.md`.

Actuators whose piezo has hysteresis, creep or both: `benchmarks.random_piezos`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import stickslip as ss

from . import oracle, oracle_piezo
from .results import write_page

ROOT = Path(__file__).parents[1]
SOURCE = (
    Path(oracle.__file__).read_bytes() + Path(oracle_piezo.__file__).read_bytes()
)  # as imported: it may change while this runs
PAGE = ROOT / "docs" / "benchmarks" / "random-actuators.md"
TOLERANCE = 1e-9  # m
PERIODS, SAMPLES = 3, 100
WELL_KNOWN = 1e-10  # m: the oracle's own doubt may not be above it
SMALL = 0.05e-9  # m: an error and its estimate, both below it, agree


class Member(NamedTuple):
    """One simulation: its number, what it is of, and the times at which it is compared [s]."""

    number: int
    actuator: ss.Actuator
    waveform: Any
    load: Any
    frequency: float

    @property
    def times(self) -> NDArray[np.float64]:
        """SAMPLES times over the periods of the drive, the last at their end."""
        return np.linspace(0.0, PERIODS / self.frequency, SAMPLES)

    @property
    def law(self) -> str:
        return type(self.actuator.friction).__name__

    @property
    def kind(self) -> str:
        """The law, or the models of the piezo."""
        if self.actuator.piezo is None:
            return self.law
        hysteresis, creep = self.actuator.piezo
        name = "" if hysteresis is None else type(hysteresis).__name__
        name += " by charge" if getattr(hysteresis, "charge_drive", False) else ""
        return " + ".join(part for part in (name, "Creep" if creep is not None else "") if part)


class Dice:
    """A generator of its own for each member, by what is drawn from it."""

    def __init__(self, seed: int, number: int, *further: int) -> None:
        self.rng = np.random.default_rng([seed, number, *further])

    def log(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(math.log(low), math.log(high))))

    def even(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def one_of(self, *choices: Any) -> Any:
        return choices[int(self.rng.integers(len(choices)))]


def _coulomb(d: Dice, c: dict[str, float]) -> Any:
    return ss.Coulomb(c["force"])


def _coulomb_viscous(d: Dice, c: dict[str, float]) -> Any:
    return ss.CoulombViscous(c["force"], c["viscous"])


def _stiction(d: Dice, c: dict[str, float]) -> Any:
    return ss.StictionCoulombViscous(c["force"], c["stiction"], c["viscous"])


def _stribeck(d: Dice, c: dict[str, float]) -> Any:
    exponent = d.one_of(2.0, 1.0, d.log(0.3, 3.0))
    return ss.Stribeck(c["force"], c["stiction"], c["stribeck"], c["viscous"], exponent)


def _dahl(d: Dice, c: dict[str, float]) -> Any:
    return ss.Dahl(c["stiffness"], c["force"], d.one_of(1.0, 1.0, 1.5, 2.0))


def _reset(d: Dice, c: dict[str, float]) -> Any:
    excess = c["stiction"] / c["force"] - 1.0
    return ss.ResetIntegrator(c["stiffness"], c["force"] / c["stiffness"], excess, c["damping"])


def _lugre(d: Dice, c: dict[str, float]) -> Any:
    fades = d.log(1e-3, 1e-1) if d.chance(0.2) else math.inf
    return ss.LuGre(
        c["stiffness"], c["damping"], c["viscous"], c["force"], c["stiction"], c["stribeck"], fades
    )


def _elastoplastic(d: Dice, c: dict[str, float]) -> Any:
    begins = d.even(0.2, 0.9) * c["force"] / c["stiffness"]
    shared = (c["stiffness"], c["damping"], c["viscous"], c["force"], c["stiction"])
    return ss.Elastoplastic(*shared, begins, c["stribeck"])


def _maxwell(d: Dice, c: dict[str, float]) -> Any:
    n = d.one_of(2, 3, 4)
    shares, parts = d.rng.dirichlet(np.full(n, 3.0)), d.rng.dirichlet(np.full(n, 3.0))
    stiffness = tuple(float(x) for x in c["stiffness"] * np.maximum(parts, 0.02))
    strength = tuple(float(x) for x in c["force"] * np.maximum(shares, 0.02))
    ratio = c["stiction"] / c["force"]
    return ss.MaxwellSlip(stiffness, strength, c["viscous"], ratio, c["stribeck"], d.log(1e2, 1e4))


LAWS: dict[str, Callable[[Dice, dict[str, float]], Any]] = {
    "Coulomb": _coulomb,
    "CoulombViscous": _coulomb_viscous,
    "StictionCoulombViscous": _stiction,
    "Stribeck": _stribeck,
    "Dahl": _dahl,
    "ResetIntegrator": _reset,
    "LuGre": _lugre,
    "Elastoplastic": _elastoplastic,
    "MaxwellSlip": _maxwell,
}


def _constants(d: Dice, mass: float) -> dict[str, float]:
    """What laws are made of: friction grows with the mass, the bristle is damped by a ratio of 0 to 1."""
    stiffness = d.log(1e5, 1e8)
    force = float(np.clip(5.0 * math.sqrt(mass) * d.log(0.1, 3.0), 0.02, 5.0))
    ratio = d.one_of(0.0, d.even(0.0, 1.0), d.log(0.01, 1.0), d.log(0.01, 1.0))
    return {
        "stiffness": stiffness,
        "force": force,
        "stiction": force * (d.even(1.0, 1.6) if d.chance(0.7) else 1.0),
        "stribeck": d.log(1e-4, 1e-2),
        "damping": 2.0 * ratio * math.sqrt(stiffness * mass),
        "viscous": d.log(1e-3, 1.0) if d.chance(0.5) else 0.0,
    }


def _drive(d: Dice, amplitude: float, frequency: float) -> Any:
    fraction = 1.0 if d.chance(0.4) else d.even(0.7, 0.999)
    kind = d.one_of(ss.Sawtooth, ss.Sawtooth, ss.ReverseSawtooth, ss.Sine, ss.Step)
    if kind is ss.Step:
        return ss.Step(amplitude)
    return kind(amplitude, frequency) if kind is ss.Sine else kind(amplitude, frequency, fraction)


def _load(d: Dice, frequency: float) -> Any:
    """Normal force over its reference: mostly 1, else between 0.5 and 1.5."""
    if not d.chance(0.12):
        return 1.0
    if d.chance(0.5):
        return ss.Sine(d.even(0.05, 0.5), frequency * d.log(0.3, 3.0), offset=1.0)
    start, end = d.even(0.5, 1.5), d.even(0.5, 1.5)
    begins, lasts = d.even(0.0, 1.0) / frequency, d.even(0.5, 2.5) / frequency
    return ss.waveform.Ramp((end - start) / lasts, begins, lasts, offset=start)


def member(number: int, seed: int) -> Member:
    """The member of this number; the laws take turns."""
    d = Dice(seed, number)
    mass, frequency = d.log(1e-3, 1.0), d.log(2.0, 2e4)
    law = list(LAWS.values())[number % len(LAWS)](d, _constants(d, mass))
    load = _load(d, frequency)
    normal = load if isinstance(load, float) else load.offset
    axial = d.even(-0.98, 0.98) * oracle.breakaway(law) * normal if d.chance(0.5) else 0.0
    incline = d.even(-0.2, 0.2) if d.chance(0.1) else 0.0
    actuator = ss.Actuator(
        gain=d.log(0.05e-6, 0.2e-6),
        natural_frequency=2 * math.pi * d.log(200.0, 2e4),
        damping_ratio=d.log(0.005, 0.7),
        stage_mass=d.log(0.01, 0.5),
        end_effector_mass=mass,
        friction=law,
        stage_reaction=d.chance(0.5),
        external_force=axial + mass * 9.80665 * math.sin(incline),
        incline=incline,
    )
    return Member(number, actuator, _drive(d, d.log(0.2, 200.0), frequency), load, frequency)


def members(count: int, seed: int = 0) -> list[Member]:
    """So many, each of its own seed and number: a longer list begins with the shorter one."""
    return [member(number, seed) for number in range(count)]


def truth(m: Member) -> oracle.Truth:
    """Its trajectory by the oracle."""
    if m.actuator.piezo is not None:
        return oracle_piezo.truth(m.actuator, m.waveform, m.load, m.times, 2 * math.pi * m.frequency)
    return oracle.truth(m.actuator, m.waveform, m.load, m.times, 2 * math.pi * m.frequency)


# ---- The study.


class Truths(NamedTuple):
    """Of all members: positions [members, times], the oracle's doubt [m] and seconds."""

    position: NDArray[np.float64]
    doubt: NDArray[np.float64]
    seconds: NDArray[np.float64]


def truths(chosen: list[Member], seed: int) -> Truths:
    """By the oracle, or as it found them before; a change of oracle or sampler makes them anew."""
    mark = hashlib.sha256(SOURCE + repr(chosen).encode()).hexdigest()[:12]
    file = ROOT / "out" / f"random-actuators-{seed}-{len(chosen)}-{mark}.npz"
    if file.exists():
        with np.load(file) as kept:
            return Truths(kept["position"], kept["doubt"], kept["seconds"])
    found = []
    for m in chosen:
        found.append(truth(m))
        if m.number % 20 == 19:
            print(f"oracle: {m.number + 1} of {len(chosen)}", file=sys.stderr, flush=True)
    made = Truths(*(np.array([getattr(one, name) for one in found]) for name in Truths._fields))
    file.parent.mkdir(exist_ok=True)
    np.savez(file, **made._asdict())
    return made


class Found(NamedTuple):
    """What the package made of a member: error and its own estimate [m], seconds, steps, and its warnings."""

    error: float
    estimate: float
    seconds: float
    steps: int
    said: str


def measure(m: Member, position: NDArray[np.float64]) -> Found:
    """The largest error over the times; infinite where there is no trajectory to the end."""
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            d = ss.simulate(m.actuator, m.waveform, times=m.times, tolerance=TOLERANCE, load=m.load)
        except ss.simulation.SimulationError as error:
            return Found(math.inf, math.nan, time.perf_counter() - start, 0, str(error))
    seconds = time.perf_counter() - start
    words = "; ".join(str(w.message) for w in said)
    if d.attrs["outcome"] != "complete":
        words = words or d.attrs["outcome"]
    x = d["end_effector_position"].values
    error = float(np.max(np.abs(x - position[: x.size]))) if x.size == SAMPLES else math.inf
    estimate = float(d.attrs.get("error_estimate", math.nan))
    return Found(error, estimate, seconds, d.attrs["steps"] + d.attrs["rejected_steps"], words)


SHOWN = ("all", "all, constant normal force", "varying normal force")  # rows of the page, others in JSON
HEAD = ("members", "median", "99 %", "worst", "> 1", "> 3", "> 10", "> 100")


def _row(name: str, errors: NDArray[np.float64]) -> list[str]:
    """Return one row of the table, from errors in tolerances."""
    middle, high = np.quantile(errors, 0.5), np.quantile(errors, 0.99, method="higher")
    shares = [f"{100 * np.mean(errors > limit):.3g} %" for limit in (1, 3, 10, 100)]
    return [name, str(errors.size), f"{middle:.2g}", f"{high:.3g}", f"{errors.max():.3g}", *shares]


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def _agreement(found: list[Found]) -> str:
    """How well the package knows its own error."""
    pairs = np.array([(f.error, f.estimate) for f in found if math.isfinite(f.estimate)]).reshape(-1, 2)
    if not len(pairs):
        return "`error_estimate` is not given."
    error, estimate = pairs.T
    small = np.maximum(error, estimate) < SMALL
    with np.errstate(divide="ignore", invalid="ignore"):
        near = small | ((error <= 3 * estimate) & (estimate <= 3 * error))
    below = ~small & (error > 3 * estimate)
    return (
        f"`error_estimate` is within a factor of 3 of the error (or both are below {SMALL * 1e9:g} nm) for "
        f"{100 * near.mean():.1f} % of {len(pairs)}, more than 3 times too small for "
        f"{100 * below.mean():.1f} %."
    )


def worst(pairs: list[tuple[Member, Found]], truth: Truths) -> list[dict[str, Any]]:
    """The ten members with the largest errors, as rows of the JSON file beside the page."""
    rows = []
    for m, f in sorted(pairs, key=lambda pair: -pair[1].error)[:10]:
        actuator = ", ".join(
            f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in m.actuator._asdict().items()
            if name in _SHOWN and value is not None
        )
        rows.append(
            {
                "member": m.number,
                "error_over_tolerance": float(f"{f.error / TOLERANCE:.3g}"),
                "oracle_doubt_nm": float(f"{truth.doubt[m.number] * 1e9:.1g}"),
                "warning": f.said,
                "drive": f"{m.waveform}",
                "load": f"{m.load}",
                "actuator": actuator,
            }
        )
    return rows


_SHOWN = (
    "friction", "gain", "natural_frequency", "damping_ratio", "stage_mass", "end_effector_mass",
    "stage_reaction", "external_force", "incline", "piezo",
)  # fmt: skip


def _groups(pairs: list[tuple[Member, Found]]) -> list[list[str]]:
    constant = [(m, f) for m, f in pairs if isinstance(m.load, float)]
    split = {"all": pairs}
    if len(constant) < len(pairs):
        split["all, constant normal force"] = constant
    of_piezo = bool(pairs) and pairs[0][0].actuator.piezo is not None
    names = sorted({m.kind for m, _ in pairs}) if of_piezo else list(LAWS)
    split |= {name: [(m, f) for m, f in constant if m.kind == name] for name in names}
    split["varying normal force"] = [(m, f) for m, f in pairs if not isinstance(m.load, float)]
    return [
        _row(name, np.array([f.error for _, f in some]) / TOLERANCE) for name, some in split.items() if some
    ]


def measured(chosen: list[Member], seed: int, truth: Truths, found: dict[int, Found]) -> dict[str, str]:
    """Return the measured parts of the page."""
    pairs = [(m, found[m.number]) for m in chosen if m.number in found]
    unsolved = int(np.sum(np.isinf(truth.doubt)))
    left = len(chosen) - len(pairs)
    seconds = np.array([f.seconds for _, f in pairs]) * 1e3
    warned = sum(bool(f.said) for _, f in pairs)
    what = "piezos" if any(m.actuator.piezo is not None for m in chosen) else "actuators"
    return {
        "command": f"`python -m benchmarks.random_{what} {len(chosen)} --seed {seed}`: "
        f"{len(pairs)} of {len(chosen)} "
        f"members are compared. For {left - unsolved} others the two solutions of the oracle "
        "differ by more than "
        f"{WELL_KNOWN * 1e9:g} nm; {unsolved} it could not solve twice.",
        "errors": table(["", *HEAD], [row for row in _groups(pairs) if row[0] in SHOWN]),
        "estimates": f"{warned} of {len(pairs)} warned or did not complete. "
        f"{_agreement([f for _, f in pairs])} "
        f"`ss.simulate` took {np.median(seconds):.3g} ms (median) and at most {np.max(seconds):.4g} ms.",
    }


def study(
    count: int, seed: int, draw: Callable[[int, int], Member] = member
) -> tuple[list[Member], Truths, dict[int, Found]]:
    """Members, their truths, and what the package made of those that are known well enough."""
    chosen = [draw(number, seed) for number in range(count)]
    known = truths(chosen, seed)
    found = {}
    for m in chosen:
        if known.doubt[m.number] <= WELL_KNOWN:
            found[m.number] = measure(m, known.position[m.number])
    return chosen, known, found


def main(draw: Callable[[int, int], Member] = member, file: Path = PAGE) -> None:
    """Run the study, print the page and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.random_actuators", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=200, metavar="COUNT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=file)
    asked = parser.parse_args()
    chosen, known, found = study(asked.count, asked.seed, draw)
    text = write_page(asked.out, measured(chosen, asked.seed, known, found), file)
    pairs = [(m, found[m.number]) for m in chosen if m.number in found]
    groups = [dict(zip(("group", *HEAD), row, strict=True)) for row in _groups(pairs)]
    numbers = {"groups": groups, "largest_errors": worst(pairs, known)}
    asked.out.with_suffix(".json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
