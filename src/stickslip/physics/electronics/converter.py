"""Converters between numbers and volts, with quantisation and saturation at the ends of their range."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si

Bits = Annotated[float, Quantity("", "b", "number of bits", minimum=1, maximum=32)]
Low = Annotated[float, Quantity("V", "u_low", "voltage of the lowest code")]
High = Annotated[float, Quantity("V", "u_high", "voltage one step above that of the highest code")]


# The functions that both classes have in common are assigned by name, because a NamedTuple cannot inherit
# from a second base class.
@property
def _step(converter: Any) -> float:
    """Return the voltage step of a converter, V: that of the least significant bit."""
    return (converter.high - converter.low) / 2.0**converter.bits


def _check(converter: Dac | Adc) -> None:
    owner = type(converter).__name__
    if converter.bits % 1:
        raise QuantityError(f"{owner}.bits = {converter.bits:g} is out of range: it must be a whole number")
    if converter.low >= converter.high:
        raise QuantityError(
            f"{owner}.low = {converter.low:g} V is out of range: it must be < high = {converter.high:g} V"
        )


@record
class Dac(NamedTuple):
    """A digital-to-analogue converter that holds each value until the next (zero-order hold).

    `gain` is the wanted voltage for the number 1, V. A converter that `truncates` outputs the step at or
    below the wanted voltage, others the nearest step. `step` is the voltage between two steps, V.
    """

    bits: Bits
    low: Low
    high: High
    gain: Annotated[float, Quantity("V", "G", "voltage for the number 1", above=0)]
    update_rate: Annotated[float, Quantity("Hz", "f_DA", "updates per second", above=0)]
    truncates: bool = False

    step = _step

    def _check(self) -> None:
        _check(self)


@record
class Adc(NamedTuple):
    """An analogue-to-digital converter that rounds to the nearest step (`step`, V) and takes at most
    `max_rate` samples per second."""

    bits: Bits
    low: Low
    high: High
    max_rate: Annotated[float, Quantity("Hz", "f_AD", "greatest sampling rate", above=0)]

    step = _step

    def _check(self) -> None:
        _check(self)


def dac_output(dac: Dac, numbers: ArrayLike) -> NDArray[np.float64]:
    """Return the output voltages [V] of a converter for numbers that a program writes, in the same shape.

    Each number is multiplied by the gain, rounded to the nearest step (down to a step if the converter
    `truncates`), and clipped to the range from `low` to one step below `high`.
    """
    steps = (array_si(numbers, "", "numbers") * dac.gain - dac.low) / dac.step
    # If a program computes a number from a step's voltage, rounding may make the number slightly too low. So
    # a small part of a step is added before truncation.
    return _at_steps(dac, np.floor(steps + 1e-6) if dac.truncates else np.rint(steps))


def adc_output(adc: Adc, volts: ArrayLike) -> NDArray[np.float64]:
    """Return input voltages as a converter reads them, V, in the same shape: rounded to its steps, clipped to
    its range."""
    return _at_steps(adc, np.rint((array_si(volts, "V", "volts") - adc.low) / adc.step))


def _at_steps(converter: Dac | Adc, steps: NDArray[np.float64]) -> NDArray[np.float64]:
    return converter.low + np.clip(steps, 0.0, 2.0**converter.bits - 1.0) * converter.step
