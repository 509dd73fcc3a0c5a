"""Trajectories that together use everything that the engine has."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import stickslip as ss
from engine.library import integrate
from plants import Lag
from stickslip.friction import NormalForce, register
from stickslip.physics.piezo import MaxwellCapacitor, Piezo
from stickslip.simulation.models import contact_load
from stickslip.simulation.plant.system import Element, Mode, Plant, state_size
from stickslip.waveform.drive import Drive, constant

Array = NDArray[np.float64]

W, ZETA, GAIN, M = 3303.1, 0.524, 0.1057e-6, 0.0998
STAGE = Mode(W**2, 2 * ZETA * W, GAIN * W**2, 0.0)
FREE = Mode(0.0, 0.0, 0.0, 0.0)
LUGRE = ss.LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.6)
SAWTOOTH, SINE, STEP = ss.Sawtooth(65.0, 50.0, 0.9), ss.Sine(50.0, 80.0), ss.Step(60.0)
KANG = ss.load_actuator("kang2007")
PORT = MaxwellCapacitor(1.8e-6, (3e4, 2e4, 2e4), (0.1, 0.3, 1.2))
EVERYTHING = NormalForce(3e3, -2.0, 0.2, 1e-6, 0.3, 1e-7, 1 / 3, 0.1)


class Integrator(NamedTuple):
    """A sampled controller: at each tick its output grows by `gain` [V/m] times what it sees."""

    gain: float
    period: float


def integrating(law, v, z):
    return z, 0.0


def integrated(law, v, z):
    return z + law.gain * v


register(Integrator, integrating, tick=integrated, smooth=True)


class Case(NamedTuple):
    """One trajectory, as `periods.integrate` takes it; `steps`: the least that it takes, for it to be one."""

    plant: Plant
    drive: Drive
    load: Drive
    state: Array
    end: float
    tolerance: float = 1e-9
    careful: bool = False
    samples: int = 50
    energy: bool = False

    @property
    def times(self) -> Array:
        return np.linspace(0.0, self.end, self.samples)

    @property
    def room(self) -> Array:
        """For samples."""
        width = self.state.size + max(len(self.plant.elements), 1)
        return np.full((self.samples, width), np.nan)


def model(of: Any, waveform: Any, end: float, *, load: Any = 1.0, **further: Any) -> Case:
    contact = contact_load(load, end)
    system, drive = contact.system(of), waveform.drive(end)
    return Case(system.plant, drive, contact.drive, contact.rest(system, drive.before), end, **further)


def built(plant: Plant, drive: Drive, end: float, **further: Any) -> Case:
    drive = drive._replace(polynomial=np.ascontiguousarray(drive.polynomial))
    return Case(plant, drive, constant(1.0), np.zeros(state_size(plant)), end, **further)


def with_law(law: Any, waveform: Any = SAWTOOTH, end: float = 0.03, **further: Any) -> Case:
    return model(KANG.replace(friction=law), waveform, end, **further)


def three_modes() -> Plant:
    others = [Mode((k * W) ** 2, 0.02 * k * W, 0.1 * GAIN * (k * W) ** 2, 0.0) for k in (2.3, 4.1)]
    contact = Element(LUGRE, (1.0, 1.0, 1.0, -1.0), (-1.0 / M, -0.3 / M, -0.2 / M, 10.0))
    return Plant((STAGE, *others, FREE), (contact,), W)


def two_sliders(one_law: Any, other_law: Any) -> Plant:
    one = Element(one_law, (1.0, -1.0, None), (-1.0 / M, 10.0, None))
    two = Element(other_law, (1.0, None, -1.0), (-1.0 / M, None, 20.0))
    return Plant((STAGE, FREE, Mode(0.0, 30.0, 0.0, 0.3)), (one, two), W)


def three_contacts() -> Plant:
    slider = Mode(2e5, 20.0, 2e5 * 0.1e-6, 0.0)
    laws = (LUGRE, ss.Elastoplastic(1e6, 20.0, 1.0, 0.3, 0.35, 1e-7), ss.MaxwellSlip((4e5, 2e5), (0.05, 0.1)))
    return Plant((slider,), tuple(Element(law, (-1.0,), (10.0,)) for law in laws), 450.0)


def amplified() -> Plant:
    lag = Element(Lag(1e3, 0.2, 1e-3), (None, None), (GAIN * W**2, None), drive=1.0, position=(-1e5, None))
    contact = Element(LUGRE, (1.0, -1.0), (-1.0 / M, 10.0), feed=(1e-6,))
    return Plant((STAGE._replace(drive=0.0), FREE), (lag, contact), W)


def controlled() -> Plant:
    integrator = Integrator(0.3 / GAIN, 1.3e-3)
    controller = Element(integrator, (None, None), (GAIN * W**2, None), drive=1.0, position=(-1.0, None))
    contact = Element(ss.Coulomb(0.3), (1.0, -1.0), (-1.0 / M, 10.0))
    return Plant((STAGE._replace(drive=0.0), FREE), (controller, contact), W)


def held_by_two() -> Plant:
    laws = (ss.Coulomb(0.2), ss.Stribeck(0.1, 0.15, 1e-3, 0.3))
    return Plant((STAGE, FREE), tuple(Element(law, (1.0, -1.0), (-1.0 / M, 10.0)) for law in laws), W)


def bent(waveform: Any, end: float, frequency: float, by: float) -> Drive:
    """A drive whose segments are no straight lines: a cubic and, in each second one, a ripple."""
    drive = waveform.drive(end)
    polynomial, count = drive.polynomial.copy(), len(drive.start)
    polynomial[:, 2:] += by * np.array([frequency**2, -3.0 * frequency**3])
    first = np.arange(1, count + 2) // 2
    ripple = np.tile([0.05 * by, 40.0 * frequency, 0.3, 0.0], (first[-1], 1))
    return drive._replace(polynomial=polynomial, first=first, harmonic=ripple)


# Chosen among 130: between them they notice what the cases at home do not (`make mutation`).
SEEDS = (9, 11, 39, 44, 53, 55, 67)


def anywhere(seed: int) -> Case:
    """An actuator away from home: law, drive, load, damping and mass are random."""
    random = np.random.default_rng(seed)
    frequency, volts = 10 ** random.uniform(1.5, 2.8), 10 ** random.uniform(0.8, 2.1)
    periods = int(random.integers(2, 9))
    end = periods / frequency * random.choice([1.0, 0.97])
    laws = (
        *(
            LUGRE,
            ss.Dahl(1e6, 0.5),
            ss.Dahl(1e6, 0.5, 0.6),
            ss.MaxwellSlip((1.3e6, 4e5), (0.3, 0.2), 4.0, 1.2),
        ),
        *(ss.Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7), ss.ResetIntegrator(1e6, 5e-7, 0.3, 100.0)),
        *(ss.Coulomb(0.5), ss.Stribeck(0.4, 0.6, 1e-3, 0.5, 0.5), ss.LuGre(1.4e6, 5.0, 0.0, 0.3, 0.6)),
    )
    waveforms = (
        *(ss.Sawtooth(volts, frequency), ss.Sawtooth(volts, frequency, 0.9), ss.Sine(volts, frequency)),
        ss.waveform.Triangle(volts, frequency),
    )
    loads = (
        *(1.0, 1.0, ss.Sine(0.4, 1.3 * frequency, offset=1.0), ss.Sawtooth(0.5, frequency, offset=0.7)),
        *(ss.Sawtooth(0.5, 2.0 * frequency, offset=0.7), ss.waveform.Triangle(0.5, frequency, offset=0.5)),
    )
    law, waveform, load = (choice[random.integers(len(choice))] for choice in (laws, waveforms, loads))
    found = model(
        KANG.replace(
            friction=law,
            damping_ratio=10 ** random.uniform(-2.5, 0.0),
            end_effector_mass=KANG.end_effector_mass * 10 ** random.uniform(-0.7, 0.7),
            external_force=random.choice([0.0, 0.1]),
            normal_force=EVERYTHING if random.random() < 0.1 and type(law) is not ss.Coulomb else None,
        ),
        waveform,
        end,
        load=load,
        samples=int(random.choice([50, 8 * periods + 1])),
        tolerance=10 ** random.uniform(-9.5, -8.0),
        energy=bool(random.random() < 0.3),
        careful=bool(random.random() < 0.2),
    )
    if random.random() < 0.3:
        found = found._replace(drive=bent(waveform, end, frequency, 0.3 * volts))
    return found


def cases() -> dict[str, Case]:
    slider = ss.physics.PulledSlider(0.1, 2e4, 3.0, ss.Stribeck(0.2, 0.3, 1e-3, 0.1, 0.6))
    static = KANG.replace(natural_frequency=math.inf, blocked_force_per_volt=1.0, external_force=0.1)
    wave, falls = ss.Sine(0.4, 130.0, offset=1.0), ss.Sawtooth(0.5, 90.0, offset=0.7)
    return {
        "the thesis's actuator": model(KANG, ss.Sawtooth(65.0, 5.0), 0.4, energy=True),
        "periods that repeat": model(KANG, SAWTOOTH, 0.6, samples=200, energy=True),
        "a careful run": with_law(ss.Dahl(1e6, 0.5), STEP, 1e-3, careful=True),
        "Dahl with a bound": with_law(ss.Dahl(1e6, 0.5, 0.6)),
        "elastoplastic": with_law(ss.Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7), SINE),
        "reset integrator": with_law(ss.ResetIntegrator(1e6, 5e-7, 0.3, 100.0)),
        "Maxwell slip": with_law(ss.MaxwellSlip((1.3e6, 4e5), (0.3, 0.2), 4.0, 1.2), end=0.01),
        "Coulomb": with_law(ss.Coulomb(0.5), energy=True),
        "stiction": with_law(ss.StictionCoulombViscous(0.4, 0.6, 1.0)),
        "a curve that is steep at rest": with_law(ss.Stribeck(0.4, 0.6, 1e-3, 0.5, 0.5), SINE),
        "a load": with_law(ss.Dahl(1e6, 0.5), load=wave, end=0.012),
        "a load that jumps": with_law(ss.ResetIntegrator(1e6, 5e-7, 0.3, 100.0), load=falls),
        "a load on a static law": with_law(ss.Stribeck(0.4, 0.6), SINE, load=wave),
        "a load along the stroke": model(KANG.replace(normal_force=EVERYTHING), SINE, 5e-3),
        "a load along the stroke and in time": model(
            KANG.replace(normal_force=EVERYTHING), SINE, 5e-3, load=ss.Sawtooth(0.5, 400.0, offset=0.7)
        ),
        "Coulomb along the stroke": model(
            KANG.replace(friction=ss.Coulomb(0.5), normal_force=NormalForce(3e3, 1.0, 0.2, 1e-6)), SINE, 0.02
        ),
        "a pulled slider": model(slider, ss.Sine(40e-6, 20.0), 0.1),
        "a stage without dynamics": model(static, ss.Sine(50.0, 80.0), 0.02),
        "a stage without dynamics at rest": model(static.replace(friction=ss.Coulomb(0.3)), SINE, 0.02),
        "clamped": model(KANG.replace(clamped=True), SAWTOOTH, 0.03),
        "a two-port": model(KANG.replace(piezo=Piezo(PORT)), SINE, 0.015),
        "three modes": built(three_modes(), SINE.drive(0.02), 0.02),
        "two sliders": built(two_sliders(LUGRE, ss.Dahl(2e6, 0.3)), SINE.drive(0.01), 0.01),
        "two sliders at rest": built(two_sliders(ss.Coulomb(0.2), ss.Coulomb(0.1)), SINE.drive(0.03), 0.03),
        "held twice over": built(held_by_two(), SINE.drive(0.03), 0.03),
        "three contacts": built(three_contacts(), SINE.drive(0.02), 0.02),
        "an amplifier": built(amplified(), SAWTOOTH.drive(0.01), 0.01),
        "a sampled controller": built(controlled(), constant(2e-6), 0.03),
        "a chirp": model(KANG, ss.waveform.Chirp(40.0, 20.0, 200.0, 0.1), 0.03),
        **{f"anywhere {seed}": anywhere(seed) for seed in SEEDS},
    }


class Answer(NamedTuple):
    """What came of a case."""

    outcome: int
    reached: float
    accepted: int
    rejected: int
    state: Array
    samples: Array
    account: Array


def answer(case: Case, resume: Array | None) -> Answer:
    """Follow a case."""
    q, samples, account = case.state.copy(), case.room, np.zeros((case.samples, 4))
    found = integrate(
        *(case.plant, case.drive, case.load, q, (0.0, case.end), case.tolerance, case.careful, 200_000),
        *(case.times, samples),
        resume=resume,
        account=account if case.energy else None,
    )
    return Answer(*found, q, samples, account)
