"""Drives as tables for generators that output a table once, checks before and after a run, and the stop of
such a generator.

A generator that loses its program continues to the end of its table. The table therefore ends with a ramp to
0 V. A stop during a run reduces the amplitude of the output in steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from ..quantities.units import QuantityError
from .limits import LONGEST_STOP
from .protocols import Array, Capabilities, RigError

_STEP = 0.02  # intended time between two steps of a reduction to 0 V, s; longer if there were too many steps
_MOST_STEPS = 100  # largest number of steps in which an output is reduced to 0 V
_LEAST_DRIVE = 1.0  # smallest range of a drive (maximum less minimum), V, that is compared with its recording
# Smallest correlation coefficient, without its sign, of a recorded drive with the output; below, it is an
# error.
_FOLLOWS = 0.5
_LAGS = (0, 1, 2, 3, 5, 8, 13, 21, 34)  # lags of the recorded drive behind the output that are tried, samples


def with_ramp(volts: Array, slew: float, rate: float) -> Array:
    """Return a table for a generator, V, one value per update: the value 0 V, a drive, and a ramp to 0 V.

    Generators wait at the first value of their table, which is therefore 0 V.

    Args:
        volts: voltages of the drive [n], V.
        slew: slew rate of the ramp, V/s.
        rate: update rate of the table, Hz.
    """
    last = float(volts[-1])
    count = max(math.ceil(abs(last) / slew * rate), 1)
    return np.concatenate([[0.0], volts, last * (1.0 - np.arange(1, count + 1) / count)])


def within(name: str, volts: Array, low: float, high: float, points: int) -> None:
    """Raise RigError unless a table is finite, within the voltages of the device, and not too long.

    Args:
        name: name of the device, for the error.
        volts: values of the table [n], V.
        low, high: least and greatest voltage, V.
        points: greatest number of values.
    """
    if not np.all(np.isfinite(volts)) or volts.min() < low - 1e-9 or volts.max() > high + 1e-9:
        raise RigError(f"{name}: the drive must be finite and within {low:g} to {high:g} V")
    if volts.size > points:
        raise RigError(
            f"{name}: the drive and its ramp to 0 V have {volts.size} values; {points} are possible"
        )


def check_inputs(can: Capabilities, inputs: tuple[str, ...], samples: int) -> None:
    """Raise RigError if the rig lacks one of the inputs or cannot record this number of samples."""
    for one in inputs:
        if one not in can.inputs:
            raise RigError(f"{can.name}: there is no input {one!r}; there are {', '.join(can.inputs)}")
    if not 1 <= samples <= can.max_points:
        raise RigError(f"{can.name}: {samples} samples are not 1 to {can.max_points}")


def check_positive(**values: float) -> None:
    """Raise QuantityError unless each of the values, given by their names, is finite and above 0."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise QuantityError(f"{name} = {value} must be > 0")


def check_ready(can: Capabilities, volts: Array, samples: int) -> None:
    """Raise RigError if no drive was loaded (`volts` [n] is empty) or no inputs were armed (`samples` 0).

    `can` are the capabilities of the rig, which give its name for the error.
    """
    if not volts.size or not samples:
        raise RigError(f"{can.name}: start needs a drive (load) and inputs (arm)")


def held(volts: Array, samples: int) -> Array:
    """Return the output at each of `samples` updates, V: the drive [n], then its last value."""
    return volts[np.minimum(np.arange(samples), volts.size - 1)]


def check_followed(name: str, recorded: Array, played: Array) -> None:
    """Raise RigError if a recorded drive [n] is another signal than the output [n].

    A scale of either sign, an offset and a lag (one of `_LAGS`, up to 34 samples) are allowed. If the
    correlation is below 0.5 with each lag, the input records another signal, or its samples are shifted or
    damaged.

    Args:
        name: name of the device, for the error.
        recorded: recorded drive [n], in any unit.
        played: output at the same times [n], V; with a range below 1 V nothing is checked.
    """
    if np.ptp(played) < _LEAST_DRIVE:
        return
    found = 0.0
    for late in (lag for lag in _LAGS if lag < played.size // 2):
        a, b = recorded[late:], played[: played.size - late]
        if np.ptp(a) > 0.0 and np.ptp(b) > 0.0:
            found = max(found, abs(float(np.corrcoef(a, b)[0, 1])))
    if found < _FOLLOWS:
        raise RigError(
            f"{name}: the recorded drive is not what was put out (its correlation is {found:.2f}): check "
            "what the input 'drive' is connected to"
        )


def lower(to: Callable[[float], None], greatest: float, slew: float, most: int = _MOST_STEPS) -> None:
    """Reduce an output to 0 V in steps, at `slew` on average.

    Args:
        to: called in each step with the next fraction below 1, at last 0, of the present amplitude; it sets
            the output to this fraction.
        greatest: greatest possible voltage at present, V.
        slew: V/s; it is raised if the reduction would last longer than 10 s.
        most: greatest number of steps. Only if more were needed, a step lasts longer than 20 ms.
    """
    takes = _takes(greatest, slew)
    steps = min(max(math.ceil(takes / _STEP), 1), most)
    for step in range(1, steps + 1):
        to(1.0 - step / steps)
        time.sleep(takes / steps)


def _takes(greatest: float, slew: float) -> float:
    return greatest / max(slew, greatest / LONGEST_STOP) if greatest else 0.0


def fade_out(fade: Callable[[float], None], greatest: float, slew: float, ends: float) -> None:
    """Bring an output to 0 V: reduce its amplitude, or wait for the end of its table if that is earlier.

    Args:
        fade: function that sets the output's amplitude to a fraction, 1 to 0, of the present one.
        greatest: greatest possible voltage at present, V.
        slew: average slew of the reduction, V/s.
        ends: time at which the table ends, s of `time.monotonic`.
    """
    left = ends - time.monotonic()
    if left <= _takes(greatest, slew):
        time.sleep(max(left, 0.0))
        return
    lower(fade, greatest, slew)
