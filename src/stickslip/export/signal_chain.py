"""Amplifier, sensor and position channel over one time step, in the subset of Python that is translated to C.

`physics.electronics` computes amplifier and sensor for whole signals. Over one step with a constant input,
both have the closed forms below.
"""

from __future__ import annotations

import math


def amplifier_settled(amplifier, wanted):
    """Return the settled output of the amplifier, V, at a constant input `wanted`, V, within its range."""
    return min(max(amplifier.gain * wanted + amplifier.offset, amplifier.low), amplifier.high)


def amplifier_input(amplifier, output):
    """Return the constant input, V, at which the amplifier settles to an output within its range, V."""
    return (output - amplifier.offset) / amplifier.gain


def amplifier_after(amplifier, capacitance, wanted, now, h):
    """Return the amplifier's output after h seconds, V: a ramp at the slew rate, then an exponential towards
    the settled output.

    The slew rate is limited by the amplifier itself and by its largest current into the capacitance.

    Args:
        amplifier: the amplifier.
        capacitance: capacitance of the piezo, F.
        wanted: constant input of the amplifier during the step, V.
        now: output at the start of the step, V.
        h: duration of the step, s.
    """
    target = amplifier_settled(amplifier, wanted)
    tau = 0.5 / (math.pi * amplifier.bandwidth) + amplifier.output_resistance * capacitance
    slew = min(amplifier.slew_rate, amplifier.max_current / capacitance)
    gap = target - now
    ramp = 0.0
    if abs(gap) > slew * tau:
        ramp = min((abs(gap) - slew * tau) / slew, h)
        gap -= math.copysign(slew * ramp, gap)
    # The condition avoids 0/0 in the exponent for a time constant tau = 0.
    return target - gap * (math.exp((ramp - h) / tau) if ramp < h else 1.0)


def sensor_after(sensor, position, now, h):
    """Return the position that a sensor of first order (one pole) measures after h seconds, m or rad.

    Args:
        sensor: the sensor, with its bandwidth.
        position: true position during the step, m or rad.
        now: measured position at the start of the step, m or rad.
        h: duration of the step, s.
    """
    if math.isinf(sensor.bandwidth):
        return position
    return position + (now - position) * math.exp(-2.0 * math.pi * sensor.bandwidth * h)


def channel_output(chain, seen):
    """Return the output of a position channel, m or rad, with its scale and offset, for the delayed position
    `seen`, m or rad."""
    return chain.scale * seen + chain.offset


def sensor_output(sensor, seen):
    """Return the output of the sensor's signal conditioner, V, at the measured position `seen`, m or rad."""
    return seen / sensor.sensitivity - sensor.offset
