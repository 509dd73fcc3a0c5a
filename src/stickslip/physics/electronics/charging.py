"""Voltage at a capacitance behind a first-order lag with limited current; a larger peak current flows for a
limited time.

Between two breaks the target is linear, and the output is linear (at the limit) or the sum of a line and an
exponential. Both have closed forms, and so have the times at which one becomes the other; the time from which
the steady current limits is found by bisection if necessary. So there is no accumulating error of time steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine._abi import ffi
from ...engine.binding import contiguous, doubles, sized
from ...engine.library import library

Array = NDArray[np.float64]

# _BELOW: fraction of its limit by which the mean square of the current must fall below the limit before the
# peak current is available again. _SAME: relative error of the mean square that counts as rounding. _OFTEN:
# longest time between two checks of the limit, as a fraction of the time constant of the mean square
# (`memory`).
_BELOW, _SAME, _OFTEN = 1e-9, 1e-12, 1.0 / 32.0


class ChargingLimits(NamedTuple):
    """Limits within which an amplifier charges a capacitance.

    Fields: `tau`, time constant of the lag, s; `rate` and `steady_rate`, largest slopes of the output with
    the peak and with the steady (rms) current, V/s; `steady_square`, square of the steady current, A²;
    `memory`, time constant of the mean square of the current, s (infinite: the peak current flows without
    end); `farad`, capacitance, F.
    """

    tau: float
    rate: float
    steady_rate: float
    steady_square: float
    memory: float
    farad: float


def rest(volts: float) -> Array:
    """Return the state of an amplifier at rest with the output `volts`, [3]: output [V], mean square of the
    current [A²] (0), and a flag that is 1 while the current is limited to the steady one (0)."""
    return np.array([volts, 0.0, 0.0])


def _remembered(t, memory, rate):
    """Return the weighted mean of exp(-rate t') over the last t seconds, with exponential weights of this
    memory time.

    Args:
        t, memory: s.
        rate: 1/s.
    """
    z = t / memory - rate * t
    left = math.exp(-t / memory)
    if abs(z) < 1e-3:
        return left * t / memory * (1.0 + z * (0.5 + z / 6.0))
    return (math.exp(-rate * t) - left) / (1.0 - rate * memory)


def _mean_square(of, t, before, slope, bend):
    """Return the mean square of the current t seconds later, for an output with this slope [V/s] and, with
    tau > 0, an exponential of height `bend` [V] that decays to 0.

    Args:
        of: limits of the amplifier; `tau` is the time constant of the exponential, `memory` of the mean.
        t: s.
        before: mean square of the current now, A².
        slope: final slope of the output, V/s.
        bend: initial value of the line that the output approaches, minus the output, V: the output is the
            line minus the exponential.
    """
    steady = of.farad * slope
    left = math.exp(-t / of.memory)
    found = before * left + steady * steady * (1.0 - left)
    if of.tau > 0.0:
        falling = of.farad * bend / of.tau
        found += 2.0 * steady * falling * _remembered(t, of.memory, 1.0 / of.tau)
        found += falling * falling * _remembered(t, of.memory, 2.0 / of.tau)
    return found


def _until_as_fast(tau, rate, s, bend):
    """Return the time [s] at which the slope of the output reaches `rate` [V/s], below abs(s).

    The output approaches a ramp of slope s [V/s]; `bend` [V] is the ramp minus the output at the start.
    """
    return -tau * math.log(tau * (rate - abs(s)) / (bend if s > 0.0 else -bend))


def _ramped(of, d, over, side, s, rate, square, folded, least):
    """Return a part of d seconds in which the output is at its slope limit.

    Four results: its duration (at least `least`), the mean square, whether the steady current limits
    afterwards, and whether the part reaches the end of the piece.

    Args:
        of: limits of the amplifier.
        d: time left in the piece of the target, s.
        over: distance from the target beyond that at which the lag, not the limit, determines the slope, V.
        side: direction of the output, 1 or -1.
        s: slope of the target, V/s.
        rate: slope limit, V/s.
        square: mean square of the current at the start, A².
        folded: True if the steady current limits.
        least: smallest duration of a part, s.
    """
    to_end = True
    closing = rate - side * s
    if closing > 0.0 and over < closing * d:
        d, to_end = max(over / closing, least), False
    if not math.isinf(of.memory):
        now = (of.farad * rate) ** 2
        folds = False
        if not folded and now > of.steady_square * (1.0 + _SAME):
            until = of.memory * math.log(max((now - square) / (now - of.steady_square), 1.0))
            if until < d:
                d, folds, to_end = max(until, least), True, False
        square = now + (square - now) * math.exp(-d / of.memory)
        folded = folded or folds
        if folded:
            square = min(square, of.steady_square)
    return d, square, folded, to_end


def _lagged(of, d, gap, s, rate, square, folded, least):
    """Return a part of d seconds in which the output is below its slope limit; results as `_ramped`.

    Args:
        gap: target minus output, V.
        of, d, s, rate, square, folded, least: as for `_ramped`.
    """
    to_end = True
    bend = gap - s * of.tau
    # The target is faster than the slope limit, so the output is below the limit only until the time `until`.
    if abs(s) > rate and of.tau > 0.0:
        until = max(_until_as_fast(of.tau, rate, s, bend), least)
        if until < d:
            d, to_end = until, False
    if not math.isinf(of.memory):
        # The mean square may reach its limit, after which the steady current limits. It is checked often only
        # while it may increase.
        if not folded:
            calm = math.sqrt(of.steady_square) / of.farad
            # Without a lag the slope is constant and the mean square monotonic, so the end of the part is
            # enough.
            above = False
            if of.tau > 0.0:
                above = abs(gap) >= calm * of.tau * (1.0 - _BELOW)
                if not above and abs(s) > calm:
                    until = max(_until_as_fast(of.tau, calm, s, bend), least)
                    if until < d:
                        d, to_end = until, False
            if above and d > _OFTEN * of.memory:
                d, to_end = _OFTEN * of.memory, False
        after = _mean_square(of, d, square, s, bend)
        if not folded and after > of.steady_square * (1.0 + _SAME):
            low, high = 0.0, d
            for _ in range(60):
                d = 0.5 * (low + high)
                if _mean_square(of, d, square, s, bend) > of.steady_square:
                    high = d
                else:
                    low = d
            d, after, folded, to_end = max(d, least), of.steady_square, True, False
        square = after
        folded = folded and square >= of.steady_square * (1.0 - _BELOW)
    return d, square, folded, to_end


def charged(
    of: ChargingLimits, bounds: Array, values: Array, slopes: Array, state: Array, tolerance: float
) -> tuple[Array, Array]:
    """Return times [s] and voltages [V] of an amplifier's output, as points for linear interpolation.

    The target of the output consists of n straight pieces, with jumps between them allowed.

    Args:
        of: limits of the amplifier.
        bounds: times at which the pieces start, and at which the last one ends, s, [n + 1].
        values, slopes: voltage of the target at the start of each piece, V, and its slope, V/s, [n].
        state: state at the start, see `rest`; replaced by that at the end.
        tolerance: largest error of the interpolation, V.
    """
    sized("bounds", bounds, values.size + 1)
    sized("slopes", slopes, values.size)
    sized("state", state, 3)
    given = [contiguous(one) for one in (bounds, values, slopes)]
    limits, now, room = ffi.new("real_t[]", tuple(of)), doubles(state, "state", True), 2 * bounds.size + 16
    while True:
        points = np.empty((2, room))
        rows = doubles(points[0], "times", True), doubles(points[1], "voltages", True)
        n = library().stickslip_charge(limits, values.size, *given, now, tolerance, room, *rows)
        if n >= 0:
            return points[0, :n].copy(), points[1, :n].copy()
        room *= 4
