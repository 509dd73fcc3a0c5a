"""Voltage at the piezo when an amplifier plays a waveform.

The target is approximated by straight lines, and the response of the amplifier to these has a closed form
(see `charging`); each has half of the tolerance. A lag and a slope limit do not enlarge errors, so the
tolerance is a bound. With current foldback (see `amplifier`), the switching time depends on the target:
target and response are then computed with an eighth of the tolerance, and the tolerance is an estimate.

Under a periodic drive the response becomes periodic. The last computed period is repeated once the remaining
drift of all later periods together is a small part of the tolerance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...quantities.units import QuantityError, to_si, with_prefix
from ...waveform import Sampled, Sequence
from ...waveform.pieces import SLIVER
from ...waveform.signal import Waveform
from .amplifier import CAPACITANCE, TOLERANCE, Amplifier, limits
from .charging import ChargingLimits, charged, rest
from .lines import PiecewiseLinear, clipped, jumps, lines_of

Array = NDArray[np.float64]

# The response counts as periodic if all later periods together would change it by at most these fractions.
# For the voltage it is a fraction of the tolerance, for the mean square of the current one of the squared rms
# current limit.
_SAME_VOLTS, _SAME_SQUARE = 0.02, 1e-4
# Largest number of periods that `driven_period` computes until the response repeats.
_MOST_PERIODS = 100_000
# Divisor of the tolerance of lines and response if the amplifier has a current foldback, whose switching time
# depends on the lines (docs/decisions/electronics.md).
_FINER = 8.0


def driven(
    amplifier: Amplifier,
    waveform: Waveform,
    capacitance: float | str,
    duration: float | str,
    *,
    tolerance: float | str = 5e-3,
) -> Waveform:
    """Return the voltage at the piezo when an amplifier plays a waveform.

    Args:
        amplifier: gain and offset are not used, because the waveform is in volts at the piezo. Voltages
            outside the amplifier's range are cut off.
        waveform: V; before t = 0 the amplifier rests at its value there.
        capacitance: capacitance of the piezo at this amplitude, F.
        duration: duration for which it is computed, s.
        tolerance: largest error, V; see the module. A simulation does not include it in its error estimate:
            multiplied by the gain, it should be below the tolerance of the simulation.

    Returns:
        A waveform for 0 <= t <= duration: a `Sampled` with linear interpolation. If the response to a
        periodic waveform repeats before the end, it is a `Sequence` of the `Sampled` until then and of one
        period. If the amplifier has no lag and no limit of slope or current, and the waveform stays within
        its output range, the waveform itself is returned.

    Raises:
        QuantityError: a number is out of range, the waveform is not in V, or the output would jump because
            the amplifier has neither a lag nor a slew limit.
    """
    tolerance = TOLERANCE.check(to_si(tolerance, "V", "tolerance"), "tolerance")
    farad = CAPACITANCE.check(capacitance, "capacitance")
    duration = to_si(duration, "s", "duration")
    if not 0.0 < duration < math.inf:
        raise QuantityError(f"duration = {duration:g} s is out of range: it must be > 0 s, and finite")
    of = limits(amplifier, farad)
    period = _endless(waveform)
    if _follows(of, amplifier, waveform):
        return waveform
    tolerance = _for_lines(of, tolerance)
    if period is None or duration < 2.0 * period:
        asked = _asked(of, amplifier, waveform, duration, tolerance)
        return Sampled(*_answer(of, asked, rest(asked.before), tolerance))
    asked = _asked(of, amplifier, waveform, period, tolerance)
    whole = math.floor(duration / period * (1.0 + SLIVER))
    times, volts, state, repeats = _until_it_repeats(of, asked, tolerance, whole)
    if repeats:
        begin = times[-1][-1]
        # The end of the last period is set to its start, so that its repetition has no jump.
        volts[-1][-1] = volts[-1][0]
        again = _period(times[-1], volts[-1], period)
        return Sequence(Sampled(*_joined(times, volts)), (again, max(duration - begin, SLIVER * begin)))
    left = duration - whole * period
    if left > SLIVER * duration:
        asked = _asked(of, amplifier, waveform, left, tolerance)
        more, last = _answer(of, asked, state, tolerance)
        times.append(more + whole * period)
        volts.append(last)
    return Sampled(*_joined(times, volts))


def driven_period(
    amplifier: Amplifier, waveform: Waveform, capacitance: float | str, *, tolerance: float | str = 5e-3
) -> Sampled:
    """Return the voltage at the piezo under an endless periodic waveform in the periodic state: one period,
    repeated without end.

    Arguments and errors are as for `driven`; also QuantityError if the waveform has no period or an end, or
    if the response does not repeat within 100,000 periods.
    """
    tolerance = TOLERANCE.check(to_si(tolerance, "V", "tolerance"), "tolerance")
    farad = CAPACITANCE.check(capacitance, "capacitance")
    period = _endless(waveform)
    if period is None:
        raise QuantityError(f"{type(waveform).__name__} does not repeat for ever: it has no steady period")
    of = limits(amplifier, farad)
    tolerance = _for_lines(of, tolerance)
    asked = _asked(of, amplifier, waveform, period, tolerance)
    times, volts, _, repeats = _until_it_repeats(of, asked, tolerance, _MOST_PERIODS, keep=False)
    if not repeats:
        raise QuantityError(f"the output does not repeat within {_MOST_PERIODS} periods")
    return _period(times[-1], volts[-1], period)


def _for_lines(of: ChargingLimits, tolerance: float) -> float:
    """Return the tolerance, V, that is used for target and output, so that the result is within `tolerance`
    [V]: a smaller one if the amplifier has a current foldback (see `_FINER`)."""
    return tolerance / _FINER if math.isfinite(of.memory) else tolerance


def _endless(waveform: Waveform) -> float | None:
    """Return the period of a waveform that repeats without end, s; None for any other waveform.

    Raises:
        QuantityError: `waveform` is not a waveform.
    """
    if not hasattr(waveform, "drive"):
        raise QuantityError(f"waveform = {waveform!r:.60} must be a waveform in V")
    period = getattr(waveform, "period", None)
    return period if period is not None and math.isinf(waveform.duration) else None


def _follows(of: ChargingLimits, amplifier: Amplifier, waveform: Waveform) -> bool:
    if of.tau > 0.0 or math.isfinite(of.rate):
        return False
    low, high = waveform.range()
    return waveform.unit == "V" and amplifier.low <= low and high <= amplifier.high


def _asked(
    of: ChargingLimits, amplifier: Amplifier, waveform: Waveform, duration: float, tolerance: float
) -> PiecewiseLinear:
    """Return the target voltage of the amplifier as straight lines over the duration [s], within half of the
    tolerance [V]: the waveform, clipped to the amplifier's output range.

    Raises:
        QuantityError: the waveform is not in V, or the output would jump.
    """
    if waveform.unit != "V":
        raise QuantityError(f"{type(waveform).__name__} is in {waveform.unit}: an amplifier gives volts")
    lines = lines_of(waveform.drive(duration), duration, 0.5 * tolerance)
    asked = clipped(lines, amplifier.low, amplifier.high)
    jumped = np.abs(jumps(asked)[0]).max()
    # A periodic waveform may also jump at the end of a period.
    if _endless(waveform) is not None:
        jumped = max(jumped, abs(asked.values[0] - asked.end))
    if of.tau == 0.0 and math.isinf(of.rate) and jumped > tolerance:
        raise QuantityError(
            f"{type(waveform).__name__} jumps beyond {with_prefix(amplifier.low, 'V')} to "
            f"{with_prefix(amplifier.high, 'V')}, and the amplifier would jump with it: give it a bandwidth, "
            "an output resistance or a slew rate"
        )
    return asked


def _answer(
    of: ChargingLimits, asked: PiecewiseLinear, state: Array, tolerance: float
) -> tuple[Array, Array]:
    """Return times [s] and voltages [V] of the amplifier's output for the target `asked`, within `tolerance`
    [V].

    The array `state` is the state of the amplifier at the start (see `charging.rest`); it is replaced by that
    at the end.
    """
    # An amplifier without lag and slope limit outputs the target.
    if of.tau == 0.0 and math.isinf(of.rate):
        state[0] = asked.end
        return asked.bounds, np.append(asked.values, state[0])
    return charged(of, *asked[1:], state, 0.5 * tolerance)


def _until_it_repeats(
    of: ChargingLimits, asked: PiecewiseLinear, tolerance: float, most: int, keep: bool = True
) -> tuple[list[Array], list[Array], Array, bool]:
    """Compute period after period of the output until a period ends as it started.

    Args:
        of: limits of the amplifier.
        asked: target over one period.
        tolerance: largest error, V.
        most: largest number of periods.
        keep: return all periods, not only the last one.

    Returns:
        Times [s] from the start of the first period, and voltages [V], both as lists with an array per
        period; the state of the amplifier at the end (see `charging.rest`); and True if the response repeats.
    """
    state, times, volts = rest(asked.before), list[Array](), list[Array]()
    period = asked.bounds[-1]
    for k in range(most):
        before = state.copy()
        t, u = _answer(of, asked, state, tolerance)
        if not keep:
            times, volts = [], []
        times.append(t + k * period)
        volts.append(u)
        moved = np.abs(state - before)
        # A lag and a slope limit do not increase the difference of two outputs. So each later period changes
        # the voltage by at most as much as this one. The mean square approaches its final value
        # exponentially, with the same factor in each period.
        lacks = -moved[1] / math.expm1(-period / of.memory) if math.isfinite(of.memory) else 0.0
        if moved[0] * (most - k) <= _SAME_VOLTS * tolerance and lacks <= _SAME_SQUARE * of.steady_square:
            return times, volts, state, True
    return times, volts, state, False


def _joined(times: list[Array], volts: list[Array]) -> tuple[Array, Array]:
    """Return the times and voltages of several successive parts as one signal. The last point of a part and
    the first one of the next are the same point, which is kept once."""
    t = np.concatenate([times[0], *(part[1:] for part in times[1:])])
    u = np.concatenate([volts[0], *(part[1:] for part in volts[1:])])
    fresh = np.append(True, np.diff(t) > 0.0)
    return t[fresh], u[fresh]


def _period(times: Array, volts: Array, period: float) -> Sampled:
    """Return a periodic waveform from times [s] and voltages [V] of one period, whose duration is `period`
    [s]. The last point is left out, because it is the start of the next period."""
    t = times - times[0]
    within = t < period * (1.0 - SLIVER)
    return Sampled(t[within], volts[within], period=period)
