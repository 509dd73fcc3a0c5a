"""Periodic polygons of the drive voltage, many at once: the candidates of a search for drives.

They are made from search points (coordinates from 0 to 1), and kept within the limits of the drive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..waveform.knots import PeriodicKnots
from ..waveform.periodic import Sawtooth
from .limits import Allowed

Array = NDArray[np.float64]
# Shortest duration of a sawtooth's rise or fall, relative to the period.
STEEPEST = 1e-3


class Polygons(NamedTuple):
    """Periodic polygons [n] of the drive voltage.

    Fields: `shares` [n, k], times of the k corners as shares of the period, ascending from 0; `volts` [n, k],
    voltages at the corners; and `period` [n], s. The last side returns to the first corner.
    """

    shares: Array
    volts: Array
    period: Array

    def slopes(self) -> Array:
        """Return the slope of each side [n, k], V/s."""
        return np.diff(self.volts, append=self.volts[:, :1]) / self._sides()

    def _sides(self) -> Array:
        return np.diff(self.shares, append=1.0) * self.period[:, None]

    def within(self, allowed: Allowed) -> Polygons:
        """Return the polygons, each scaled about the middle of its voltage range until its steepest side is
        allowed, and clipped to the allowed voltages."""
        steepest = np.abs(self.slopes()).max(axis=1)
        with np.errstate(divide="ignore"):
            scale = np.minimum(1.0, allowed.slope / steepest)[:, None]
        middle = 0.5 * (self.volts.min(axis=1) + self.volts.max(axis=1))[:, None]
        flat = np.where(scale < 1.0, middle + (1.0 - 1e-12) * scale * (self.volts - middle), self.volts)
        return self._replace(volts=np.clip(flat, allowed.low, allowed.high))

    def one(self, i: int) -> PeriodicKnots:
        """Return polygon number i as a waveform."""
        period = float(self.period[i])
        return PeriodicKnots(tuple((self.shares[i] * period).tolist()), tuple(self.volts[i].tolist()), period)

    def sawtooth(self, i: int) -> Sawtooth:
        """Return polygon number i, made by `sawtooths`, as a `Sawtooth`."""
        low, high = float(self.volts[i].min()), float(self.volts[i].max())
        return Sawtooth(high - low, 1.0 / float(self.period[i]), float(self.shares[i, 1]), low)

    def rows(self, which: NDArray[np.int64]) -> Polygons:
        return Polygons(*(column[which] for column in self))


def knots(x: Array, allowed: Allowed) -> Polygons:
    """Return the polygons of search points `x` [n, k + 1], each coordinate from 0 to 1.

    The first k coordinates are voltages at equidistant times, from the lowest to the highest allowed voltage.
    The last one is the frequency, on a logarithmic scale over the allowed range. Too steep polygons are
    scaled.
    """
    count = x.shape[1] - 1
    shares = np.tile(np.arange(count) / count, (len(x), 1))
    return Polygons(
        shares, allowed.low + allowed.swing * x[:, :-1], 1.0 / _frequency(x[:, -1], allowed)
    ).within(allowed)


def as_knots(shape: Polygons, count: int, allowed: Allowed) -> Array:
    """Return the search point of `knots`, [count + 1] from 0 to 1, of a polygon (the first of `shape`).

    The polygon is sampled at `count` equidistant times. Voltages and frequency beyond the allowed ranges are
    clipped.
    """
    at, period = np.arange(count) / count, float(shape.period[0])
    volts = np.interp(at, np.append(shape.shares[0], 1.0), np.append(shape.volts[0], shape.volts[0, 0]))
    span = np.log(allowed.fastest / allowed.slowest)
    x = np.append((volts - allowed.low) / allowed.swing, -np.log(period * allowed.slowest) / span)
    return np.clip(x, 0.0, 1.0)


def starts(sawtooth: Polygons, count: int, allowed: Allowed) -> Array:
    """Return three initial points of a search for `knots`, [3, count + 1], at the frequency of a sawtooth.

    They are the sawtooth itself, a ramp in the direction of its slow flank over 0.1 to 0.9 of the voltage
    range, and a constant voltage in mid-range.
    """
    first = as_knots(sawtooth, count, allowed)
    ramp = np.linspace(0.1, 0.9, count)[:: 1 if sawtooth.shares[0, 1] > 0.5 else -1]
    return np.array([first, np.append(ramp, first[-1]), np.append(np.full(count, 0.5), first[-1])])


def sawtooths(x: Array, allowed: Allowed) -> Polygons:
    """Return the sawtooths of search points `x` [n, 3], each coordinate from 0 to 1, as polygons of two
    corners.

    The coordinates are the share of the rise in the period, the frequency (logarithmic scale over the allowed
    range) and the swing from the lowest allowed voltage. Points [n, 2] have the whole swing. The swing is
    reduced about its middle if a flank is too steep.
    """
    rise = STEEPEST + (1.0 - 2.0 * STEEPEST) * x[:, 0]
    shares = np.stack([np.zeros_like(rise), rise], axis=1)
    swing = allowed.swing * (x[:, 2] if x.shape[1] > 2 else np.ones(len(x)))
    volts = np.stack([np.full(len(x), allowed.low), allowed.low + swing], axis=1)
    return Polygons(shares, volts, 1.0 / _frequency(x[:, 1], allowed)).within(allowed)


def _frequency(x: Array, allowed: Allowed) -> Array:
    return allowed.slowest * (allowed.fastest / allowed.slowest) ** x
