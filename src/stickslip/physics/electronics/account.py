r"""Electrical quantities of a piezo stack during a run: current, charge, power and temperature.

Between two points the voltage is linear, so at constant capacitance the current is constant, and every sum is
exact. Capacitance and loss may grow with the temperature ϑ, by the factor c = 1 + α (ϑ - ϑ_0). Between two
points the loss P at the reference temperature ϑ_0 is constant, and the heat balance

.. math:: C_\vartheta \dot\vartheta = c(\vartheta)\, P - \frac{\vartheta - \vartheta_a}{R_\vartheta}

has an exponential solution, with the rate 1/(R_ϑ C_ϑ) - α P / C_ϑ; if the rate is negative, the temperature
runs away. C_ϑ is the heat capacity, R_ϑ the thermal resistance to the surroundings, and ϑ_a their
temperature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import of_kind
from ...quantities.units import QuantityError, array_si, optional_si, to_si, with_prefix
from ...waveform.signal import Waveform
from .cycles import lost_power
from .lines import jumps, lines_of
from .stack import TEMPERATURE, Stack, TemperatureDependence

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

# Largest interval between two points of the computation, as a fraction of the stack's thermal time constant,
# so that the points resolve warming and cooling.
_WARMING = 0.02

_OVER_TIME = {
    "drive_voltage": ("V", "drive voltage"),
    "current": ("A", "current"),
    "charge": ("C", "charge"),
    "reactive_power": ("W", "reactive power"),
    "loss_power": ("W", "loss"),
    "temperature": ("K", "temperature of the stack"),
    "gain_factor": ("", "gain over that at the reference temperature"),
}
_OF_ALL = {
    "peak_current": ("A", "greatest current"),
    "rms_current": ("A", "rms current"),
    "mean_loss": ("W", "mean loss"),
    "steady_temperature": ("K", "final temperature if the run continued"),
}


def electrical(
    source: Waveform | Mapping[str, Any],
    stack: Stack,
    duration: float | str | None = None,
    *,
    times: ArrayLike | None = None,
    ambient: float | str = 293.15,
    tolerance: float | str = 5e-3,
    dependence: TemperatureDependence | None = None,
) -> xr.Dataset:
    """Return current, charge, power and temperature of a piezo stack during a run.

    The current is that of the capacitance; losses increase its rms value by less than the square of the loss
    tangent. Noise of a recorded voltage counts as current, so smooth it first.

    Args:
        source: voltage at the piezo: a waveform in V without jumps (`driven` returns one); or a recording
            or trajectory with "time" and "drive_voltage".
        stack: the stack.
        duration: s; by default the duration of the waveform. Ignored for a recording.
        times: s, ascending, within the run: times of the result; by default the points of
            the computation.
        ambient: temperature of the surroundings, and initially of the stack, K.
        tolerance: largest error of the straight lines that approximate a waveform, V.
        dependence: dependence of capacitance and gain on temperature; the loss follows the capacitance, and
            all are fed back. By default none.

    Returns:
        Dataset over "time": the given times, or those of the lines or samples, with more where the stack's
        temperature curves: `drive_voltage` [V], `charge` [C] and `temperature` [K] at each point, `current`
        [A], `reactive_power` (into the field, negative: out of it) and `loss_power` [W] from that point
        to the next point of the computation; with a `dependence` also `gain_factor` at each point, which
        multiplies the actuator's gain. For the whole run: `peak_current`, `rms_current`, `mean_loss`, and
        `steady_temperature`, the final temperature if the run continued: infinite if the loss grows faster
        than the heat leaves.

    Raises:
        QuantityError: a waveform without a duration, in m or with a jump, which takes an infinite current; a
            recording without drive_voltage, without two samples or with gaps; a trajectory with the charge
            of a `MaxwellCapacitor`; a number out of range; a temperature outside the range of the dependence.
    """
    import xarray as xr

    seconds = optional_si(duration, "s", "duration")
    kelvin = TEMPERATURE.check(to_si(ambient, "K", "ambient"), "ambient")
    volts_off = to_si(tolerance, "V", "tolerance")
    if not volts_off > 0.0:
        raise QuantityError(f"tolerance = {volts_off:g} V is out of range: it must be > 0 V")
    of_kind(stack, Stack, "stack")
    of_kind(dependence, TemperatureDependence | None, "dependence")
    at, volts = _closer(*_points(source, seconds, volts_off), _WARMING * stack.time_constant)
    told = slice(None)
    if times is not None:
        at, volts, told = _and_at(at, volts, array_si(times, "s", "times"))
    step = np.diff(at)
    cold = lost_power(at, volts, stack.cycle_loss)
    lasted = float(at[-1] - at[0])
    slope, first = 0.0, 1.0
    if dependence is not None:
        slope, first = dependence.capacitance, float(dependence.capacitance_factor(kelvin))
    rise = _warmed(step, cold, stack, slope, first)
    factor = np.full(rise.size, 1.0) if dependence is None else dependence.capacitance_factor(kelvin + rise)
    loss = cold * 0.5 * (factor[1:] + factor[:-1])
    charge = stack.load * factor * volts
    current = np.diff(charge) / step
    stored = 0.5 * np.diff(charge * volts) / step
    mean_loss = float(np.sum(loss * step)) / lasted
    # Temperature rise in the steady state, K, that would follow if the loss did not depend on the
    # temperature.
    steady = stack.thermal_resistance * float(np.sum(cold * step)) / lasted
    left = 1.0 - steady * slope
    found = {
        "drive_voltage": volts,
        "current": _held(current),
        "charge": charge,
        "reactive_power": _held(stored),
        "loss_power": _held(loss),
        "temperature": kelvin + rise,
        "peak_current": float(np.abs(current).max()),
        "rms_current": math.sqrt(float(np.sum(current * current * step)) / lasted),
        "mean_loss": mean_loss,
        "steady_temperature": kelvin + steady * first / left if left > 0.0 else math.inf,
    }
    if dependence is not None:
        found["gain_factor"] = dependence.gain_factor(kelvin + rise)
    said = {**_OVER_TIME, **_OF_ALL}
    return xr.Dataset(
        {
            name: (
                ("time",) if name in _OVER_TIME else (),
                found[name][told] if name in _OVER_TIME else found[name],
                {"units": unit, "long_name": long_name},
            )
            for name, (unit, long_name) in said.items()
            if name in found
        },
        {"time": ("time", at[told], {"units": "s", "long_name": "time"})},
    )


def _points(source: Any, duration: float | None, tolerance: float) -> tuple[Array, Array]:
    """Return times [s] and voltages [V] of the run as points for linear interpolation.

    Args:
        source: recording, whose samples are the points; or waveform, which is approximated.
        duration: duration of a waveform, s; None: its own.
        tolerance: largest error of the approximation, V.

    Raises:
        QuantityError: the source is not as `electrical` requires.
    """
    if isinstance(source, Mapping):
        return _samples(source)
    if not hasattr(source, "drive"):
        raise QuantityError(f"source = {source!r:.60} must be a waveform in V, or a recording")
    duration = source.duration if duration is None else duration
    if duration is None or not 0.0 < duration < math.inf:
        raise QuantityError(f"duration = {duration} s: of a waveform it must be said, > 0 s and finite")
    name = type(source).__name__
    if source.unit != "V":
        raise QuantityError(f"{name} is in {source.unit}: a piezo is driven by volts")
    lines = lines_of(source.drive(duration), duration, tolerance)
    jumped, at = jumps(lines)
    far = np.flatnonzero(np.abs(jumped) > 2.0 * tolerance)
    if far.size:
        raise QuantityError(
            f"{name} jumps by {with_prefix(float(jumped[far[0]]), 'V')} at {at[far[0]]:g} s, which takes an "
            "infinite current: electronics.driven says what an amplifier makes of it"
        )
    return lines.bounds, np.append(lines.values, lines.end)


def _closer(times: Array, volts: Array, farthest: float) -> tuple[Array, Array]:
    """Return the points (times and voltages) with interpolated points added where they are farther apart than
    `farthest` [s]."""
    parts = np.maximum(np.ceil(np.diff(times) / farthest), 1.0).astype(np.int64)
    if parts.max() == 1:
        return times, volts
    which = np.repeat(np.arange(parts.size), parts)
    share = (np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[which]
    finer = times[which] + share * np.diff(times)[which]
    return np.append(finer, times[-1]), np.append(volts[which] + share * np.diff(volts)[which], volts[-1])


def _and_at(times: Array, volts: Array, wanted: Array) -> tuple[Array, Array, Any]:
    """Return times [s] and voltages [V] of the points with interpolated points added at the wanted times, and
    the indices of the wanted times in them. Raises QuantityError unless these times ascend within the run."""
    if wanted.ndim != 1 or not wanted.size or not np.all(np.diff(wanted) > 0.0):
        raise QuantityError("times [s] must be a list of numbers that ascend")
    if not (times[0] <= wanted[0] and wanted[-1] <= times[-1]):
        raise QuantityError(
            f"times [s] from {wanted[0]:g} to {wanted[-1]:g} are not within the run, from {times[0]:g} to "
            f"{times[-1]:g}"
        )
    every = np.union1d(times, wanted)
    return every, np.interp(every, times, volts), np.searchsorted(every, wanted)


def _samples(recording: Any) -> tuple[Array, Array]:
    for name in ("time", "drive_voltage"):
        if name not in recording:
            raise QuantityError(f"the recording has no {name!r}; it has {', '.join(map(str, recording))}")
    if "charge" in recording:
        raise QuantityError(
            "the trajectory has the charge and current of its own piezo (a MaxwellCapacitor), which are not "
            "those of a stack: give its time and drive_voltage alone, trajectory[['drive_voltage']]"
        )
    times = array_si(recording["time"], "s", "time")
    volts = array_si(recording["drive_voltage"], "V", "drive_voltage")
    if times.ndim != 1 or times.shape != volts.shape or times.size < 2:
        raise QuantityError(f"time and drive_voltage must be two or more samples each, {times.size} came")
    if not np.all(np.diff(times) > 0.0):
        raise QuantityError("time [s] must ascend, and be finite")
    bad = np.flatnonzero(~np.isfinite(volts))
    if bad.size:
        raise QuantityError(
            f"drive_voltage[{bad[0]}] = {volts[bad[0]]} V is not finite: a gap has no current"
        )
    return times, volts


def _held(values: Array) -> Array:
    """Return values [n] at n points from the values of the n - 1 intervals between them: each point gets the
    value of the interval that starts there, and the last point that of the last interval."""
    return np.append(values, values[-1])


def _warmed(step: Array, power: Array, stack: Stack, slope: float, first: float) -> Array:
    """Return the temperature of a stack above its surroundings at each point, K, [n].

    Args:
        step: durations of the intervals between the points, s, [n - 1].
        power: loss in each interval if the stack had its reference temperature, W, [n - 1].
        stack: thermal resistance and heat capacity.
        slope: increase of the loss per kelvin, as a fraction of `power`, 1/K.
        first: ratio of the loss at the temperature of the surroundings to `power`.
    """
    rate = 1.0 / stack.time_constant - slope * power / stack.heat_capacity
    left = np.exp(-rate * step)
    lasting = np.where(rate == 0.0, step, -np.expm1(-rate * step) / np.where(rate == 0.0, 1.0, rate))
    gained = first * power / stack.heat_capacity * lasting
    rise, found = 0.0, [0.0]
    for a, b in zip(left.tolist(), gained.tolist(), strict=True):
        rise = a * rise + b
        found.append(rise)
    return np.array(found)
