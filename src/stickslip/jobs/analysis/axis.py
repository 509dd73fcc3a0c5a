"""Axis of a map or a grid in a file: values between two ends."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...quantities.input_file import Strict
from ...quantities.units import QuantityError


class AxisSpec(Strict):
    """Values from `start` to `stop`, with equal differences, or equal ratios (`spacing: log`)."""

    start: float | str
    stop: float | str
    points: Annotated[int, Field(ge=2, le=1_000_000)]
    spacing: Literal["linear", "log"] = "linear"

    def between(self, first: float, last: float, name: str, unit: str = "") -> list[float]:
        """Return the values between these ends, in SI; raises QuantityError with name and unit."""
        if self.spacing == "linear":
            return np.linspace(first, last, self.points).tolist()
        if not (first > 0.0 and last > 0.0):
            above = f"0 {unit}".strip()
            raise QuantityError(f"{name}: spacing: log needs values above {above}, not {first:g} to {last:g}")
        return np.geomspace(first, last, self.points).tolist()
