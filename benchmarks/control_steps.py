"""Steps of one length both ways, the position in open loop, and many random moves, over drawn actuators."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stickslip.control import Estimator, Mover, NoiseShaped, StepModel, Steps, StepSizes
from stickslip.control.steps import RISING
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.rig import Channel, VirtualRig, regulate
from stickslip.simulation import Motion, steady_steps
from stickslip.waveform import Sawtooth

from .control_bench import LIMITS, RATE, SET, WALK, bench, drawn, loop, ours


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


def open_loop(count: int, load: float, seed: int, amplitude: float) -> tuple[float, float, float]:
    """After 10 mm of steps under a load [N] that drifts by 10 %, of drawn motors whose first 100 steps were
    measured: the share of positions within the 95 % band, the half-width of the band over the way, and what
    of that the load alone makes: its walk, of standard deviation d at the end, moves the end by d c / sqrt(3)
    steps of s for a slope c of the step over the load."""
    random, base = np.random.default_rng(seed), load_actuator(SET).replace(piezo=None)
    held, widths, drive = 0, [], Sawtooth(amplitude, WALK.frequency)
    scatter, loaded = 20e-9, base.replace(external_force=load)
    known = StepModel.of_model(loaded, RATE, amplitude, WALK.frequency, scatter=scatter, size_error=0.3e-6)
    alone = 1.96 * 0.1 * abs(load) * known.per_load / math.sqrt(3.0) / known.forward
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
    return held / count, float(np.median(widths)), alone


class Wandering:
    """Random targets one after the other, each as soon as the one before was reached."""

    def __init__(self, mover: Mover, targets: list[float]) -> None:
        self._mover, self._targets = mover, targets
        self._at, self.done = 0, False
        self.steps, self.target, self.beyond = 0, targets[0], 0.0
        self._from, self._mean = 0.0, 0.0

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V]."""
        del target
        volts = self._mover.step(measured, self.target, tick)
        self.steps = self._mover.steps
        self._mean += (measured - self._mean) / 20.0  # over 1 ms
        if self._mover.phase in ("scan", "hold"):
            side = 1.0 if self.target >= self._from else -1.0
            self.beyond = max(self.beyond, side * (self._mean - self.target))
        if self._mover.settled_at is not None and self._mover.phase == "hold":
            self._at += 1
            self.done = self._at == len(self._targets)
            if not self.done:
                self._from, self.target = self.target, self._targets[self._at]
        return volts


class Wandered(NamedTuple):
    """Of many moves: how many, how long they took [s], the greatest overshoot [m] while the piezo lands, the
    ends of the voltage [V] and the greatest current [A] at the piezo, at any sample."""

    moves: int
    seconds: float
    beyond: float
    low: float
    high: float
    current: float


def wander(count: int, seed: int, each: int = 100) -> Wandered:
    """Moves to random places within 60 um to each side of home, `each` of them in a run on one drawn
    actuator."""
    random, (base, tuning, table) = np.random.default_rng(seed), loop()
    seconds, beyond, low, high, current = 0.0, 0.0, 0.0, 0.0, 0.0
    for first in range(0, count, each):
        goals = random.uniform(-60e-6, 60e-6, min(each, count - first)).tolist()
        made = Wandering(Mover(WALK, table, ours(tuning), base.gain), goals)
        rig = VirtualRig(drawn(random), bench(), seed=seed + first)
        seen = {"end_effector_position": Channel("laser")}
        shaped = NoiseShaped(made, rig.capabilities.step)
        run = regulate(rig, shaped, 0.0, seen, LIMITS, 2.0 * len(goals), interval=1e-2)
        if not made.done:
            raise SystemExit(f"after {made._at} of {len(goals)} moves no more time was left")
        seconds, beyond = seconds + float(run["time"][-1]), max(beyond, made.beyond)
        times, volts = rig.output()
        low, high = min(low, float(volts.min())), max(high, float(volts.max()))
        rate = float(np.abs(np.diff(volts) / np.diff(times)).max())
        current = max(current, bench().piezo_capacitance * rate)
        print(f"{first + len(goals)} of {count} moves", flush=True)
    return Wandered(count, seconds, beyond, low, high, current)


def equalised(count: int, seed: int) -> tuple[float, float]:
    """Of drawn actuators under loads of up to 30 mN, steps of 2 um asked for both ways: the greatest
    difference between them in the first series of ten, and in the third."""
    random = np.random.default_rng(seed)
    base = load_actuator(SET)
    table = StepSizes.of_model(base.replace(piezo=None), RATE, WALK.frequency, 100.0)
    found = []
    for k in range(count):
        model = drawn(random).replace(external_force=float(random.uniform(-0.03, 0.03)))
        turns = equal_steps(model, Steps(table), 2e-6, seed=seed + k)
        found.append([abs(ways[0] / ways[1] - 1.0) for ways in (turns[0], turns[-1])])
    first, last = np.max(found, axis=0)
    return float(first), float(last)
