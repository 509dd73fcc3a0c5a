"""Shapers leave what theory says, and an actuator that rings does not."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from stickslip.control import (
    Mover,
    Pid,
    Regulator,
    Shaper,
    Shaping,
    Slip,
    Stepping,
    StepSizes,
    simulate_control,
)
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.rig import Controller
from stickslip.simulation import simulate
from stickslip.simulation.sticking import sticking
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


def test_a_mode_that_the_ticks_cannot_show_is_refused() -> None:
    said = r"Shaper\.frequency = 30 kHz must be below half the rate, 20 kHz"
    with pytest.raises(QuantityError, match=said):
        Shaping(Ahead(), Shaper("30 kHz"), RATE)
    with pytest.raises(QuantityError, match=said):
        Shaper("30 kHz").shaped(np.ones(9), RATE)
    with pytest.raises(QuantityError, match=r"Slip\.frequency = 10 kHz must be below half the rate, 20 kHz"):
        Slip(frequency="10 kHz").left(RATE)


@pytest.mark.parametrize("slip", [Slip("0.3 ms"), Slip("0.1 ms", "525 Hz", 0.1)])
def test_steps_with_such_an_edge_go_as_their_table_says(slip: Slip) -> None:
    """Twenty steps of a mover in a simulation, the mean of the last ten beside the table of the model."""
    model = load_actuator("kang2007").replace(damping_ratio=0.1)
    table = StepSizes.of_model(model, RATE, "100 Hz", "100 V", slip)
    regulator = Regulator(Pid(1e8), 20e3)
    mover = Mover(Stepping("65 V", "100 Hz"), table, regulator, model.gain, learning=0.0, slip=slip)
    mover.steps_wanted = 20
    found = simulate_control(model, mover, 0.0, "0.22 s")
    after = found["end_effector_position"].values[[round((0.02 + k / 100) * 20e3) for k in (8, 18)]]
    step = float(np.interp(65.0, table.voltages, table.forward))
    assert float(np.diff(after)[0]) / 10.0 == pytest.approx(step, rel=0.02)
    other = StepSizes.of_model(model, RATE, "100 Hz", "100 V")
    assert abs(step / float(np.interp(65.0, other.voltages, other.forward)) - 1.0) > 0.02


@pytest.mark.parametrize("off", [0.9, 1.1])
def test_a_shaped_edge_leaves_the_stage_less_ringing(off: float) -> None:
    """Of a stage with a damping ratio of 0.02, its frequency up to 10 % off, at most a quarter."""
    base = load_actuator("kang2007").replace(damping_ratio=0.02)
    model = base.replace(natural_frequency=off * base.natural_frequency)
    left = []
    for slip in (Slip(), Slip(frequency=base.natural_frequency / (2.0 * np.pi), damping=0.02)):
        after, level = slip.corners(1e-5)
        times = np.concatenate([[0.0], 8e-3 + after, [30e-3]])
        drive = Sampled(times, np.concatenate([[0.0], 65.0 * level, [0.0]]))
        found = simulate(model, drive, "30 ms", sample_rate="100 kHz")
        end = 8e-3 + after[-1]
        ringing = found["stage_position"].sel(time=slice(end + 0.3e-3, end + 8e-3))
        left.append(float(np.ptp(ringing.values)))
    assert left[1] < 0.25 * left[0]


def test_an_edge_takes_the_time_that_a_current_takes() -> None:
    slip = Slip.within("0.3 A", "1.8 uF", "65 V")
    assert slip.duration == pytest.approx(0.39e-3)
    left = slip.left(20e3)
    assert len(left) == 8
    np.testing.assert_allclose(left[:-1], 1.0 - np.arange(1, 8) * 50e-6 / 0.39e-3, rtol=1e-12)
    assert left[-1] == 0.0


def test_samples_keep_their_unit_and_are_finite() -> None:
    shaper = Shaper(100.0)
    millimetres = xr.DataArray([1.0, 2.0, 2.0], dims="time", attrs={"units": "mm"})
    np.testing.assert_array_equal(shaper.shaped(millimetres, RATE), shaper.shaped([1.0, 2.0, 2.0], RATE))
    for wrong in ([1.0, np.nan], [np.inf], ["1 V"]):
        with pytest.raises(QuantityError, match="values"):
            shaper.shaped(wrong, RATE)
