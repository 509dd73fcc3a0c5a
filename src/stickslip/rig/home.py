"""Home: positions of the end-effector count from there, over runs, repeats and restarts.

A rig's readings keep counting from run to run, or begin anew with each: then its `origin` says how far the
end-effector had come before. Home is a reading and the origin at which it was taken, so the position is

    x = origin - origin_home + calibrated(reading) - calibrated(reading_home).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..calibration import Calibration
from ..recording.replacing import replaced_whole
from .protocols import Array


class Home:
    """The reading at home of each input that gave the position, and where the end-effector was seen last.

    `position` is in m from home, None before the first run. `origin` is that of a rig which begins each
    run at zero, kept here for the process that owns the rig after this one.
    """

    def __init__(self) -> None:
        self.readings: dict[str, tuple[float, float]] = {}
        self.position: float | None = None
        self.origin = 0.0

    def set(self, source: str, reading: float, origin: float) -> None:
        """Call where this input reads so (in the input's unit) home."""
        self.readings = {source: (reading, origin)}
        self.position = 0.0

    def positions(self, source: str, raw: Array, chain: Sequence[Calibration], origin: float) -> Array:
        """Readings [n] of an input as positions from home, m; the first reading ever is home itself."""
        if source not in self.readings:
            self.readings[source] = (float(raw[0]), origin)
        reading, before = self.readings[source]
        return origin - before + calibrated(raw, chain) - float(calibrated(raw[:1] * 0.0 + reading, chain)[0])

    def save(self, path: Path) -> None:
        """Keep it in a file, whole or not at all."""
        content = {"readings": self.readings, "position": self.position, "origin": self.origin}
        with replaced_whole(path) as temporary:
            temporary.write_text(json.dumps(content), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Home:
        """What a file keeps; a new one where there is none, or none that can be used."""
        made = cls()
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            made.readings = {str(k): (float(v[0]), float(v[1])) for k, v in found["readings"].items()}
            made.position = None if found["position"] is None else float(found["position"])
            made.origin = float(found["origin"])
        except (OSError, ValueError, LookupError, TypeError, AttributeError):
            return cls()
        return made


def calibrated(raw: Array, chain: Sequence[Calibration]) -> Array:
    """Readings through their calibrations, one after the other."""
    for calibration in chain:
        raw = calibration(raw)
    return raw
