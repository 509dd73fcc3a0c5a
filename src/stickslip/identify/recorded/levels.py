"""Detection of the levels of an analogue-to-digital converter in readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Readings come from a converter if the distances between levels are whole steps within the share WHOLE. If
# more than the share MOST_LEVELS of the samples differ, some must move by several steps, because those of an
# even ramp move by one.
MOST_LEVELS, WHOLE = 0.25, 0.05


def converter_step(values: Array) -> float:
    """Return the step between the levels of values [n], in their unit; 0 without levels."""
    levels = np.unique(values)
    if levels.size < 2:
        return 0.0
    apart = np.diff(levels)
    step = float(apart[apart > 1e-6 * (levels[-1] - levels[0])].min())
    steps = apart / step
    if levels.size > MOST_LEVELS * values.size and float(np.max(np.abs(np.diff(values)))) < 1.5 * step:
        return 0.0
    return step if float(np.max(np.abs(steps - np.round(steps)))) < WHOLE else 0.0
