"""python -m benchmarks.open_loop [COUNT] [--seed S]: positions without a sensor, of random motors.

Each motor is an actuator with irregular steps under a load and at a temperature that both drift while it
works. Its steps at five loads, five strokes per volt and five voltages are those of the equations
(`steady_steps`), joined by cubic splines; scatter, direction and threshold noise are those of
`rig.irregularity`, and a change of direction loses a way. The motor is calibrated against a sensor with
noise, then it walks there and back without it: how often does the 95 % interval of `DeadReckoning` hold the
true position? Writes docs/benchmarks/open-loop.md and its figure. A small case is in the tests.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy
from matplotlib.figure import Figure

from stickslip.control import Bursts, DeadReckoning, StepLaw, fit_steps, measure_steps
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.report.figures.style import SERIES, drawn, panels, svg
from stickslip.rig import About, Irregularity
from stickslip.rig.positioner import Ranges
from stickslip.simulation import steady_steps
from stickslip.waveform import ReverseSawtooth, Sawtooth

from .results import write_page

OUT = Path(__file__).parents[1] / "docs" / "benchmarks" / "open-loop.md"
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "open-loop.svg"
FREQUENCY, VOLTAGES = 100.0, (40.0, 55.0, 70.0)
GRID = 5
WALKS = ((1, 200), (-1, 200), (1, 500), (-1, 300), (1, 1000), (-1, 1500), (1, 100), (-1, 100))
LEVEL = 0.95


class Conditions(NamedTuple):
    """Drift of the load and of the stroke per volt: random walks, per root of a step, back to their middle
    over so many steps."""

    load: float
    stroke: float
    memory: float


class Motor:
    """A positioner without a sensor, in this process, whose steps are those of an actuator; `true` is where
    it is, m."""

    simulated = True

    about: ClassVar[About] = About(
        "a motor of equations", "steps", "none; steps are counted", "0 V", "this study"
    )

    def __init__(
        self, actuator: Actuator, of: Irregularity, conditions: Conditions, reversal: float, seed: int
    ) -> None:
        self.ranges = Ranges("motor", (0,), 100.0, 1.0, 1000.0, 100_000, sensor=False, scans=False)
        self._of, self._conditions, self._random = of, conditions, np.random.default_rng([seed, 1])
        self._steps = table(actuator)
        self._lost = abs(actuator.gain) * of.threshold_noise
        self._load, self._stroke = self._random.standard_normal(2)
        self._reversal, self.true, self._count, self._way = reversal, 0.0, 0, 0

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Make steps at once."""
        del axis, frequency
        volts, way = float(voltage), 1 if count > 0 else -1
        n = abs(count)
        load, stroke = self._drifted(n)
        points = np.column_stack([np.full(n, volts), load, stroke])
        sizes = np.maximum(self._steps[way](points), 0.0)
        scatter = np.maximum(1.0 + self._of.scatter * self._random.standard_normal(n), 0.0)
        ratio = (1.0 + self._of.direction) ** (0.5 * way)
        made = np.maximum(ratio * sizes * scatter - self._lost * self._random.standard_normal(n), 0.0)
        made *= sizes > 0.0
        self.true += way * float(made.sum())
        if way != self._way:
            self.true -= way * self._reversal
            self._way = way
        self._count += count

    def read(self, noise: float) -> float:
        """A reading of a sensor [m], after a rest."""
        return self.true + noise * float(self._random.standard_normal())

    def moving(self, axis: int) -> bool:
        """Never: steps are made at once."""
        del axis
        return False

    def position(self, axis: int) -> float:
        """Steps, up less down."""
        del axis
        return float(self._count)

    def scan(self, axis: int, voltage: float | str) -> None:
        """It cannot."""
        raise NotImplementedError

    def stop(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing is open."""

    def _drifted(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Load [N] and stroke per volt over that at the start, at each of n steps."""
        load, stroke, memory = self._conditions
        keep = math.exp(-1.0 / memory)
        kick = math.sqrt(1.0 - keep * keep)
        found = []
        for name in ("_load", "_stroke"):
            kicks = kick * self._random.standard_normal(n)
            path, last = scipy.signal.lfilter([1.0], [1.0, -keep], kicks, zi=[keep * getattr(self, name)])
            del last
            setattr(self, name, float(path[-1]))
            found.append(np.clip(path, -3.0, 3.0))
        return load * found[0], 1.0 + stroke * found[1]


def table(actuator: Actuator) -> dict[int, Any]:
    """Return steps [m] of both directions over voltage [V], load [N] and stroke per volt (a share),
    interpolated."""
    volts = np.linspace(VOLTAGES[0], VOLTAGES[-1], GRID)
    loads = np.linspace(-0.3, 0.3, GRID) * actuator.friction.coulomb_force
    strokes = np.linspace(0.85, 1.15, GRID)
    grid = np.meshgrid(volts, loads, strokes, indexing="ij")
    found = {}
    for way, shape in ((1, Sawtooth), (-1, ReverseSawtooth)):
        drive = shape(1.0, FREQUENCY)
        # A stroke per volt that is so many times larger does as so many times the voltage.
        steps = steady_steps(
            actuator,
            drive,
            parameters={"amplitude": (grid[0] * grid[2]).ravel(), "external_force": grid[1].ravel()},
        )["net_step"].values.reshape(grid[0].shape)
        found[way] = scipy.interpolate.RegularGridInterpolator(
            (volts, loads, strokes), way * np.nan_to_num(steps), bounds_error=False, fill_value=None
        )
    return found


class Trial(NamedTuple):
    """A motor: for each walk, steps since the datum, the true position less the estimate over the half-width
    of the interval, and that half-width over the way since the datum; whether the datum on the way was
    thought not to fit."""

    steps: list[int]
    off: list[float]
    wide: list[float]
    surprised: bool


def motor(seed: int) -> tuple[Motor, float]:
    """Return a random motor, and the noise of the sensor that calibrates it, m."""
    random, base = np.random.default_rng([seed, 2]), load_actuator("kang2007")
    factor = np.exp(0.2 * random.standard_normal(5))
    law = base.friction
    law = law._replace(
        sigma_0=law.sigma_0 * factor[0],
        coulomb_force=law.coulomb_force * factor[1],
        stiction_force=law.stiction_force * factor[1],
    )
    actuator = base.replace(
        gain=base.gain * factor[2],
        natural_frequency=base.natural_frequency * factor[3],
        end_effector_mass=base.end_effector_mass * factor[4],
        friction=law,
    )
    irregularity = Irregularity(
        scatter=random.uniform(0.02, 0.15),
        direction=1.65 ** random.uniform(-1.0, 1.0) - 1.0,
        threshold_noise=random.uniform(0.2, 2.0),
    )
    load = random.uniform(0.0, 0.06) * law.coulomb_force
    conditions = Conditions(load, random.uniform(0.0, 0.05), 10.0 ** random.uniform(2.0, 4.5))
    made = Motor(actuator, irregularity, conditions, random.uniform(0.0, 0.4e-6), seed)
    return made, 10e-9 * 30.0 ** random.random()


def calibrated(made: Motor, noise: float) -> StepLaw:
    """Calibrate a motor against a sensor."""
    bursts = Bursts(VOLTAGES, FREQUENCY, steps=50, bursts=2, repeats=4, settle=0.0)
    return fit_steps(measure_steps(made, 0, lambda: made.read(noise), bursts, noise=noise))


def trial(seed: int) -> Trial:
    """Calibrate a motor, then walk without the sensor; a datum halfway."""
    made, noise = motor(seed)
    law = calibrated(made, noise)
    volts = float(np.random.default_rng([seed, 3]).uniform(VOLTAGES[0], VOLTAGES[-1]))
    axis = DeadReckoning(made, 0, law, made.read(noise), noise, voltage=volts)
    steps, off, wide, since, way = [], [], [], 0, 0.0
    for number, (direction, count) in enumerate(WALKS):
        if number == len(WALKS) // 2:
            axis.datum(made.read(noise), noise)
            since, way = 0, 0.0
        axis.step(direction * count)
        low, high = axis.interval(LEVEL)
        since += count
        way += count * law.size(volts, direction)
        half = 0.5 * (high - low)
        steps.append(since)
        off.append((made.true - axis.position) / half)
        wide.append(half / way)
    return Trial(steps, off, wide, bool(axis.events))


def measured(trials: list[Trial], seed: int) -> dict[str, str]:
    """Return the measured parts of the page."""
    off, wide = np.abs([one.off for one in trials]), np.array([one.wide for one in trials])
    walked = trials[0].steps
    rows = [
        f"| {'after a datum halfway: ' if k >= len(WALKS) // 2 else ''}{walked[k]} "
        f"| {100.0 * (off[:, k] <= 1.0).mean():.1f} % "
        f"| {100.0 * np.median(wide[:, k]):.1f} % | {100.0 * np.percentile(wide[:, k], 90):.1f} % |"
        for k in range(len(WALKS))
    ]
    held = (off <= 1.0).mean(axis=1)  # intervals of one motor are not independent
    error = 100.0 * float(np.std(held)) / math.sqrt(len(trials))
    count, share = len(trials), 100.0 * float((off <= 1.0).mean())
    whole = 100.0 * float((off <= 1.0).all(axis=1).mean())
    surprised = sum(one.surprised for one in trials)
    return {
        "command": f"`python -m benchmarks.open_loop {count} --seed {seed}`",
        "intervals": "\n".join([*_HEAD, *rows]),
        "held": f"**{share:.1f} % of all intervals contain the truth** (standard error {error:.1f} %); "
        f"all eight do "
        f"for {whole:.0f} % of the motors. {surprised} of {count} datums were rejected.",
    }


_HEAD = (
    "| steps since datum | intervals that contain the truth | "
    "half-width over distance, median | 90 % of motors |",
    "|---|---|---|---|",
)


@drawn
def drawing(trials: list[Trial]) -> Figure:
    """Draw the error over the half-width of the interval, by steps since the datum."""
    figure, (axes,) = panels([3.2])
    random = np.random.default_rng(0)
    for k in range(len(WALKS)):
        off = np.array([one.off[k] for one in trials])
        at = k + 0.3 * random.uniform(-1.0, 1.0, off.size)
        holds = np.abs(off) <= 1.0
        axes.plot(at[holds], off[holds], ".", color=SERIES[0], markersize=2)
        axes.plot(at[~holds], off[~holds], ".", color=SERIES[1], markersize=4)
    for edge in (-1.0, 1.0):
        axes.axhline(edge, color="black", linewidth=0.8)
    axes.axvline(len(WALKS) / 2 - 0.5, color="grey", linewidth=0.8, linestyle=":")
    axes.set_xticks(range(len(WALKS)), [str(n) for n in trials[0].steps])
    axes.set(xlabel="steps since the datum", ylabel="error / half-width of the interval", ylim=(-2.5, 2.5))
    return figure


def main() -> None:
    """Write the page and its figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1000)
    asked, trials = parser.parse_args(), []
    for number in range(asked.count):
        trials.append(trial(asked.seed + number))
        print(number, trials[-1], flush=True)
        if number % 50 == 49 or number == asked.count - 1:
            write_page(OUT, measured(trials, asked.seed))
            FIGURE.write_text(svg(drawing(trials)), encoding="utf-8")


if __name__ == "__main__":
    main()
