"""The voltage at a capacitance behind a lag with a limited, and for a time only larger, current.

Between two breaks the target is a line, and the output is a line (at the limit) or a line and an exponential,
both in closed form, as are the times at which one becomes the other: no time step, no error that builds up.
The equations are in ``engine/c/charging.c``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine._abi import ffi
from ..engine.binding import doubles, sized
from ..engine.library import library

Array = NDArray[np.float64]

_ROOM = 16  # points for each bound of the target, at first; most pieces have fewer


class ChargingLimits(NamedTuple):
    """tau [s], greatest slopes with the peak and with the steady current [V/s], the square of the steady
    current [A²], the time over which the mean square forgets [s] (infinite: the peak lasts for ever), and the
    capacitance [F]."""

    tau: float
    rate: float
    steady_rate: float
    steady_square: float
    memory: float
    farad: float


def rest(volts: float) -> Array:
    """The state at rest: output [V], mean square of the current [A²], and 1 while the steady one limits."""
    return np.array([volts, 0.0, 0.0])


def charged(
    of: ChargingLimits, bounds: Array, values: Array, slopes: Array, state: Array, tolerance: float
) -> tuple[Array, Array]:
    """Compute times and voltages to be joined by lines.

    Args:
        of: limits.
        bounds: s, shape (n + 1,), where lines of the target start, and the end.
        values: V, shape (n,), targets at these starts.
        slopes: V/s, shape (n,), of the targets.
        state: see `rest`; becomes the state at the end.
        tolerance: V, of the lines between the points; the points themselves are exact.

    Raises:
        TypeError: an array is no C-contiguous array of doubles.
        ValueError: an array has another size than the others ask for.
    """
    for name, array, size in (
        ("values", values, bounds.size - 1),
        ("slopes", slopes, bounds.size - 1),
        ("state", state, 3),
    ):
        sized(name, array, size)
    task: Any = ffi.new("struct stickslip_charging *")
    task.limits, task.tolerance, task.count = tuple(of), tolerance, values.size
    task.bounds, task.values = doubles(bounds, "bounds"), doubles(values, "values")
    task.slopes, task.state = doubles(slopes, "slopes"), doubles(state, "state", True)
    before, count = state.copy(), _ROOM * bounds.size
    while True:  # twice where there was no room
        times, volts = np.empty(count), np.empty(count)
        task.room = count
        task.times, task.volts = doubles(times, "times", True), doubles(volts, "volts", True)
        count = library().stickslip_charge(task)
        if count <= times.size:
            return times[:count].copy(), volts[:count].copy()
        state[:] = before
