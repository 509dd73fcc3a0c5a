r"""A voltage amplifier that charges the capacitance of a piezo.

.. math:: \dot u = \operatorname{clip}\left(\frac{u^* - u}{\tau}, \pm R\right), \qquad
          u^* = \operatorname{clip}(G u_{in} + u_0, u_{low}, u_{high}), \qquad
          \tau = \frac{1}{2\pi f_B}, \qquad R = \min\left(R_{max}, \frac{I_{max}}{C_p}\right)

Between two updates of the input the target u* is constant, so the output is a ramp and then an exponential,
both in closed form: no time step, no error that builds up.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..records import Quantity, record
from ..units import QuantityError, to_si

_CAPACITANCE = Quantity("F", "C_p", "capacitance of the piezo", above=0)
_RATE = Quantity("Hz", "f", "samples of the input per second", above=0)


@record
class Amplifier(NamedTuple):
    """See the module. `bandwidth` is that of small signals (-3 dB)."""

    gain: Annotated[float, Quantity("", "G", "voltage gain", above=0)]
    offset: Annotated[float, Quantity("V", "u_0", "output at input zero")]
    bandwidth: Annotated[float, Quantity("Hz", "f_B", "bandwidth of small signals", above=0)]
    slew_rate: Annotated[float, Quantity("V/s", "R_max", "greatest slew rate", above=0, maximum=math.inf)]
    max_current: Annotated[float, Quantity("A", "I_max", "current limit", above=0, maximum=math.inf)]
    low: Annotated[float, Quantity("V", "u_low", "least output")]
    high: Annotated[float, Quantity("V", "u_high", "greatest output")]

    def _check(self) -> None:
        if self.low >= self.high:
            raise QuantityError(
                f"Amplifier.low = {self.low:g} V is out of range: it must be < high = {self.high:g} V"
            )


def amplifier_output(
    amplifier: Amplifier,
    volts: ArrayLike,
    sample_rate: float | str,
    capacitance: float | str,
    *,
    tolerance: float | str = 5e-3,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The output for an input that is held from sample to sample, as points to be joined by lines.

    Args:
        amplifier: its numbers.
        volts: input, V, shape (n,); before the first sample it was like the first.
        sample_rate: Hz, of the input.
        capacitance: F, of the piezo.
        tolerance: V, greatest error of the lines; the points themselves are exact.

    Returns:
        times [s], ascending from 0, the last one n / sample_rate; and the output there [V].
    """
    tolerance = to_si(tolerance, "V", "tolerance")
    capacitance = _CAPACITANCE.check(capacitance, "capacitance")
    rate = _RATE.check(sample_rate, "sample_rate")
    targets = np.clip(
        amplifier.gain * np.asarray(volts, dtype=float) + amplifier.offset, amplifier.low, amplifier.high
    )
    tau = 0.5 / (math.pi * amplifier.bandwidth)
    slew = min(amplifier.slew_rate, amplifier.max_current / capacitance)
    changes = np.flatnonzero(np.diff(targets, prepend=np.nan))  # the first sample counts as one
    begin = changes / rate
    end = np.append(begin[1:], targets.size / rate)
    target = targets[changes]
    start, ramp = _starts(target, end - begin, tau, slew)
    corner = start + np.sign(target - start) * slew * ramp  # where the ramp ends and the exponential begins
    times, values = _points(begin + ramp, end, corner, target, tau, tolerance)
    ramped = ramp > 0.0
    order = np.argsort(np.concatenate([begin[ramped], times]), kind="stable")
    times = np.concatenate([begin[ramped], times])[order]
    values = np.concatenate([start[ramped], values])[order]
    fresh = np.append(True, np.diff(times) > 0.0)
    times, values = times[fresh], values[fresh]
    last = target[-1] + (corner[-1] - target[-1]) * math.exp(-(end[-1] - begin[-1] - ramp[-1]) / tau)
    return np.append(times, end[-1]), np.append(values, last)


def _starts(
    target: NDArray[np.float64], lasts: NDArray[np.float64], tau: float, slew: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The output at each change of the target [V], and how long it then ramps [s]."""
    start, ramp = np.empty(target.size), np.zeros(target.size)
    now, far = float(target[0]), slew * tau
    for k, (wanted, time) in enumerate(zip(target.tolist(), lasts.tolist(), strict=True)):
        start[k] = now
        gap = wanted - now
        if abs(gap) > far:
            ramp[k] = min((abs(gap) - far) / slew, time)
            now += math.copysign(slew * ramp[k], gap)
            time -= ramp[k]
        now = wanted + (now - wanted) * math.exp(-time / tau)
    return start, ramp


def _points(
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    start: NDArray[np.float64],
    target: NDArray[np.float64],
    tau: float,
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points on exponentials from start towards target, close where they bend: with p = 1 - exp(-t/2τ), steps
    dp leave the error A dp²/2 everywhere, A being the height."""
    height = np.abs(target - start)
    count = np.ceil(np.sqrt(height / (2.0 * tolerance))).astype(int) + 1
    which = np.repeat(np.arange(count.size), count)
    place = np.arange(which.size) - np.repeat(np.cumsum(count) - count, count)
    decay = 1.0 - place / count[which]  # exp(-t/2τ)
    times = begin[which] - 2.0 * tau * np.log(decay)
    values = target[which] + (start - target)[which] * decay**2
    inside = times < end[which]
    return times[inside], values[inside]
