"""Thresholds beyond which a closed loop does not believe its sensor, from a model of the actuator or from a
table of its step sizes."""

from __future__ import annotations

import numpy as np

from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage
from ..quantities.units import optional_si, to_si, unit_for
from ..rig.plausibility import Plausibility
from .steps import StepSizes

# Largest speed that a loop believes, over the largest speed of the stage when it vibrates after a jump of the
# voltage through the whole range.
_SPEED = 3.0
# Largest slope of the voltage at which the contact certainly sticks, over the voltage at which stepping
# starts times the stage's natural frequency [rad/s].
_STICKS = 0.3
_RINGS = 4.0  # settling time over the time constant with which the stage's vibration decays
_SETTLING = (2e-3, 0.02)  # smallest and largest settling time, s
_STROKE = 0.05  # displacement that the drive need not explain (creep, loads), over the piezo's stroke
_BEGINS = 0.05  # size of a step, over the largest one, at whose voltage stepping counts as started
_SLOW, _QUICK = 1e3, 3e4  # lowest and highest natural frequency that an unknown stage may have, rad/s
# Largest believed distance from a target that was reached, beyond the piezo's stroke, in largest steps.
_ASTRAY = 5.0


def plausibility(
    model: Actuator,
    output: OutputStage | float | str,
    frequency: float | str,
    max_voltage: float | str,
    *,
    table: StepSizes | None = None,
    noise: float | str | None = None,
) -> Plausibility:
    """Return the thresholds beyond which a loop does not believe its sensor (`rig.Plausibility`), from a
    model.

    Args:
        model: identified actuator.
        output: converter and amplifier, or the rate of its updates, Hz.
        frequency: frequency of the steps, Hz.
        max_voltage: difference between least and greatest voltage, V.
        table: `StepSizes.of_model` for the same arguments, if it has been computed; None: compute it, for
            the model without hysteresis and creep of the piezo.
        noise: standard deviation of a reading, m (rad for a rotary actuator); None: 0.

    Raises:
        QuantityError: a number is out of range, or the model does not step; see `StepSizes.of_model`.
    """
    rms = optional_si(noise, unit_for(model, "m"), "noise") or 0.0
    span = to_si(max_voltage, "V", "max_voltage")
    steps = table or StepSizes.of_model(model.replace(piezo=None), output, frequency, span)
    omega = model.natural_frequency
    settling = None
    if not model.static and model.damping_ratio > 0.0:
        settling = _RINGS / (omega * model.damping_ratio)
    return of_steps(
        steps, model.gain, span, omega=None if model.static else omega, settling=settling, rms=rms
    )


def of_steps(
    table: StepSizes,
    gain: float,
    span: float,
    *,
    omega: float | None = None,
    settling: float | None = None,
    rms: float = 0.0,
) -> Plausibility:
    """Return the thresholds beyond which a loop does not believe its sensor (`rig.Plausibility`), from a
    table of steps and the gain.

    Args:
        table: step sizes, m (rad).
        gain: gain of the piezo, m/V (rad/V).
        span: difference between least and greatest voltage, V.
        omega: natural frequency of the stage, rad/s; None: unknown, 1000 to 30,000 rad/s is assumed.
        settling: settling time of stage and sensor, s, limited to 2 to 20 ms; None: unknown, 20 ms.
        rms: standard deviation of a reading, m.
    """
    volts = np.array(table.voltages)
    sizes = 0.5 * (np.array(table.forward) + np.array(table.backward))
    edge = float(np.interp(_BEGINS * sizes[-1], sizes, volts))
    apart = gain * edge + _STROKE * gain * span + 8.0 * rms
    greatest = float(max(table.forward[-1], table.backward[-1]))
    return Plausibility(
        gain=gain,
        speed=_SPEED * gain * span * (omega or _QUICK),
        apart=apart,
        settling=min(max(settling or _SETTLING[1], _SETTLING[0]), _SETTLING[1]),
        edge=edge,
        slope=_STICKS * edge * (omega or _SLOW),
        step_share=float(sizes[-1]) / (gain * max(float(volts[-1]) - edge, edge)),
        astray=gain * span + _ASTRAY * greatest,
        sensors=apart,
    )
