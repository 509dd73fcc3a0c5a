"""Limits, and the one gate that every output passes."""

from __future__ import annotations

import math
import time
from typing import Annotated, NamedTuple

import numpy as np

from ..records import Quantity, record
from ..units import QuantityError, with_prefix
from .protocols import Array, Capabilities, DriveOutput, RigError

_INF = math.inf


class LimitError(RigError):
    """An output was refused, or stopped, because it passed a limit; names the limit and the value."""


@record
class Limits(NamedTuple):
    """What no output may pass, at the piezo.

    `max_duty` is the greatest share of a run in which the drive is away from 0 V, by more than a hundredth of
    `max_voltage`; `min_position` and `max_position` are end stops of the end-effector's travel, watched while
    it runs; `watchdog` is the longest silence of the rig. Stop is a ramp to 0 V at `stop_slew`.
    """

    min_voltage: Annotated[float, Quantity("V", "u_min", "least voltage", maximum=0)] = 0.0
    max_voltage: Annotated[float, Quantity("V", "u_max", "greatest voltage", minimum=0)] = 150.0
    max_slew: Annotated[float, Quantity("V/s", "R_max", "greatest slew", above=0, maximum=_INF)] = _INF
    max_duty: Annotated[float, Quantity("", "D", "greatest duty", minimum=0, maximum=1)] = 1.0
    min_position: Annotated[float, Quantity("m", "x_min", "end stop", minimum=-_INF, maximum=0)] = -_INF
    max_position: Annotated[float, Quantity("m", "x_max", "end stop", minimum=0, maximum=_INF)] = _INF
    watchdog: Annotated[float, Quantity("s", "T_w", "longest silence", above=0)] = 5.0
    stop_slew: Annotated[float, Quantity("V/s", "R_0", "slew of the ramp to 0 V", minimum=1)] = 1000.0

    def _check(self) -> None:
        if self.stop_slew > self.max_slew:
            raise QuantityError(
                f"Limits.stop_slew = {self.stop_slew:g} V/s is out of range: it must be <= max_slew = "
                f"{self.max_slew:g} V/s"
            )

    @property
    def end_stops(self) -> bool:
        """Whether the travel is limited."""
        return math.isfinite(self.min_position) or math.isfinite(self.max_position)


def check_drive(volts: Array, limits: Limits, can: Capabilities) -> None:
    """Raises LimitError unless a run of these values [n], V, from 0 V on, is allowed on such a rig."""
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
            raise LimitError(f"the drive reaches {value:.6g} V, {words} of {limit:.6g} V")
    slew = float(np.abs(np.diff(volts, prepend=0.0)).max()) * can.update_rate
    if slew > limits.max_slew * (1 + 1e-9):
        raise LimitError(
            f"the drive changes at {slew:.4g} V/s, faster than the greatest slew of "
            f"{limits.max_slew:.4g} V/s (a sawtooth with rise_fraction < 1 has no jumps)"
        )
    duty = float(np.mean(np.abs(volts) > 0.01 * limits.max_voltage))
    if duty > limits.max_duty:
        raise LimitError(
            f"the drive is away from 0 V for {100 * duty:.3g} % of the run, more than the greatest duty "
            f"of {100 * limits.max_duty:.3g} %"
        )


class Gate:
    """The way to a rig's output: nothing is put out that the limits do not allow.

    Limits hold for what is asked for; a converter then takes one of its steps beside it.
    """

    def __init__(self, output: DriveOutput, limits: Limits, capabilities: Capabilities) -> None:
        self._output, self._limits, self._can = output, limits, capabilities
        self._heard = 0.0

    def load(self, volts: Array) -> None:
        """Check the drive and hand it to the output; raises LimitError."""
        check_drive(volts, self._limits, self._can)
        self._output.load(volts)

    def start(self) -> None:
        """Start the output that was loaded, and the watchdog."""
        self._heard = time.monotonic()
        self._output.start()

    def heard(self, samples: int) -> None:
        """The rig gave so many samples; raises LimitError where it has been silent for too long."""
        now = time.monotonic()
        if samples:
            self._heard = now
        elif now - self._heard > self._limits.watchdog:
            raise LimitError(
                f"watchdog: nothing came from {self._can.name} for {with_prefix(now - self._heard, 's')}"
            )

    def watch(self, positions: Array) -> None:
        """Positions [n] of the end-effector, m; raises LimitError where one is beyond an end stop."""
        for value, limit, sign in (
            (float(positions.min(initial=_INF)), self._limits.min_position, -1),
            (float(positions.max(initial=-_INF)), self._limits.max_position, 1),
        ):
            if sign * (value - limit) > 0.0 and positions.size:
                raise LimitError(
                    f"the end-effector is at {with_prefix(value, 'm')}, beyond the end stop at "
                    f"{with_prefix(limit, 'm')}: stopped"
                )

    def stop(self) -> None:
        """A safe ramp to 0 V, from wherever the output is."""
        self._output.stop(self._limits.stop_slew)
