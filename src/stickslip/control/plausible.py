"""Thresholds of what a closed loop believes of its sensor, from the model of its actuator."""

from __future__ import annotations

import numpy as np

from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage
from ..quantities.units import optional_si, to_si, unit_for
from ..rig.plausibility import Plausibility
from .steps import StepSizes

_SPEED = 3.0  # over that of the stage which rings after a jump through the whole range
_STICKS = 0.3  # share of the slope at the start of stepping up to which the contact surely sticks
_RINGS = 4.0  # time constants of the stage until it has settled
_SETTLING = (2e-3, 0.02)  # s, least and greatest
_STROKE = 0.05  # share of the stroke that the drive need not explain: creep, loads
_BEGINS = 0.05  # share of the largest step that counts as the start of stepping
_SLOW, _QUICK = 1e3, 3e4  # rad/s, of stages that nothing is known of
_ASTRAY = 5.0  # steps


def plausibility(
    model: Actuator,
    output: OutputStage | float | str,
    frequency: float | str,
    max_voltage: float | str,
    *,
    table: StepSizes | None = None,
    noise: float | str | None = None,
) -> Plausibility:
    """Return the thresholds for the loop of a model.

    Args:
        model: identified.
        output: converter and amplifier, or the rate of its updates, Hz.
        frequency: Hz, of the steps.
        max_voltage: V, from the least to the greatest voltage.
        table: `StepSizes.of_model` of the same, if it is at hand.
        noise: m, standard deviation of a reading.
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
    """Return the thresholds that follow from a table of steps and the stroke per volt.

    Args:
        table: of the steps.
        gain: m/V, of the piezo.
        span: V, from the least to the greatest voltage.
        omega: rad/s, natural frequency of the stage, if that is known.
        settling: s, until stage and sensor have settled, if that is known.
        rms: m, noise of a reading.
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
