"""Sequence of waveforms, one after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from ..quantities import registry
from ..quantities.records import Quantity
from ..quantities.units import QuantityError
from .drive import Drive, constant
from .pieces import cut, join
from .signal import Waveform, breaks_within, slope_at, value_at

_DURATION = Quantity("s", "T", "duration of a part", above=0)


@dataclass(frozen=True, init=False)
class Sequence:
    """Waveforms one after the other, each from its own start.

    An example is a walk forward, a rest, and a walk back::

        Sequence(Sawtooth(65, 5, periods=8), Rest(0.5), ReverseSawtooth(65, 5, periods=8))

    A part is a waveform of finite duration, or a pair (waveform, duration in s); the duration of a pair cuts
    the waveform off or lengthens its final rest. After the last part the signal keeps its final value.

    Raises:
        QuantityError: no parts, an endless part without a duration, a duration that is not above 0, or parts
            in different units.
    """

    parts: tuple[tuple[Waveform, float], ...]

    value, slope, breaks = value_at, slope_at, breaks_within

    def __init__(self, *parts: Waveform | tuple[Waveform, float | str]) -> None:
        if not parts:
            raise QuantityError("Sequence has no parts: at least one waveform is needed")
        timed = tuple(_timed(part, f"Sequence.parts[{i}]") for i, part in enumerate(parts))
        unit = timed[0][0].unit
        for i, (waveform, _) in enumerate(timed):
            if waveform.unit != unit:
                raise QuantityError(f"Sequence.parts[{i}] is in {waveform.unit}, the first part in {unit}")
        object.__setattr__(self, "parts", timed)

    @property
    def unit(self) -> str:
        """Return the unit of all parts: "V", "m" or "rad"."""
        return self.parts[0][0].unit

    @property
    def period(self) -> None:
        """Return None: a sequence does not repeat."""

    @property
    def duration(self) -> float:
        """Return the total duration, s."""
        return math.fsum(length for _, length in self.parts)

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value of all parts.

        The range may be too wide if a part is cut off before it reaches an extreme value.
        """
        ranges = [waveform.range() for waveform, _ in self.parts]
        return min(low for low, _ in ranges), max(high for _, high in ranges)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        begins = [0.0, *accumulate(length for _, length in self.parts)]
        drives = [
            cut(waveform.drive(min(length, duration - begin)), length)
            for (waveform, length), begin in zip(self.parts, begins, strict=False)
            if begin < duration or begin == 0
        ]
        if begins[-1] < duration:
            last, length = self.parts[-1]
            drives.append(constant(float(value_at(last, length))))
        return cut(join(drives, begins[: len(drives)]), duration)


def _timed(part: Any, field: str) -> tuple[Waveform, float]:
    if hasattr(part, "drive"):  # test this first, because a waveform that is a record is also a tuple
        if not math.isfinite(part.duration):
            raise QuantityError(
                f"{field} is an endless {type(part).__name__}: give (waveform, duration in s), or periods"
            )
        return part, part.duration
    if isinstance(part, tuple) and len(part) == 2 and hasattr(part[0], "drive"):
        return part[0], _DURATION.check(part[1], f"{field} duration")
    raise QuantityError(f"{field} = {part!r} is neither a waveform nor a pair (waveform, duration in s)")


registry.waveforms.add(Sequence)
