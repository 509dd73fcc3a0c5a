"""Random plants and drives with extreme values: the engine does not crash, hang, or end without numbers.

    python -m benchmarks.fuzz_engine [--first SEED] [--count N]

A plant has one to four modes and up to four elements of any law; its numbers spread over many decades and are
sometimes 0. A drive has lines, cubics and sines; the load may vary in time and along the stroke. Each is
followed in a process that ends after ten seconds of computing.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import subprocess
import sys
import time
from collections import Counter
from typing import Any

import numpy as np

import stickslip as ss
from stickslip.engine import binding
from stickslip.engine.library import library
from stickslip.friction import NormalForce
from stickslip.simulation.plant.system import Element, Mode, Plant
from stickslip.waveform.drive import Drive, constant

LIMIT = 10.0  # s of computing for one case
STEPS = 2_000  # that one case may take
FOUND = "found"  # what a case is called that is wrong


def number(rng: np.random.Generator, low: float, high: float, zero: float = 0.1) -> float:
    """A number of any decade between two, or 0."""
    return 0.0 if rng.random() < zero else float(10.0 ** rng.uniform(math.log10(low), math.log10(high)))


def law(rng: np.random.Generator) -> Any:
    """A law of the package with numbers from far apart; unchecked, as they come from a broken program."""
    kind = ss.LAWS[rng.integers(len(ss.LAWS))]
    if kind is ss.MaxwellSlip:
        n = int(rng.integers(1, 9))
        many = [tuple(number(rng, 1e-6, 1e12, 0.02) for _ in range(n)) for _ in range(2)]
        rest = (number(rng, 1e-3, 1e3), 1.0 + number(rng, 1e-3, 3.0, 0.5), number(rng, 1e-9, 1e2), 1e3)
        return tuple.__new__(kind, (*many, *rest))
    force = number(rng, 1e-6, 1e4, 0.02)
    known = {
        "coulomb_force": force,
        "stiction_force": force * (1.0 + number(rng, 1e-6, 10.0, 0.3)),
        "exponent": float(rng.uniform(0.1, 4.0)),
    }
    return tuple.__new__(kind, tuple(known.get(name, number(rng, 1e-9, 1e12)) for name in kind._fields))


def shares(rng: np.random.Generator, count: int, low: float, high: float) -> tuple[float | None, ...]:
    """A share of each mode, or none."""
    signs = rng.choice([-1.0, 1.0], count)
    return tuple(None if rng.random() < 0.3 else float(sign) * number(rng, low, high, 0.0) for sign in signs)


def element(rng: np.random.Generator, modes: int, before: int) -> Element:
    """A contact, whatever it feels."""
    along = NormalForce(number(rng, 1e-2, 1e6), float(rng.choice([1.0, -2.0, 0.5])), 0.2, 1e-4)
    rare = rng.random(5) < 0.1
    return Element(
        law(rng),
        shares(rng, modes, 1e-3, 1e3),
        shares(rng, modes, 1e-6, 1e6),
        normal=number(rng, 1e-6, 1e6, 0.02),
        loaded=1.0 if rng.random() < 0.4 else None,
        drive_rate=number(rng, 1e-12, 1e3) if rare[0] else None,
        drive=number(rng, 1e-12, 1e3) if rare[1] else None,
        position=shares(rng, modes, 1e-6, 1e6) if rare[2] else None,
        feed=tuple(number(rng, 1e-9, 1.0) for _ in range(before)) if rare[3] and before else None,
        along=along if rare[4] else None,
    )


def table(rng: np.random.Generator, end: float) -> Drive:
    """Up to twenty segments, some of which jump, bend or ring."""
    n = int(rng.integers(1, 20))
    start = np.concatenate([[0.0], np.sort(rng.uniform(0.0, end, n - 1))])
    size = number(rng, 1e-9, 1e6)
    bends = size * rng.normal(size=(n, 4)) * (1.0 / end) ** np.arange(4) * (rng.random((n, 4)) < 0.6)
    sines = np.where(rng.random(n) < 0.2, 1, 0)
    first = np.concatenate([[0], np.cumsum(sines)])
    rings = np.column_stack(
        [
            size * rng.normal(size=first[-1]),
            rng.uniform(1.0, 1e3, first[-1]) / end,
            rng.normal(size=(first[-1], 2)),
        ]
    )
    return Drive(0.0, start, np.ascontiguousarray(bends), first, np.ascontiguousarray(rings))


def case(seed: int) -> str:
    """Follow one, and return what came of it."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 5))
    modes = tuple(
        Mode(number(rng, 1.0, 1e12), number(rng, 1e-3, 1e7), number(rng, 1e-9, 1e9), number(rng, 1e-6, 1e4))
        for _ in range(count)
    )
    elements: list[Element] = []
    for _ in range(int(rng.integers(0, 5))):
        elements.append(element(rng, count, len(elements)))
    plant = Plant(modes, tuple(elements), number(rng, 1.0, 1e6, 0.0))
    end = number(rng, 1e-6, 10.0, 0.0)
    drive, load = table(rng, end), constant(1.0)
    if rng.random() < 0.4:
        load = table(rng, end)
        load = load._replace(polynomial=load.polynomial + np.array([number(rng, 1e-3, 1e6), 0.0, 0.0, 0.0]))
    try:
        composed = binding.ComposedPlant(plant)
    except ss.QuantityError:
        return "refused"
    q = rng.normal(size=composed.states) * number(rng, 1e-12, 1e-3, 0.5)
    times = np.linspace(0.0, end, 20)
    samples = np.full((times.size, composed.columns), np.nan)
    made = composed, binding.DriveTable(drive), binding.DriveTable(load)
    outcome, reached, *_ = binding.integrate(
        *made, q, (0.0, end), number(rng, 1e-14, 1e-5, 0.0), bool(rng.random() < 0.2), STEPS, times, samples
    )
    if outcome != library().DONE:
        return "given up, with a reason"
    if reached < end:
        return f"{FOUND}: done before its end"
    return "done" if np.isfinite(q).all() and np.isfinite(samples).all() else f"{FOUND}: done without numbers"


def work(first: int, end: int) -> None:
    """Follow the cases, and say each before and after."""
    for seed in range(first, end):
        print(json.dumps([seed, "begun"]), flush=True)
        signal.setitimer(signal.ITIMER_PROF, LIMIT)
        print(json.dumps([seed, case(seed)]), flush=True)


def main() -> None:
    """Follow all, in a process that is begun again behind a case that ends it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    end = asked.first + asked.count
    if asked.work:
        work(asked.first, end)
        return
    begun, seed, found, wrong = time.monotonic(), asked.first, Counter[str](), []
    while seed < end:
        command = [sys.executable, "-m", "benchmarks.fuzz_engine", "--work"]
        command += ["--first", str(seed), "--count", str(end - seed)]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        said = "begun"
        for line in child.stdout:
            seed, said = json.loads(line)
            if said != "begun":
                found[said] += 1
                if said.startswith(FOUND):
                    wrong.append((seed, said))
        code = child.wait()
        if said == "begun":
            wrong.append((seed, f"ended by {signal.Signals(-code).name}" if code < 0 else f"exit {code}"))
        seed += 1
    for what in wrong:
        print(*what)
    print(f"{asked.count:,} plants in {time.monotonic() - begun:.0f} s: {dict(found.most_common())}")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
