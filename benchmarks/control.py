"""Controllers on the virtual rig: how long to come within windows of a target, over many actuators.

python -m benchmarks.control [COUNT] [--seed S] [--long N] [--minute] [--moves N]

Each actuator is `kang2007-hysteresis` (hysteresis 13 % at 150 V, creep) with its numbers drawn; loops are
tuned on the set itself and its corners, never on the drawn one. Bench: 12-bit converter, amplifier with
limited current, an interferometer with 1 nm rms of noise and 50 us of delay. Writes
docs/benchmarks/control.md.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stickslip.control import (
    WINDOWS,
    LowPass,
    Mover,
    NoiseShaped,
    Notch,
    Pid,
    Regulator,
    StepSizes,
    Tuning,
    settling,
)
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.rig import Channel, RigError, VirtualRig, load_bench, regulate

from .control_bench import HOLD, LIMITS, RATE, SET, TOP, WALK, bench, drawn, loop, ours
from .control_steps import equalised, open_loop, wander
from .results import write_page

OUT = Path(__file__).parents[1] / "docs" / "benchmarks" / "control.md"


class Plain:
    """Full steps until less than half of one is missing; then nothing."""

    def __init__(self, table: StepSizes) -> None:
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

    def __init__(self, table: StepSizes, model: Actuator) -> None:
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


class Result(NamedTuple):
    """Of one run: times [s] to the windows, overshoot and rms of the hold [m], peak current [A], what the
    amplifier delivers [J], steps."""

    times: tuple[float, ...]
    overshoot: float
    rms: float
    current: float
    energy: float
    steps: int


def run(model: Actuator, controller: Any, goal: float, seed: int, most: float) -> Result:
    """One run."""
    rig, seen = VirtualRig(model, bench(), seed=seed), {"end_effector_position": Channel("laser")}
    recording = regulate(rig, NoiseShaped(controller, rig.capabilities.step), goal, seen, LIMITS, most)
    hold = min(HOLD, float(recording["time"][-1]))
    found = settling(recording, goal, hold=0.75 * hold)
    times, volts = rig.output()
    capacitance = bench().piezo_capacitance
    current = capacitance * float(np.abs(np.diff(volts) / np.diff(times)).max())
    energy = 0.5 * capacitance * float(np.maximum(np.diff(volts**2), 0.0).sum())
    return Result(found.times, found.overshoot, found.rms, current, energy, controller.steps)


def controllers(table: StepSizes, tuning: Tuning, base: Actuator) -> dict[str, Any]:
    """By what to call them."""
    return {
        "plain stepping": Plain(table),
        "published state machine": Published(table, base),
        "PID only": Only(tuning.regulator(RATE, max_voltage=TOP)),
        "ours": Mover(WALK, table, ours(tuning), base.gain, hold=HOLD),
    }


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


SHOWN = (1, 3, 4)  # windows of the tables, as indices of `WINDOWS`


def table_of(found: dict[str, list[Result | None]]) -> list[str]:
    """Return the Markdown table of the windows in `SHOWN`."""
    heads = " | ".join(f"{1e9 * WINDOWS[w]:g} nm" for w in SHOWN)
    lines = [f"| controller | {heads} | overshoot | hold, rms | energy |", "|" + "---|" * (len(SHOWN) + 4)]
    for name, results in found.items():
        there = [one for one in results if one is not None]
        rms = [1e9 * one.rms for one in there]
        cells = [_time([one.times[w] if one else math.nan for one in results]) for w in SHOWN]
        lines.append(
            f"| {name} | {' | '.join(cells)} | {1e9 * max(o.overshoot for o in there):.0f} nm "
            f"| {np.median(rms):.2f} / {max(rms):.2f} nm "
            f"| {1e3 * np.median([o.energy for o in there]):.0f} mJ |"
        )
    return lines


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
    parser.add_argument("--moves", type=int, default=0, help="random moves, 10000 say")
    given = parser.parse_args()
    near, far = compare(given.count, 40e-6, given.seed, 3.0), compare(given.long, 1e-3, given.seed, 12.0)
    asked = [(load, volts) for load in (-10e-3, -30e-3) for volts in (WALK.amplitude, TOP)]
    blind = {one: open_loop(100, one[0], given.seed, one[1]) for one in asked}
    rates, rms = speed(), minute(given.seed) if given.minute else math.nan
    content = {"open_loop": blind, "us": rates, "minute": rms, "equal": equalised(20, given.seed)}
    content["moves"] = wander(given.moves, given.seed) if given.moves else None
    print(content)
    write_page(OUT, measured(given, near, far, content))


def measured(
    given: Any, near: dict[str, Any], far: dict[str, Any], content: dict[str, Any]
) -> dict[str, str]:
    """Return the measured parts of the page."""
    first, last = content["equal"]
    others = [
        "| what | measured |",
        "|---|---|",
        "| steps of 2 um, 20 actuators, loads up to 30 mN: greatest difference between directions in the "
        f"first and third series of ten | {100 * first:.1f} %, {100 * last:.2f} % |",
    ]
    if content["moves"] is not None:
        one = content["moves"]
        others.append(
            f"| {one.moves} random moves within 60 um: greatest overshoot; voltage, current "
            f"| {1e9 * one.beyond:.0f} nm; {one.low:.2f} to {one.high:.2f} V, {one.current:.2f} A |"
        )
    if content["minute"] == content["minute"]:
        others.append(f"| hold at 15 um over a minute, rms | {1e9 * content['minute']:.2f} nm |")
    for name, us in content["us"].items():
        others.append(f"| CPU time of an update, {name}, over the 50 us of 20 kHz | {us / 50.0:.2f} |")
    blind = ["| steps, load | within the band | half-width |", "|---|---|---|"]
    for (load, volts), (held, width, alone) in content["open_loop"].items():
        half = f"{100 * width:.2f} % ({100 * alone:.2f} %)"
        blind.append(f"| {volts:g} V, {-1e3 * load:.0f} mN | {100 * held:.0f} % | {half} |")
    minute = " --minute" if given.minute else ""
    return {
        "command": f"`python -m benchmarks.control {given.count} --long {given.long}{minute}`: "
        f"{given.count} actuators "
        f"move by 40 um, {given.long} by 1 mm.",
        "near": "\n".join(table_of(near)),
        "far": "\n".join(table_of(far)),
        "others": "\n".join(others),
        "open_loop": "\n".join(blind),
    }


if __name__ == "__main__":
    main()
