"""Period by period: every peer is restarted where the drive jumps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..problems import PERIODS

Array = np.ndarray


def restarted(one_period: Callable[[Array], tuple[Array, Array]]) -> Callable[[], Array]:
    """All positions, from a function that takes the state at the start of a period to the positions at its
    samples (but the first) and the state at its end."""

    def run() -> Array:
        state, parts = np.zeros(5), [np.zeros(1)]
        for _ in range(PERIODS):
            positions, state = one_period(state)
            parts.append(positions)
        return np.concatenate(parts)

    return run
