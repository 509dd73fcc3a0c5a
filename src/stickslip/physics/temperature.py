r"""Stroke of a piezo at low temperature, from the voltages at which published positioners start to step.

A stage starts to step when its stroke exceeds the elastic deflection d of the contact: :math:`C(T)\,V_{th}(T)
= d`. With d independent of the temperature, the stroke per volt falls as the threshold voltage rises,
:math:`C(T) = C(300\,\mathrm{K})\,V_{th}(300\,\mathrm{K}) / V_{th}(T)`. The thresholds are those that a
laboratory set for its ANPx101 and ANPz102 positioners (`THRESHOLDS`), interpolated linearly over ln T.

Valid from 1 K to 300 K, for such positioners. The thresholds are settings, not a calibration: expect an error
of a fifth. Friction, capacitance and hysteresis keep their values, although they also change with the
temperature.
"""

from __future__ import annotations

import math

import numpy as np

from ..quantities.records import Quantity
from .actuator import Actuator

# Pairs of temperature, K, and voltage, V, from which positioners start to step at this temperature.
THRESHOLDS = ((1.0, 49.0), (4.0, 44.0), (77.0, 30.0), (300.0, 22.0))
# Temperature, K, at which the values of parameter sets are valid.
ROOM = THRESHOLDS[-1][0]
KELVIN = Quantity("K", "T", "temperature", minimum=THRESHOLDS[0][0], maximum=ROOM)


def stroke_factor(temperature: float | str) -> float:
    """Return the ratio of the stroke per volt at a temperature [K] to that at 300 K (see the module).

    Raises:
        QuantityError: the temperature is outside 1 to 300 K.
    """
    kelvin = KELVIN.check(temperature, "temperature")
    at, volts = zip(*THRESHOLDS, strict=True)
    return volts[-1] / float(np.interp(math.log(kelvin), np.log(at), volts))


def at_temperature(actuator: Actuator, temperature: float | str) -> Actuator:
    """Return a copy of the actuator for a temperature [K]: its gain (stroke per volt), valid at 300 K, is
    multiplied by `stroke_factor`. All other values are unchanged.

    Raises:
        QuantityError: the temperature is outside 1 to 300 K.
    """
    factor = stroke_factor(temperature)
    return actuator if factor == 1.0 else actuator.replace(gain=factor * actuator.gain)
