"""The bench and the actuators of the benchmark of controllers, and the loop that is tuned for them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip.control import MarginRequirement, Regulator, Stepping, StepSizes, Tuning, tune
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.electronics import Interferometer
from stickslip.rig import Bench, Limits, load_bench
from stickslip.rig.bench import Mounted

SET, RATE, TOP = "kang2007-hysteresis", 20e3, 95.0
WALK = Stepping(amplitude=65.0, frequency=100.0, tolerance=10e-9)
# Relative standard deviations of what is drawn.
SPREAD = {"gain": 0.03, "natural_frequency": 0.05, "damping_ratio": 0.1, "end_effector_mass": 0.03}
OF_FRICTION = {"sigma_0": 0.1, "sigma_1": 0.2, "coulomb_force": 0.1}
HOLD = 0.2  # s
# The machine may do other work for long.
LIMITS = Limits(max_voltage=100.0, watchdog=120.0)


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


def ours(tuning: Tuning) -> Regulator:
    """With feedforward ahead by the actuator's lag."""
    return tuning.regulator(RATE, max_voltage=TOP, lead=tuning.lag)


def loop() -> tuple[Actuator, Tuning, StepSizes]:
    """The set, the loop that is tuned on it and its corners, and its steps."""
    base = load_actuator(SET)
    tuning = tune(base, RATE, MarginRequirement(), posterior=corners(base), delay=2)
    return base, tuning, StepSizes.of_model(base.replace(piezo=None), RATE, WALK.frequency, TOP)
