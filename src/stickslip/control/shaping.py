r"""Input shaping: a change of the target comes in parts that cancel each other's vibration.

A mode with the natural frequency ω and the damping ratio ζ has the damped period :math:`T_d =
2\pi/(\omega\sqrt{1-\zeta^2})`. With :math:`K = e^{-\zeta\pi/\sqrt{1-\zeta^2}}`, the shaper of order 1 (ZV)
has the parts :math:`1/(1+K)` at once and :math:`K/(1+K)` half a damped period later. The shaper of order n is
n of them in series (2: ZVD) and lasts n half periods [singer1990]. If the frequency is wrong by a share d,
the remaining vibration is about :math:`(\pi d/2)^n`.
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
    """Input shaper for one vibration mode: natural `frequency` of the mode, Hz, its `damping` ratio, and the
    `order` n of the shaper, 1 to 6; see the module."""

    frequency: Annotated[float, Quantity("Hz", "ω/2π", "natural frequency of the mode", above=0)]
    damping: Annotated[float, Quantity("", "ζ", "damping ratio of the mode", minimum=0, maximum=0.99)] = 0.0
    order: Annotated[float, Quantity("", "n", "1: ZV, 2: ZVD, ...", minimum=1, maximum=6)] = 2

    def _check(self) -> None:
        if self.order % 1:
            raise QuantityError(f"Shaper.order = {self.order:g} must be a whole number")

    def parts(self) -> tuple[Array, Array]:
        """Return the times [s] and the sizes of the parts of a unit change, as arrays [order + 1]; the sum of
        the sizes is 1."""
        root = math.sqrt(1.0 - self.damping**2)
        k = math.exp(-self.damping * math.pi / root)
        shares: Array = np.ones(1)
        for _ in range(int(self.order)):
            shares = np.convolve(shares, np.array([1.0, k]) / (1.0 + k))
        half = 0.5 / (self.frequency * root)
        return np.arange(float(shares.size)) * half, shares

    def taps(self, rate: float | str) -> Array:
        """Return the shaper as taps of a digital filter (weights of the present tick, index 0, and of each
        earlier one, with sum 1) at an update rate [Hz]; each part is split between the two ticks around its
        time. Raises QuantityError unless the mode's frequency is below half the rate."""
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
        """Return samples [n] at a rate [Hz] after the shaper, in their own unit; earlier samples equal the
        first. Raises QuantityError unless the samples are finite numbers, and as `taps`."""
        given, taps = array_si(values, own_unit(values), "values"), self.taps(rate)
        if given.ndim != 1 or not given.size or not np.all(np.isfinite(given)):
            raise QuantityError(f"values of the shape {given.shape} must be finite samples [n], one at least")
        return np.convolve(np.append(np.full(taps.size - 1, given[0]), given), taps, mode="valid")


@record
class Slip(NamedTuple):
    """Edge of the drive voltage with which a step slips.

    The voltage changes at a constant rate over `duration` [s], and so with a constant current; 0 is a jump.
    With a `frequency` [Hz] above 0, the voltage changes in parts that do not excite the mode of the stage
    with this frequency and `damping` ratio: those of a `Shaper` of this `order`, each over `duration`. The
    contact slides meanwhile, which a linear mode does not include, so the vibration is reduced but not
    removed.
    """

    duration: Annotated[float, Quantity("s", "t_e", "time of the edge, of each part", minimum=0)] = 0.0
    frequency: Annotated[float, Quantity("Hz", "ω/2π", "of a mode; 0: not shaped", minimum=0)] = 0.0
    damping: Annotated[float, Quantity("", "ζ", "damping ratio of the mode", minimum=0, maximum=0.99)] = 0.0
    order: Annotated[float, Quantity("", "n", "1: ZV, 2: ZVD, ...", minimum=1, maximum=6)] = 1

    @classmethod
    def within(cls, current: float | str, capacitance: float | str, voltage: float | str) -> Slip:
        """Return the edge whose duration is that of charging a capacitance [F] by a voltage [V] with a
        constant current [A]; raise QuantityError unless the current is above 0 and finite."""
        ampere, farad = to_si(current, "A", "current"), to_si(capacitance, "F", "capacitance")
        if not 0.0 < ampere < math.inf:
            raise QuantityError(f"current = {ampere:g} A must be > 0 A and finite")
        return cls(farad * abs(to_si(voltage, "V", "voltage")) / ampere)

    def _check(self) -> None:
        if self.order % 1:
            raise QuantityError(f"Slip.order = {self.order:g} must be a whole number")

    def corners(self, shortest: float = 1e-9) -> tuple[Array, Array]:
        """Return two arrays: times [s] from the start of the edge, and the share of the voltage that remains
        at each, from 1 to 0, linear in between. A jump takes `shortest` [s]."""
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
        """Return the share of the voltage that remains at each tick after the start of the edge, at an update
        rate [Hz]; the last one is 0, and the only one for a jump.

        Raises QuantityError unless `frequency` is below half the rate.
        """
        below_half(self.frequency, rate, "Slip.frequency")
        times, levels = self.corners()
        ticks = np.arange(1, math.ceil(times[-1] * rate) + 1) / rate
        return tuple(np.interp(ticks, times, levels).tolist())


class Shaping:
    """Controller whose target passes an input shaper.

    Args:
        controller: controller that gets the shaped target; its attribute `done` is passed on.
        shaper: shaper of the mode that must not vibrate.
        rate: update rate, Hz.

    Raises:
        QuantityError: the rate is not above twice the frequency of the mode.
    """

    def __init__(self, controller: Controller, shaper: Shaper, rate: float | str) -> None:
        self.controller, self.rate = controller, RATE.check(rate, "Shaping.rate")
        self._taps = shaper.taps(self.rate)
        self._targets: Array | None = None  # targets of the last ticks, m or rad, latest first

    @property
    def done(self) -> bool:
        """Return True if the inner controller is done."""
        return getattr(self.controller, "done", False)

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V] of the inner controller for a measured and a wanted position [m, or rad] at
        a tick. At the first tick, all earlier targets are taken as equal to this one."""
        if self._targets is None:
            self._targets = np.full(self._taps.size, target)
        self._targets[1:] = self._targets[:-1]
        self._targets[0] = target
        return self.controller.step(measured, float(self._taps @ self._targets), tick)
