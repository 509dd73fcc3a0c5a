"""What a row says of a fit: how far it ended from the global optimum, in standard errors there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import numpy as np

# Of P4, from a fit with simulations at a relative tolerance of 1e-11; its reduced chi-square is 0.9736.
OPTIMUM = np.array([1.3836e6, 37.04, 0.53992])
STANDARD_ERRORS = np.array([9.6e3, 2.0, 2.7e-4])
# The simulation's own error moves the optimum by some hundredths of these; another minimum is many away.
SAME = 0.2


def _away(values: np.ndarray) -> np.ndarray:
    return np.max(np.abs(values - OPTIMUM) / STANDARD_ERRORS, axis=-1)


def judge_fit(values: np.ndarray) -> dict[str, object]:
    away = float(_away(values))
    return {
        "values": [float(f"{v:.6g}") for v in values],
        "away_in_standard_errors": away,
        "global": away < SAME,
    }


SECONDS = 60.0  # for fits from a hundred starts


def from_all(fit: Callable[[np.ndarray], np.ndarray], starts: Iterable[np.ndarray]) -> np.ndarray:
    """The values that fits from as many of the starts as there is time for end in; NaN where one fails."""
    end, found = time.perf_counter() + SECONDS, []
    for start in starts:
        if time.perf_counter() > end:
            break
        try:
            found.append(fit(start))
        except (ArithmeticError, RuntimeError, ValueError, np.linalg.LinAlgError):
            found.append(np.full(3, np.nan))
    return np.array(found)


def judge_starts(values: np.ndarray) -> dict[str, int]:
    """Of fits from many starts; one that gave nothing is a row of NaN."""
    return {"starts": len(values), "at_the_optimum": int(np.count_nonzero(_away(values) < SAME))}
