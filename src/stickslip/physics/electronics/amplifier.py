r"""An amplifier that charges the capacitance of a piezo: bandwidth, slew rate, peak and rms current.

.. math:: \dot u = \operatorname{clip}\left(\frac{u^* - u}{\tau}, \pm R\right), \qquad
          u^* = \operatorname{clip}(G u_{in} + u_0, u_{low}, u_{high}), \qquad
          \tau = \frac{1}{2\pi f_B} + R_o C_p, \qquad R = \min\left(R_{max}, \frac{I}{C_p}\right)

u is the output for the input u_in, and C_p the capacitance of the piezo. The other symbols are those of the
fields of `Amplifier`.

The peak current flows for a limited time, as in data sheets. I is I_max while q, the exponentially weighted
mean square of the current i, is below the square of the rms current; then it is I_rms until the demand falls
below that,

.. math:: T \dot q = i^2 - q, \qquad I = I_{max} \ (q < I_{rms}^2), \quad I_{rms} \ (q = I_{rms}^2), \qquad
          T = \frac{t_{peak}}{-\ln(1 - I_{rms}^2/I_{max}^2)}

so that from rest I_max flows for t_peak. The exponential weight is an assumption: makers print the duration
and the remaining current, not the circuit.

One lag with the sum of both time constants differs from two lags in series, but is closer to measurements
[piezodrive2021, p. 13]. For PiezoDrive's PD200X4 with 0 to 30 uF (seven loads, 684 to 2.4 kHz), 717 kHz and
2.35 ohm, the error of the bandwidth is 5.6 % rms and at most 10 %; with two lags in series 8.6 and 14 %. At
10 and 30 nF that amplifier has a resonance peak (759 and 720 kHz), which neither model has, and at 110 uF
both are 30 to 35 % too slow.

A charge amplifier is not covered: with a linear capacitance, charge and voltage are equivalent. It avoids the
hysteresis between both, which belongs to the piezo's model.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, of_kind, record
from ...quantities.units import QuantityError, array_si, to_si
from .charging import ChargingLimits, charged, rest

CAPACITANCE = Quantity("F", "C_p", "capacitance of the piezo", above=0)
TOLERANCE = Quantity("V", "ε", "greatest error of the lines", above=0)
_RATE = Quantity("Hz", "f", "samples of the input per second", above=0)


@record
class Amplifier(NamedTuple):
    """Amplifier that charges a piezo: gain, output range, bandwidth, slew rate and currents; see the module.

    `bandwidth` is that of small signals (-3 dB) without a load. An infinite value means: no such limit.
    """

    gain: Annotated[float, Quantity("", "G", "voltage gain", above=0)]
    offset: Annotated[float, Quantity("V", "u_0", "output at input zero")]
    bandwidth: Annotated[
        float, Quantity("Hz", "f_B", "bandwidth of small signals", above=0, maximum=math.inf)
    ]
    slew_rate: Annotated[float, Quantity("V/s", "R_max", "greatest slew rate", above=0, maximum=math.inf)]
    max_current: Annotated[float, Quantity("A", "I_max", "current limit", above=0, maximum=math.inf)]
    low: Annotated[float, Quantity("V", "u_low", "least output")]
    high: Annotated[float, Quantity("V", "u_high", "greatest output")]
    output_resistance: Annotated[float, Quantity("ohm", "R_o", "output resistance", minimum=0)] = 0.0
    rms_current: Annotated[
        float, Quantity("A", "I_rms", "rms current that may flow continuously", above=0, maximum=math.inf)
    ] = math.inf
    peak_duration: Annotated[
        float, Quantity("s", "t_peak", "duration of max_current from rest", above=0, maximum=math.inf)
    ] = math.inf

    def _check(self) -> None:
        if self.low >= self.high:
            raise QuantityError(
                f"Amplifier.low = {self.low:g} V is out of range: it must be < high = {self.high:g} V"
            )
        if self.rms_current < self.max_current and self.peak_duration == math.inf:
            raise QuantityError(
                f"Amplifier.peak_duration = {self.peak_duration:g} s is out of range: with an rms_current "
                f"({self.rms_current:g} A) below max_current it must be finite"
            )
        if self.rms_current < self.max_current and self.max_current == math.inf:
            raise QuantityError(
                f"Amplifier.max_current = {self.max_current:g} A is out of range: with an rms_current "
                f"({self.rms_current:g} A) it must be finite"
            )


def small_signal_bandwidth(amplifier: Amplifier, capacitance: float | str) -> float:
    """Return the small-signal bandwidth (-3 dB) of an amplifier with a capacitance [F] as load, Hz; infinite
    without a lag. Raises QuantityError unless the capacitance is positive."""
    tau = limits(amplifier, CAPACITANCE.check(capacitance, "capacitance")).tau
    return 0.5 / (math.pi * tau) if tau > 0.0 else math.inf


def limits(amplifier: Amplifier, farad: float) -> ChargingLimits:
    """Return the limits within which an amplifier charges a capacitance `farad` [F]: its time constant,
    largest slopes and current limits.

    Raises:
        QuantityError: `amplifier` is not an `Amplifier`.
    """
    of_kind(amplifier, Amplifier, "amplifier")
    tau = 0.5 / (math.pi * amplifier.bandwidth) + amplifier.output_resistance * farad
    peak, steady = amplifier.max_current, min(amplifier.rms_current, amplifier.max_current)
    memory = math.inf
    if steady < peak:
        memory = -amplifier.peak_duration / math.log1p(-((steady / peak) ** 2))
    return ChargingLimits(
        tau,
        min(amplifier.slew_rate, peak / farad),
        min(amplifier.slew_rate, steady / farad),
        steady**2,
        memory,
        farad,
    )


def amplifier_output(
    amplifier: Amplifier,
    volts: ArrayLike,
    sample_rate: float | str,
    capacitance: float | str,
    *,
    tolerance: float | str = 5e-3,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the output of an amplifier whose input is held constant from sample to sample, as points for
    linear interpolation.

    Args:
        amplifier: data of the amplifier.
        volts: input, V, shape (n,); before the first sample it equals the first.
        sample_rate: sample rate of the input, Hz.
        capacitance: capacitance of the piezo, F.
        tolerance: largest error of the interpolation, V; the points themselves are exact.

    Returns:
        times [s], ascending from 0, the last one n / sample_rate; and the output there [V].

    Raises:
        QuantityError: a number is out of range or not finite, or the output would jump because the amplifier
            has neither a lag nor a slew limit.
    """
    tolerance = TOLERANCE.check(to_si(tolerance, "V", "tolerance"), "tolerance")
    farad = CAPACITANCE.check(capacitance, "capacitance")
    rate = _RATE.check(sample_rate, "sample_rate")
    of = limits(amplifier, farad)
    asked = array_si(volts, "V", "volts")
    if asked.ndim != 1 or not asked.size or not np.all(np.isfinite(asked)):
        raise QuantityError(f"volts [V] must be one row of finite values, at least one: {volts!r:.60}")
    targets = np.clip(amplifier.gain * asked + amplifier.offset, amplifier.low, amplifier.high)
    # Indices of the samples at which the target changes; the first sample counts as a change.
    changes = np.flatnonzero(np.diff(targets, prepend=np.nan))
    if of.tau == 0.0 and math.isinf(of.rate) and changes.size > 1:
        raise QuantityError("an amplifier without bandwidth, output resistance and slew rate would jump")
    bounds = np.append(changes / rate, targets.size / rate)
    values = targets[changes]
    return charged(of, bounds, values, np.zeros_like(values), rest(values[0]), tolerance)
