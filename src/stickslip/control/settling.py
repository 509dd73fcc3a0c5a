"""Settling of a move: times after which it stays within each of several windows about its target, and its
overshoot.

A settling time within the dead band of the controller only measures the dead band, so a ladder of windows is
reported.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity
from ..quantities.units import QuantityError, to_si

if TYPE_CHECKING:
    import xarray as xr

WINDOWS = (1e-6, 100e-9, 30e-9, 10e-9, 3e-9)  # default half-widths of the windows about the target, m (rad)
_TIME = Quantity("s", "", "it", minimum=0)
_MEAN = 1e-3  # default duration of the running mean of a sensor's readings, s


class Settling(NamedTuple):
    """Settling of a move.

    Fields: `times` [s] of the recording from which on the position stays within each of the `windows` [m]
    (NaN: outside at the end); `overshoot` [m] beyond the target, in the direction of the move, or 0; `rms`
    [m] of the error over the last `held` seconds (0: of the last sample); `noise` [m], standard deviation of
    the sensor's noise after the running mean, 0 without a mean. For a rotary actuator, m is rad.
    """

    windows: tuple[float, ...]
    times: tuple[float, ...]
    overshoot: float
    rms: float
    held: float
    noise: float = 0.0


def settling(
    recording: xr.Dataset,
    target: float | str,
    *,
    windows: Sequence[float | str] = WINDOWS,
    hold: float | str = 0.0,
    average: float | str | None = None,
) -> Settling:
    """Return settling times, overshoot and error while holding, of a recording with `end_effector_position`.

    Args:
        recording: result of `rig.regulate` or `simulate_control`.
        target: target position, m, or rad if the recording is in rad.
        windows: half-widths of the windows about the target, in the same unit.
        hold: duration at the end over which the rms error and the noise are computed, s; 0: the last sample
            for the error, the last two for the noise.
        average: duration of a running mean, s, which removes the sensor's noise, and faster motion, from all
            results. By default 1 ms for a sensor's readings, and no mean for a simulated position (next to
            `measured_position`), which has no noise.

    Raises:
        QuantityError: the channel is missing, the target is not finite, the hold is longer than the recording
            or below 0, a window is not > 0, or `average` is negative.
    """
    if "end_effector_position" not in recording:
        raise QuantityError(
            f"the recording has no end_effector_position; it has {', '.join(map(str, recording))}"
        )
    unit = recording["end_effector_position"].attrs.get("units", "m")
    goal, span = Quantity(unit, "", "it").check(target, "target"), _TIME.check(hold, "hold")
    wide = 0.0 if "measured_position" in recording else _MEAN
    wide = wide if average is None else _TIME.check(average, "average")
    sizes = tuple(to_si(one, unit, "windows") for one in windows)
    if not all(one > 0.0 for one in sizes):
        raise QuantityError(f"windows must be > 0 {unit}: {windows!r:.60}")
    time = recording["time"].values
    between = float(time[1] - time[0])
    if span > time[-1] - time[0]:
        raise QuantityError(f"hold = {span:g} s is longer than the recording, {time[-1] - time[0]:g} s")
    count, raw = max(1, round(wide / between)), recording["end_effector_position"].values
    x = _averaged(raw, count)
    off = x - goal
    found = []
    for one in sizes:
        outside = np.flatnonzero(np.abs(off) > one)
        last = int(outside[-1]) if outside.size else -1
        found.append(math.nan if last == off.size - 1 else float(time[last + 1]))
    side = 1.0 if goal >= x[0] else -1.0
    last = max(1, round(span / between))
    rms = float(np.sqrt(np.mean(off[-last:] ** 2)))
    # The standard deviation of white noise follows from successive differences. Motion that is slow compared
    # with the sampling adds little to them.
    noise = float(np.sqrt(0.5 * np.mean(np.diff(raw[-max(last, 2) :]) ** 2) / count)) if wide else 0.0
    return Settling(sizes, tuple(found), max(float((side * off).max()), 0.0), rms, span, noise)


def _averaged(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the running mean [n] of `values` [n] over the last `count` samples; earlier ones equal the
    first."""
    total = np.cumsum(np.append(np.zeros(count), values - values[0]))
    return values[0] + (total[count:] - total[:-count]) / count
