"""Margins against python-control, stability against simulations, and gains that are refused."""

from __future__ import annotations

import math
import warnings

import control as referee
import numpy as np
import pytest
import xarray as xr

from stickslip.control import (
    LowPass,
    MarginError,
    MarginRequirement,
    Notch,
    Pid,
    Regulator,
    check_margins,
    simulate_control,
    tune,
)
from stickslip.control.loops import sampled_loop
from stickslip.control.tuning import margins, models_of
from stickslip.estimate.posterior import Posterior
from stickslip.friction import Coulomb
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation.sticking import sticking

KANG = load_actuator("kang2007")
RATE = 20e3
WIDE = {"min_voltage": -1e9, "max_voltage": 1e9}


def as_system(matrices, rate: float):
    a, b, c, d = matrices
    return referee.ss(a, b[:, None], c[None, :], d, 1.0 / rate)


def test_the_sticking_model_has_the_modes_of_masses_and_springs() -> None:
    """Undamped: stage m_s with its spring, slider m_e on the bristle; by the eigenvalues of K - ω² M."""
    free = KANG.replace(damping_ratio=0.0, friction=KANG.friction._replace(sigma_1=0.0))
    found = np.sort(np.abs(np.linalg.eigvals(sticking(free).a).imag))[::2]
    m_s, m_e, k = KANG.stage_mass, KANG.end_effector_mass, KANG.friction.sigma_0
    stiff = np.array([[m_s * KANG.natural_frequency**2 + k, -k], [-k, k]])
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(np.diag([m_s, m_e]), stiff)).real))
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    a, b, c = sticking(KANG)
    assert c @ np.linalg.solve(-a, b) == pytest.approx(KANG.gain, rel=1e-9), "at rest"


@pytest.mark.parametrize("delay", [0, 3])
def test_margins_are_those_of_python_control(delay: int) -> None:
    regulator = Regulator(Pid(3e8, 20.0, 2e3), RATE, notches=(Notch(349.0),), low_pass=LowPass(1e3), **WIDE)
    loop = sampled_loop(KANG, RATE, delay=delay)
    found = margins(regulator, [loop])
    whole = as_system((loop.a, loop.b, loop.c, 0.0), RATE) * as_system(regulator.state_space(), RATE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it tells that it interpolates a response
        gain, phase, stability, *_ = referee.stability_margins(whole)
    assert found.gain_margin == pytest.approx(gain, rel=1e-3)
    assert math.degrees(found.phase_margin) == pytest.approx(phase, rel=1e-3)
    assert found.sensitivity == pytest.approx(1.0 / stability, rel=1e-3)
    poles = referee.feedback(whole, 1).poles()
    assert found.stable == bool(np.abs(poles).max() < 1.0)


def response(model, gain: float, seconds: float = 0.4) -> np.ndarray:
    """Of 20 nm, small against presliding, from 30 V."""
    regulator = Regulator(Pid(gain), RATE, min_voltage=0.0, max_voltage=100.0)
    regulator.begin(0.0, 0.0)
    made = simulate_control(model, regulator, 20e-9, seconds, rate=RATE, delay=1)
    return made["end_effector_position"].values - 20e-9


def test_the_poles_say_what_the_simulation_does() -> None:
    """The greatest gain that is stable, by bisection: below it the simulated loop settles, above it it rings
    on, as far as the range of the voltage lets it."""
    low, high = 1e8, 1e11
    loops = [sampled_loop(KANG, RATE)]
    for _ in range(30):
        middle = math.sqrt(low * high)
        stable = margins(Regulator(Pid(middle), RATE, **WIDE), loops).stable
        low, high = (middle, high) if stable else (low, middle)
    calm, loud = response(KANG, 0.9 * low), response(KANG, 1.1 * low)
    assert np.abs(calm[-1000:]).max() < 0.2 * 20e-9
    assert np.abs(loud[-1000:]).max() > 20e-9


def test_the_quickest_loop_that_keeps_its_margins_on_all_models() -> None:
    others = [KANG.replace(natural_frequency=k * KANG.natural_frequency) for k in (0.9, 1.1)]
    wanted = MarginRequirement(max_sensitivity=1.6)
    alone, all_of_them = tune(KANG, RATE, wanted), tune(KANG, RATE, wanted, posterior=others)
    assert all_of_them.models == 3
    assert all_of_them.margins.crossover < alone.margins.crossover
    assert all_of_them.margins.sensitivity == pytest.approx(1.6, rel=0.02), "nothing is given away"
    for one in (KANG, *others):
        assert check_margins(all_of_them.regulator(RATE), one, wanted).sensitivity <= 1.6
    with pytest.raises(MarginError, match=r"over 3 models: the greatest sensitivity is 1\.\d+, above 1\.6"):
        check_margins(alone.regulator(RATE), KANG, wanted, posterior=others)
    settles = simulate_control(KANG, all_of_them.regulator(RATE), 1e-6, 0.1, rate=RATE)
    assert abs(settles["end_effector_position"].values[-1] - 1e-6) < 1e-9


def test_gains_that_are_unstable_on_one_model_are_refused() -> None:
    gains = Regulator(Pid(2e10), RATE, **WIDE)
    with pytest.raises(MarginError, match="over 1 models: the closed loop is unstable"):
        check_margins(gains, KANG)
    with pytest.raises(MarginError, match="no integral gain keeps"):
        tune(KANG, RATE, MarginRequirement(phase_margin=math.pi))


def test_draws_of_a_posterior_are_models() -> None:
    draws = np.arange(200.0).reshape(2, 100)
    samples = xr.Dataset(
        {
            "sigma_0": (("chain", "draw"), 1e6 + draws),
            "natural_frequency": (("chain", "draw"), 3000.0 + draws),
            "log_posterior": (("chain", "draw"), -draws),
        }
    )
    found = models_of(KANG, Posterior(samples, xr.Dataset(), True, "", 0.5), 5)
    assert len(found) == 6
    assert found[0] is KANG
    assert [one.natural_frequency for one in found[1:]] == pytest.approx(
        [3000, 3049, 3099, 3149, 3199], abs=1
    )
    assert all(one.friction.sigma_0 - 1e6 == one.natural_frequency - 3000.0 for one in found[1:])


def test_what_has_no_linear_model_is_refused() -> None:
    with pytest.raises(QuantityError, match="no presliding"):
        tune(KANG.replace(friction=Coulomb(0.5)), RATE)
    with pytest.raises(QuantityError, match="natural_frequency"):
        tune(KANG.replace(natural_frequency=math.inf), RATE)


@pytest.mark.parametrize(
    ("rate", "delay", "said"),
    [
        (math.nan, 1, "rate"),
        (RATE, 0.5, "delay"),
    ],
)
def test_a_loop_has_a_rate_and_whole_ticks_of_delay(rate: float, delay: int, said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        tune(KANG, rate, delay=delay)
    with pytest.raises(QuantityError, match=said):
        sampled_loop(KANG, rate, delay=delay)
