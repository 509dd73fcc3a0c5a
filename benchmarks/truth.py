"""The net displacements of P3, from a method of none of the tools' settings; kept beside other results."""

from __future__ import annotations

from pathlib import Path

import numpy as np

TRUTH = Path(__file__).resolve().parents[1] / "out" / "benchmarks" / "members.npy"


def judge_members(net: np.ndarray) -> dict[str, float]:
    """What a row says of an ensemble: errors of the net displacements, m."""
    off = np.abs(net - np.load(TRUTH))
    return {"members": net.size, "median_error_m": float(np.median(off)), "max_error_m": float(np.max(off))}
