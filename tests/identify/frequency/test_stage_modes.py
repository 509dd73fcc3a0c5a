"""A modal model as the stage of an actuator: the same response, in a simulation too."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.identify import ModalModel, identify_frequency, with_modes
from stickslip.identify.frequency.modal import modal_response
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")
OMEGA, ZETA, GAIN = np.array([9e3, 3e3, 2e4]), np.array([0.03, 0.2, 0.1]), np.array([-2e-8, 1e-7, 5e-9])
NONE = np.zeros((3, 1, 1))
MODES = ModalModel(OMEGA, ZETA, 0.0, GAIN[:, None, None], NONE, np.zeros((1, 1)))


def test_the_largest_mode_is_the_first_and_the_response_is_the_same() -> None:
    found = with_modes(KANG, MODES)
    assert (found.gain, found.natural_frequency, found.damping_ratio) == (1e-7, 3e3, 0.2)
    assert found.stage_mass == KANG.stage_mass
    frequency = np.geomspace(10.0, 5e3, 50)
    np.testing.assert_allclose(
        found.state_space().response(frequency), modal_response(MODES, frequency), rtol=1e-10
    )
    one = ModalModel(OMEGA[:1], ZETA[:1], 0.0, GAIN[:1, None, None], NONE[:1], np.zeros((1, 1)))
    assert with_modes(KANG, one).further_modes is None


def test_from_a_measured_response_to_a_simulated_sine() -> None:
    """A response with noise, fitted by real modes; the stage then moves as the response said."""
    random, frequency = np.random.default_rng(0), np.linspace(20.0, 4.5e3, 600)
    exact = modal_response(MODES, frequency)[:, 0, 0]
    noise = 2e-11 * (random.standard_normal(600) + 1j * random.standard_normal(600))
    measured = xr.Dataset(
        {"response": (("frequency", "output", "input"), (exact + noise)[:, None, None], {"units": "m/V"}),
         "deviation": (("frequency", "output", "input"), np.full((600, 1, 1), 2.8e-11), {"units": "m/V"})},
        {"frequency": ("frequency", frequency, {"units": "Hz"}), "output": ["y"], "input": ["u"]},
    )  # fmt: skip
    fit = identify_frequency(measured, 3, complex_modes=False, remainder=False)
    one = with_modes(KANG, fit.model).replace(clamped=True)
    at, volts = 1430.0, 10.0
    found = ss.simulate(one, ss.Sine(volts, at, offset=20.0), 0.06, sample_rate=2e5)
    late = found.isel(time=found.time >= 0.04)
    basis = np.exp(-2j * np.pi * at * late.time.values)
    moved = late.stage_position.values - late.stage_position.values.mean()
    answer = 2.0 * np.mean(moved[:-1] * basis[:-1]) * 1j / volts
    expected = modal_response(MODES, np.array([at]))[0, 0, 0]
    assert abs(answer - expected) < 0.01 * abs(expected)


def test_parts_that_no_stage_has_are_refused() -> None:
    bent = MODES._replace(rate_gain=np.full((3, 1, 1), 1e-8))
    with pytest.raises(QuantityError, match=r"rate_gain of 11.8 % of its stroke.*complex_modes=False"):
        with_modes(KANG, bent)
    with pytest.raises(QuantityError, match="remainder"):
        with_modes(KANG, MODES._replace(remainder=np.full((1, 1), 1e-8)))
    with pytest.raises(QuantityError, match="the modal model is in rad/A, but the actuator's gain in m/V"):
        with_modes(KANG, MODES._replace(units=("A", "rad")))
