"""Linear systems: against the formulas they stand for, and python-control."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from scipy import signal

import stickslip as ss
from stickslip.identify.frequency.modal import ModalModel, modal_response
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")
LINES = np.array([0.1, 50.0, 500.0, 2000.0])


def modal_model(seed: int) -> ModalModel:
    """Three modes, two outputs, three inputs, complex mode shapes, and a delay."""
    random = np.random.default_rng(seed)
    gain, rate = random.standard_normal((2, 3, 2, 3))
    omega = 2.0 * np.pi * np.array([200.0, 450.0, 900.0])
    remainder = random.standard_normal((2, 3))
    return ModalModel(omega, random.uniform(0.01, 0.5, 3), 2e-5, gain, rate, remainder)


def test_the_stage_is_one_mode() -> None:
    """[kang2007, eq. 3.18], by SciPy."""
    omega, zeta = KANG.natural_frequency, KANG.damping_ratio
    _, expected = signal.freqs(
        [KANG.gain * omega**2], [1.0, 2.0 * zeta * omega, omega**2], 2.0 * np.pi * LINES
    )
    np.testing.assert_allclose(KANG.state_space().response(LINES)[:, 0, 0], expected, rtol=1e-12)


def test_a_static_stage_is_its_gain() -> None:
    static = KANG.replace(natural_frequency=np.inf)
    np.testing.assert_allclose(static.state_space().response(LINES), KANG.gain)


def test_its_step_is_what_is_simulated() -> None:
    times = np.linspace(0.0, 0.02, 201)
    _, expected = control.step_response(KANG.state_space().to_control(), times)
    run = ss.simulate(KANG.replace(clamped=True), ss.Step(1.0), times=times, tolerance=1e-12)
    np.testing.assert_allclose(run.stage_position, np.squeeze(expected), atol=2e-12)


@pytest.mark.parametrize("seed", range(3))
def test_a_modal_model_is_the_same_system(seed: int) -> None:
    model = modal_model(seed)
    expected = modal_response(model, LINES)
    np.testing.assert_allclose(model.state_space().response(LINES), expected, rtol=1e-9)
    shown = model.state_space().to_control()(2j * np.pi * LINES)
    np.testing.assert_allclose(np.moveaxis(shown, -1, 0), expected, rtol=1e-6)


def test_no_delay_needs_an_order() -> None:
    for order in (0, 2.5, math.nan, True, "3"):
        with pytest.raises(QuantityError, match=f"order = {order!r} is out of range: .* whole order >= 1"):
            modal_model(0).state_space().to_control(order=order)
