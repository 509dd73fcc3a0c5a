"""A drive as a table that begins and ends at 0 V, for generators that put it out once, and its fading out.

A generator that loses its program goes on to the end of its table, so that is at 0 V: the ramp to there is
part of the table. In mid-run the amplitude is brought down in steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from ..quantities.units import QuantityError
from .limits import LONGEST_STOP
from .protocols import Array, Capabilities, RigError

_STEP = 0.02  # s from one amplitude to the next, at least
_MOST_STEPS = 100
_LEAST_DRIVE = 1.0  # V of a drive that its record can be compared with
_FOLLOWS = 0.5  # least correlation of a recorded drive with what was put out
_LAGS = (0, 1, 2, 3, 5, 8, 13, 21, 34)  # samples by which an amplifier may be late


def with_ramp(volts: Array, slew: float, rate: float) -> Array:
    """A drive [n], V, one value per 1/rate s, and a ramp at `slew` V/s from its last value to 0 V, after 0 V.

    The first value is that at rest: generators wait there.
    """
    last = float(volts[-1])
    count = max(math.ceil(abs(last) / slew * rate), 1)
    return np.concatenate([[0.0], volts, last * (1.0 - np.arange(1, count + 1) / count)])


def within(name: str, volts: Array, low: float, high: float, points: int) -> None:
    """Raises RigError unless the table [n], V, is finite, from `low` to `high` V, and not too long."""
    if not np.all(np.isfinite(volts)) or volts.min() < low - 1e-9 or volts.max() > high + 1e-9:
        raise RigError(f"{name}: the drive must be finite and within {low:g} to {high:g} V")
    if volts.size > points:
        raise RigError(
            f"{name}: the drive and its ramp to 0 V have {volts.size} values; {points} are possible"
        )


def check_inputs(can: Capabilities, inputs: tuple[str, ...], samples: int) -> None:
    """Raises RigError for inputs that there are not, and for too many samples."""
    for one in inputs:
        if one not in can.inputs:
            raise RigError(f"{can.name}: there is no input {one!r}; there are {', '.join(can.inputs)}")
    if not 1 <= samples <= can.max_points:
        raise RigError(f"{can.name}: {samples} samples are not 1 to {can.max_points}")


def check_positive(**values: float) -> None:
    """Raises QuantityError, by its name, for an option that is not finite and above 0."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise QuantityError(f"{name} = {value} must be > 0")


def check_ready(can: Capabilities, volts: Array, samples: int) -> None:
    """Raises RigError unless a drive [n] was loaded and inputs were armed."""
    if not volts.size or not samples:
        raise RigError(f"{can.name}: start needs a drive (load) and inputs (arm)")


def held(volts: Array, samples: int) -> Array:
    """What is put out in so many updates, V: the drive [n], and its last value from then on."""
    return volts[np.minimum(np.arange(samples), volts.size - 1)]


def check_followed(name: str, recorded: Array, played: Array) -> None:
    """Raises RigError where a recorded drive [n] is not what was put out [n].

    A scale, an offset and a lag of some samples are allowed. Anything else is of another signal, or its
    samples are shifted or damaged.
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
    """Bring an output to 0 V in steps, at `slew` on average.

    Args:
        to: makes the output that share of what it was.
        greatest: V that there can be at present.
        slew: V/s; a ramp takes 10 s at most.
        most: steps, which are 20 ms long at least.
    """
    takes = _takes(greatest, slew)
    steps = min(max(math.ceil(takes / _STEP), 1), most)
    for step in range(1, steps + 1):
        to(1.0 - step / steps)
        time.sleep(takes / steps)


def _takes(greatest: float, slew: float) -> float:
    return greatest / max(slew, greatest / LONGEST_STOP) if greatest else 0.0


def fade_out(fade: Callable[[float], None], greatest: float, slew: float, ends: float) -> None:
    """Bring an output to 0 V by its amplitude (see `lower`), or wait for the end of its table where that
    comes first: `ends`, s of the monotonic clock."""
    left = ends - time.monotonic()
    if left <= _takes(greatest, slew):
        time.sleep(max(left, 0.0))
        return
    lower(fade, greatest, slew)
