"""Systems that the solver was not written for, built from modes and elements alone, against SciPy."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plants
from engine.library import integrate
from stickslip.friction import Dahl, Elastoplastic, LuGre, MaxwellSlip, register
from stickslip.simulation.plant.system import Element, Mode, Plant, state_size
from stickslip.waveform.drive import Drive, constant
from stickslip.waveform.periodic import Sawtooth, Sine

W, ZETA, GAIN, M = 3303.1, 0.524, 0.1057e-6, 0.0998
STAGE = Mode(W**2, 2 * ZETA * W, GAIN * W**2, 0.0)
FREE = Mode(0.0, 0.0, 0.0, 0.0)
LUGRE = LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.6)
TIMES = np.linspace(0.0, 0.0399, 40)
DRIVE = Sine(30.0, 50.0)


def followed(plant: Plant, drive: Drive, times: np.ndarray = TIMES, tolerance: float = 1e-10) -> np.ndarray:
    """States at the times, from zero."""
    q = np.zeros(state_size(plant))
    samples = np.full((times.size, q.size + max(len(plant.elements), 1)), np.nan)
    span = 0.0, float(times[-1])
    outcome, *_ = integrate(plant, drive, constant(1.0), q, span, tolerance, False, 1_000_000, times, samples)
    assert outcome == 0
    return samples[:, : q.size]


def by_scipy(plant: Plant, amplitude: float, frequency: float, times: np.ndarray = TIMES) -> np.ndarray:
    """The same under a sine, by LSODA over the docstring of `plant.system` written in NumPy."""
    omega = 2.0 * math.pi * frequency

    def slope(t: float, q: np.ndarray) -> np.ndarray:
        u = amplitude * np.array([math.sin(omega * t), omega * math.cos(omega * t), 0.0, 0.0])
        sides = tuple(1.0 if s >= 0.0 else -1.0 for s in speeds(q))
        return plants.motion(plant, sides, q, tuple(u), (1.0, 0.0, 0.0))[0]

    def speeds(q: np.ndarray) -> list[float]:
        bodies = q[: 2 * len(plant.modes)]
        return [plants.entries(e.velocity, len(plant.modes)) @ bodies[1::2] for e in plant.elements]

    scale = np.tile([1e-6, 1e-3], len(plant.modes)).tolist() + [1e-7] * (
        state_size(plant) - 2 * len(plant.modes)
    )
    atol = 1e-9 * np.array(scale)
    done = solve_ivp(
        slope, (0.0, times[-1]), np.zeros(len(scale)), method="LSODA", t_eval=times, rtol=1e-9, atol=atol
    )
    assert done.success
    return done.y.T


def three_modes() -> Plant:
    others = [Mode((k * W) ** 2, 0.02 * k * W, 0.1 * GAIN * (k * W) ** 2, 0.0) for k in (2.3, 4.1)]
    contact = Element(LUGRE, (1.0, 1.0, 1.0, -1.0), (-1.0 / M, -0.3 / M, -0.2 / M, 10.0))
    return Plant((STAGE, *others, FREE), (contact,), W)


def two_sliders() -> Plant:
    one = Element(LUGRE, (1.0, -1.0, None), (-1.0 / M, 10.0, None))
    two = Element(Dahl(2e6, 0.3), (1.0, None, -1.0), (-1.0 / M, None, 20.0))
    return Plant((STAGE, FREE, Mode(0.0, 30.0, 0.0, 0.0)), (one, two), W)


def three_contacts() -> Plant:
    slider = Mode(2e5, 20.0, 2e5 * 0.1e-6, 0.0)
    laws = (LUGRE, Elastoplastic(1e6, 20.0, 1.0, 0.3, 0.35, 1e-7), MaxwellSlip((4e5, 2e5), (0.05, 0.1), 0.5))
    return Plant((slider,), tuple(Element(law, (-1.0,), (10.0,)) for law in laws), 450.0)


@pytest.mark.parametrize(
    ("plant", "positions"),
    [(three_modes(), [0, 2, 4, 6]), (two_sliders(), [0, 2, 4]), (three_contacts(), [0])],
    ids=["stage of three modes", "two sliders on one stage", "slider held by three contacts"],
)
def test_bodies_and_contacts_in_other_numbers(plant: Plant, positions: list[int]) -> None:
    found = followed(plant, DRIVE.drive(0.04))
    expected = by_scipy(plant, 30.0, 50.0)
    assert np.ptp(expected[:, positions[-1]]) > 2e-8
    np.testing.assert_allclose(found[:, positions], expected[:, positions], rtol=0, atol=1e-9)


OWN_FILE = '''
from typing import NamedTuple

from stickslip.friction import register


class Amplifier(NamedTuple):
    """First order, of bandwidth 1/time [s], whose output cannot change faster than `slew` [V/s]."""

    time: float
    slew: float


def amplified(law, v, z):
    return z, min(max((v - z) / law.time, -law.slew), law.slew)


register(Amplifier, amplified, smooth=True)
'''


def test_a_users_element_in_the_users_file(tmp_path: Path) -> None:
    """An amplifier between the drive and the stage: its closed form where it slews, then where it settles."""
    (tmp_path / "own_amplifier.py").write_text(OWN_FILE)
    spec = importlib.util.spec_from_file_location("own_amplifier", tmp_path / "own_amplifier.py")
    assert spec is not None
    assert spec.loader is not None
    own: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(own)
    amplifier = Element(own.Amplifier(1e-3, 2e4), (None, None), (GAIN * W**2, None), drive=1.0)
    contact = Element(LUGRE, (1.0, -1.0), (-1.0 / M, 10.0))
    plant = Plant((STAGE._replace(drive=0.0), FREE), (amplifier, contact), W)
    times = np.linspace(0.0, 0.02, 201)
    found = followed(plant, constant(80.0), times)
    slewing = (80.0 - 20.0) / 2e4  # until 20 V are left, which is slew times time
    expected = np.where(times < slewing, 2e4 * times, 80.0 - 20.0 * np.exp(-(times - slewing) / 1e-3))
    np.testing.assert_allclose(found[:, 4], expected, rtol=0, atol=0.01)
    assert found[-1, 0] == pytest.approx(80.0 * GAIN, rel=1e-3)


class Integrator(NamedTuple):
    """A sampled controller: at each tick its output grows by `gain` [V/m] times what it sees."""

    gain: float
    period: float


def integrating(law, v, z):
    return z, 0.0


def integrated(law, v, z):
    return z + law.gain * v


register(Integrator, integrating, tick=integrated, smooth=True)


def test_a_sampled_controller() -> None:
    """Between ticks its output stands still; the stage alone is linear, so that its motion is known
    exactly."""
    gain, period, target = 0.3 / GAIN, 1.3e-3, 2e-6
    controller = Element(
        Integrator(gain, period), (None,), (GAIN * W**2,), drive=1.0, position=(-1.0,), drive_rate=None
    )
    plant = Plant((STAGE._replace(drive=0.0),), (controller,), W)
    times = np.linspace(0.0, 0.0247, 248)
    found = followed(plant, constant(target), times, tolerance=1e-13)
    damped = W * math.sqrt(1.0 - ZETA**2)

    def moved(x: float, w: float, u: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, decay = x - GAIN * u, np.exp(-ZETA * W * t)
        b = (w + ZETA * W * a) / damped
        c, s = np.cos(damped * t), np.sin(damped * t)
        position = GAIN * u + decay * (a * c + b * s)
        return position, decay * ((b * damped - ZETA * W * a) * c - (a * damped + ZETA * W * b) * s)

    x, w, u, expected = 0.0, 0.0, 0.0, np.full((times.size, 2), np.nan)
    for k in range(20):
        u += gain * (target - x)
        inside = (times >= k * period - 1e-12) & (times < (k + 1) * period - 1e-12)
        expected[inside, 0] = moved(x, w, u, times[inside] - k * period)[0]
        expected[inside, 1] = u
        x, w = (float(one) for one in moved(x, w, u, np.array(period)))
    np.testing.assert_allclose(found[:, 0], expected[:, 0], rtol=0, atol=1e-12)
    ticks = np.abs(times / period - np.round(times / period)) < 1e-6
    np.testing.assert_allclose(found[~ticks, 2], expected[~ticks, 1], rtol=1e-6)


def test_rotary_units() -> None:
    """An angle on a radius: N m for N, kg m² for kg, rad for m; the same motion."""
    radius = 0.012
    sawtooth = Sawtooth(65.0, 50.0, periods=2).drive(0.04)
    contact = Element(LUGRE, (1.0, -1.0), (-1.0 / M, 10.0))
    straight = followed(Plant((STAGE, FREE), (contact,), W), sawtooth)
    law = LuGre(
        LUGRE.sigma_0 * radius**2,
        LUGRE.sigma_1 * radius**2,
        0.0,
        LUGRE.coulomb_force * radius,
        LUGRE.stiction_force * radius,
        LUGRE.stribeck_velocity / radius,
    )
    turned = Element(law, (1.0, -1.0), (-1.0 / (M * radius**2), 10.0 / radius**2))
    stage = STAGE._replace(drive=STAGE.drive / radius)
    angle = followed(Plant((stage, FREE), (turned,), W), sawtooth, tolerance=1e-10 / radius)
    np.testing.assert_allclose(angle[:, [0, 2]] * radius, straight[:, [0, 2]], rtol=0, atol=1e-10)
