"""Pareto front of two goals: drives for which no other drive is as good in both goals and better in one.

Differential evolution of a population: after each generation the candidates stay that no other one dominates
in both goals; of crowded candidates some are removed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from ..quantities.progress import Progress, unheard
from ..quantities.units import unit_for
from ..waveform.knots import PeriodicKnots
from .goals import extras_of, swings_of
from .moving import exactly, moved
from .polygons import Array, knots, sawtooths, starts
from .sawtooth import best_sawtooth
from .search import Judge, Task, robust
from .searched import Searched

# Differential evolution. FACTOR: weight of the difference of two candidates, which is added to a third one.
# CHANCE: probability that a coordinate of a candidate is replaced by the coordinate of this sum.
FACTOR, CHANCE = 0.5, 0.7
# Number of candidates in the search for the first goal alone. The best drive of this search and the best
# sawtooth, and copies of both with a smaller voltage swing, are part of the initial population.
FIRST = 1000


@dataclass(frozen=True, eq=False)
class Front:
    """Pareto front of two goals: drives from the worst to the best value of the first goal.

    Attributes:
        waveforms: drive of each point of the front.
        table: over "point": a variable for each goal, named by the goal's label with "_" for spaces: its
            value in its worst condition, SI; and `frequency`, Hz.
        evaluations: number of computed periodic motions.
        interrupted: True if Ctrl-C stopped the search; the front is then the best one found so far.
    """

    waveforms: tuple[PeriodicKnots, ...]
    table: xr.Dataset
    evaluations: int
    interrupted: bool = False


def front_of(
    searched: list[Searched], count: int, points: int, generations: int, seed: int, progress: Progress
) -> Front:
    """Return the Pareto front of two goals.

    Args:
        searched: two searches that differ only in their goal.
        count: number of knots of a drive.
        points: number of candidates in the population, and largest number of points of the front.
        generations: number of generations.
        seed: seed of the search.
        progress: called after each generation with activity and finished fraction. Ctrl-C ends the search
            with the best front so far.

    Raises:
        QuantityError: random sawtooths cause no steady motion, see `Searched.scaled`.
    """
    random = np.random.default_rng([seed, 2])
    one = searched[0].scaled(random)
    allowed, conditions = one.allowed, len(one.conditions.names)
    swings, judge = swings_of(one.goal), Judge(0.0, None, one.scale)
    saw, spent = best_sawtooth(one.merits_of(sawtooths), judge, conditions, swings)
    begin = starts(sawtooths(saw[None], allowed), count, allowed)
    task = Task(one.merits_of(knots), Judge(0.0, None, one.scale), conditions, FIRST, random, unheard)
    best = robust(task, begin)
    spent += best.evaluations
    shares = np.linspace(0.2, 1.0, points // 4)[:, None]
    flat = [
        np.column_stack([0.5 + shares * (z[:-1] - 0.5), np.full(shares.size, z[-1])])
        for z in (best.x, begin[0])
    ]
    seeds = np.concatenate(flat)
    x = np.concatenate([seeds, random.random((points - len(seeds), count + 1))])
    merits = _merits(searched, x)
    done, interrupted = 0, best.interrupted
    try:
        while done < generations and not interrupted:
            a, b, c = (x[random.permutation(points)] for _ in range(3))
            moved = np.where(random.random(x.shape) < CHANCE, a + FACTOR * (b - c), x)
            # Coordinates beyond the bounds 0 and 1 are reflected at them.
            moved = np.clip(1.0 - np.abs(1.0 - np.abs(moved)), 0.0, 1.0)
            every, found = np.concatenate([x, moved]), np.concatenate([merits, _merits(searched, moved)])
            stay = selected(found, points)
            x, merits = every[stay], found[stay]
            done += 1
            progress("searching for a front", done / generations)
    except KeyboardInterrupt:
        interrupted = True
    spent += points * (done + 1) * conditions
    front = _exact(searched, x[np.isfinite(merits).all(axis=1)], spent)
    return replace(front, interrupted=interrupted)


def _merits(searched: list[Searched], x: Array) -> Array:
    """Return the merits of candidates in both goals, each in its worst condition, shape [n, 2].

    A merit is a goal's value with the sign that makes larger values better; minus infinity if a condition has
    no periodic motion.

    Args:
        searched: searches of both goals.
        x: candidates, search points of `polygons.knots`, [n, coordinates] from 0 to 1.
    """
    one = searched[0]
    shapes = knots(x, one.allowed)
    extras = extras_of(*(of.goal for of in searched))
    ways = moved(one.model, shapes, one.conditions.columns, one.threads, extras=extras)
    found = np.stack([of.merits(shapes, ways).min(axis=1) for of in searched], axis=1)
    found[np.isnan(ways.steps).any(axis=1)] = -np.inf
    return found


def selected(merits: Array, count: int) -> Any:
    """Return the indices of the `count` candidates that stay in the population, from merits [n, 2].

    Larger merits are better; n must be at least `count`.
    First all candidates stay that no other one dominates, then those that only these dominate, and so on
    (front by front). From the last front, the most crowded candidates are removed one by one (see `_gaps`).
    """
    left, stay = np.arange(len(merits)), list[int]()
    while len(stay) < count:
        front = left[unbeaten(merits[left])]
        left = np.setdiff1d(left, front)
        front = front[np.argsort(merits[front, 0])]
        while len(stay) + front.size > count:
            front = np.delete(front, int(np.argmin(_gaps(merits[front]))))
        stay.extend(front.tolist())
    return np.array(stay)


def unbeaten(merits: Array) -> Any:
    """Return a mask [n] of the candidates, from merits [n, goals], that are not dominated: no other one is at
    least as good in all goals and better in one."""
    as_good = (merits[:, None, :] >= merits[None, :, :]).all(axis=2)
    better = (merits[:, None, :] > merits[None, :, :]).any(axis=2)
    return ~(as_good & better).any(axis=0)


def _gaps(merits: Array) -> Array:
    """Return the crowding distance of each candidate, [n], from merits [n, goals] sorted along the front.

    The crowding distance is the distance between the two neighbours of a candidate, relative to the range and
    summed over the goals. At both ends of the front it is infinite, so they stay.
    """
    gaps = np.full(len(merits), np.inf)
    fine = np.where(np.isfinite(merits), merits, 0.0)
    span = np.maximum(np.ptp(fine, axis=0), 1e-300)
    gaps[1:-1] = (np.abs(fine[2:] - fine[:-2]) / span).sum(axis=1)
    return gaps


def _exact(searched: list[Searched], x: Array, spent: int) -> Front:
    """Return the front of some candidates, computed again at the tolerances of a result.

    Drives that are then dominated, or have no periodic motion in some condition, are left out.

    Args:
        searched: searches of both goals.
        x: candidates, search points of `polygons.knots`, [n, coordinates] from 0 to 1.
        spent: number of periodic motions computed so far, for the front's `evaluations`.
    """
    one = searched[0]
    shapes = knots(x, one.allowed)
    drives = [shapes.one(i) for i in range(len(x))]
    extras = extras_of(*(of.goal for of in searched))
    ways = exactly(one.model, list(drives), one.conditions.columns, one.threads, extras)
    merits = np.stack([of.merits(shapes, ways).min(axis=1) for of in searched], axis=1)
    fine = np.flatnonzero(np.isfinite(merits).all(axis=1))
    fine = fine[unbeaten(merits[fine])]
    order = fine[np.argsort(merits[fine, 0])]
    data: dict[str, Any] = {}
    for of, column in zip(searched, merits[order].T, strict=True):
        about = {"units": unit_for(one.model, of.goal.unit), "long_name": of.goal.label}
        data[of.goal.label.replace(" ", "_")] = ("point", of.goal.sign * column, about)
    data["frequency"] = ("point", 1.0 / shapes.period[order], {"units": "Hz", "long_name": "frequency"})
    return Front(tuple(drives[i] for i in order), xr.Dataset(data), spent + ways.steps.size)
