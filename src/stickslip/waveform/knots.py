"""Periodic waveform through given values at given times, for drives that a user or an optimiser shapes."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity
from ..quantities.units import QuantityError
from .drive import Drive
from .members import Drives, columns_of, repeat_curves
from .periodic import Periods, check_periods
from .pieces import repeat_table, wrapped
from .signal import Unit, breaks_within, signal_record, slope_at, value_at

_CLOSEST = 1e-6  # smallest time between two knots over the period; the same limit as for a sawtooth

Array = NDArray[np.float64]


@signal_record
class PeriodicKnots(NamedTuple):
    r"""Periodic drive through knots: values at times within one period, joined by lines or smooth curves.

    With values :math:`u_k` and slopes :math:`m_k` at :math:`t_k`, :math:`h_k = t_{k+1} - t_k`,
    :math:`\delta_k = (u_{k+1} - u_k)/h_k` and :math:`\tau = t - t_k`, where the knot after the last is the
    first of the next period, the signal is

    .. math:: u = u_k + m_k \tau + (3\delta_k - 2m_k - m_{k+1})\frac{\tau^2}{h_k}
                  + (m_k + m_{k+1} - 2\delta_k)\frac{\tau^3}{h_k^2}

    By default knots are joined by lines, :math:`m_k = m_{k+1} = \delta_k`. `smooth` makes the slope
    continuous: m_k is the harmonic mean of the slopes on both sides, weighted by :math:`2h_k + h_{k-1}`
    (before) and :math:`h_k + 2h_{k-1}` (after), and zero where these differ in sign [fritsch1984]. Such a
    cubic is monotone between knots [fritsch1980]. So the drive stays within the range of the knots, which a
    spline of continuous curvature may exceed. The curvature may jump at knots.

    Times ascend from 0 or later to below the period. Before t = 0, and after the last of `periods`, the drive
    rests at its value at t = 0.
    """

    times: Annotated[tuple[float, ...], Quantity("s", "t_k", "time of a knot", minimum=0)]
    values: Annotated[tuple[float, ...], Quantity("V", "u_k", "value of a knot")]
    period: Annotated[float, Quantity("s", "T", "period", above=0)]
    smooth: bool = False
    unit: Unit = "V"
    periods: Periods = None

    value, slope, breaks = value_at, slope_at, breaks_within

    def _check(self) -> None:
        check_periods(self)
        times, n = self.times, len(self.times)
        if not n or n != len(self.values):
            raise QuantityError(
                f"PeriodicKnots has {n} times (in s) for {len(self.values)} values (in {self.unit}): "
                "as many are needed, at least one"
            )
        for i, (t, after) in enumerate(zip(times, (*times[1:], self.period), strict=True)):
            gap = after - t if i + 1 < n else times[0] + (self.period - t)
            if t >= after or gap < _CLOSEST * self.period:
                raise QuantityError(
                    f"PeriodicKnots.times[{i}] = {t!r} s is out of range: times ascend from 0 s to below the "
                    f"period of {self.period!r} s, each at least a millionth of it before the next, "
                    f"which is at {after!r} s"
                )

    @property
    def duration(self) -> float:
        """Return the duration, s; infinite unless the number of periods is given."""
        return math.inf if self.periods is None else self.periods * self.period

    def range(self) -> tuple[float, float]:
        """Return the exact least and greatest value of the drive: those of the knots."""
        return min(self.values), max(self.values)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        times = np.array(self.times)
        polynomial = _polynomials(times, np.array(self.values), np.array(self.period), self.smooth)
        return repeat_table(wrapped(times, polynomial, self.period), self.period, self.periods, duration)

    def drives(self, durations: Array) -> Drives:
        """Return the segment tables of the members of an ensemble.

        Fields of `self` that differ between members are arrays with a number per member; they are not
        checked.

        Args:
            durations: end of each member's table [members], s.
        """
        times, values, period = (
            columns_of(numbers, durations.size) for numbers in (self.times, self.values, [self.period])
        )
        polynomial = _polynomials(times, values, period[:, 0], self.smooth)
        return repeat_curves(times, polynomial, period[:, 0], self.periods, durations)


def _polynomials(times: Array, values: Array, period: Array, smooth: bool) -> Array:
    """Return the coefficients c_0..c_3 from each knot to the next, [..., knots, 4], as in `PeriodicKnots`.

    Args:
        times, values: times [s] and values of the knots, [..., knots].
        period: period, s, [...].
        smooth: True for a continuous slope, False for lines.
    """
    h = np.diff(times, append=times[..., :1] + period[..., None])
    delta = np.diff(values, append=values[..., :1]) / h
    polynomial = np.zeros((*times.shape, 4))
    polynomial[..., 0], polynomial[..., 1] = values, delta
    if smooth:
        m = _monotone_slopes(h, delta)
        after = np.roll(m, -1, axis=-1)
        polynomial[..., 1] = m
        polynomial[..., 2] = (3 * delta - 2 * m - after) / h
        polynomial[..., 3] = (m + after - 2 * delta) / h**2
    return polynomial


def _monotone_slopes(h: Array, delta: Array) -> Array:
    """Return the slope at each knot [..., knots] by the weighted harmonic mean given in `PeriodicKnots`.

    Args:
        h: time from each knot to the next, s; the last one to the first knot of the next period.
        delta: slope of the line from each knot to the next.
    """
    h_before, before = np.roll(h, 1, axis=-1), np.roll(delta, 1, axis=-1)
    slopes = np.zeros_like(delta)
    on = np.sign(before) * np.sign(delta) > 0
    steeper = np.abs(before) > np.abs(delta)
    w_before, w_after = 2 * h + h_before, h + 2 * h_before
    low, w_low = np.where(steeper, delta, before)[on], np.where(steeper, w_after, w_before)[on]
    high, w_high = np.where(steeper, before, delta)[on], np.where(steeper, w_before, w_after)[on]
    slopes[on] = low * (w_low + w_high) / (w_low + w_high * (low / high))
    return slopes
