"""Home: the origin of end-effector positions, kept over runs, repeats and restarts.

The position readings of some rigs continue from run to run (`origin` is 0). Those of others start at zero in
each run; `origin` is then the displacement by all earlier runs. Home is a reading together with the origin at
that time. The position is

    x = origin - origin_home + calibrated(reading) - calibrated(reading_home).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..recording.calibration import Calibration
from ..recording.replacing import read_small, replaced_whole
from .limits import LimitError
from .protocols import Array, RigError


class Home:
    """Home of a rig, and the last position of the end-effector.

    `readings` gives, by name of the position input, its reading at home (in the unit of the input) and the
    origin [m or rad] at that time. `position` is the last position, m (rad) from home; None before the first
    run. `origin` [m or rad] is the displacement by all runs so far of a rig whose readings start at zero in
    each run; it is kept here for the next process that owns the rig.
    """

    def __init__(self) -> None:
        self.readings: dict[str, tuple[float, float]] = {}
        self.position: float | None = None
        self.origin = 0.0

    def set(self, source: str, reading: float, origin: float) -> None:
        """Make the position with this reading home, and the present position 0.

        Homes of other inputs are forgotten, because they belong to another position.

        Args:
            source: name of the position input.
            reading: its reading at home, in the unit of the input.
            origin: displacement by all earlier runs at that time, m (rad); 0 for a rig whose readings
                continue.
        """
        self.readings = {source: (reading, origin)}
        self.position = 0.0

    def positions(self, source: str, raw: Array, chain: Sequence[Calibration], origin: float) -> Array:
        """Return the positions from home [n], m (rad), of readings of an input.

        If the input has no home yet, its first reading becomes home.

        Args:
            source: name of the input.
            raw: readings [n], in the unit of the input.
            chain: calibrations of the input to m (rad).
            origin: displacement by all earlier runs now, m (rad); 0 for a rig whose readings continue.

        Raises:
            LimitError: a calibration gives no finite number, so that end stops could not be checked.
        """
        if source not in self.readings:
            self.readings[source] = (float(raw[0]), origin)
        reading, before = self.readings[source]
        with np.errstate(over="ignore", invalid="ignore"):
            zero = float(calibrated(raw[:1] * 0.0 + reading, chain)[0])
            found = origin - before + calibrated(raw, chain) - zero
        wrong = np.flatnonzero(~np.isfinite(found))
        if wrong.size:
            raise LimitError(
                f"the input {source!r} reads {raw[wrong[0]]:.6g}, from which comes a position of "
                f"{found[wrong[0]]}: stopped"
            )
        return found

    def save(self, path: Path) -> None:
        """Save home to a JSON file, which is replaced as a whole, so that a crash leaves no damaged file."""
        content = {"readings": self.readings, "position": self.position, "origin": self.origin}
        with replaced_whole(path) as temporary:
            temporary.write_text(json.dumps(content), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Home:
        """Return the home that a file contains; a new home if there is no file.

        Raises:
            RigError: the file is damaged. End stops would otherwise have a wrong origin.
        """
        made = cls()
        try:
            found = read_small(path)
            if found is None:
                return made
            made.readings = {str(k): (_finite(v[0]), _finite(v[1])) for k, v in found["readings"].items()}
            made.position = None if found["position"] is None else _finite(found["position"])
            made.origin = _finite(found["origin"])
        except (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError) as error:
            raise RigError(
                f"{path} is damaged ({error}), and end stops count from what it says: restore it, or remove "
                "it, which calls home where the end-effector is at the next run"
            ) from None
        return made


def _finite(value: object) -> float:
    number = float(value)  # type: ignore[arg-type]
    if not math.isfinite(number):
        raise ValueError(f"{number} is not finite")
    return number


def calibrated(raw: Array, chain: Sequence[Calibration]) -> Array:
    """Return the readings `raw` [n] after all calibrations of the chain, in the unit of the last one."""
    for calibration in chain:
        raw = calibration(raw)
    return raw
