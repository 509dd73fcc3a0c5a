"""Capture settings: length, interval, trigger, pre-trigger, averaging."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, with_prefix
from .protocols import Array, RigError


class CaptureError(RigError):
    """A capture cannot be made as it was asked for: the trigger did not come, for example."""


class Trigger(NamedTuple):
    """When the channel `signal` passes `level` (SI, in the channel's unit) on a rising or falling edge."""

    signal: str
    level: float
    edge: Literal["rising", "falling"] = "rising"


@record
class Capture(NamedTuple):
    """One recording: its length, how far its samples are apart, and where it begins.

    Time 0 is `pre_trigger` before the trigger, or before the drive begins where there is no trigger.
    `average` runs are averaged into one recording.
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
        """How many there are."""
        return int(self.length / self.interval + 1e-6)

    @property
    def before(self) -> int:
        """How many of them are before the trigger."""
        return round(self.pre_trigger / self.interval)


def stride(capture: Capture, sample_rate: float) -> int:
    """Every which sample of the rig is kept.

    Raises:
        QuantityError: the interval is no whole multiple of the rig's.
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
    """The first sample, from `start` on, at which the values have passed the level; None if none has."""
    above = values >= trigger.level if trigger.edge == "rising" else values <= trigger.level
    crossings = np.flatnonzero(above[1:] & ~above[:-1]) + 1
    later = crossings[crossings >= max(start, 1)]
    return int(later[0]) if later.size else None


def picks(capture: Capture, sample_rate: float, trigger: int) -> NDArray[np.int64]:
    """The samples of the rig that make the recording, by their index, for a trigger at the sample
    `trigger`."""
    step = stride(capture, sample_rate)
    return trigger + (np.arange(capture.samples) - capture.before) * step
