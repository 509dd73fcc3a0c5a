"""Amplifier and sensor over one time step, in the subset of Python that is translated to C.

`physics.electronics` computes them for whole signals. Over one step with a constant input, both have the
closed forms below.
"""

from __future__ import annotations

import math


def amplifier_settled(amplifier, wanted):
    """Return the output of the amplifier at a constant input, V."""
    return min(max(amplifier.gain * wanted + amplifier.offset, amplifier.low), amplifier.high)


def amplifier_input(amplifier, output):
    """Return the constant input that settles at an output within the amplifier's range, V."""
    return (output - amplifier.offset) / amplifier.gain


def amplifier_after(amplifier, capacitance, wanted, now, h):
    """Return the output after h seconds, V: a ramp at the slew rate, then an exponential towards the
    target."""
    target = amplifier_settled(amplifier, wanted)
    tau = 0.5 / (math.pi * amplifier.bandwidth) + amplifier.output_resistance * capacitance
    slew = min(amplifier.slew_rate, amplifier.max_current / capacitance)
    gap = target - now
    ramp = 0.0
    if abs(gap) > slew * tau:
        ramp = min((abs(gap) - slew * tau) / slew, h)
        gap -= math.copysign(slew * ramp, gap)
    return target - gap * (math.exp((ramp - h) / tau) if ramp < h else 1.0)  # avoids 0/0 for tau = 0


def sensor_after(sensor, position, now, h):
    """Return the position after h seconds as a sensor of one pole measures it, m."""
    if math.isinf(sensor.bandwidth):
        return position
    return position + (now - position) * math.exp(-2.0 * math.pi * sensor.bandwidth * h)


def channel_output(chain, seen):
    """Return the output of a position channel, m, for the delayed position."""
    return chain.scale * seen + chain.offset


def sensor_output(sensor, seen):
    """Return the output of the conditioner, V."""
    return seen / sensor.sensitivity - sensor.offset
