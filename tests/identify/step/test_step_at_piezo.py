"""Steps of a hysteretic, creeping stage: its closed form against the simulation, and the fit."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.step.at_piezo import ramps, response
from stickslip.identify.step.linear import one_of_pairs, residues, second_order_poles, step_response
from stickslip.physics.piezo import BoucWen, Creep, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.waveform.slewed import Slewed

STAGE = ss.load_actuator("kang2007-hysteresis").replace(clamped=True, min_voltage=-200.0)


def random_piezo(random: np.random.Generator) -> Piezo:
    n = int(random.integers(1, 7))
    thresholds = (0.0, *np.sort(random.uniform(0.5, 60.0, n)).tolist())
    weights = tuple(random.dirichlet(np.ones(n + 1)).tolist())
    shares = tuple(random.uniform(0.0, 0.03, 2).tolist())
    return Piezo(PrandtlIshlinskii(thresholds, weights, (25.0,), (0.1,)), Creep((0.05, 2.0), shares))


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("slew", [None, 1e5])
def test_the_closed_form_is_what_the_simulation_does(seed: int, slew: float | None) -> None:
    random = np.random.default_rng(seed)
    stage = STAGE.replace(piezo=random_piezo(random))
    rest, voltage = float(random.uniform(-20.0, 40.0)), float(random.uniform(20.0, 90.0))
    voltage *= 1.0 if seed % 2 else -1.0
    drive = ss.Step(voltage, offset=rest, delay=0.0)
    times = np.linspace(0.0, 0.02, 400)
    truth = ss.simulate(stage, Slewed(drive, slew) if slew else drive, times=times, tolerance=1e-12)
    poles = second_order_poles(stage.damping_ratio, stage.natural_frequency)
    x = stage.gain * response(stage.piezo, slew)(times, voltage, rest, poles, [])
    y = truth["stage_position"].values
    np.testing.assert_allclose(x[1:], (y - y[0])[1:], atol=2e-6 * stage.gain * abs(voltage) + 2e-12)


def test_a_pole_however_fast_is_as_none() -> None:
    """A lag of a nanosecond behind a ramp of a tenth of a millisecond, whose exponentials leave a double."""
    time, poles = np.linspace(-1e-3, 5e-3, 400), [complex(-800.0, 2000.0), complex(-800.0, -2000.0)]
    fast = response(None, 6e5)(time, 60.0, 0.0, [*poles, complex(-1e9)], [])
    assert fast == pytest.approx(response(None, 6e5)(time, 60.0, 0.0, poles, []), abs=2e-4)


@pytest.mark.parametrize("zeta", [0.3, 1.0 - 1e-13, 1.0 - 1e-7, 1.0])
@pytest.mark.parametrize("other", [0.3, 0.7])
def test_one_of_each_conjugate_pair_stands_for_both(zeta: float, other: float) -> None:
    poles = [*second_order_poles(zeta, 3e3), *second_order_poles(other, 3e3), complex(-900.0)]
    c, p = residues(poles)
    half, upper = one_of_pairs(c, p)
    t = np.linspace(0.0, 5e-3, 60)
    assert len(upper) == 5 - (zeta < 1.0 - 1e-10) - 1
    np.testing.assert_allclose(
        np.real(half @ np.exp(np.outer(upper, t))), np.real(c @ np.exp(np.outer(p, t))), atol=1e-9
    )


def test_without_a_piezo_it_is_one_step() -> None:
    poles, t = second_order_poles(0.5, 3e3), np.linspace(-1e-3, 0.01, 200)
    for slew in (None, 1e5):
        rise = 50.0 / slew if slew else 0.0
        expected = 50.0 * step_response(t, poles, [], rise)
        np.testing.assert_allclose(response(None, slew)(t, 50.0, 3.0, poles, []), expected, atol=1e-11)
    assert ramps(None, 50.0, 3.0, None) == [(50.0, 0.0, 0.0)]


def test_the_mode_and_the_gain_of_a_hysteretic_stage_come_back() -> None:
    random = np.random.default_rng(3)
    recordings = []
    for volts in (30.0, 60.0, 90.0):
        times = np.arange(2000) / 20e3
        r = ss.simulate(STAGE, ss.Step(volts, delay=0.04), times=times)
        r["end_effector_position"] = r["stage_position"] + 5e-9 * random.standard_normal(times.size)
        recordings.append(r)
    fit = ss.identify_step(recordings, STAGE, lag=False)
    for name in ("gain", "natural_frequency", "damping_ratio"):
        low, high = fit.confidence_intervals(0.999)[name]
        assert low < getattr(STAGE, name) < high, name
    assert fit.rmse < 5.5e-9
    assert fit.model.piezo == STAGE.piezo
    straight = ss.identify_step(recordings, STAGE.replace(piezo=None), lag=False)
    assert straight.rmse > 10.0 * fit.rmse
    assert any(one.seen for one in straight.lack)
    left = fit.predict(recordings[1]) + fit.values["offset_2"] - recordings[1]["end_effector_position"].values
    assert left.std() < 6e-9


def test_a_piezo_whose_steps_have_no_closed_form_is_refused() -> None:
    r = ss.simulate(STAGE, ss.Step(60.0, delay=0.04), times=np.arange(2000) / 20e3)
    with pytest.raises(QuantityError, match="no closed form"):
        ss.identify_step(r, STAGE.replace(piezo=Piezo(BoucWen(0.3, 0.06))))
