"""python -m benchmarks.real_moves [COUNT] [--seed S]: moves of 10 um on a twin with irregular steps.

Two parts. First the twin is driven as a laboratory drove an attocube axis (AMC controller, 500 Hz, 50 V;
4,654 public moves): steps until the reading is in the target range, a poll every 10 ms, stop, read. Errors
and times are compared with the percentiles of the sessions of the real axis. Then `Mover` moves the same twin
through the virtual rig, COUNT times with random irregularities; the true position, which it does not see,
says whether it had arrived when it said so. Writes docs/benchmarks/real-moves.md and its figure. A small case
is in the tests.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy
from matplotlib.figure import Figure

from stickslip.control import Mover, NoiseShaped, Stepping, StepSizes, plausibility, tune
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.electronics import Interferometer
from stickslip.report.figures.style import SERIES, drawn, panels, svg
from stickslip.rig import (
    Bench,
    Channel,
    Irregularity,
    LimitError,
    Limits,
    Repeats,
    VirtualRig,
    load_bench,
    regulate,
)
from stickslip.rig.bench import Mounted
from stickslip.rig.twins import Stage
from stickslip.rig.twins.axis import steps

from .results import write_page

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "real-moves.svg"
OUT = Path(__file__).parents[1] / "docs" / "benchmarks" / "real-moves.md"
RATE, TOP, WAY, RANGE = 20e3, 100.0, 10e-6, 100e-9
WALK = Stepping(amplitude=50.0, frequency=500.0, tolerance=RANGE)
NOISE = 15e-9  # m, standard deviation of the real axis's readings at rest: 13 to 23 nm
POLL = 5  # steps between polls of the script
_CLOSE = 35e-9  # m, half a step: nearer, the controller rests
_MOST = 3000  # steps of one move
# Of 63 sessions of 28 to 100 real moves: target range [nm], then least and greatest percentile of a session:
# median and 95 % of |error| [nm], share that ended outside of the range [%], median time [s]. From
# scan_timings.txt of github.com/NVScanning/AttocubePCscripts, commit 086a90c.
SESSIONS = {
    50: ((16, 45), (43, 197), (5.0, 42.5), (0.32, 0.94)),
    70: ((14, 50), (45, 156), (0.0, 36.7), (0.31, 1.31)),
    90: ((18, 45), (62, 184), (0.0, 20.0), (0.31, 1.22)),
    110: ((18, 50), (56, 292), (0.0, 11.7), (0.31, 1.19)),
}
HOLD = 0.1  # s after the arrival in which the true position must stay in the range
SHOWN = {"end_effector_position": Channel("laser"), "drive_voltage": Channel("drive")}


def axis() -> Actuator:
    """Return an actuator like the real axis: 88 nm a step of 50 V at 500 Hz, from some 17 V on.

    The real axis makes at least 67 nm.
    """
    base = load_actuator("kang2007")
    force, deflection, mass = 0.02, 20e-9, 0.01
    stiffness = force / deflection
    law = base.friction._replace(
        sigma_0=stiffness,
        sigma_1=0.6 * math.sqrt(stiffness * mass),
        coulomb_force=force,
        stiction_force=force,
    )
    return base.replace(
        gain=2.6e-9,
        natural_frequency=2.0 * math.pi * 4e3,
        damping_ratio=0.5,
        end_effector_mass=mass,
        friction=law,
        name="axis of 88 nm a step",
    )


def bench(noise: float = NOISE) -> Bench:
    """Return a bench whose only sensor reads the end-effector with a noise [m]."""
    made = load_bench("kang2007-bench")
    laser = Mounted(
        Interferometer(0.31e-9, 0.0, noise / math.sqrt(2.0 * made.sample_rate)), "end_effector", None
    )
    return replace(made, sensors={"laser": laser})


class Scripted(NamedTuple):
    """Moves of the twin as the laboratory's script makes them: errors after the stop [nm] and times [s]."""

    errors: np.ndarray
    times: np.ndarray

    def told(self, window: float) -> tuple[float, float, float, float]:
        """Return median and 95 % of |error| [nm], the share outside of a range [nm] in %, and the median time
        [s]."""
        size = np.abs(self.errors)
        middle, most = np.percentile(size, [50, 95])
        return float(middle), float(most), 100.0 * float((size > window).mean()), float(np.median(self.times))


def scripted(irregularity: Irregularity, window: float, count: int, seed: int) -> Scripted:
    """Move a twin forth and back by 10 um, count times, to a range [m].

    The controller steps towards the target until the reading is within half a step; the script looks every 10
    ms, stops when the reading is in the range, and reads once more.
    """
    stage, random = (
        Stage(axis(), travel=1e-3, irregularity=irregularity, seed=seed),
        np.random.default_rng(seed),
    )
    errors, times = [], []
    for number in range(count):
        target = stage.position + (WAY if number % 2 == 0 else -WAY)
        made = 0
        for made in range(_MOST):
            if made and made % POLL == 0 and abs(_read(stage, random) - target) <= window:
                break
            error = target - _read(stage, random)
            if abs(error) > _CLOSE:
                for piece in steps(stage, int(math.copysign(1, error)), WALK.amplitude, WALK.frequency):
                    stage.play(piece)
            else:
                stage.rest(1.0 / WALK.frequency)
        errors.append(1e9 * (target - _read(stage, random)))
        times.append(made / WALK.frequency)
    return Scripted(np.array(errors), np.array(times))


def _read(stage: Stage, random: np.random.Generator) -> float:
    return stage.position + NOISE * float(random.standard_normal())


class Watched(VirtualRig):
    """A virtual rig that keeps the true position [m] of each update."""

    def __init__(self, actuator: Actuator, of: Bench, seed: int, irregularity: Irregularity) -> None:
        super().__init__(actuator, of, seed=seed, repeats=Repeats(series=seed, irregularity=irregularity))
        self.true: list[float] = []

    def exchange(self, volts: float) -> list[float]:
        """The readings at the next update."""
        found = super().exchange(volts)
        assert self._stream is not None
        self.true.append(self._stream.position)
        return found


class Moved(NamedTuple):
    """How a move ended: whether it said "arrived", after how many seconds, the largest true distance [m] from
    the target in the hold after that, and why it ended, where it did not."""

    arrived: bool
    time: float
    off: float
    why: str


def move(
    actuator: Actuator,
    model: Actuator,
    irregularity: Irregularity,
    target: float,
    seed: int,
    walk: Stepping = WALK,
) -> Moved:
    """Move to a target [m] with a mover that is made from the model."""
    of = bench()
    output = of.output()
    tuning = tune(model, output)
    table = StepSizes.of_model(model, output, walk.frequency, TOP)
    regulator = tuning.regulator(RATE, max_voltage=TOP, lead=tuning.lag)
    mover = Mover(walk, table, regulator, model.gain, hold=HOLD)
    rig, why = Watched(actuator, of, seed, irregularity), ""
    beliefs = plausibility(model, output, walk.frequency, TOP, table=table, noise=NOISE)
    try:
        regulate(
            *(
                rig,
                NoiseShaped(mover, rig.capabilities.step),
                target,
                SHOWN,
                Limits(max_voltage=TOP, watchdog=120.0),
            ),
            5.0,
            plausibility=beliefs,
        )
    except LimitError as error:
        why = str(error)
    true = np.array(rig.true)
    if mover.settled_at is None:
        return Moved(False, math.nan, math.nan, why or "not arrived in 5 s")
    said = round(mover.settled_at * RATE) + round(walk.dwell * RATE)
    held = true[said : said + round(HOLD * RATE)]
    return Moved(True, said / RATE, float(np.abs(held - target).max()), why)


def irregular(random: np.random.Generator) -> Irregularity:
    """Return irregularities: scatter 2 to 15 %, either direction by up to 65 %, relaxations up to 0.35 um in
    10 ms to 1 s."""
    ratio = 1.65 ** random.uniform(-1.0, 1.0)
    return Irregularity(
        scatter=random.uniform(0.02, 0.15),
        direction=ratio - 1.0,
        threshold_noise=random.uniform(0.2, 2.0),
        relaxation=random.uniform(0.0, 0.35e-6),
        relaxation_time=0.01 * 100.0 ** random.random(),
    )


def off(model: Actuator, random: np.random.Generator, by: float = 0.03) -> Actuator:
    """Return the model with stroke, frequency and friction each off by some per cent."""
    factor = np.exp(by * random.standard_normal(4))
    law = model.friction
    law = law._replace(
        sigma_0=law.sigma_0 * factor[0],
        coulomb_force=law.coulomb_force * factor[1],
        stiction_force=law.stiction_force * factor[1],
    )
    return model.replace(
        gain=model.gain * factor[2], natural_frequency=model.natural_frequency * factor[3], friction=law
    )


def moves(count: int, seed: int) -> list[Moved]:
    """Move forth or back by 10 um, each on a twin and with a model of its own."""
    found = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        irregularity, model = irregular(random), off(axis(), random)
        found.append(move(axis(), model, irregularity, WAY * (1 - 2 * (number % 2)), number))
        print(number, found[-1], flush=True)
    return found


def within(value: float, ends: tuple[float, float]) -> str:
    """Return a cell of the table: the value, and the sessions' range."""
    said = f"{value:.2f}" if ends[1] < 2.0 else f"{value:.0f}"
    return f"{said} ({ends[0]:g} to {ends[1]:g})"


def measured(twin: dict[int, Scripted], made: list[Moved], seed: int) -> dict[str, str]:
    """Return the measured parts of the page."""
    rows = [
        f"| {window} | "
        + " | ".join(within(*one) for one in zip(of.told(window), SESSIONS[window], strict=True))
        + " |"
        for window, of in twin.items()
    ]
    there = [one for one in made if one.arrived]
    true = sum(one.off <= RANGE for one in there)
    least = proportion(true, len(there))
    times = np.percentile([one.time for one in there], [50, 95, 100])
    error = np.percentile([1e9 * one.off for one in there], [50, 95, 100])
    failed = [f"- {one.why}" for one in made if not one.arrived]
    count, times = len(made), "{:.2f} s, 95 % within {:.2f} s, the longest {:.2f} s".format(*times)
    error = "{:.0f} nm, 95 % within {:.0f} nm, the largest {:.0f} nm".format(*error)
    moved = [
        f'- {len(there)} of {count} moves reported "arrived"; **{true} of them truly** '
        f"(at least {100.0 * least:.1f} % with "
        "95 % confidence).",
        f"- Time until the report: median {times}.",
        f"- Largest true distance from the target in the hold: median {error}.",
        *failed,
    ]
    return {
        "command": f"`python -m benchmarks.real_moves {count} --seed {seed}`: {count} moves, and "
        f"{next(iter(twin.values())).errors.size} by the laboratory's rule for each range.",
        "twin": "\n".join([*_HEAD, *rows]),
        "moves": "\n".join(moved),
    }


_HEAD = (
    "| range, nm | median error, nm | 95 % of errors, nm | ended outside, % | median time, s |",
    "|---|---|---|---|---|",
)


def proportion(hits: int, count: int) -> float:
    """Return the lower end of the 95 % interval (Clopper and Pearson, one-sided) of a share."""
    return float(scipy.stats.beta.ppf(0.05, hits, count - hits + 1)) if hits else 0.0


@drawn
def drawing(twin: dict[int, Scripted]) -> Figure:
    """Draw cumulative errors of the twin for each range, and the sessions' ranges."""
    figure, (axes,) = panels([3.2])
    for number, (window, of) in enumerate(twin.items()):
        size = np.sort(np.abs(of.errors))
        color = SERIES[number]
        axes.plot(
            size, np.arange(1, size.size + 1) / size.size, color=color, label=f"twin, range {window} nm"
        )
        for level, ends in zip((0.5, 0.95), SESSIONS[window][:2], strict=True):
            at = level + 0.012 * (number - 1.5)
            axes.plot(ends, [at, at], color=color, linewidth=4, alpha=0.35, solid_capstyle="butt")
    axes.set(xlabel="|error| after the stop, nm", ylabel="share of moves", xlim=(0, 300), ylim=(0, 1.02))
    axes.legend(title="bars: sessions of the real axis,\nmedian and 95 %", loc="lower right", fontsize=8)
    return figure


def main() -> None:
    """Write the page and its figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    twin = {
        w: scripted(Irregularity(), 1e-9 * w, max(asked.count // 2, 20), asked.seed + w) for w in SESSIONS
    }
    FIGURE.write_text(svg(drawing(twin)), encoding="utf-8")
    write_page(OUT, measured(twin, moves(asked.count, asked.seed), asked.seed))


if __name__ == "__main__":
    main()
