r"""Learning of a repeated motion: corrections of the target that make a loop follow it.

Iterative learning keeps, for each tick of the motion, a correction w of the loop's target. After each run it
changes w by the remaining error [bristow2006]; repetitive control does so after each period of a continuing
scan:

.. math:: w_{j+1} = Q\,(w_j + \lambda\,q^{m} e_j), \qquad
    e_{j+1} = Q\,(1 - \lambda\,q^{m}\,P)\,e_j + (1 - Q)\,e_r, \qquad P = \frac{G\,(C + F)}{1 + G C}

with the number j of the run, the error e_j in it, the share λ that is learned, and the shift q by one tick:
the correction at a tick learns from the error m ticks later. G is the plant, C the regulator, F its
feedforward, and e_r the error without learning. Q is a zero-phase filter (binomial, with an odd number of
taps). The change from run to run is multiplied by

.. math:: \rho(\omega) = \left|Q\,(1 - \lambda\,e^{i\omega m T} P)\right|

at each frequency, and learning converges if the largest factor is below 1. The remaining error consists of
the frequencies that Q does not pass, and of differences between the runs.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..quantities.records import Quantity, of_kind
from ..quantities.units import QuantityError, array_si
from .blocks import Regulator, whole_number
from .loops import Loop

Array = NDArray[np.float64]

_GAIN = Quantity("", "λ", "the share of an error that is learnt", minimum=0, maximum=1)


class Learnt:
    """Controller for a repeated motion: a regulator with a learned correction of the target at each tick.

    Args:
        regulator: regulator of the loop.
        ticks: number of ticks in the motion or period, above `taps` + `lead`.
        gain: share λ of an error that is learned in each repetition, 0 to 1.
        lead: number m of ticks by which a correction precedes the error that it removes: the delay of the
            closed loop.
        taps: number of taps of the filter Q, odd; 1: no filter.
        periodic: True for repetitive control, which learns after each period by itself; the loop must settle
            within one. Otherwise call `learn` after each run, and the regulator's `begin` before the next.

    Attributes:
        correction: value added to the target at each tick, m (rad).
        history: rms error of each run or period, m (rad).

    Raises:
        QuantityError: a number is out of range or not whole, `taps` is even, or `regulator` has the wrong
            type.
    """

    def __init__(
        self,
        regulator: Regulator,
        ticks: int,
        gain: float | str = 0.8,
        *,
        lead: int = 0,
        taps: int = 21,
        periodic: bool = False,
    ) -> None:
        self._gain = _GAIN.check(gain, "gain")
        ticks, taps, lead = (
            whole_number(value, field) for field, value in (("ticks", ticks), ("taps", taps), ("lead", lead))
        )
        if taps % 2 != 1 or not ticks > taps + lead:
            raise QuantityError(
                f"taps = {taps} must be odd, and {ticks} ticks more than those and lead = {lead}"
            )
        self.regulator: Regulator = of_kind(regulator, Regulator, "Learnt.regulator")
        self.periodic = periodic
        self._lead, self._q = lead, _binomial(taps)
        self.correction: Array = np.zeros(ticks)
        self._errors: Array = np.zeros(ticks)
        self.history: list[float] = []

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V] for a measured and a wanted position [m] at a tick, counted from the start
        of the run, and keep the error for learning; with `periodic`, learn at the start of each later
        period. After the last tick of a motion, its last correction is used, and its last error replaced."""
        size = self.correction.size
        at = tick % size if self.periodic else min(tick, size - 1)
        if self.periodic and at == 0 and tick:
            self.learn()
        self._errors[at] = target - measured
        return self.regulator.step(measured, target + float(self.correction[at]), tick)

    def learn(self) -> float:
        """Update the correction by the errors of the last run or period; return their rms value [m], which is
        also appended to `history`."""
        rms = float(np.sqrt(np.mean(self._errors**2)))
        self.history.append(rms)
        wider = self._q.size // 2
        if self.periodic:
            ahead = np.roll(self._errors, -self._lead)
            raw = np.pad(self.correction + self._gain * ahead, wider, mode="wrap")
        else:
            ahead = np.append(self._errors[self._lead :], np.full(self._lead, self._errors[-1]))
            raw = np.pad(self.correction + self._gain * ahead, wider, mode="edge")
        self.correction = np.convolve(raw, self._q, mode="valid")
        return rms

    def contraction(self, loop: Loop, frequencies: ArrayLike | None = None) -> Array:
        """Return the factor by which one repetition multiplies the error, at each frequency, as an array.

        Learning converges if the largest factor is below 1. See the module for the equation.

        Args:
            loop: result of `control.loops.sampled_loop` at the regulator's update rate.
            frequencies: Hz, between which values are interpolated; by default those of the loop, up to half
                the update rate.
        """
        known = loop.frequencies
        angle, control = 2.0 * math.pi * known / loop.rate, self.regulator.response(known)
        own = self.regulator
        ahead = own.feedforward * (1.0 + own.lead_ticks * (1.0 - np.exp(-1j * angle)))
        inner = loop.response * (control + ahead) / (1.0 + control * loop.response)
        offsets = np.arange(self._q.size) - self._q.size // 2
        q = np.cos(np.outer(angle, offsets)) @ self._q
        found = np.abs(q * (1.0 - self._gain * np.exp(1j * angle * self._lead) * inner))
        return (
            found
            if frequencies is None
            else np.interp(array_si(frequencies, "Hz", "frequencies"), known, found)
        )


def _binomial(taps: int) -> Array:
    """Return the taps of a binomial filter [taps]: a row of Pascal's triangle, divided by its sum."""
    return scipy.stats.binom.pmf(np.arange(taps), taps - 1, 0.5)
