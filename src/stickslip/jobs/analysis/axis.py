"""Axis of a map or of a grid in an input file: values between two ends."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...quantities.input_file import Strict
from ...quantities.units import QuantityError


class AxisSpec(Strict):
    """Axis: `points` values from `start` to `stop`, with equal differences or ratios (`spacing: log`).

    The ends are numbers in SI, or texts with units.
    """

    start: float | str
    stop: float | str
    points: Annotated[int, Field(ge=2, le=1_000_000)]
    spacing: Literal["linear", "log"] = "linear"

    def between(self, first: float, last: float, name: str, unit: str = "") -> list[float]:
        """Return the values of the axis as a list, both ends included.

        Args:
            first, last: `start` and `stop` in SI.
            name: name of the axis, for errors.
            unit: SI unit, for errors.

        Raises:
            QuantityError: the spacing is "log", and an end is not positive.
        """
        if self.spacing == "linear":
            return np.linspace(first, last, self.points).tolist()
        if not (first > 0.0 and last > 0.0):
            above = f"0 {unit}".strip()
            raise QuantityError(f"{name}: spacing: log needs values above {above}, not {first:g} to {last:g}")
        return np.geomspace(first, last, self.points).tolist()
