"""Classical numbers of step responses: delay, peak, steady value, and the second-order system that follows
from them [kang2007, app. 5]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import optional_si
from ...recording import RecordingError
from ..recorded.channels import recordings_of, unit_of
from .first_look import Look, first_look
from .recorded_step import POSITION, StepTest, step_tests

# Fewest samples from the start of the rise to the peak.
FEWEST_TO_PEAK = 6
# Fewest samples from the step until the response has settled (two or three natural periods); with fewer, the
# rise is not resolved.
FEWEST_IN_RISE = 8

Array = NDArray[np.float64]


@record
class Timing(NamedTuple):
    """Times, in s, at which the classical numbers of a step are read. The position before the step (the bias)
    is the mean of the two samples at the start of the rise."""

    steady_after: Annotated[
        float, Quantity("s", "", "time from the rise until the motion has settled", above=0.0)
    ] = 4e-3
    steady_over: Annotated[
        float, Quantity("s", "", "time over which the steady value is averaged", above=0.0)
    ] = 1e-3
    peak_within: Annotated[
        float, Quantity("s", "", "time after the rise in which the peak is", above=0.0)
    ] = 5e-3
    rise_at: Annotated[
        float, Quantity("s", "", "time from the step until the rise, where it is longer than the motion")
    ] = 0.0


THESIS = Timing()
# Time until a response has settled (to 0.1 %), in decay times.
SETTLED = 7.0


def timing_of(test: StepTest, look: Look) -> Timing:
    """Return the times of the classical numbers for a second-order response `look`: the peak is searched
    within one period, and the steady value is the mean over one period after the response has settled. In a
    short recording both times are shorter."""
    lasts = float(test.time[-1]) - look.delay
    over = min(look.period, 0.5 * lasts)
    after = min(SETTLED / look.decay, (1.0 - 1e-6) * (lasts - over))
    return Timing(after, over, look.period, look.delay)


def own_timing(test: StepTest) -> Timing:
    """Return the times of the classical numbers from the recording's own response, as `timing_of` does.

    Raises:
        RecordingError: see `first_look`.
    """
    return timing_of(test, first_look(test))


def classical(test: StepTest, timing: Timing, delay: float | None = None) -> dict[str, float]:
    """Return the classical numbers of a step by name.

    Args:
        test: recorded step.
        timing: times at which the numbers are read.
        delay: time from the step to the start of the rise, s; by default estimated from the rise.

    Returns:
        voltage [V], delay [s], bias (position before the step) and steady_value (height of the rise) [m],
        peak_time after the start of the rise [s], overshoot (a fraction of steady_value), damping_ratio,
        natural_frequency [rad/s] and gain [m/V]. Damping ratio and natural frequency are NaN without
        overshoot.

    Raises:
        RecordingError: the recording is too short, too coarsely sampled, or does not rise out of its noise.
    """
    t, x = test.time, test.position
    needed = timing.rise_at + timing.steady_after + timing.steady_over
    if t[-1] < needed:
        raise RecordingError(
            f"end_effector_position [m] of {test.name} is too short: it ends {t[-1]:g} s after "
            f"its step; {needed:g} s are needed for the steady value"
        )
    interval = float(np.median(np.diff(t)))
    if timing.steady_after < FEWEST_IN_RISE * interval:
        raise RecordingError(
            f"end_effector_position [m] of {test.name} is too coarsely sampled: one sample every "
            f"{interval:.3g} s; at least {FEWEST_IN_RISE} are needed until it has settled, "
            f"{timing.steady_after:g} s after its step"
        )
    delay = _onset(t, x, test.name, timing) if delay is None else delay
    begin = int(np.searchsorted(t, delay - 1e-9))
    bias = float(x[max(begin - 1, 0) : begin + 1].mean())
    since = t - delay
    level = (since >= timing.steady_after) & (since <= timing.steady_after + timing.steady_over)
    if not level.any():
        raise RecordingError(f"{test.name} has no sample {timing.steady_after:g} s after its rise")
    steady = float(x[level].mean()) - bias
    window = (since >= 0.0) & (since <= timing.peak_within)
    peak = int(np.flatnonzero(window)[np.argmax(math.copysign(1.0, steady) * x[window])])
    peak_time = float(since[peak])
    if np.count_nonzero((since > 0.0) & (since <= peak_time)) < FEWEST_TO_PEAK:
        raise RecordingError(
            f"end_effector_position [m] of {test.name} is too coarsely sampled: one sample every "
            f"{interval:.3g} s; at least {FEWEST_TO_PEAK} are needed from rise to peak, {peak_time:.3g} s"
        )
    overshoot = (float(x[peak]) - bias - steady) / steady
    zeta, omega = second_order(overshoot, peak_time)
    return {
        "voltage": test.voltage,
        "delay": delay,
        "bias": bias,
        "steady_value": steady,
        "peak_time": peak_time,
        "overshoot": overshoot,
        "damping_ratio": zeta,
        "natural_frequency": omega,
        "gain": steady / test.voltage,
    }


def second_order(overshoot: float, peak_time: float) -> tuple[float, float]:
    """Return damping ratio and natural frequency [rad/s] from overshoot (a fraction) and peak time [s].

    Both are NaN for an overshoot that is not between 0 and 1, or a peak time that is not above 0.
    """
    if not (0.0 < overshoot < 1.0 and peak_time > 0.0):
        return math.nan, math.nan
    log = math.log(overshoot)
    zeta = -log / math.hypot(math.pi, log)
    return zeta, math.pi / (peak_time * math.sqrt(1.0 - zeta**2))


def _onset(t: Array, x: Array, where: str, timing: Timing) -> float:
    """Return the time from the step to the start of the rise, s.

    The rise starts as a parabola, so the times from its start to 5 and 20 % are in the ratio 1 to 2.

    Args:
        t: times after the step, s, [n].
        x: positions, m, [n].
        where: name of the recording in errors.
        timing: times at which the response has settled.

    Raises:
        RecordingError: there are no samples before the step or after settling, or the rise is not above the
            noise.
    """
    before = x[t <= 0.0]
    settled = t - timing.rise_at - timing.steady_after
    level = x[(settled >= 0.0) & (settled <= timing.steady_over)]
    if not before.size or not level.size:
        raise RecordingError(f"{where} has no samples before its step, or none where it has settled")
    rest, least = float(before.mean()), 4.0 * float(before.std())
    rise, at_end = (float(some.mean()) - rest for some in (level, x[-level.size :]))
    if abs(rise) < least <= abs(at_end):
        raise RecordingError(
            f"{where}: {timing.steady_after:g} s after its step it has not moved, at its end by "
            f"{at_end:.3g} m: steady_after of the timing must be longer than delay and motion together"
        )
    if abs(rise) < least:
        raise RecordingError(f"{where}: the rise of {rise:g} m drowns in the noise, {before.std():g} m")
    share = (x - rest) / rise
    half = int(np.flatnonzero((t > 0.0) & (share >= 0.5))[0])
    times = []
    for part in (0.2, 0.05):
        # The last crossing before half of the rise counts, because noise can cause earlier ones.
        below = int(np.flatnonzero(share[:half] < part)[-1])
        times.append(float(np.interp(part, share[below : below + 2], t[below : below + 2])))
    return 2.0 * times[1] - times[0]


def step_features(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    voltages: Sequence[float | str] | None = None,
    start: float | str | None = None,
    delay: float | str | None = None,
    timing: Timing | None = None,
    observed: str = POSITION,
) -> xr.Dataset:
    """Return delay, bias, steady value, peak time and overshoot of steps, and the second-order system.

    The formulas trust one sample, the peak, and ignore the sensor; `step_formula_errors` estimates the error.

    Args:
        recordings: with end_effector_position [m], and drive_voltage [V] unless voltages and start are given.
        voltages: height of each step, V; by default from drive_voltage.
        start: instant of the step in the time of the recordings, s; by default from drive_voltage.
        delay: time from the step to the start of the rise, s; by default estimated from each rise.
        timing: times at which the numbers are read. By default the peak is searched within one period of the
            vibration of each recording, and the steady value is the mean over one period after the vibration
            has decayed. `Timing()` has the times of [kang2007].
        observed: name of the position channel.

    Returns:
        A dataset over "recording" of the numbers of `classical`, and r_squared of each recording's own
        second-order system over the time `peak_within` after the start of its rise. In `attrs`:
        damping_ratio and natural_frequency from the mean overshoot and the mean peak time, as [kang2007]
        averages them, the mean gain, and the mean r_squared of this common system.

    Raises:
        RecordingError: a channel is missing, empty, constant, clipped, too short or too coarsely sampled; the
            drive is not a single step; or the rise is not above the noise.
        QuantityError: a voltage, `start` or `delay` has a wrong unit.
    """
    delay = optional_si(delay, "s", "delay")
    tests = step_tests(recordings, voltages, start, observed)
    timings = [timing or own_timing(test) for test in tests]
    rows = [classical(test, one, delay) for test, one in zip(tests, timings, strict=True)]
    unit = unit_of(recordings_of(recordings), observed) or "m"
    units = {
        "voltage": "V",
        "delay": "s",
        "bias": unit,
        "steady_value": unit,
        "peak_time": "s",
        "overshoot": "",
        "damping_ratio": "",
        "natural_frequency": "rad/s",
        "gain": f"{unit}/V",
    }
    table = xr.Dataset(
        {name: ("recording", [row[name] for row in rows], {"units": unit}) for name, unit in units.items()},
        coords={"recording": [test.name for test in tests]},
    )
    zeta, omega = second_order(float(table["overshoot"].mean()), float(table["peak_time"].mean()))
    own = [
        _r_squared(test, row, row["damping_ratio"], row["natural_frequency"], one)
        for test, row, one in zip(tests, rows, timings, strict=True)
    ]
    table["r_squared"] = ("recording", own, {"units": ""})
    averaged = [
        _r_squared(test, row, zeta, omega, one) for test, row, one in zip(tests, rows, timings, strict=True)
    ]
    table.attrs = {
        "damping_ratio": zeta,
        "natural_frequency": omega,
        "gain": float(table["gain"].mean()),
        "r_squared": float(np.mean(averaged)),
    }
    return table


def _r_squared(test: StepTest, row: dict[str, float], zeta: float, omega: float, timing: Timing) -> float:
    since = test.time - row["delay"]
    window = (since >= 0.0) & (since <= timing.peak_within)
    t, y = since[window], test.position[window] - row["bias"]
    root = math.sqrt(1.0 - zeta**2) if math.isfinite(zeta) else math.nan
    shape = np.cos(omega * root * t) + zeta / root * np.sin(omega * root * t)
    r = row["steady_value"] * (1.0 - np.exp(-zeta * omega * t) * shape) - y
    return 1.0 - float(r @ r) / float(np.sum((y - y.mean()) ** 2))
