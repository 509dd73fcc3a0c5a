"""Simulation of a sensor sample by sample, for closed loops.

The samples are those that `Mounted.sensor.sense` computes for a whole signal at once, except for other random
numbers in the noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from ..physics.electronics import (
    Encoder,
    Filter,
    InductiveSensor,
    Interferometer,
    PositionSensor,
    StrainGauge,
)
from ..physics.electronics.filters import sections
from ..recording.chain import Chain
from .bench import Mounted
from .protocols import RigError

_DRAWN = 4096  # number of random numbers that are drawn at once, because single draws are slower
# Times within each update at which analogue signals are computed, as fractions of the update.
OVERSAMPLED = (0.25, 0.5, 0.75, 1.0)


class Sensing:
    """Simulation of one input of a bench: sensor, anti-aliasing filter and A/D converter.

    Args:
        mounted: sensor and converter.
        anti_alias: the filter before the converter.
        rate: rate at which analogue signals are computed, Hz: `len(OVERSAMPLED)` times the sampling rate.
        random: random number generator of the noise.
        position: initial position, at rest, m (or rad).

    Attributes:
        shares: times within each update at which `sees` must be called, as fractions of the update.

    Raises:
        RigError: the sensor is a user's own, which can only process whole signals.
    """

    def __init__(
        self, mounted: Mounted, anti_alias: Filter, rate: float, random: np.random.Generator, position: float
    ) -> None:
        sensor: Any = mounted.sensor
        self._shown, self._finished = _curve(sensor), _quantised(sensor)
        self._delay = getattr(sensor, "delay", 0.0) * rate
        first = self._shown(position)
        self._filters = []
        bandwidth = getattr(sensor, "bandwidth", math.inf)
        if bandwidth < 0.5 * rate:
            self._filters.append(Running(Filter(1, bandwidth), rate, first))
        self._late: deque[float] = deque([first] * (math.ceil(self._delay) + 1), math.ceil(self._delay) + 1)
        self._noise = getattr(sensor, "noise_density", 0.0) * math.sqrt(0.5 * rate)
        self._drift = getattr(sensor, "drift", 0.0) / math.sqrt(rate)
        self._random, self._drawn = random, iter(())
        self._walked = 0.0
        self._adc = mounted.adc
        # Without filter, delay and converter only the output at the reading matters: one time per update.
        simple = mounted.adc is None and not self._filters and not self._delay
        self.shares = (1.0,) if simple else OVERSAMPLED
        self._after = None if mounted.adc is None else Running(anti_alias, rate, self._finished(first))

    def sees(self, position: float) -> float:
        """Take the next position, m (or rad); return the sensor's output with filter, delay, noise, drift.

        The output is that at the input of the A/D converter, V; without a converter it is in m or rad.
        """
        value = self._shown(position)
        for one in self._filters:
            value = one(value)
        if self._delay:
            late = self._late
            late.append(value)
            share = self._delay - math.floor(self._delay)
            value = late[0] if share == 0.0 else late[1] + share * (late[0] - late[1])
        if self._noise:
            value += self._noise * self._normal()
        if self._drift:
            self._walked += self._drift * self._normal()
            value += self._walked
        value = self._finished(value)
        return value if self._after is None else self._after(value)

    def reading(self, value: float) -> float:
        """Return an output [V] of `sees` rounded to a step of the A/D converter, within its range; unchanged
        without a converter."""
        adc = self._adc
        if adc is None:
            return value
        code = min(max(round((value - adc.low) / adc.step), 0), 2**adc.bits - 1)
        return adc.low + code * adc.step

    def _normal(self) -> float:
        value = next(self._drawn, None)
        if value is None:
            self._drawn = iter(self._random.standard_normal(_DRAWN).tolist())
            value = next(self._drawn)
        return value


class Running:
    """Digital low-pass filter of a signal that comes sample by sample.

    A call takes the next sample of the signal and returns the filtered sample, in the same unit.

    Args:
        filter: order, corner frequency and family of the filter.
        rate: sampling rate, Hz.
        first: constant value of the signal before the first sample, at which the filter has settled.
    """

    def __init__(self, filter: Filter, rate: float, first: float) -> None:
        made = sections(filter, rate)
        zi = scipy.signal.sosfilt_zi(made) * first
        self._rows = [[*row[:3], *row[4:], *z] for row, z in zip(made.tolist(), zi.tolist(), strict=True)]

    def __call__(self, value: float) -> float:
        for row in self._rows:
            b0, b1, b2, a1, a2, s1, s2 = row
            out = b0 * value + s1
            row[5], row[6] = b1 * value - a1 * out + s2, b2 * value - a2 * out
            value = out
        return value


def _curve(sensor: Any) -> Callable[[float], float]:
    """Return the sensor's static characteristic, without noise and quantisation.

    The result is a function from the position [m or rad] to the sensor's output, V or in the position's unit.

    Raises:
        RigError: the sensor is a user's own, whose characteristic is not known.
    """
    if isinstance(sensor, PositionSensor | Interferometer | Encoder):
        return lambda x: x
    if isinstance(sensor, Chain):
        return lambda x: sensor.scale * x + sensor.offset
    if isinstance(sensor, StrainGauge):
        return lambda x: x / sensor.sensitivity - sensor.offset
    if isinstance(sensor, InductiveSensor):
        spline = scipy.interpolate.CubicSpline(sensor.gaps, sensor.voltages)
        low, high = sensor.gaps[0], sensor.gaps[-1]
        return lambda x: float(spline(min(max(x + sensor.standoff, low), high)))
    raise RigError(
        f"a {type(sensor).__name__} shows whole recordings only: it cannot be an input of a closed loop"
    )


def _quantised(sensor: Any) -> Callable[[float], float]:
    """Return the last operation of the sensor, a function from the noisy output to the final output.

    The function rounds to the resolution (interferometer, encoder) or clips to the range (inductive sensor);
    for other sensors the output is unchanged.
    """
    if isinstance(sensor, Interferometer | Encoder):
        return lambda x: round(x / sensor.resolution) * sensor.resolution
    if isinstance(sensor, InductiveSensor):
        low, high = min(0.0, sensor.voltages[0]), sensor.voltages[-1]
        return lambda x: min(max(x, low), high)
    return lambda x: x
