"""A drive as a table that starts and ends at 0 V, for generators that put it out once, and its fade-out.

A generator that loses its program continues to the end of its table. The ramp to 0 V is therefore part of the
table. During a run, a stop reduces the amplitude in steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from ..quantities.units import QuantityError
from .limits import LONGEST_STOP
from .protocols import Array, Capabilities, RigError

_STEP = 0.02  # s, shortest time between two amplitudes
_MOST_STEPS = 100
_LEAST_DRIVE = 1.0  # V, smallest drive whose recording can be compared
_FOLLOWS = 0.5  # least correlation between the recorded drive and the output
_LAGS = (0, 1, 2, 3, 5, 8, 13, 21, 34)  # samples by which the amplifier may lag


def with_ramp(volts: Array, slew: float, rate: float) -> Array:
    """Return 0 V, then a drive [n], V, at `rate` values per second, then a ramp at `slew` V/s to 0 V.

    Generators wait at the first value of their table, which is therefore 0 V.
    """
    last = float(volts[-1])
    count = max(math.ceil(abs(last) / slew * rate), 1)
    return np.concatenate([[0.0], volts, last * (1.0 - np.arange(1, count + 1) / count)])


def within(name: str, volts: Array, low: float, high: float, points: int) -> None:
    """Raise RigError unless the table [n], V, is finite, from `low` to `high` V, and not too long."""
    if not np.all(np.isfinite(volts)) or volts.min() < low - 1e-9 or volts.max() > high + 1e-9:
        raise RigError(f"{name}: the drive must be finite and within {low:g} to {high:g} V")
    if volts.size > points:
        raise RigError(
            f"{name}: the drive and its ramp to 0 V have {volts.size} values; {points} are possible"
        )


def check_inputs(can: Capabilities, inputs: tuple[str, ...], samples: int) -> None:
    """Raise RigError for unknown inputs and for too many samples."""
    for one in inputs:
        if one not in can.inputs:
            raise RigError(f"{can.name}: there is no input {one!r}; there are {', '.join(can.inputs)}")
    if not 1 <= samples <= can.max_points:
        raise RigError(f"{can.name}: {samples} samples are not 1 to {can.max_points}")


def check_positive(**values: float) -> None:
    """Raise QuantityError, naming the option, if an option is not finite or not above 0."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise QuantityError(f"{name} = {value} must be > 0")


def check_ready(can: Capabilities, volts: Array, samples: int) -> None:
    """Raise RigError if no drive [n] was loaded or no inputs were armed."""
    if not volts.size or not samples:
        raise RigError(f"{can.name}: start needs a drive (load) and inputs (arm)")


def held(volts: Array, samples: int) -> Array:
    """Return the output at each of `samples` updates, V: the drive [n], then its last value."""
    return volts[np.minimum(np.arange(samples), volts.size - 1)]


def check_followed(name: str, recorded: Array, played: Array) -> None:
    """Raise RigError if a recorded drive [n] differs from the output [n].

    A scale, an offset and a lag of some samples are allowed. Otherwise the recording is of another signal, or
    its samples are shifted or damaged.
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
        to: sets the output to this fraction of its original amplitude.
        greatest: greatest possible voltage at present, V.
        slew: V/s; a ramp lasts 10 s at most.
        most: greatest number of steps; a step lasts 20 ms at least.
    """
    takes = _takes(greatest, slew)
    steps = min(max(math.ceil(takes / _STEP), 1), most)
    for step in range(1, steps + 1):
        to(1.0 - step / steps)
        time.sleep(takes / steps)


def _takes(greatest: float, slew: float) -> float:
    return greatest / max(slew, greatest / LONGEST_STOP) if greatest else 0.0


def fade_out(fade: Callable[[float], None], greatest: float, slew: float, ends: float) -> None:
    """Reduce the amplitude of an output to 0 V (see `lower`), or wait for the end of its table if that is
    earlier.

    `ends` is the end of the table, s of the monotonic clock.
    """
    left = ends - time.monotonic()
    if left <= _takes(greatest, slew):
        time.sleep(max(left, 0.0))
        return
    lower(fade, greatest, slew)
