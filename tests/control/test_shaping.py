"""Shapers leave what theory says, and an actuator that rings does not."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.actuator import load_actuator
from stickslip.control import Shaper, Shaping, simulate_control
from stickslip.rig import Controller
from stickslip.simulation.sticking import sticking
from stickslip.units import QuantityError
from stickslip.waveform import Sampled

RATE = 20e3
# Light damping, and a contact so stiff that end-effector and stage are one mode.
RINGING = load_actuator("kang2007").replace(damping_ratio=0.02, end_effector_mass="20 g")
POLE = min(np.linalg.eigvals(sticking(RINGING).a), key=abs)
JUMP = Sampled(np.array([0.0, 1e-3, 1.05e-3, 0.1]), np.array([0.0, 0.0, 100e-9, 100e-9]), unit="m")


def left(shaper: Shaper, frequency: float, damping: float) -> float:
    """Of a shaper's parts on a mode, relative to a step: |sum A exp(s t)| at the end [singer1990]."""
    times, shares = shaper.parts()
    omega = 2.0 * np.pi * frequency
    pole = omega * complex(-damping, np.sqrt(1.0 - damping**2))
    return abs(np.sum(shares * np.exp(-pole * (times - times[-1]))))


@pytest.mark.parametrize(
    ("order", "off", "expected"), [(1, 0.0, 0.0), (2, 0.0, 0.0), (1, 0.1, 0.157), (2, 0.1, 0.0246)]
)
def test_what_is_left_of_the_swing(order: int, off: float, expected: float) -> None:
    """cos(pi f / 2 f0)^n for a mode without damping."""
    assert left(Shaper(500.0, 0.0, order), 500.0 * (1.0 + off), 0.0) == pytest.approx(expected, abs=2e-3)


def test_a_damped_mode_is_stopped_and_the_parts_are_all_of_it() -> None:
    for order in (1, 2, 3):
        shaper = Shaper("500 Hz", 0.2, order)
        times, shares = shaper.parts()
        assert left(shaper, 500.0, 0.2) < 1e-9
        assert shares.sum() == pytest.approx(1.0)
        assert times[-1] == pytest.approx(order * 0.5 / (500.0 * np.sqrt(1 - 0.04)))
        taps = shaper.taps(RATE)
        assert taps.sum() == pytest.approx(1.0)
        assert np.arange(taps.size) @ taps / RATE == pytest.approx(times @ shares)


class Ahead:
    """Feedforward alone."""

    def step(self, measured: float, target: float, tick: int) -> float:
        return target / RINGING.gain


def ringing(controller: Controller) -> float:
    """Greatest swing after a step of 100 nm, m, from when the slowest shaper has ended on."""
    found = simulate_control(RINGING, controller, JUMP, 0.03, rate=RATE)["end_effector_position"].values
    return float(np.ptp(found[80:]))


def test_ringing_is_below_a_tenth_with_the_frequency_ten_per_cent_off() -> None:
    hertz, zeta = abs(POLE) / (2.0 * np.pi), -POLE.real / abs(POLE)
    assert zeta < 0.02
    plain = ringing(Ahead())
    assert plain > 100e-9
    for factor in (0.9, 1.0, 1.1):
        assert ringing(Shaping(Ahead(), Shaper(hertz * factor, zeta, 2), RATE)) < 0.1 * plain


def test_samples_are_shaped_as_the_target_is() -> None:
    shaper, seen = Shaper("500 Hz", 0.1), []

    class Seeing:
        done = True

        def step(self, measured: float, target: float, tick: int) -> float:
            seen.append(target)
            return 0.0

    values = np.append(np.zeros(5), np.ones(60))
    shaping = Shaping(Seeing(), shaper, RATE)
    for tick, value in enumerate(values):
        shaping.step(0.0, value, tick)
    np.testing.assert_allclose(seen, shaper.shaped(values, RATE), atol=1e-12)
    assert shaping.done
    assert seen[4] == 0.0
    assert seen[-1] == pytest.approx(1.0)
    with pytest.raises(QuantityError, match=r"order = 1\.5"):
        Shaper(500.0, 0.1, 1.5)
