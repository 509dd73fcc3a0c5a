"""Limits of a drive signal that follow from an output stage and an actuator together."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..physics.electronics.output import FEWEST, codes_within
from ..quantities.units import QuantityError, to_si, with_prefix

# Ends of the frequency range that is searched by default, relative to the lower and the higher of two
# frequencies: the stage's natural frequency, and the one at which friction can just accelerate the
# end-effector over the stroke.
SLOWEST, FASTEST = 0.1, 3.0


class Allowed(NamedTuple):
    """Ranges of a drive: least and greatest voltage (`low`, `high`), V; largest `slope`, V/s; least and
    greatest frequency (`slowest`, `fastest`), Hz; and the `output` stage (converter and amplifier)."""

    low: float
    high: float
    slope: float
    slowest: float
    fastest: float
    output: OutputStage

    @property
    def swing(self) -> float:
        return self.high - self.low


def allowed(
    model: Actuator,
    min_voltage: float | None,
    max_voltage: float | None,
    output: OutputStage | None,
    frequency: tuple[float, float] | None,
) -> Allowed:
    """Return the ranges of voltage, slope and frequency that a model and an output stage allow together.

    With a converter, the slope is reduced by one converter step per update, and the frequency range is
    limited to those with an allowed number of updates in a period.

    Args:
        model: the actuator.
        min_voltage, max_voltage: ends of the voltage range, V; None: those of the model (from 0 V if the
            model has no least voltage).
        output: output stage; None: without limits.
        frequency: range (low, high), Hz; None: a range that follows from the model (see `_usual`).

    Raises:
        QuantityError: no drive is allowed, or the model does not allow a voltage; the message names the
            limit.
    """
    low, high = _voltages(model, min_voltage, max_voltage)
    slowest, fastest = frequency or _usual(model, high - low)
    output = output or OutputStage()
    if not isinstance(output, OutputStage):
        raise QuantityError(f"output = {output!r:.60} must be electronics.OutputStage(slew_rate=..., ...)")
    slope = output.slope
    if output.updates:
        least, most = codes_within(output.step, low, high) if output.step else (0, 1)
        if most <= least:
            raise QuantityError(
                f"OutputStage.step = {with_prefix(output.step, 'V')} leaves less than two voltages from "
                f"{low:g} V to {high:g} V"
            )
        # The converter rounds each sample by up to half a step. So the difference of two successive samples
        # may be one step larger than that of the drive, and the drive's slope must be lower by one step per
        # update.
        steps = output.step * output.update_rate
        if slope <= steps:
            raise QuantityError(
                f"a slope of at most {with_prefix(slope, 'V/s')} excludes every drive: one step of the "
                f"output, {with_prefix(output.step, 'V')}, takes {with_prefix(steps, 'V/s')}"
            )
        slope -= steps
        ends = output.update_rate / output.points, output.update_rate / FEWEST
        wanted = slowest, fastest
        slowest, fastest = max(slowest, ends[0]), min(fastest, ends[1])
        if slowest >= fastest:
            raise QuantityError(
                f"frequency = {wanted[0]:g} Hz to {wanted[1]:g} Hz is excluded by the output, which plays "
                f"{FEWEST} to {output.points:g} points at {output.update_rate:g} Hz: "
                f"{ends[0]:g} Hz to {ends[1]:g} Hz"
            )
    return Allowed(low, high, slope, slowest, fastest, output)


def _voltages(model: Actuator, low: float | None, high: float | None) -> tuple[float, float]:
    if low is None:
        low = model.min_voltage if math.isfinite(model.min_voltage) else 0.0
    if high is None:
        high = model.max_voltage
    if not (math.isfinite(low) and math.isfinite(high)):
        raise QuantityError("max_voltage [V] is missing, and the model has no greatest voltage of its own")
    if not low < high:
        raise QuantityError(
            f"min_voltage = {low:g} V and max_voltage = {high:g} V exclude every drive: the first "
            "must be less"
        )
    if low < model.min_voltage or high > model.max_voltage:
        raise QuantityError(
            f"{low:g} V to {high:g} V is out of range: {model.name or 'the actuator'} takes "
            f"{model.min_voltage:g} V to {model.max_voltage:g} V"
        )
    return low, high


def frequencies(given: tuple[float | str, float | str] | None) -> tuple[float, float] | None:
    """Return a frequency range given by the user as (low, high) in Hz; None stays None.

    Raises:
        QuantityError: the range is not a pair of frequencies with 0 < low < high, both finite.
    """
    if given is None:
        return None
    try:
        first, last = given
    except (TypeError, ValueError):
        raise QuantityError(f"frequency = {given!r} must be (low, high), in Hz") from None
    low, high = to_si(first, "Hz", "frequency"), to_si(last, "Hz", "frequency")
    if not 0.0 < low < high < math.inf:
        raise QuantityError(
            f"frequency = ({low:g}, {high:g}) Hz excludes every drive: low must be > 0 Hz and below high"
        )
    return low, high


def _usual(model: Actuator, swing: float) -> tuple[float, float]:
    """Return the frequency range (low, high) [Hz] that is searched by default, for a voltage `swing` [V].

    The range is from `SLOWEST` times the lower to `FASTEST` times the higher of two frequencies: the stage's
    natural frequency, and that at which friction can just accelerate the end-effector over the stroke. An
    unknown frequency (static stage, law without Coulomb force) does not count.

    Raises:
        QuantityError: both frequencies are unknown.
    """
    stroke = abs(model.gain) * swing
    force = abs(getattr(model.friction, "coulomb_force", 0.0))
    found = [] if model.static else [model.natural_frequency / (2.0 * math.pi)]
    if stroke > 0.0 and force > 0.0:
        found.append(0.5 * math.sqrt(force / (model.end_effector_mass * stroke)))
    if not found:
        raise QuantityError("frequency = (low, high) [Hz] is needed: the model does not tell")
    return SLOWEST * min(found), FASTEST * max(found)
