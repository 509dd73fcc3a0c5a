r"""Discrete blocks of a regulator: PID with anti-windup, notch, low-pass.

With the sample time T = 1/f_s, the change r_k of the target since the start, and the position error e_k,
which notches and low-pass filter to v_k, the output voltage is u_k [astrom2006]:

.. math:: i_k = i_{k-1} + K_i T v_k, \qquad
          d_k = a\,d_{k-1} + (1 - a)\,\frac{v_k - v_{k-1}}{T}, \quad a = e^{-2\pi f_d T}, \qquad
          u_k = K_p v_k + i_k + K_d d_k + K_f r_k

K_p, K_i and K_d are the gains of the PID, K_f the feedforward of the target, and i_k the integral. The
derivative d_k passes a low-pass of first order with the corner frequency f_d. Notch and low-pass are of
second order. The bilinear transform makes them discrete, and is scaled so that their frequency does not
change.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.state_space import python_control
from ..quantities.records import Quantity, of_kind, record
from ..quantities.units import QuantityError, array_si, to_si, with_prefix
from .inverse import RATE as RATE
from .inverse import PiezoInverse

Array = NDArray[np.float64]
Coefficients = tuple[float, float, float, float, float]

_LEAD = Quantity("s", "", "the time that the feedforward is ahead", minimum=0)
_FEEDFORWARD = Quantity("V/m", "K_f", "the voltage per wanted position")


class ControlWarning(UserWarning):
    """Warning: a loop may perform worse than its margins or its tolerance promise, because of noise above a
    third of the tolerance, or a vibration mode that the update rate does not resolve."""


def whole_number(value: Any, field: str) -> int:
    """Return an int (also of NumPy) as Python's int; raise QuantityError, which names the argument `field`,
    for a negative one and any other type, such as 3.0 or True."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise QuantityError(f"{field} = {value!r:.60}: it must be a whole number >= 0")
    return int(value)


def below_half(frequency: float, rate: float, field: str) -> None:
    """Raise QuantityError unless a frequency [Hz] is below half the update rate [Hz]. `field` is the name of
    the frequency in the message."""
    if not frequency < 0.5 * rate:
        raise QuantityError(
            f"{field} = {with_prefix(frequency, 'Hz')} must be below half the rate, {with_prefix(rate, 'Hz')}"
        )


@record
class Pid(NamedTuple):
    """Gains of a PID regulator from the position error to the voltage.

    Fields: `integral` K_i, V/(m s); `proportional` K_p, V/m; `derivative` K_d, V s/m; `roll_off` f_d, Hz,
    corner frequency of the low-pass of the derivative.
    """

    integral: Annotated[float, Quantity("V/(m*s)", "K_i", "integral gain", minimum=0)]
    proportional: Annotated[float, Quantity("V/m", "K_p", "proportional gain", minimum=0)] = 0.0
    derivative: Annotated[float, Quantity("V*s/m", "K_d", "derivative gain", minimum=0)] = 0.0
    roll_off: Annotated[float, Quantity("Hz", "f_d", "corner of the derivative", above=0)] = 1e3


@record
class Notch(NamedTuple):
    r"""Notch filter (s² + 2 ζ d ω s + ω²) / (s² + 2 ζ ω s + ω²).

    Fields: `frequency` ω/2π, Hz, at which the signal is multiplied by the `depth` d (0 to 1); `width` ζ, half
    the width of the notch over its frequency.
    """

    frequency: Annotated[float, Quantity("Hz", "f_n", "frequency", above=0)]
    width: Annotated[float, Quantity("", "ζ", "half its relative width", above=0, maximum=10)] = 0.5
    depth: Annotated[float, Quantity("", "d", "what is left at its frequency", minimum=0, maximum=1)] = 0.1

    def coefficients(self, rate: float) -> Coefficients:
        """Return the coefficients b0, b1, b2, a1, a2 of a `Biquad` at an update rate [Hz]; raise
        QuantityError unless the notch frequency is below half of it."""
        wide = 2.0 * self.width
        return _bilinear(self.frequency, rate, "Notch.frequency", (1.0, wide * self.depth, 1.0), wide)


@record
class LowPass(NamedTuple):
    """Low-pass filter of second order, ω² / (s² + 2 ζ ω s + ω²), with the `corner` frequency ω/2π, Hz, and
    the `damping` ratio ζ."""

    corner: Annotated[float, Quantity("Hz", "f_c", "corner", above=0)]
    damping: Annotated[float, Quantity("", "ζ", "damping ratio", above=0, maximum=10)] = math.sqrt(0.5)

    def coefficients(self, rate: float) -> Coefficients:
        """Return the coefficients b0, b1, b2, a1, a2 of a `Biquad` at an update rate [Hz]; raise
        QuantityError unless the corner frequency is below half of it."""
        return _bilinear(self.corner, rate, "LowPass.corner", (0.0, 0.0, 1.0), 2.0 * self.damping)


def _bilinear(
    frequency: float, rate: float, name: str, above: tuple[float, float, float], middle: float
) -> Coefficients:
    """Return the coefficients b0, b1, b2, a1, a2 of the discrete form (bilinear transform) of the filter
    (above[0] p² + above[1] p + above[2]) / (p² + middle p + 1) with p = s/ω.

    Args:
        frequency: ω/2π, Hz, at which the discrete filter has the same response.
        rate: update rate, Hz.
        name: name of the frequency in errors.
        above: coefficients of the numerator.
        middle: coefficient of p in the denominator.
    """
    below_half(frequency, rate, name)
    k = 1.0 / math.tan(math.pi * frequency / rate)
    c2, c1, c0 = above
    norm = k * k + middle * k + 1.0
    return (
        (c2 * k * k + c1 * k + c0) / norm,
        2.0 * (c0 - c2 * k * k) / norm,
        (c2 * k * k - c1 * k + c0) / norm,
        2.0 * (1.0 - k * k) / norm,
        (k * k - middle * k + 1.0) / norm,
    )


class Biquad:
    """Digital filter of second order, computed tick by tick, from rest.

    Args:
        coefficients: b0, b1, b2, a1, a2 of (b0 + b1 z⁻¹ + b2 z⁻²) / (1 + a1 z⁻¹ + a2 z⁻²).
    """

    def __init__(self, coefficients: Coefficients) -> None:
        self.coefficients = coefficients
        self._s1 = self._s2 = 0.0

    def step(self, value: float) -> float:
        """Return the output of the filter for the next input value, in the unit of the input, and advance its
        state."""
        b0, b1, b2, a1, a2 = self.coefficients
        out = b0 * value + self._s1
        self._s1 = b1 * value - a1 * out + self._s2
        self._s2 = b2 * value - a2 * out
        return out

    def reset(self) -> None:
        """Set the filter to rest: all earlier inputs are taken as 0."""
        self._s1 = self._s2 = 0.0


class Regulator:
    """PID regulator behind notches and a low-pass, with feedforward and voltage limits.

    At a limit of the output, the integral does not move further beyond it (anti-windup). Positions are in m,
    or in rad for a rotary actuator.

    Args:
        pid: gains.
        rate: update rate, Hz.
        notches, low_pass: filters of the error.
        feedforward: voltage per change of the target, V/m, or the inverse of a piezo at the same rate, which
            `step` advances.
        lead: time by which the feedforward precedes a moving target, s: the actuator's lag. Do not use it for
            a target that jumps.
        min_voltage, max_voltage: limits of the output, V.

    Raises:
        QuantityError: a number is out of range, a filter's frequency is not below half the rate, or an
            argument has the wrong type.
    """

    def __init__(
        self,
        pid: Pid,
        rate: float | str,
        *,
        notches: tuple[Notch, ...] = (),
        low_pass: LowPass | None = None,
        feedforward: float | str | PiezoInverse = 0.0,
        lead: float | str = 0.0,
        min_voltage: float | str = 0.0,
        max_voltage: float | str = 100.0,
    ) -> None:
        self.rate = RATE.check(rate, "Regulator.rate")
        own = isinstance(feedforward, PiezoInverse)
        self.inverse = feedforward if own else None
        self.feedforward = 0.0 if own else _FEEDFORWARD.check(feedforward, "Regulator.feedforward")
        self.lead_ticks = _LEAD.check(lead, "Regulator.lead") * self.rate
        self.low, self.high = (
            to_si(min_voltage, "V", "min_voltage"),
            to_si(max_voltage, "V", "max_voltage"),
        )
        self.pid = of_kind(pid, Pid, "Regulator.pid")
        listed = enumerate(of_kind(notches, tuple | list, "Regulator.notches"))
        self.notches = tuple(of_kind(one, Notch, f"Regulator.notches[{i}]") for i, one in listed)
        self.low_pass = of_kind(low_pass, LowPass | None, "Regulator.low_pass")
        if not self.low < self.high:
            raise QuantityError(f"min_voltage = {self.low:g} V must be < max_voltage = {self.high:g} V")
        parts: list[Any] = [*self.notches, *([] if low_pass is None else [low_pass])]
        self.sections = [Biquad(one.coefficients(self.rate)) for one in parts]
        self.per_tick = pid.integral / self.rate
        self.fading = math.exp(-2.0 * math.pi * pid.roll_off / self.rate)
        self.begin(0.0, 0.0)

    def begin(self, voltage: float, target: float) -> None:
        """Start from rest at a voltage [V] and a wanted position [m, or rad]: filters and derivative start at
        0. The output continues from this voltage, without a jump if the first reading is that position."""
        for section in self.sections:
            section.reset()
        self._integral, self._from, self._target = voltage, target, target
        self._slope = self._last = 0.0
        # `step` adds the inverse's voltage to the integral. Its present voltage is subtracted here, so that
        # the output does not jump.
        if self.inverse is not None:
            self._inverted_from = self.inverse.position
            self._integral -= self.inverse.volts

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V], within the limits, for a measured and a wanted position [m], and advance
        the state by one update: call this once per update. The number of the tick is not used. Raises
        QuantityError as `PiezoInverse.step`."""
        del tick
        value = target - measured
        for section in self.sections:
            value = section.step(value)
        pid = self.pid
        self._integral += self.per_tick * value
        ahead = target - self._from + self.lead_ticks * (target - self._target)
        self._target = target
        others = pid.proportional * value + self.feedforward * ahead
        if self.inverse is not None:
            others += self.inverse.step(self._inverted_from + ahead)
        if pid.derivative:
            change = (value - self._last) * self.rate
            self._slope = self.fading * self._slope + (1.0 - self.fading) * change
            self._last = value
            others += pid.derivative * self._slope
        wanted = self._integral + others
        given = min(max(wanted, self.low), self.high)
        if given != wanted and (wanted - given) * value > 0.0:
            self._integral -= self.per_tick * value
        return given

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response from error to voltage at frequencies [Hz], V/m, in their shape."""
        z: NDArray[np.complex128] = np.exp(
            2j * math.pi / self.rate * array_si(frequencies, "Hz", "frequencies")
        )
        pid = self.pid
        slope = pid.derivative * self.rate * (1.0 - self.fading) * (1.0 - 1.0 / z) / (1.0 - self.fading / z)
        found: Any = pid.proportional + self.per_tick / (1.0 - 1.0 / z) + slope
        for section in self.sections:
            b0, b1, b2, a1, a2 = section.coefficients
            found *= (b0 + b1 / z + b2 / z**2) / (1.0 + a1 / z + a2 / z**2)
        return found

    def state_space(self) -> tuple[Array, Array, Array, float]:
        """Return A (n, n), B (n,), C (n,) and D (a number) of the regulator without feedforward and limits:
        x' = A x + B e, u = C x + D e.

        x are the states (filters first, then the PID's three), x' the states at the next tick, e is the error
        [m], and u the voltage [V]."""
        rows = [(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)]
        rows += [_section(section.coefficients) for section in self.sections]
        a, b, c, d = rows[0]
        for a2, b2, c2, d2 in rows[1:]:
            a = np.block([[a, np.zeros((b.size, b2.size))], [np.outer(b2, c), a2]])
            b, c, d = np.append(b, b2 * d), np.append(d2 * c, c2), d * d2
        pid, keep = self.pid, self.fading
        slope = pid.derivative * self.rate * (1.0 - keep)
        # States of the PID: integral, filtered derivative, previous value of the filtered error.
        own = np.diag([1.0, keep, 0.0])
        own[1, 2] = -slope
        into, out = np.array([self.per_tick, slope, 1.0]), np.array([1.0, keep, -slope])
        direct = pid.proportional + self.per_tick + slope
        a = np.block([[a, np.zeros((b.size, 3))], [np.outer(into, c), own]])
        return a, np.append(b, into * d), np.append(direct * c, out), direct * d

    def to_control(self) -> Any:
        """Return the linear part as a discrete ``control.StateSpace``, from the error [m] to the voltage [V].

        Feedforward and voltage limits are not in it.

        Raises:
            QuantityError: python-control is not installed.
        """
        a, b, c, d = self.state_space()
        made = python_control("Regulator.to_control")
        return made.ss(a, b[:, None], c[None, :], [[d]], 1.0 / self.rate)

    def __repr__(self) -> str:
        parts: list[Any] = [self.pid, *self.notches, *([] if self.low_pass is None else [self.low_pass])]
        limits = f"{self.low:g} to {self.high:g} V"
        return f"Regulator({', '.join(map(str, parts))}; {with_prefix(self.rate, 'Hz')}, {limits})"


def _section(coefficients: Coefficients) -> tuple[Array, Array, Array, float]:
    b0, b1, b2, a1, a2 = coefficients
    a = np.array([[-a1, 1.0], [-a2, 0.0]])
    return a, np.array([b1 - a1 * b0, b2 - a2 * b0]), np.array([1.0, 0.0]), b0
