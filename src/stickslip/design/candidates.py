"""Candidates of a planned experiment: a grid of sawtooths forward and back, and checks against limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..estimate import Fit
from ..identify.recorded.drives import refuse_sampling
from ..identify.walk.experiments import PlannedWalk
from ..quantities.units import QuantityError, with_prefix
from ..recording import RecordingError
from ..rig import Limits
from ..waveform import ReverseSawtooth, Sawtooth
from ..waveform import Sequence as Parts
from ..waveform.signal import Waveform, value_at

# Amplitudes of the grid's sawtooths, which start at 0 V, as shares of the largest allowed voltage.
VOLTAGES = (0.4, 0.6, 0.8, 1.0)
# Frequencies of the grid, Hz. All but the first are primes that divide no usual sample rate, so that
# successive periods are sampled at different phases.
FREQUENCIES = (5.0, 11.0, 23.0, 47.0, 97.0, 197.0, 397.0)
# Fractions of the period for the rise of the grid's sawtooths.
RISES = (1.0, 0.8, 0.65)
# Duration of a burst in one direction, s, and smallest number of periods of a burst. A single period in each
# direction would not contain the jump from one period to the next.
BURST, FEWEST = 0.05, 2
# Rate, Hz, at which a drive is sampled to check its slope: the usual update rate of a rig's output.
UPDATES = 20e3


def limits_of(model: Any) -> Limits:
    """Return the limits of a plan by default: `Limits()` with the voltage range of a model, or of a fit's
    model. Raises QuantityError if the range does not contain 0 V."""
    of, own = model.model if isinstance(model, Fit) else model, Limits()
    low, high = getattr(of, "min_voltage", own.min_voltage), getattr(of, "max_voltage", own.max_voltage)
    if not low <= 0.0 <= high:
        raise QuantityError(
            f"the model's voltage range, {low:g} V to {high:g} V, does not contain 0 V, where each recording "
            "starts and ends: give the model a range that contains it, such as model.replace(min_voltage=0)"
        )
    return Limits(
        min_voltage=low if math.isfinite(low) else own.min_voltage,
        max_voltage=high if math.isfinite(high) else own.max_voltage,
    )


def sawtooths(
    limits: Limits, slew_rate: float, duration: float, sample_rate: float, noise: float
) -> dict[str, PlannedWalk]:
    """Return a grid of planned recordings by name, such as "40 V 11 Hz rise 0.8": bursts of a sawtooth
    forward and back, over voltage, frequency and share of the rise. The grid is empty if no sawtooth fits.

    The bursts bring the end-effector back. With flanks that are not jumps, such recordings contain twice as
    much information as one long walk. If the fall would exceed the slew rate, the rise is shortened to leave
    enough time for the fall; a sawtooth whose rise would be shorter than all of `RISES` is left out, as are
    frequencies with two periods or fewer in the duration.

    Args:
        limits: limits of the output, whose largest voltage scales the grid.
        slew_rate: slew rate of the amplifier, V/s, which no flank exceeds.
        duration: duration of each recording, s.
        sample_rate: sample rate of the position, Hz.
        noise: standard deviation of a sample of the position, m, or rad for a rotary actuator.
    """
    found = {}
    for share in VOLTAGES:
        volts = share * limits.max_voltage
        for hertz in FREQUENCIES:
            if not FEWEST < duration * hertz < math.inf:
                continue
            for rise in RISES:
                # Largest share of the rise in the period: the remaining time is enough for the fall.
                steepest = 1.0 - volts * hertz / slew_rate
                fraction = min(rise, steepest)
                if fraction < min(RISES) - 1e-9:
                    continue
                name = f"{volts:.4g} V {hertz:.4g} Hz rise {fraction:.3g}"
                drive = there_and_back(volts, hertz, fraction, duration)
                found[name] = PlannedWalk(drive, duration, sample_rate, noise)
    return found


def there_and_back(volts: float, hertz: float, rise: float, duration: float) -> Parts:
    """Return a drive of alternating bursts: of a sawtooth (forward) and of a reverse sawtooth (back).

    Args:
        volts: amplitude, V: the sawtooths go from 0 V to this voltage.
        hertz: frequency, Hz.
        rise: fraction of the period for the rise; the fall takes the remainder.
        duration: total duration, s; the drive has as many pairs of bursts as fit into it, at least one.
    """
    periods = max(FEWEST, round(BURST * hertz))
    rise = round(rise, 6)
    both = (
        Sawtooth(volts, hertz, rise, periods=periods),
        ReverseSawtooth(volts, hertz, rise, periods=periods),
    )
    times = max(1, math.floor(duration * hertz / (2 * periods) + 1e-9))
    return Parts(*(both * times))


def walks_of(
    candidates: Mapping[str, PlannedWalk | Waveform] | Sequence[PlannedWalk | Waveform],
    duration: float,
    sample_rate: float,
    noise: float,
) -> dict[str, PlannedWalk]:
    """Return planned recordings by name.

    Args:
        candidates: recordings or waveforms in V, by name; in a sequence their names are "recording 1", ...
        duration, sample_rate, noise: of the recordings that are made from waveforms: duration, s; sample
            rate, Hz; and standard deviation of a sample of the position, m, or rad for a rotary actuator.

    Raises:
        QuantityError: there is no candidate, or one is neither a recording nor a waveform.
    """
    named: Mapping[str, Any] = (
        candidates
        if isinstance(candidates, Mapping)
        else {f"recording {i}": one for i, one in enumerate(candidates, start=1)}
    )
    if not named:
        raise QuantityError("there are no candidates: give at least one waveform or identify.PlannedWalk")
    found = {}
    for name, one in named.items():
        if isinstance(one, PlannedWalk):
            found[str(name)] = one
        elif hasattr(one, "drive") and getattr(one, "unit", "") == "V":
            found[str(name)] = PlannedWalk(one, duration, sample_rate, noise)
        else:
            raise QuantityError(
                f"candidate {name!r} is {one!r:.60}: it must be a waveform in V or an identify.PlannedWalk"
            )
    return found


def refused(walk: PlannedWalk, limits: Limits, name: str) -> str:
    """Return the reason why a recording cannot be made or fitted; an empty text if it can.

    The reason is a voltage, slope or duty beyond the limits, or a sample rate that is too low for the drive.

    Args:
        walk: the recording.
        limits: limits of the output.
        name: name of the recording in the text.
    """
    low, high = walk.drive.range()
    shown = [with_prefix(value, "V", 3) for value in (limits.min_voltage, limits.max_voltage)]
    if low < limits.min_voltage - 1e-9 or high > limits.max_voltage + 1e-9:
        return f"it reaches from {low:.4g} to {high:.4g} V, and {shown[0]} to {shown[1]} are allowed"
    volts = value_at(walk.drive, np.arange(0.0, walk.duration, 1.0 / UPDATES))
    slew = float(np.abs(np.diff(volts, prepend=0.0)).max()) * UPDATES
    if slew > limits.max_slew * (1.0 + 1e-6):
        return f"it changes at {slew:.3g} V/s, and {limits.max_slew:.3g} V/s are allowed"
    duty = float(np.mean(np.abs(volts) > 0.01 * limits.max_voltage))
    if duty > limits.max_duty:
        return f"it is away from 0 V for {100 * duty:.3g} % of the time, of {100 * limits.max_duty:.3g} %"
    try:
        refuse_sampling(walk.times, walk.drive, name)
    except RecordingError as error:
        return str(error)
    return ""


def beyond(low: float, high: float, limits: Limits, unit: str) -> str:
    """Return the reason why a motion violates the position limits; an empty text if it does not.

    Args:
        low, high: least and greatest position of the motion, in `unit`.
        limits: limits with `min_position` and `max_position`, in `unit`.
        unit: "m", or "rad" for a rotary actuator.
    """
    if low >= limits.min_position and high <= limits.max_position:
        return ""
    ends = [with_prefix(x, unit, 3) for x in (low, high, limits.min_position, limits.max_position)]
    return f"it moves from {ends[0]} to {ends[1]}, and {ends[2]} to {ends[3]} are allowed"
