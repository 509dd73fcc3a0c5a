"""Controllers on the virtual rig: how long to come within windows of a target, over many actuators.

python -m benchmarks.control [COUNT] [--seed S] [--long N] [--minute]

Each actuator is `kang2007-hysteresis` (hysteresis 13 % at 150 V, creep) with its numbers drawn; loops are
tuned on the set itself and its corners, never on the drawn one. Bench: 12-bit converter, amplifier with
limited current, an interferometer with 1 nm rms of noise and 50 us of delay. Writes
docs/benchmarks/control.md.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stickslip.actuator import Actuator, load_actuator
from stickslip.control import (
    WINDOWS,
    Estimator,
    LowPass,
    Mover,
    NoiseShaped,
    Notch,
    Pid,
    Regulator,
    Requirement,
    StepModel,
    Steps,
    StepTable,
    Tuning,
    Walk,
    settling,
    tune,
)
from stickslip.control.steps import RISING
from stickslip.electronics import Interferometer
from stickslip.rig import Bench, Channel, Limits, RigError, VirtualRig, load_bench, regulate
from stickslip.rig.bench import Mounted
from stickslip.simulation import Motion, steady_steps
from stickslip.waveform import Sawtooth

OUT = Path(__file__).parents[1] / "docs" / "benchmarks" / "control.md"
SET, RATE, TOP = "kang2007-hysteresis", 20e3, 95.0
WALK = Walk(amplitude=65.0, frequency=100.0, tolerance=10e-9)
# Relative standard deviations of what is drawn.
SPREAD = {"gain": 0.03, "natural_frequency": 0.05, "damping_ratio": 0.1, "end_effector_mass": 0.03}
OF_FRICTION = {"sigma_0": 0.1, "sigma_1": 0.2, "coulomb_force": 0.1}
HOLD = 0.2  # s
# The machine may do other work for long.
LIMITS = Limits(max_voltage=100.0, watchdog=120.0)


class Plain:
    """Full steps until less than half of one is missing; then nothing."""

    def __init__(self, table: StepTable) -> None:
        self._step = float(np.interp(WALK.amplitude, table.voltages, table.forward))
        self._period, self._until = round(RATE / WALK.frequency), math.inf
        self.steps, self.done, self._walking = 0, False, True

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V]."""
        phase = tick % self._period
        if phase == 0 and self._walking:
            self._walking = target - measured > 0.5 * self._step
            self.steps += self._walking
            self._until = tick + HOLD * RATE
        self.done = not self._walking and tick >= self._until
        rise = 0.8 * self._period
        return WALK.amplitude * phase / rise if self._walking and phase < rise else 0.0


class Published:
    """As a maker's manual describes its controller: fast steps, then slow single ones, then linear with PID
    and notch, the loop closed in this last phase only. It prints no gains: here a crossover of 20 Hz."""

    def __init__(self, table: StepTable, model: Actuator) -> None:
        self._fast, self._table = Plain(table), table
        self._slow_period, self._begun = round(RATE / 10.0), 0
        self._regulator = Regulator(
            Pid(2.0 * math.pi * 20.0 / model.gain),
            RATE,
            notches=(Notch(350.0),),
            low_pass=LowPass(1000.0),
            max_voltage=TOP,
        )
        self._reach = 0.5 * TOP * model.gain
        self.phase, self.steps, self.done = "fast", 0, False

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V]."""
        missing, one = target - measured, self._fast._step
        if self.phase == "fast":
            if tick % self._fast._period == 0 and missing < self._reach + 2.0 * one:
                self.phase, self._begun, self.steps = "slow", tick, self._fast.steps
            else:
                return self._fast.step(measured, target, tick)
        if self.phase == "slow":
            since = (tick - self._begun) % self._slow_period
            if since == 0:
                if missing < self._reach:
                    self.phase, self._begun = "linear", tick
                    self._regulator.begin(0.0, target)
                else:
                    self.steps += 1
            if self.phase == "slow":
                return WALK.amplitude * since / self._slow_period
        self.done = tick - self._begun > 0.3 * RATE + HOLD * RATE
        return self._regulator.step(measured, target, tick)


class Only:
    """The same regulator as ours, without steps."""

    def __init__(self, regulator: Regulator) -> None:
        self._regulator, self.steps, self.done = regulator, 0, False

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V]."""
        self.done = tick > (0.2 + HOLD) * RATE
        return self._regulator.step(measured, target, tick)


class Series:
    """Steps of one distance, `each` forward and then as many backward, by turns; `went` is which way each
    went, which of its series it was, and how far [m]."""

    def __init__(self, steps: Steps, distance: float, each: int) -> None:
        self.steps, self._distance, self._each = steps, distance, each
        self._period = round(RATE / WALK.frequency)
        self.went: list[tuple[int, int, float]] = []
        self._way, self._tick, self._made, self._before = 1, 0, 0, math.nan
        self._returning = False
        self._volts = self._from = self._amplitude = 0.0

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V]."""
        del target, tick
        end = 0.0 if self._way > 0 else 100.0
        if self._returning:
            self._tick += 1
            share = min(self._tick / 400, 1.0)
            self._volts = self._from + (end - self._from) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            if self._tick == 600:
                self._returning, self._tick, self._made = False, 0, 0
            return self._volts
        if self._tick == 0:
            if self._made:
                went = self._way * (measured - self._before)
                self.went.append((self._way, self._made, went))
                if self._made > 1:  # the first begins with a contact that was bent the other way
                    self.steps.learn(self._amplitude, self._way, went)
            if self._made == self._each:
                self._returning, self._from, self._way = True, self._volts, -self._way
                return self._volts
            self._before, self._made = measured, self._made + 1
            self._amplitude = self.steps.voltage_for(self._distance, self._way)
        self._tick += 1
        rise = RISING * self._period
        part = self._tick / rise if self._tick <= rise else 0.0
        self._volts = end + self._way * self._amplitude * part
        self._tick %= self._period
        return self._volts


def equal_steps(
    model: Actuator, steps: Steps, distance: float, *, seed: int = 0, turns: int = 3, each: int = 10
) -> list[tuple[float, float]]:
    """Mean step forward and backward [m] of each turn, without the first of a series; 1 nm of noise."""
    motion, made = Motion(model), Series(steps, distance, each)
    random = np.random.default_rng(seed)
    for tick in range(2 * turns * (each * round(RATE / WALK.frequency) + 600)):
        measured = motion.position + 1e-9 * random.standard_normal()
        motion.hold(made.step(measured, 0.0, tick), 1.0 / RATE)
    found = []
    for turn in range(turns):
        part = made.went[2 * turn * each : 2 * (turn + 1) * each]
        forward, backward = ([w for way, k, w in part if way == sign and k > 1] for sign in (1, -1))
        found.append((float(np.mean(forward)), float(np.mean(backward))))
    return found


class Result(NamedTuple):
    """Of one run: times [s] to the windows, overshoot and rms of the hold [m], peak current [A], steps."""

    times: tuple[float, ...]
    overshoot: float
    rms: float
    current: float
    steps: int


def bench() -> Bench:
    """With an interferometer of 1 nm rms and 50 us."""
    made = load_bench(f"{SET}-bench")
    density = 1e-9 / math.sqrt(2.0 * made.sample_rate)
    laser = Mounted(Interferometer(0.31e-9, 50e-6, density), "end_effector", None)
    return replace(made, sensors={"laser": laser})


def drawn(random: np.random.Generator) -> Actuator:
    """An actuator."""
    base = load_actuator(SET)
    own = {name: getattr(base, name) * math.exp(s * random.standard_normal()) for name, s in SPREAD.items()}
    law = {
        name: getattr(base.friction, name) * math.exp(s * random.standard_normal())
        for name, s in OF_FRICTION.items()
    }
    law["stiction_force"] = law["coulomb_force"]
    return base.replace(friction=base.friction._replace(**law), **own)


def corners(base: Actuator) -> list[Actuator]:
    """Two standard deviations of what matters to the loop, either way."""
    found = []
    for sign in (-2.0, 2.0):
        found.append(base.replace(natural_frequency=base.natural_frequency * (1.0 + sign * 0.05)))
        law = base.friction
        found.append(base.replace(friction=law._replace(sigma_0=law.sigma_0 * (1.0 + sign * 0.1))))
        found.append(base.replace(gain=base.gain * (1.0 + sign * 0.03)))
    return found


def run(model: Actuator, controller: Any, goal: float, seed: int, most: float) -> Result:
    """One run."""
    rig, seen = VirtualRig(model, bench(), seed=seed), {"end_effector_position": Channel("laser")}
    recording = regulate(rig, NoiseShaped(controller, rig.capabilities.step), goal, seen, LIMITS, most)
    hold = min(HOLD, float(recording["time"][-1]))
    found = settling(recording, goal, hold=0.75 * hold)
    times, volts = rig.output()
    current = bench().piezo_capacitance * float(np.abs(np.diff(volts) / np.diff(times)).max())
    return Result(found.times, found.overshoot, found.rms, current, controller.steps)


def ours(tuning: Tuning) -> Regulator:
    """With feedforward ahead by the actuator's lag."""
    return tuning.regulator(RATE, max_voltage=TOP, lead=tuning.lag)


def controllers(table: StepTable, tuning: Tuning, base: Actuator) -> dict[str, Any]:
    """By what to call them."""
    return {
        "plain stepping": Plain(table),
        "published state machine": Published(table, base),
        "PID only": Only(tuning.regulator(RATE, max_voltage=TOP)),
        "ours": Mover(WALK, table, ours(tuning), base.gain, hold=HOLD),
    }


def loop() -> tuple[Actuator, Tuning, StepTable]:
    """The set, the loop that is tuned on it and its corners, and its steps."""
    base = load_actuator(SET)
    tuning = tune(base, RATE, Requirement(), posterior=corners(base), delay=2)
    return base, tuning, StepTable.of_model(base.replace(piezo=None), WALK.frequency, TOP)


def compare(count: int, goal: float, seed: int, most: float) -> dict[str, list[Result | None]]:
    """All controllers on the same actuators; None where a run ended early."""
    (base, tuning, table), random = loop(), np.random.default_rng(seed)
    found: dict[str, list[Result | None]] = {}
    for k in range(count):
        model = drawn(random)
        for name, controller in controllers(table, tuning, base).items():
            try:
                made = run(model, controller, goal, seed + k, most)
            except RigError as error:
                print(k, name, error)
                made = None
            found.setdefault(name, []).append(made)
        print(f"{k + 1} of {count}", flush=True)
    return found


def _time(values: list[float]) -> str:
    """Median and greatest, and how many came there."""
    there = [v for v in values if v == v]
    if not there:
        return "-"
    share = "" if len(there) == len(values) else f" ({len(there)} of {len(values)})"
    return f"{np.median(there):.3f} / {max(there):.3f} s{share}"


def table_of(found: dict[str, list[Result | None]]) -> list[str]:
    """In Markdown."""
    heads = ["1 um", "100 nm", "30 nm", "10 nm", "3 nm"]
    lines = [f"| controller | {' | '.join(heads)} | overshoot | hold, rms | peak current | steps |"]
    lines.append("|" + "---|" * (len(heads) + 5))
    for name, results in found.items():
        there = [one for one in results if one is not None]
        rms = [1e9 * one.rms for one in there]
        cells = [_time([one.times[w] if one else math.nan for one in results]) for w in range(len(WINDOWS))]
        lines.append(
            f"| {name} | {' | '.join(cells)} | {1e9 * max(o.overshoot for o in there):.0f} nm "
            f"| {np.median(rms):.2f} / {max(rms):.2f} nm "
            f"| {1e3 * max(o.current for o in there):.0f} mA | {np.median([o.steps for o in there]):.0f} |"
        )
    return lines


def open_loop(count: int, load: float, seed: int) -> tuple[float, float]:
    """After 10 mm of steps under a load [N] that drifts by 10 %, of drawn motors whose first 100 steps were
    measured: the share of positions within the 95 % band, and the half-width of the band over the way."""
    random, base = np.random.default_rng(seed), load_actuator(SET).replace(piezo=None)
    held, widths, drive = 0, [], Sawtooth(WALK.amplitude, WALK.frequency)
    scatter, loaded = 20e-9, base.replace(external_force=load)
    known = StepModel.of_model(loaded, WALK.amplitude, WALK.frequency, scatter=scatter, size_error=0.3e-6)
    for _ in range(count):
        model = drawn(random).replace(piezo=None)
        forces = np.linspace(1.3 * load, 0.7 * load, 5)
        sizes = steady_steps(model, drive, parameters={"external_force": forces}).net_step.values
        steps = round(10e-3 / float(np.mean(sizes)))
        # A random walk whose standard deviation at the end is a tenth of the load.
        drift = 0.1 * abs(load) / math.sqrt(steps)
        wander = drift * np.cumsum(random.standard_normal(steps))
        at = np.cumsum(np.interp(load + wander, forces, sizes) + scatter * random.standard_normal(steps))
        one = Estimator(known._replace(load_drift=drift))
        for k in range(0, 100, 10):
            one.stepped(1, 10)
            one.measured(float(at[k + 9]), 1e-9)
        one.stepped(1, steps - 100)
        low, high = one.band()
        held += low < at[-1] < high
        widths.append(0.5 * (high - low) / at[-1])
    return held / count, float(np.median(widths))


def speed() -> dict[str, float]:
    """Microseconds of processor time per update of the whole chain, the least of five times a thousand."""
    found = {}
    for name, sensor in (("kang2007", "interferometer"), (SET, "interferometer")):
        rig = VirtualRig(load_actuator(name), load_bench(f"{name}-bench"))
        rig.begin((sensor,))
        drive = [30.0 + 20.0 * math.sin(k / 100.0) for k in range(1000)]
        spent = []
        for _ in range(5):
            begun = time.thread_time()
            for volts in drive:
                rig.exchange(volts)
            spent.append((time.thread_time() - begun) / len(drive))
        rig.stop(1000.0)
        found[name] = 1e6 * min(spent)
    return found


def minute(seed: int) -> float:
    """Rms over a minute of holding 15 um on one actuator, m."""
    base, tuning, table = loop()
    mover = Mover(WALK, table, ours(tuning), base.gain, hold=60.0)
    rig = VirtualRig(base, bench(), seed=seed)
    recording = regulate(
        *(rig, NoiseShaped(mover, rig.capabilities.step), 15e-6, {"end_effector_position": Channel("laser")}),
        *(LIMITS, 61.0),
        interval=1e-3,
    )
    return settling(recording, 15e-6, hold=59.9, average=1e-3).rms


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--long", type=int, default=3, help="actuators that go 1 mm")
    parser.add_argument("--minute", action="store_true", help="hold for a minute too")
    given = parser.parse_args()
    near, far = compare(given.count, 40e-6, given.seed, 3.0), compare(given.long, 1e-3, given.seed, 12.0)
    blind = {load: open_loop(100, load, given.seed) for load in (-10e-3, -30e-3)}
    rates, rms = speed(), minute(given.seed) if given.minute else math.nan
    content = {"open_loop": blind, "us": rates, "minute": rms}
    print(content)
    OUT.write_text(page(given, near, far, content), encoding="utf-8")


def page(given: Any, near: dict[str, Any], far: dict[str, Any], content: dict[str, Any]) -> str:
    """docs/benchmarks/control.md."""
    lines = [
        "# Controllers",
        "",
        f"`python -m benchmarks.control {given.count} --long {given.long}"
        f"{' --minute' if given.minute else ''}` wrote this page. Actuators are `{SET}`",
        "(hysteresis, creep) with numbers drawn independently: gain and mass 3 %, stage frequency 5 %,",
        "damping 10 %, bristle stiffness and friction 10 %, bristle damping 20 % (standard deviations).",
        "Loops are tuned on the set and its corners, not on the drawn actuator. Bench: 12-bit converter,",
        "PD200X4 before 1.4 uF, interferometer of 1 nm rms and 50 us delay, 20 kHz. All controllers walk",
        "with 65 V at 100 Hz and drive through the same noise shaping. Times are median and greatest, after",
        "which the measured position, averaged over 1 ms, stays within the window to the end of a hold of",
        "0.2 s.",
        "",
        f"## 40 um, {given.count} actuators",
        "",
        *table_of(near),
        "",
        f"## 1 mm, {given.long} actuators",
        "",
        *table_of(far),
        "",
        "*Plain stepping* stops where less than half a step is missing. The *published state machine*",
        "follows the description in a maker's manual (fast steps, slow single steps, linear with PID and",
        "notch, closed only at the end); the manual prints no gains, ours for it cross over at 20 Hz. *PID",
        "only* is our regulator without steps: the piezo does not reach so far.",
        "",
        "## Other figures",
        "",
        "| what | measured |",
        "|---|---|",
    ]
    for load, (held, width) in content["open_loop"].items():
        what = f"open loop, 10 mm of steps against {-1e3 * load:.0f} mN that drift by 10 %"
        lines.append(f"| {what}: truth within the 95 % band | {100 * held:.0f} % |")
        lines.append(f"| {what}: half-width of the band over the way, median | {100 * width:.2f} % |")
    if content["minute"] == content["minute"]:
        lines.append(f"| hold at 15 um over a minute, rms | {1e9 * content['minute']:.2f} nm |")
    for name, us in content["us"].items():
        what = f"processor time of an update of the whole chain, {name}, over the 50 us of 20 kHz"
        lines.append(f"| {what} | {us / 50.0:.2f} |")
    lines += [
        "",
        f"Processor: {platform.machine()}, other work beside it. The open-loop motors (100 drawn, the first",
        "100 steps measured) step by the model's periodic walk at the load of the moment, with 20 nm of",
        "scatter; they are not simulated step by step.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
