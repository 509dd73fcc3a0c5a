"""Settings of a recording (capture): length, sampling interval, trigger, time before the trigger, averaging;
and the choice of the rig's samples that form the recording."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, with_prefix
from .protocols import Array, RigError


class CaptureError(RigError):
    """A recording cannot be made as requested: its trigger cannot come, or did not come in time."""


class Trigger(NamedTuple):
    """Trigger of a recording: the channel named `signal` crosses `level`.

    `level` is in the unit of the channel after its calibrations, SI. `edge` is the direction of the crossing:
    "rising" (upwards) or "falling" (downwards).
    """

    signal: str
    level: float
    edge: Literal["rising", "falling"] = "rising"


@record
class Capture(NamedTuple):
    """Length, sampling interval and start of one recording.

    The recording starts, at its time 0, `pre_trigger` seconds before the trigger; without a trigger it starts
    `pre_trigger` before the drive. The samples of `average` runs are averaged into one recording.
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
        """Return the number of samples of the recording before the trigger, or before the drive without
        one."""
        return round(self.pre_trigger / self.interval)


def stride(capture: Capture, sample_rate: float) -> int:
    """Return the number of rig samples per sample of the recording, which keeps one of them.

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
    """Return the index of the first sample that has reached the trigger's level in the trigger's direction.

    The sample before it has not reached the level. The result is None without such a crossing.

    Args:
        values: samples of the trigger's channel [n], in the unit of the trigger's level.
        trigger: level and edge.
        start: smallest index that counts; at least 1 is used.
    """
    above = values >= trigger.level if trigger.edge == "rising" else values <= trigger.level
    crossings = np.flatnonzero(above[1:] & ~above[:-1]) + 1
    later = crossings[crossings >= max(start, 1)]
    return int(later[0]) if later.size else None


def picks(capture: Capture, sample_rate: float, trigger: int) -> NDArray[np.int64]:
    """Return the indices of the rig's samples that form the recording, one per sample of the recording.

    Args:
        capture: settings of the recording.
        sample_rate: sampling rate of the rig, Hz.
        trigger: index of the rig's sample at the trigger, or at the start of the drive.

    Raises:
        QuantityError: as `stride`.
    """
    step = stride(capture, sample_rate)
    return trigger + (np.arange(capture.samples) - capture.before) * step
