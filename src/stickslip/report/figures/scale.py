"""Scale of an axis or of a table column: one prefix for all its numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.units import with_prefix


class Scale(NamedTuple):
    """Scale of shown numbers: shown number = factor x SI number; `unit` is the shown unit."""

    factor: float
    unit: str

    def __call__(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the numbers to show for values in SI, in the shape of the values."""
        return np.asarray(values, dtype=float) * self.factor

    def label(self, name: str) -> str:
        """Return the label of an axis: name and shown unit, as in "position (µm)"."""
        return f"{name} ({self.unit})" if self.unit else name


def scale_for(unit: str, *values: ArrayLike) -> Scale:
    """Return the scale whose prefix suits the largest finite magnitude in all arrays of values.

    ``scale_for("m", [0, 28.8e-6])`` shows µm. Units that take no prefix ("kg", "rad/s", "") stay as they are.

    Args:
        unit: SI unit of the values.
        values: arrays or numbers in this unit.
    """
    magnitudes = [np.abs(np.asarray(array, dtype=float)) for array in values]
    largest = max((float(np.max(m, where=np.isfinite(m), initial=0.0)) for m in magnitudes), default=0.0)
    if largest == 0.0:
        return Scale(1.0, unit)
    shown, _, prefixed = with_prefix(largest, unit).partition(" ")
    return Scale(10.0 ** round(math.log10(float(shown) / largest)), prefixed)
