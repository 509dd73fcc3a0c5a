"""Inverse of a piezo's hysteresis and creep: the voltage for a wanted position, tick by tick.

The inverse of `physics.piezo.PrandtlIshlinskii` and `physics.piezo.Creep` is exact (`identify.inverse_drive`
computes it for a complete motion known beforehand). The loop must only correct the error of the model and the
lag of the stage.
"""

from __future__ import annotations

import numpy as np

from ..physics.actuator import Actuator
from ..physics.piezo import Creep, PrandtlIshlinskii
from ..physics.piezo.creep import Lags, before_creep, relaxed
from ..physics.piezo.operators import inverse, response
from ..quantities.records import Quantity
from ..quantities.units import QuantityError

# Declaration of the update rate of controllers and filters, Hz, with which arguments are checked.
RATE = Quantity("Hz", "f_s", "the rate of the ticks", above=0)
_REST = Quantity("V", "", "the voltage of rest")
_PUT_OUT = Quantity("V", "", "the voltage that was put out")


class PiezoInverse:
    """Inverse of a piezo with hysteresis and creep: voltages for positions, starting from rest at a voltage.

    Args:
        model: an actuator with a `piezo`, whose hysteresis, creep (if any) and gain are used.
        rate: update rate, Hz.
        voltage: voltage, V, at which the piezo has rested for long, after a monotonic change from 0 V.

    Raises:
        QuantityError: the model has no piezo, or one whose inverse is not known; a number is out of range.
    """

    def __init__(self, model: Actuator, rate: float | str, voltage: float | str = 0.0) -> None:
        hertz, rest = RATE.check(rate, "rate"), _REST.check(voltage, "voltage")
        piezo = getattr(model, "piezo", None)
        if piezo is None or not isinstance(piezo.hysteresis, PrandtlIshlinskii):
            raise QuantityError(
                f"{getattr(model, 'name', model)!s:.60} has no PrandtlIshlinskii to be inverted"
            )
        if not isinstance(piezo.creep, Creep | None):
            raise QuantityError(f"the inverse of a {type(piezo.creep).__name__} is not known")
        self.gain, self._hysteresis = model.gain, piezo.hysteresis
        self._operators, self._plays = self._hysteresis.operators, self._hysteresis.rested(rest)
        level, creep = self._hysteresis.at_rest(rest), piezo.creep
        self._shares = np.array(() if creep is None else creep.shares)
        self._lags = Lags(np.array(() if creep is None else creep.time_constants))
        self._terms = np.full(self._shares.size, level)
        self._volts, self._times = rest, np.array([0.0, 1.0 / hertz])
        self._wanted = np.full(2, level * (1.0 + float(self._shares.sum())))
        self._before, self._out = np.empty(2), np.empty(1)
        self._given, self._levels = np.empty(2), np.empty(2)
        self._crept = np.empty((2, self._shares.size))

    @property
    def position(self) -> float:
        """Return the position at the last voltage, m, relative to rest at 0 V."""
        return self.gain * float(self._wanted[1])

    @property
    def volts(self) -> float:
        """Return the last voltage, V."""
        return self._volts

    def follow(self, volts: float) -> None:
        """Update the state for a voltage [V] that was put out for one tick without a call of `step`; raise
        QuantityError unless it is finite."""
        volts = _PUT_OUT.check(volts, "volts")
        self._given[0], self._given[1] = self._volts, volts
        response(self._operators, self._given, self._plays, self._levels)
        self._volts, moved = volts, float(self._levels[1])
        if self._shares.size:
            relaxed(self._lags, self._times, self._levels, self._terms, self._crept)
            moved += float(self._crept[1] @ self._shares)
        self._wanted[0], self._wanted[1] = self._wanted[1], moved

    def step(self, position: float) -> float:
        """Return the voltage [V] at which the free piezo reaches a position [m, relative to rest at 0 V] one
        tick later; raise QuantityError if no voltage does. Call this once per tick: each call advances
        hysteresis and creep."""
        self._wanted[0], self._wanted[1] = self._wanted[1], position / self.gain
        level = self._wanted[1:]
        if self._shares.size:
            before_creep(self._lags, self._times, self._wanted, self._shares, self._terms, self._before)
            level = self._before[1:]
        inverse(self._operators, level, self._volts, self._plays, self._out)
        self._volts = float(self._out[0])
        if not np.isfinite(self._volts):
            raise QuantityError(f"no voltage gives the position {position:g} m")
        return self._volts
