"""Limits of a rig's output and position, and the checks of a drive against these limits."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..quantities.records import Quantity, quantities, record
from ..quantities.units import QuantityError, with_prefix
from .protocols import Array, Capabilities, RigError

_INF = math.inf
LONGEST_STOP = 10.0  # longest allowed duration of a ramp from the limits' largest voltage to 0 V, s


class LimitError(RigError):
    """A drive was refused, or a run was stopped, at a limit or by a safety check. The message says which."""


@record
class Limits(NamedTuple):
    """Limits of every output of a rig.

    Voltages apply at the piezo, within half a step of the converter. `max_slew` applies to the drive between
    consecutive updates. The converter rounds each update to its step, and the amplifier follows with its own
    bandwidth. The slew at the piezo is therefore limited over time, not at each instant: within a time T the
    voltage changes by at most `max_slew` (T + one update) + one step. `max_duty` is the greatest fraction of
    a run in which the drive differs from 0 V by more than a hundredth of `max_voltage`.

    `min_position` and `max_position` are end stops of the end-effector, m (rad) from home, checked during a
    run. `watchdog` is the longest time without an answer of the rig or a request of the program that runs it.
    `frozen` is the longest time in which the position may stay exactly the same while the drive moves by 10 V
    or more. A stop is a ramp to 0 V at `stop_slew`, at most `max_slew`; the ramp may last 10 s at most.
    `heartbeat` is the longest silence of the operator during a run: of the panel's page in control, or of the
    program that records. A longer silence ends the run with a ramp, and is no fault. Only the process of a
    rig checks this; with infinity, the default, it does not.
    """

    min_voltage: Annotated[float, Quantity("V", "u_min", "lowest voltage at the piezo", maximum=0)] = 0.0
    max_voltage: Annotated[float, Quantity("V", "u_max", "highest voltage at the piezo", minimum=0)] = 150.0
    max_slew: Annotated[
        float, Quantity("V/s", "R_max", "greatest slew of the drive", above=0, maximum=_INF)
    ] = _INF
    max_duty: Annotated[
        float, Quantity("", "D", "greatest fraction of a run away from 0 V", minimum=0, maximum=1)
    ] = 1.0
    min_position: Annotated[
        float, Quantity("m", "x_min", "lower end stop relative to home", minimum=-_INF, maximum=0)
    ] = -_INF
    max_position: Annotated[
        float, Quantity("m", "x_max", "upper end stop relative to home", minimum=0, maximum=_INF)
    ] = _INF
    watchdog: Annotated[float, Quantity("s", "T_w", "longest silence of rig or program", above=0)] = 5.0
    stop_slew: Annotated[float, Quantity("V/s", "R_0", "slew of the ramp to 0 V at a stop", minimum=1)] = (
        1000.0
    )
    frozen: Annotated[
        float, Quantity("s", "T_f", "longest time without a change of position", above=0, maximum=_INF)
    ] = 0.1
    heartbeat: Annotated[
        float, Quantity("s", "T_h", "longest silence of the operator", minimum=0.2, maximum=_INF)
    ] = _INF

    def _check(self) -> None:
        if self.stop_slew > self.max_slew:
            raise QuantityError(
                f"Limits.stop_slew = {self.stop_slew:g} V/s is out of range: it must be <= max_slew = "
                f"{self.max_slew:g} V/s"
            )
        least = max(-self.min_voltage, self.max_voltage) / LONGEST_STOP
        if self.stop_slew < least:
            raise QuantityError(
                f"Limits.stop_slew = {self.stop_slew:g} V/s is out of range: it must be >= {least:g} V/s, "
                f"for a stop from the greatest voltage may take {LONGEST_STOP:g} s"
            )

    @property
    def end_stops(self) -> bool:
        """Return True if at least one of the two end stops is finite."""
        return math.isfinite(self.min_position) or math.isfinite(self.max_position)


def changed_limits(before: Limits | None, after: Limits, unit: str = "") -> list[str]:
    """Return the changed limits as texts for the log, such as "max_voltage 100 V -> 80 V".

    Args:
        before: previous limits; None to return all finite limits of `after`.
        after: new limits.
        unit: unit of positions, "m" or "rad"; "" if unknown: positions are then shown in "m or rad".
    """
    units = {name: quantity.unit for name, quantity in quantities(Limits).items()}

    def shown(name: str, limits: Limits) -> str:
        value = getattr(limits, name)
        if not math.isfinite(value):
            return "none"
        if units[name] == "m" and not unit:
            return f"{value:g} m or rad"
        return with_prefix(value, unit if units[name] == "m" else units[name])

    if before is None:
        return [f"{name} {shown(name, after)}" for name in units if math.isfinite(getattr(after, name))]
    return [
        f"{name} {shown(name, before)} -> {shown(name, after)}"
        for name in units
        if getattr(before, name) != getattr(after, name)
    ]


def beyond(position: float, end: float, unit: str) -> LimitError:
    """Return the error for an end-effector at `position`, beyond its end stop `end`; both are in `unit`."""
    here, there = with_prefix(position, unit), with_prefix(end, unit)
    return LimitError(f"the end-effector is at {here} from home, beyond the end stop at {there}: stopped")


def check_edges(limits: Limits, can: Capabilities) -> None:
    """Raise QuantityError if `max_slew` forbids a jump over the whole voltage range within one update.

    A closed loop that walks by stick-slip steps needs such jumps, at which the contact slips. `can` are the
    capabilities of the rig; the range is what both rig and limits allow.
    """
    low, high = max(limits.min_voltage, can.min_voltage), min(limits.max_voltage, can.max_voltage)
    least = (high - low) * can.update_rate
    if limits.max_slew < least * (1 - 1e-9):
        raise QuantityError(
            f"limits.max_slew = {limits.max_slew:.4g} V/s: the slip edge of a step needs {least:.4g} V/s; "
            "leave slower edges to the amplifier"
        )


def check_drive(volts: Array, limits: Limits, can: Capabilities) -> None:
    """Raise LimitError if the limits or the capabilities of the rig forbid a drive.

    The voltages must be finite, within both voltage ranges, and not more than the rig's `max_points`. Slew
    and duty must be within the limits, also the slew of the ramp that the rig itself adds.

    Args:
        volts: voltages at the piezo, one per update [n]; the output is at 0 V before the first.
        limits: allowed voltages, slew and duty.
        can: capabilities of the rig.
    """
    if volts.ndim != 1 or not volts.size or not np.all(np.isfinite(volts)):
        raise LimitError("the drive must be one row of finite voltages")
    if volts.size > can.max_points:
        raise LimitError(f"the drive has {volts.size} points; {can.name} takes {can.max_points}")
    low, high = float(volts.min()), float(volts.max())
    for value, limit, sign, words in (
        (low, max(limits.min_voltage, can.min_voltage), -1, "below the least voltage"),
        (high, min(limits.max_voltage, can.max_voltage), 1, "above the greatest voltage"),
    ):
        if sign * (value - limit) > 1e-9 * max(abs(limit), 1.0):
            raise LimitError(
                f"the drive reaches {value:.6g} V, {words} of {limit:.6g} V: change the drive or the limits"
            )
    slew = float(np.abs(np.diff(volts, prepend=0.0)).max()) * can.update_rate
    if slew > limits.max_slew * (1 + 1e-9):
        raise LimitError(
            f"the drive changes at {slew:.4g} V/s, faster than the greatest slew of "
            f"{limits.max_slew:.4g} V/s (a sawtooth with rise_fraction < 1 has no jumps)"
        )
    if can.own_slew > limits.max_slew * (1 + 1e-9):
        raise LimitError(
            f"{can.name} ends a drive with a ramp of {can.own_slew:.4g} V/s, faster than the greatest slew "
            f"of {limits.max_slew:.4g} V/s"
        )
    duty = float(np.mean(np.abs(volts) > 0.01 * limits.max_voltage))
    if duty > limits.max_duty:
        raise LimitError(
            f"the drive is away from 0 V for {100 * duty:.3g} % of the run, more than the greatest duty "
            f"of {100 * limits.max_duty:.3g} %"
        )
