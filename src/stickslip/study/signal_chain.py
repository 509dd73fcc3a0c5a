"""What stands between a model and what a position channel shows: kept with the results, for predictions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..report import Number


class SignalChain(NamedTuple):
    """Delay [s] and offset [m] of the channel, the scale that its position is divided by, and the slew rate
    of the amplifier [V/s]; `zeroed`: the mean of the position before the drive begins is taken off."""

    delay: float = 0.0
    offset: float = 0.0
    scale: float = 1.0
    slew_rate: float = math.inf
    zeroed: bool = False

    def numbers(self) -> dict[str, Any]:
        """For results.json; an infinite slew rate, which is the default, is left out."""
        found: dict[str, Any] = {
            "delay": Number(self.delay, "s"),
            "offset": Number(self.offset, "m"),
            "scale": Number(self.scale, ""),
            "zeroed": self.zeroed,
        }
        if math.isfinite(self.slew_rate):
            found["slew_rate"] = Number(self.slew_rate, "V/s")
        return found

    @classmethod
    def of(cls, numbers: Mapping[str, Any]) -> SignalChain:
        """From what was read from results.json; of a fit of walks, its delay and offset."""
        if "signal_chain" in numbers:
            known = numbers["signal_chain"]
        else:
            known = {k: v for k, v in numbers.get("parameters", {}).items() if k in ("delay", "offset")}
        return cls(**{k: v["value"] if isinstance(v, Mapping) else bool(v) for k, v in known.items()})
