"""Detection of the levels of an analogue-to-digital converter in readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Readings come from a converter if the distances between different readings are whole steps, within the share
# WHOLE of a step. The samples of an even ramp also have whole steps between them. So if the number of
# different readings exceeds the share MOST_LEVELS of the samples, at least one change between samples must be
# of several steps.
MOST_LEVELS, WHOLE = 0.25, 0.05


def converter_step(values: Array) -> float:
    """Return the step between converter levels in values [n], in their unit; 0 if they show no levels."""
    levels = np.unique(values)
    if levels.size < 2:
        return 0.0
    apart = np.diff(levels)
    step = float(apart[apart > 1e-6 * (levels[-1] - levels[0])].min())
    steps = apart / step
    if levels.size > MOST_LEVELS * values.size and float(np.max(np.abs(np.diff(values)))) < 1.5 * step:
        return 0.0
    return step if float(np.max(np.abs(steps - np.round(steps)))) < WHOLE else 0.0
