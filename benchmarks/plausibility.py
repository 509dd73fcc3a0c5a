"""python -m benchmarks.plausibility [COUNT] [--seed S]: closed loops whose sensor is wrong, and healthy ones.

Each trial draws an actuator, a load, a sensor and a target, and closes a `Mover` on the virtual rig. Its
model is off by some per cent. Of the sensor, one thing goes wrong at a random instant; true position and
output of the amplifier are those of the simulation, which the loop does not see. COUNT trials are made of
each fault, and ten times as many healthy ones, which must not be stopped. Writes
docs/benchmarks/plausibility.md. A small case is in the tests.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip.control import MoveError, Mover, NoiseShaped, Stepping, StepSizes, plausibility, tune
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.electronics import Interferometer
from stickslip.quantities.units import QuantityError
from stickslip.rig import Bench, Channel, LimitError, Limits, Plausibility, VirtualRig, load_bench, regulate
from stickslip.rig.bench import Mounted

from .results import write_page

OUT = Path(__file__).parents[1] / "docs" / "benchmarks" / "plausibility.md"
RATE, TOP = 20e3, 100.0
WALK = Stepping(amplitude=65.0, frequency=100.0, tolerance=100e-9)
BENCH = load_bench("kang2007-bench")
OUTPUT = BENCH.output()
SHOWN = {"end_effector_position": Channel("laser"), "drive_voltage": Channel("drive")}
LATE = 0.02  # s by which late readings are old
DRIFT, JUMP = 100e-6, 50e-6  # m/s and m
MODEL_ERROR = 0.03  # relative standard deviation of the model's fields

Change = Callable[[list[float], np.random.Generator], float]
# What the sensor shows, from its true readings since the one before the fault, the last one now.
FAULTS: dict[str, Change] = {
    "jump up": lambda seen, random: seen[-1] + JUMP,
    "jump down": lambda seen, random: seen[-1] - JUMP,
    "drift up": lambda seen, random: seen[-1] + DRIFT * len(seen) / RATE,
    "drift down": lambda seen, random: seen[-1] - DRIFT * len(seen) / RATE,
    "reversed": lambda seen, random: 2.0 * seen[0] - seen[-1],
    "loose cable": lambda seen, random: 20e-9 * random.standard_normal(),
    "frozen": lambda seen, random: seen[0],
    "no number": lambda seen, random: math.nan,
    "late": lambda seen, random: seen[max(len(seen) - 1 - round(LATE * RATE), 0)],
}


class Case(NamedTuple):
    """A trial.

    The actuator on the rig, its model, the bench, the delay of its sensor [s], target and end stops [m], the
    seconds to hold, what goes wrong with the sensor (or ""), after how many updates, and the seed.
    """

    plant: Actuator
    model: Actuator
    bench: Bench
    delay: float
    target: float
    stop: float
    hold: float
    fault: str
    after: int
    seed: int


class Outcome(NamedTuple):
    """How a trial ended.

    `stopped` says why the guard or a limit ended the run, or is ""; `ended` why the mover did. `beyond` is
    how far [m] the true position was beyond an end stop; `wandered` [m] the way it made after the fault,
    `seconds` after it; `last` [V] at the amplifier at the end; `step` [m] a full one; `kept` is whether the
    recording was.
    """

    stopped: str
    ended: str
    beyond: float
    wandered: float
    seconds: float
    last: float
    step: float
    kept: bool


class Wrong(VirtualRig):
    """A virtual rig whose first reading, the position, goes wrong after so many updates."""

    def __init__(self, case: Case) -> None:
        super().__init__(case.plant, case.bench, seed=case.seed)
        self._fault, self._after = FAULTS.get(case.fault), case.after
        self._random = np.random.default_rng(case.seed)
        self._seen: list[float] = []
        self.true: list[float] = []  # m, of the end-effector at each update

    def exchange(self, volts: float) -> list[float]:
        """The readings at the next update."""
        found = super().exchange(volts)
        assert self._stream is not None
        self.true.append(self._stream._motion.position)
        if self._fault is None:
            return found
        if len(self.true) >= self._after:
            self._seen.append(found[0])
        if len(self._seen) > 1:
            found[0] = self._fault(self._seen, self._random)
        return found


def drawn(random: np.random.Generator) -> Actuator:
    """An actuator: stages of 300 to 2000 Hz, 40 to 200 nm/V, loads of up to a fifth of the friction."""
    base = load_actuator("kang2007-hysteresis" if random.random() < 0.5 else "kang2007")
    omega = 2.0 * math.pi * 300.0 * (2000.0 / 300.0) ** random.random()
    gain = 40e-9 * 5.0 ** random.random()
    mass = base.end_effector_mass * 3.0 ** random.uniform(-1.0, 1.0)
    # A jump of so many volts begins to slip.
    force = mass * gain * omega**2 * random.uniform(3.0, 12.0)
    presliding = random.uniform(0.5, 4.0) * gain
    law = base.friction._replace(
        sigma_0=force / presliding,
        sigma_1=2.0 * math.sqrt(force / presliding * mass) * random.uniform(0.05, 0.5),
        coulomb_force=force,
        stiction_force=force,
    )
    return base.replace(
        gain=gain,
        natural_frequency=omega,
        damping_ratio=0.05 * 10.0 ** random.random(),
        end_effector_mass=mass,
        friction=law,
        external_force=float(force * random.uniform(-0.2, 0.2)),
    )


def walks(plant: Actuator) -> bool:
    """Whether it walks both ways under its load, by a third at least of what it does without."""
    sizes = []
    for one in (plant, plant.replace(external_force=0.0)):
        try:
            table = StepSizes.of_model(one.replace(piezo=None), OUTPUT, WALK.frequency, TOP)
        except QuantityError:
            return False
        sizes += [np.interp(WALK.amplitude, table.voltages, way) for way in (table.forward, table.backward)]
    return min(sizes[:2]) > min(sizes[2:]) / 3.0


def modelled(plant: Actuator, random: np.random.Generator) -> Actuator:
    """The model of a plant, without its load, each number off by some per cent."""

    def off(value: float) -> float:
        return value * math.exp(MODEL_ERROR * random.standard_normal())

    force = off(plant.friction.coulomb_force)
    law = plant.friction._replace(
        sigma_0=off(plant.friction.sigma_0), coulomb_force=force, stiction_force=force
    )
    return plant.replace(
        gain=off(plant.gain),
        natural_frequency=off(plant.natural_frequency),
        damping_ratio=off(plant.damping_ratio),
        friction=law,
        external_force=0.0,
    )


def case_of(seed: int, fault: str) -> Case:
    """The trial of a number."""
    random = np.random.default_rng([seed, sorted((*FAULTS, "")).index(fault)])
    plant = drawn(random)
    while not walks(plant):
        plant = drawn(random)
    noise = 0.3e-9 * 100.0 ** random.random()
    density = noise / math.sqrt(2.0 * BENCH.sample_rate)
    delay = random.uniform(0.0, 0.5e-3)
    laser = Mounted(Interferometer(0.31e-9, delay, density), "end_effector", None)
    stop = 80e-6
    target = random.uniform(-0.4, 0.4) * stop
    hold = random.uniform(0.3, 0.8)
    return Case(
        plant,
        modelled(plant, random),
        replace(BENCH, sensors={"laser": laser}),
        delay,
        target,
        stop,
        hold,
        fault,
        int(random.uniform(0.0, hold + 0.1) * RATE),
        seed,
    )


def mover_of(case: Case) -> tuple[Mover, Plausibility]:
    """The loop of the model, and what is believed of its sensor."""
    late = round(case.delay * RATE)
    tuning = tune(case.model, OUTPUT, delay=2 + late)
    table = StepSizes.of_model(case.model.replace(piezo=None), OUTPUT, WALK.frequency, TOP)
    regulator = tuning.regulator(RATE, max_voltage=TOP, lead=tuning.lag)
    mover = Mover(WALK, table, regulator, case.model.gain, hold=case.hold)
    return mover, plausibility(case.model, OUTPUT, WALK.frequency, TOP, table=table)


def run(case: Case, beliefs: Plausibility | None = None) -> Outcome:
    """Close the loop, with other beliefs than those of the model if they are given, and look at the truth."""
    mover, own = mover_of(case)
    rig = Wrong(case)
    limits = Limits(max_voltage=TOP, min_position=-case.stop, max_position=case.stop, watchdog=120.0)
    stopped = ended = ""
    kept = True
    try:
        regulate(
            rig,
            NoiseShaped(mover, rig.capabilities.step),
            case.target,
            SHOWN,
            limits,
            case.hold + 2.0,
            plausibility=beliefs or own,
        )
    except LimitError as error:
        kept = getattr(error, "recording", None) is not None
        if isinstance(error.__cause__, MoveError):
            ended = str(error)
        else:
            stopped = str(error)
    true = np.array(rig.true)
    after = true[min(case.after, true.size - 1) :]
    return Outcome(
        stopped,
        ended,
        max(float(np.abs(true).max()) - case.stop, 0.0),
        float(np.ptp(after)),
        max(true.size - case.after, 0) / RATE,
        float(rig.output()[1][-1]),
        float(np.interp(WALK.amplitude, mover.steps_of.table.voltages, mover.steps_of.table.forward)),
        kept,
    )


def false_stop(case: Case, outcome: Outcome) -> bool:
    """Whether a healthy run was stopped that comes to its end without the guard."""
    if not outcome.stopped:
        return False
    free = run(case, Plausibility(speed=math.inf, apart=math.inf, at_limit=math.inf))
    return not free.stopped and not free.ended


def study(count: int, seed: int) -> dict[str, str]:
    """Run all trials; return the measured parts of the page."""
    rows, healthy = [], 10 * count
    false, gave_up, begun = [], 0, time.time()
    for k in range(healthy):
        case = case_of(seed + k, "")
        outcome = run(case)
        gave_up += bool(outcome.ended or outcome.stopped)
        if false_stop(case, outcome):
            false.append(f"{seed + k}: {outcome.stopped}")
            gave_up -= 1
        print(k, "healthy", outcome.stopped or outcome.ended, flush=True)
    for fault in FAULTS:
        found = []
        for k in range(count):
            found.append(run(case_of(seed + k, fault)))
            print(k, fault, found[-1], flush=True)
        struck = [one for one in found if one.seconds > 0.0]
        ways = sorted(1e6 * one.wandered for one in struck)
        beyond = [one for one in found if one.beyond > one.step]
        unsafe = [one for one in found if abs(one.last) > 0.1 or not one.kept]
        times = [1e3 * one.seconds for one in struck if one.stopped]
        rows.append(
            f"| {fault} | {len(struck)} | {len(times)} | {sum(bool(one.ended) for one in struck)} "
            f"| {np.median(times) if times else math.nan:.0f} ms "
            f"| {np.median(ways):.1f} um | {ways[-1]:.1f} um "
            f"| {len(beyond)} | {len(unsafe)} |"
        )
    most = 1.0 - 0.05 ** (1.0 / healthy) if not false else math.nan
    rate = f"{len(false)} of {healthy} healthy runs were stopped by the check"
    rate += f" (below {100.0 * most:.2g} % with 95 % confidence)." if not false else ":"
    gave = f"{gave_up} healthy runs do not arrive even without this check, because the actuator does not "
    minutes = (time.time() - begun) / 60.0
    return {
        "command": f"`python -m benchmarks.plausibility {count} --seed {seed}`: {count} trials "
        f"of each fault, {healthy} healthy runs, {minutes:.0f} min.",
        "faults": "\n".join([*_HEAD, *rows]),
        "healthy": "\n".join(
            [f"**{rate}**", *(f"- {one}" for one in false), "", f"{gave}walk as its model predicts."]
        ),
    }


_HEAD = (
    "| fault | struck | stopped | given up | time, median | distance, median | "
    "distance, most | beyond | unsafe |",
    "|---|---|---|---|---|---|---|---|---|",
)


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    write_page(OUT, study(asked.count, asked.seed))


if __name__ == "__main__":
    main()
