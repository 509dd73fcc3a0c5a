r"""Input shaping: a change comes in parts, so that what each sets swinging the others stop.

Of a mode with the damped period :math:`T_d = 2\pi/(\omega\sqrt{1-\zeta^2})` and
:math:`K = e^{-\zeta\pi/\sqrt{1-\zeta^2}}` the shaper of order 1 (ZV) has the parts :math:`1/(1+K)` at once
and :math:`K/(1+K)` half a period later; that of order n is n of them in a row (2: ZVD), n half periods long
[singer1990]. With the frequency off by a share d what is left of the swing is about :math:`(\pi d/2)^n`.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, array_si, own_unit, to_si
from ..rig.protocols import Controller
from .blocks import RATE, below_half

Array = NDArray[np.float64]


@record
class Shaper(NamedTuple):
    """See the module."""

    frequency: Annotated[float, Quantity("Hz", "ω/2π", "natural frequency of the mode", above=0)]
    damping: Annotated[float, Quantity("", "ζ", "damping ratio of the mode", minimum=0, maximum=0.99)] = 0.0
    order: Annotated[float, Quantity("", "n", "1: ZV, 2: ZVD, ...", minimum=1, maximum=6)] = 2

    def _check(self) -> None:
        if self.order % 1:
            raise QuantityError(f"Shaper.order = {self.order:g} must be a whole number")

    def parts(self) -> tuple[Array, Array]:
        """When [s] and how much of a change comes; the sum of the parts is 1."""
        root = math.sqrt(1.0 - self.damping**2)
        k = math.exp(-self.damping * math.pi / root)
        shares: Array = np.ones(1)
        for _ in range(int(self.order)):
            shares = np.convolve(shares, np.array([1.0, k]) / (1.0 + k))
        half = 0.5 / (self.frequency * root)
        return np.arange(float(shares.size)) * half, shares

    def taps(self, rate: float | str) -> Array:
        """The shaper at a rate [Hz]: each part is split between the two ticks around its time. Raises
        QuantityError for a mode beyond half the rate."""
        hertz = RATE.check(rate, "rate")
        below_half(self.frequency, hertz, "Shaper.frequency")
        times, shares = self.parts()
        at = times * hertz
        found = np.zeros(math.ceil(at[-1]) + 2)
        for k, share in zip(at, shares, strict=True):
            first, part = int(k), k - int(k)
            found[first] += share * (1.0 - part)
            found[first + 1] += share * part
        return found[: np.flatnonzero(found)[-1] + 1]

    def shaped(self, values: ArrayLike, rate: float | str) -> Array:
        """Samples [n] at a rate [Hz], shaped, in their own unit; before the first they were like it. Raises
        QuantityError for what is no such list of finite numbers, and as `taps`."""
        given, taps = array_si(values, own_unit(values), "values"), self.taps(rate)
        if given.ndim != 1 or not given.size or not np.all(np.isfinite(given)):
            raise QuantityError(f"values of the shape {given.shape} must be finite samples [n], one at least")
        return np.convolve(np.append(np.full(taps.size - 1, given[0]), given), taps, mode="valid")


@record
class Slip(NamedTuple):
    """The edge with which a step slips: over `duration` the voltage goes at a steady pace, and so with a
    steady current; with a `frequency`, in parts that do not set that mode of the stage swinging (see the
    module).

    The contact slides meanwhile, which no linear mode knows: less ringing of the stage is left, not none.
    """

    duration: Annotated[float, Quantity("s", "t_e", "time of the edge, of each part", minimum=0)] = 0.0
    frequency: Annotated[float, Quantity("Hz", "ω/2π", "of a mode; 0: not shaped", minimum=0)] = 0.0
    damping: Annotated[float, Quantity("", "ζ", "damping ratio of the mode", minimum=0, maximum=0.99)] = 0.0
    order: Annotated[float, Quantity("", "n", "1: ZV, 2: ZVD, ...", minimum=1, maximum=6)] = 1

    @classmethod
    def within(cls, current: float | str, capacitance: float | str, voltage: float | str) -> Slip:
        """Return the edge of a voltage [V] into a capacitance [F] with a current [A]."""
        ampere, farad = to_si(current, "A", "current"), to_si(capacitance, "F", "capacitance")
        if not 0.0 < ampere < math.inf:
            raise QuantityError(f"current = {ampere:g} A must be > 0 A and finite")
        return cls(farad * abs(to_si(voltage, "V", "voltage")) / ampere)

    def _check(self) -> None:
        if self.order % 1:
            raise QuantityError(f"Slip.order = {self.order:g} must be a whole number")

    def corners(self, shortest: float = 1e-9) -> tuple[Array, Array]:
        """Times [s] after the rise, from 0, and what is left of the voltage, from 1 to 0, with lines between;
        a jump takes `shortest` [s]."""
        if self.frequency:
            times, shares = Shaper(self.frequency, self.damping, self.order).parts()
        else:
            times, shares = np.zeros(1), np.ones(1)
        long = max(self.duration, shortest)
        at = np.unique(np.concatenate([times, times + long]))
        gone = np.clip((at[:, None] - times) / long, 0.0, 1.0) @ shares
        left = np.clip(1.0 - gone, 0.0, 1.0)
        left[-1] = 0.0
        return at, left

    def left(self, rate: float) -> tuple[float, ...]:
        """Return the remaining share of the voltage at the ticks after the rise, at a rate [Hz].

        Raises QuantityError for a mode beyond half the rate.
        """
        below_half(self.frequency, rate, "Slip.frequency")
        times, levels = self.corners()
        ticks = np.arange(1, math.ceil(times[-1] * rate) + 1) / rate
        return tuple(np.interp(ticks, times, levels).tolist())


class Shaping:
    """A controller whose target is shaped.

    Args:
        controller: what sees the shaped target; its attribute `done` is passed on.
        shaper: of the mode that must not swing.
        rate: Hz, of the ticks; more than twice the frequency of the mode.
    """

    def __init__(self, controller: Controller, shaper: Shaper, rate: float | str) -> None:
        self.controller, self.rate = controller, RATE.check(rate, "Shaping.rate")
        self._taps = shaper.taps(self.rate)
        self._targets: Array | None = None  # the newest first

    @property
    def done(self) -> bool:
        """True if the controller is done."""
        return getattr(self.controller, "done", False)

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V]."""
        if self._targets is None:
            self._targets = np.full(self._taps.size, target)
        self._targets[1:] = self._targets[:-1]
        self._targets[0] = target
        return self.controller.step(measured, float(self._taps @ self._targets), tick)
