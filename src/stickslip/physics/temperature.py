r"""Stroke of a piezo in the cold, from the voltages at which published positioners begin to step.

A stage begins to step where its stroke exceeds the deflection that the contact takes up elastically, a length
d: :math:`C(T)\,V_{th}(T) = d`. With d independent of the temperature, the stroke per volt falls as the
threshold voltage rises, :math:`C(T) = C(300\,\mathrm{K})\,V_{th}(300\,\mathrm{K}) / V_{th}(T)`. The
thresholds are those that a laboratory set for its ANPx101 and ANPz102 positioners (`THRESHOLDS`), joined by
lines over ln T.

Valid from 1 K to 300 K, for positioners of that kind. They are settings, not a calibration: expect an error
of a fifth. Friction, capacitance and hysteresis keep their values, though they change in the cold, too.
"""

from __future__ import annotations

import math

import numpy as np

from ..quantities.records import Quantity
from .actuator import Actuator

THRESHOLDS = ((1.0, 49.0), (4.0, 44.0), (77.0, 30.0), (300.0, 22.0))  # K, V
ROOM = THRESHOLDS[-1][0]  # K, at which parameter sets hold
KELVIN = Quantity("K", "T", "temperature", minimum=THRESHOLDS[0][0], maximum=ROOM)


def stroke_factor(temperature: float | str) -> float:
    """Return the stroke per volt at a temperature [K] over that at 300 K; raises QuantityError outside 1 to
    300 K."""
    kelvin = KELVIN.check(temperature, "temperature")
    at, volts = zip(*THRESHOLDS, strict=True)
    return volts[-1] / float(np.interp(math.log(kelvin), np.log(at), volts))


def at_temperature(actuator: Actuator, temperature: float | str) -> Actuator:
    """Return the actuator with the stroke per volt of a temperature [K]; its own is taken for that at 300
    K."""
    factor = stroke_factor(temperature)
    return actuator if factor == 1.0 else actuator.replace(gain=factor * actuator.gain)
