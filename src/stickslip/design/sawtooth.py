"""Search for the best sawtooth: frequency, share of the rise and swing, within the limits and conditions of a
drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .search import Array, Judge, Merits, worst_of

# Number of frequencies in the first scan, evenly spaced on the logarithmic scale of the allowed range.
FREQUENCIES = 25
# After the scan, finer grids around the best sawtooth are computed in turn (zooms over rise and frequency).
# ZOOMS: number of these grids; POINTS: their points along each axis; NARROWER: size relative to the previous
# one.
ZOOMS, POINTS, NARROWER = 4, 5, 0.4
# Then the swing alone is refined, to reach a given step size. SWINGS: half-widths of the range of each
# refinement, as shares of the whole swing; LINE: its points, relative to the half-width.
SWINGS, LINE = (0.5, 0.05, 5e-3, 5e-4, 5e-5), np.linspace(-1.0, 1.0, 21)


def best_sawtooth(merits: Merits, judge: Judge, count: int, swings: Sequence[float]) -> tuple[Array, int]:
    """Return the best sawtooth, a point of `polygons.sawtooths` [rise, frequency, swing] with coordinates
    from 0 to 1, and the number of computed periodic motions.

    Args:
        merits: function of points [n, 3] and indices of conditions that returns merits [n, conditions], to be
            maximised.
        judge: conversion of the merits of a candidate to one number.
        count: number of conditions. The grid is scanned in the first condition alone, then in the worst
            conditions of the best sawtooth.
        swings: swings of the scanned sawtooths, as shares of the allowed voltage range.
    """
    everything = np.arange(count)
    # Shares of the rise near 0 and 1 (a steep rise or fall) are tried more densely: the best ones are there.
    rises = np.array([0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.999])
    x = np.array([(r, f, s) for s in swings for r in rises for f in np.linspace(0.0, 1.0, FREQUENCIES)])
    active = np.zeros(1, np.int64)
    scan = merits(x, active)
    spent = len(x)
    best = x[int(np.argmax(judge.score(scan, active)))]
    if count > 1:
        active = worst_of(merits(best[None], everything)[0], judge, active)
        scan = merits(x, active)
        spent += count + len(x) * active.size
        best = x[int(np.argmax(judge.score(scan, active)))]
    half = np.array([0.1, 1.0 / (FREQUENCIES - 1), 0.0])
    for _ in range(ZOOMS):
        offsets = np.linspace(-1.0, 1.0, POINTS)
        grid = np.array([(a, b, 0.0) for a in offsets for b in offsets]) * half
        near = np.clip(best + grid, 0.0, 1.0)
        found = merits(near, active)
        spent += len(near) * active.size
        best = near[int(np.argmax(judge.score(found, active)))]
        half = half * NARROWER
    for reach in SWINGS:
        # The first row stays the best sawtooth so far; the others vary its swing.
        near = np.tile(best, (LINE.size + 1, 1))
        near[1:, 2] = np.clip(best[2] + reach * LINE, 0.0, 1.0)
        found = merits(near, active)
        spent += len(near) * active.size
        best = near[int(np.argmax(judge.score(found, active)))]
    return best, spent
