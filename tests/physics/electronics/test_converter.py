"""Converters against integers worked out by hand, and properties that hold for all of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.physics.electronics import Adc, Dac, adc_output, dac_output
from stickslip.quantities.units import QuantityError

DAC = Dac(bits=12, low="-10 V", high="10 V", gain="10 V", update_rate="20 kHz")
ADC = Adc(bits=16, low=-10.0, high=10.0, max_rate="250 kHz")


def test_steps_of_the_thesis() -> None:
    assert DAC.step == pytest.approx(4.88e-3, abs=5e-6)
    assert ADC.step == 20.0 / 65536


def test_codes_by_hand() -> None:
    step = 20.0 / 4096
    numbers = np.array([0.0, 0.4 * step / 10, 0.6 * step / 10, -0.4 * step / 10, 1.0, 5.0, -5.0])
    nearest = np.array([0.0, 0.0, 1.0, 0.0, 2047.0, 2047.0, -2048.0]) * step
    np.testing.assert_array_equal(dac_output(DAC, numbers), nearest)
    below = np.array([0.0, 0.0, 0.0, -1.0, 2047.0, 2047.0, -2048.0]) * step
    np.testing.assert_array_equal(dac_output(DAC._replace(truncates=True), numbers), below)


def test_a_truncating_converter_gives_the_step_that_was_computed_for() -> None:
    dac = DAC._replace(truncates=True)
    steps = np.arange(-2048, 2048) * dac.step
    np.testing.assert_allclose(dac_output(dac, steps / dac.gain), steps, atol=1e-12)


@given(st.lists(st.floats(-30, 30), min_size=1, max_size=20), st.integers(1, 24))
def test_within_half_a_step_or_at_the_end_of_the_range(volts: list[float], bits: int) -> None:
    adc = Adc(bits=bits, low=-10.0, high=10.0, max_rate=1e5)
    given_, out = np.array(volts), adc_output(adc, volts)
    top = adc.high - adc.step
    inside = (given_ >= adc.low) & (given_ <= top)
    assert np.all(np.abs(out - given_)[inside] <= 0.5 * adc.step * (1 + 1e-9))
    assert np.all(out[given_ > top] == pytest.approx(top))
    assert np.all(out[given_ < adc.low] == adc.low)
    np.testing.assert_array_equal(adc_output(adc, out), out)


def test_noise_of_quantisation_is_that_of_a_uniform_error() -> None:
    ramp = np.linspace(-5.0, 5.0, 1_000_003)
    assert np.std(adc_output(ADC, ramp) - ramp) == pytest.approx(ADC.step / np.sqrt(12), rel=1e-3)


@pytest.mark.parametrize(("field", "value"), [("bits", 0), ("bits", 12.5), ("low", 10.0), ("truncates", 1)])
def test_refused(field: str, value: object) -> None:
    with pytest.raises(QuantityError, match=f"Dac.{field}"):
        DAC._replace(**{field: value})


def test_volts_with_a_unit() -> None:
    expected = adc_output(ADC, [0.1, 0.2])
    np.testing.assert_array_equal(adc_output(ADC, ["100 mV", 0.2]), expected)
    np.testing.assert_array_equal(dac_output(DAC, ["10 %", 0.2]), dac_output(DAC, [0.1, 0.2]))
