"""Capture settings: length, interval, trigger, pre-trigger, averaging."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, with_prefix
from .protocols import Array, RigError


class CaptureError(RigError):
    """A capture cannot be made as requested, for example because the trigger did not come."""


class Trigger(NamedTuple):
    """Trigger of a recording: the channel `signal` crosses `level`, upwards ("rising") or downwards.

    `level` is in the unit of the channel after its calibration, SI.
    """

    signal: str
    level: float
    edge: Literal["rising", "falling"] = "rising"


@record
class Capture(NamedTuple):
    """Length, sampling interval and start of one recording.

    The recording starts, at time 0, `pre_trigger` before the trigger; without a trigger it starts
    `pre_trigger` before the drive. `average` runs are averaged into one recording.
    """

    length: Annotated[float, Quantity("s", "T", "length", above=0)]
    interval: Annotated[float, Quantity("s", "Δt", "sampling interval", above=0)]
    pre_trigger: Annotated[float, Quantity("s", "T_0", "time before the trigger", minimum=0)] = 0.0
    trigger: Trigger | None = None
    average: Annotated[float, Quantity("", "N", "runs to average", minimum=1, maximum=10_000)] = 1

    def _check(self) -> None:
        if self.pre_trigger >= self.length:
            raise QuantityError(
                f"Capture.pre_trigger = {with_prefix(self.pre_trigger, 's')} is out of range: it must be "
                f"< length = {with_prefix(self.length, 's')}"
            )
        if self.length < 2 * self.interval:
            raise QuantityError(f"Capture.length = {with_prefix(self.length, 's')} is below two samples")
        if self.average % 1:
            raise QuantityError(f"Capture.average = {self.average:g} must be a whole number")

    @property
    def samples(self) -> int:
        """Return the number of samples of the recording."""
        return int(self.length / self.interval + 1e-6)

    @property
    def before(self) -> int:
        """Return the number of samples of the recording before the trigger."""
        return round(self.pre_trigger / self.interval)


def stride(capture: Capture, sample_rate: float) -> int:
    """Return how many samples of the rig correspond to one sample of the recording.

    Args:
        capture: settings of the recording.
        sample_rate: samples per second of the rig, Hz.

    Raises:
        QuantityError: the recording's interval is not a whole multiple of the rig's sampling interval.
    """
    ratio = capture.interval * sample_rate
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > 1e-6 * whole:
        raise QuantityError(
            f"Capture.interval = {with_prefix(capture.interval, 's')} must be a whole multiple of the rig's "
            f"{with_prefix(1 / sample_rate, 's')}"
        )
    return whole


def find_trigger(values: Array, trigger: Trigger, start: int) -> int | None:
    """Return the index of the first sample after a crossing of the trigger's level; None without a crossing.

    Args:
        values: samples of the trigger's channel [n].
        trigger: level and edge.
        start: least index that counts, at least 1.
    """
    above = values >= trigger.level if trigger.edge == "rising" else values <= trigger.level
    crossings = np.flatnonzero(above[1:] & ~above[:-1]) + 1
    later = crossings[crossings >= max(start, 1)]
    return int(later[0]) if later.size else None


def picks(capture: Capture, sample_rate: float, trigger: int) -> NDArray[np.int64]:
    """Return the indices [samples] of the rig's samples that form the recording.

    `sample_rate` is that of the rig, Hz, and `trigger` the index of the rig's sample at the trigger.
    """
    step = stride(capture, sample_rate)
    return trigger + (np.arange(capture.samples) - capture.before) * step
