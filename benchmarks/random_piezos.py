"""python -m benchmarks.random_piezos [COUNT] [--seed S]: errors of `ss.simulate` with hysteresis and creep.

As `benchmarks.random_actuators`, for actuators whose piezo has hysteresis, creep or both, against
`benchmarks.oracle_piezo`. The friction laws are few; drives, piezos and all numbers differ. The page is
`docs/benchmarks/random-piezos.md`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

import stickslip as ss
from stickslip.physics.piezo import BoucWen, Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii, register_piezo
from stickslip.quantities.records import Quantity, record

from . import random_actuators
from .random_actuators import Dice, Member

LAWS = ("LuGre", "Dahl", "MaxwellSlip", "CoulombViscous")
PAGE = random_actuators.PAGE.with_name("random-piezos.md")
DRIVES = ("sawtooth", "knots", "knots", "sine", "multisine", "step")


@record
class Lossy(NamedTuple):
    """A user's own model: the loss grows with the square of the voltage."""

    alpha: Annotated[float, Quantity("", "a", "share", minimum=0)]
    beta: Annotated[float, Quantity("1/V", "b", "decay", above=0)]
    growth: Annotated[float, Quantity("1/V2", "c", "growth of the decay", minimum=0)]


register_piezo(
    Lossy, lambda model, u, h, up: model.alpha - model.beta * up * h * (1.0 + model.growth * u * u)
)


def _plays(d: Dice) -> PrandtlIshlinskii:
    count = d.one_of(2, 4, 8)
    thresholds = (0.0, *sorted(d.log(0.3, 40.0) for _ in range(count - 1)))
    return PrandtlIshlinskii(thresholds, (d.even(0.6, 1.0), *(d.even(0.01, 0.1) for _ in thresholds[1:])))


def _bouc_wen(d: Dice) -> BoucWen:
    beta = d.log(1e-3, 0.1)
    return BoucWen(d.even(0.05, 0.4), beta, beta * d.even(-0.2, 0.5))


def _lossy(d: Dice) -> Lossy:
    return Lossy(d.even(0.05, 0.4), d.log(1e-3, 0.1), d.log(1e-6, 1e-4))


def _port(d: Dice, by_charge: bool) -> MaxwellCapacitor:
    farad = d.log(5e-8, 5e-6)
    slips = sorted(d.log(1.0, 60.0) * farad for _ in range(3))  # C
    stiffness = [d.even(0.02, 0.15) / farad for _ in slips]
    breakaways = tuple(k * q for k, q in zip(stiffness, slips, strict=True))
    return MaxwellCapacitor(farad, tuple(stiffness), breakaways, by_charge)


def _creep(d: Dice, period: float) -> Creep:
    """From a hundredth of a period to a million periods, but for seconds the usual logarithmic law."""
    if d.chance(0.3):
        return Creep.logarithmic(d.even(0.005, 0.03), 0.1, 10.0)
    times = sorted(period * d.log(0.01, 1e6) for _ in range(d.one_of(1, 2, 3)))
    return Creep(tuple(times), tuple(d.log(0.003, 0.2) for _ in times))


def _drive(d: Dice, amplitude: float, frequency: float, kind: str) -> Any:
    if kind == "step":
        return ss.Step(amplitude)
    if kind == "sine":
        return ss.Sine(amplitude, frequency)
    if kind == "sawtooth":
        return ss.Sawtooth(amplitude, frequency, d.even(0.7, 0.999) if d.chance(0.6) else 1.0)
    if kind == "multisine":
        many = tuple(amplitude * d.even(0.1, 0.4) for _ in range(3))
        return ss.waveform.Multisine(many, (frequency, 3 * frequency, 4 * frequency), (0.0, 0.0, 0.0))
    period = 1.0 / frequency
    times = tuple(period * (k + d.even(-0.3, 0.3) * (k > 0)) / 5 for k in range(5))
    return ss.PeriodicKnots(
        times, (0.0, *(amplitude * d.even(0.0, 1.0) for _ in range(4))), period, smooth=True
    )


def _piezo(d: Dice, number: int, period: float) -> Piezo:
    """The models take turns."""
    return (
        lambda: Piezo(_plays(d)),
        lambda: Piezo(_plays(d), _creep(d, period)),
        lambda: Piezo(None, _creep(d, period)),
        lambda: Piezo(_bouc_wen(d)),
        lambda: Piezo(_bouc_wen(d), _creep(d, period)),
        lambda: Piezo(_lossy(d), _creep(d, period)),
        lambda: Piezo(_port(d, True)),
        lambda: Piezo(_port(d, False)),
    )[number % 8]()


def member(number: int, seed: int) -> Member:
    """The member of this number."""
    law = "LuGre" if number % 8 == 7 else LAWS[number // 8 % len(LAWS)]
    names = list(random_actuators.LAWS)
    base = random_actuators.member(len(names) * number + names.index(law), seed)
    d = Dice(seed, number, 1)
    frequency, model = base.frequency, base.actuator
    piezo, kind, amplitude = _piezo(d, number, 1.0 / frequency), d.one_of(*DRIVES), d.log(1.0, 150.0)
    if (
        number % 8 == 7
    ):  # what is driven by a voltage is solved in steps of one length: neither stiff nor slow
        frequency, kind = d.log(50.0, 2e3), d.one_of("knots", "sine", "multisine")
        mass = d.log(0.02, 0.5)
        force = float(np.clip(5.0 * math.sqrt(mass) * d.log(0.3, 3.0), 0.1, 5.0))
        stiffness = d.log(1e5, 2e6)
        damping, stiction = 2 * d.even(0.0, 1.0) * math.sqrt(stiffness * mass), force * d.even(1.0, 1.5)
        friction = ss.LuGre(stiffness, damping, 0.0, force, stiction, d.log(1e-3, 1e-2))
        changes: dict[str, Any] = {"friction": friction, "end_effector_mass": mass, "external_force": 0.0}
        model = model.replace(**changes, incline=0.0, natural_frequency=2 * math.pi * d.log(200.0, 5e3))
    waveform = _drive(d, amplitude, frequency, kind)
    return Member(number, model.replace(piezo=piezo), waveform, 1.0, frequency)


if __name__ == "__main__":
    random_actuators.main(member, PAGE)
