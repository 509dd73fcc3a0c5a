r"""Autotuning on the rig by a relay in front of an integrator: it finds the integral gain at which a loop
just oscillates.

The voltage rises with a fixed slope while the position is below the middle, and falls while it is above. With
the plant's response G, the loop oscillates at the frequency where the phase of G is -90 degrees; the
integrator adds another -90. The describing function of the square wave :math:`\pm s` [V/s] keeps its first
harmonic [astrom2006]. With the amplitude a of the position

.. math:: K_u = \frac{\omega}{|G(i\omega)|} = \frac{4 s}{\pi a}, \qquad \frac{4 s}{\pi\omega}\,|G| = a

and an integral gain of K_u / g_m has the gain margin g_m, whatever the plant. This is valid if the plant
attenuates higher harmonics (a stage does so above its resonance), and while the contact sticks: the
oscillation must stay below the presliding displacement.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..quantities.records import Quantity
from ..quantities.units import QuantityError, to_si
from .blocks import RATE, Pid, whole_number

_FORGOTTEN = 4  # number of first periods that are not measured, until the oscillation is steady
_RAMP, _REST = 0.1, 0.05  # duration of the ramp to the middle, and of the rest there, s
# Smallest band of the relay, in standard deviations of the sensor's noise. In a smaller band, noise would
# switch the relay.
_CLEAR = 3.0
_SLOPE = Quantity("V/s", "s", "the slope of the voltage", above=0)
_MIDDLE = Quantity("V", "", "the voltage where it oscillates")
_BAND = Quantity("m", "", "how far the position must have passed", minimum=0)
_REACH = Quantity("V", "", "how far it may go to each side", above=0)


class Oscillation(NamedTuple):
    """Result of a relay test.

    Fields: `ultimate`, integral gain K_u at which the loop just oscillates, V/(m s); `frequency` of the
    oscillation, Hz; `amplitude` of the position's first harmonic, m.
    """

    ultimate: float
    frequency: float
    amplitude: float

    def pid(self, gain_margin: float | str = 2.5) -> Pid:
        """Return the gains of a purely integral controller with this gain margin, above 1 (else
        QuantityError)."""
        margin = to_si(gain_margin, "", "gain_margin")
        if not 1.0 < margin < math.inf:
            raise QuantityError(f"gain_margin = {margin:g} must be > 1 and finite")
        return Pid(self.ultimate / margin)


class Relay:
    """Controller for a relay test. It ramps to the middle of the piezo's range and oscillates about the
    position reached there, whatever the target. It is `done` after some periods; `found` is then the result.

    Args:
        slope: slope of the voltage, up and down, V/s.
        rate: update rate, Hz.
        voltage: voltage about which the loop oscillates, V, such as the middle of the piezo's range.
        band: distance beyond the middle at which the relay switches, m, small compared with the amplitude; it
            is raised to three times the noise of the sensor, which is measured at rest in the middle.
        reach: largest deviation of the voltage to each side, V.
        periods: number of measured periods, above 0.

    Raises:
        QuantityError: a number is out of range.
    """

    def __init__(
        self,
        slope: float | str,
        rate: float | str,
        voltage: float | str,
        *,
        band: float | str = 0.0,
        reach: float | str = 10.0,
        periods: int = 20,
    ) -> None:
        self._slope, self._rate = _SLOPE.check(slope, "slope"), RATE.check(rate, "rate")
        self._middle, self._reach = _MIDDLE.check(voltage, "voltage"), _REACH.check(reach, "reach")
        self._band, self._periods = _BAND.check(band, "band"), whole_number(periods, "periods")
        if not self._periods:
            raise QuantityError("periods = 0: a relay measures one at least")
        self._volts = 0.0
        self._ramp, self._rest = round(_RAMP * self._rate), round(_REST * self._rate)
        self._sums: list[float] = []  # positions in the second half of the rest, m
        self._at, self._sign, self._count = 0.0, 1.0, 0
        self._turns: list[int] = []  # ticks at which the voltage started to rise
        self._swing: list[float] = []  # positions during the measured periods, m
        self.done = False

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V] for a measured position [m]; `target` and `tick` are not used. At the end of
        the last oscillation, `done` becomes True. Raise QuantityError if the voltage would leave the middle
        by more than `reach`."""
        del target, tick
        self._count += 1
        if self._count <= self._ramp + self._rest:
            self._volts = self._middle * min(self._count / self._ramp, 1.0)
            if self._count > self._ramp + self._rest // 2:
                self._sums.append(measured)
                self._at = sum(self._sums) / len(self._sums)
            if self._count == self._ramp + self._rest and len(self._sums) > 1:
                self._band = max(self._band, _CLEAR * float(np.std(np.diff(self._sums))) / math.sqrt(2.0))
            return self._volts
        error = self._at - measured
        if self._sign * error < -self._band:
            self._sign = -self._sign
            if self._sign > 0.0:
                self._turns.append(self._count)
        if _FORGOTTEN < len(self._turns) <= _FORGOTTEN + self._periods:
            self._swing.append(measured)
        self._volts += self._sign * self._slope / self._rate
        if abs(self._volts - self._middle) > self._reach:
            raise QuantityError(
                f"the relay has gone {self._reach:g} V far without an oscillation: a gentler slope, or more "
                "reach"
            )
        self.done = len(self._turns) > _FORGOTTEN + self._periods
        return self._volts

    @property
    def found(self) -> Oscillation:
        """Return the oscillation over the measured periods, with the amplitude of its first harmonic; raise
        QuantityError before the relay is `done`."""
        if not self.done:
            raise QuantityError("the relay has not oscillated for long enough yet")
        # The positions cover whole periods, so that the mean of position times exp(i ω t) is half the
        # harmonic.
        swing = np.array(self._swing)
        period = swing.size / (self._periods * self._rate)
        turns = 2.0 * math.pi * self._periods / swing.size * np.arange(swing.size)
        amplitude = 2.0 * abs(complex(np.mean(swing * np.exp(1j * turns))))
        return Oscillation(4.0 * self._slope / (math.pi * amplitude), 1.0 / period, amplitude)
