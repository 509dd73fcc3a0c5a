"""The best sawtooth over frequency and share of the rise, within the same limits and conditions."""

from __future__ import annotations

import numpy as np

from .search import Array, Judge, Merits, worst_of

FREQUENCIES = 25
# Zooms after the scan, points along each axis of one, and by how much each is narrower.
ZOOMS, POINTS, NARROWER = 4, 5, 0.4


def best_sawtooth(merits: Merits, judge: Judge, count: int) -> tuple[Array, int]:
    """Where it is, [rise, frequency] from 0 to 1 each, and how many members that took."""
    everything = np.arange(count)
    # Steep falls are where the best ones are: more of these, on either side.
    rises = np.array([0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.999])
    x = np.array([(r, f) for r in rises for f in np.linspace(0.0, 1.0, FREQUENCIES)])
    active = np.zeros(1, np.int64)
    scan = merits(x, active)
    spent = len(x)
    best = x[int(np.argmax(judge.score(scan, active)))]
    if count > 1:
        active = worst_of(merits(best[None], everything)[0], judge, active)
        scan = merits(x, active)
        spent += count + len(x) * active.size
        best = x[int(np.argmax(judge.score(scan, active)))]
    half = np.array([0.1, 1.0 / (FREQUENCIES - 1)])
    for _ in range(ZOOMS):
        offsets = np.linspace(-1.0, 1.0, POINTS)
        grid = np.array([(a, b) for a in offsets for b in offsets]) * half
        near = np.clip(best + grid, 0.0, 1.0)
        found = merits(near, active)
        spent += len(near) * active.size
        best = near[int(np.argmax(judge.score(found, active)))]
        half = half * NARROWER
    return best, spent
