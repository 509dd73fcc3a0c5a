"""Optimisation algorithm for drives: the candidates of a generation are computed under all active conditions
in one call.

Differential evolution [storn1997] brings a population (initial guesses and the best of random candidates)
near an optimum, and CMA-ES [hansen2016] refines it. With several conditions, the worst one alone is used
first, which is fast and finds the right region. Then candidates are judged by the worst few conditions, which
are determined again whenever the best candidate is computed under all of them. For the reasons see
docs/decisions/design.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..quantities.progress import Progress
from ..quantities.units import QuantityError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Type of the function that a search maximises. Its arguments are candidates [n, coordinates from 0 to 1] and
# indices of conditions; it returns merits [n, conditions], NaN without a periodic motion.
Merits = Callable[[Array, Index], Array]

# SCOUTS: share of the budget (number of candidates) for one round of random candidates. FOR_HILL: share of
# the budget for one such round and for differential evolution together.
# POPULATION, OF_BUDGET: largest population of differential evolution, as a number and as a share of the
# budget. GENERATION: number of candidates in a generation of CMA-ES.
SCOUTS, FOR_HILL = 0.125, 0.5
POPULATION, OF_BUDGET, GENERATION = 50, 0.025, 16
# LOOKS: largest number of rounds of random candidates. LEVEL: the rounds end when the best score exceeds the
# median by this share of the scale of merits. If most drives cause no motion, more must be tried.
LOOKS, LEVEL = 4, 0.02
# Initial standard deviation of the coordinates (0 to 1) in CMA-ES: WIDE from a single initial guess, NEAR
# around the result of an earlier search.
WIDE, NEAR = 0.3, 0.08
# Smallest distance of the initial point of CMA-ES from the bounds 0 and 1 of each coordinate.
INSIDE = 0.02
# ACTIVE: largest number of conditions that one round adds to those by which candidates are judged (half by
# merit, half by shortfall below the baseline). ROUNDS: largest number of rounds.
ACTIVE, ROUNDS = 4, 4
# Divisor of the budget for the second and each later round with several conditions; the first round uses half
# of the budget.
LATER = 6
# Largest number of conditions that represent all conditions if candidates are judged by a quantile.
RANKS = 24
# Smallest gain of the score in a round, relative to the scale of merits, after which another round follows.
# The first round needs no gain. Another round also needs a new condition by which to judge.
GAIN = 2e-5
DOING = "searching for a drive signal"
# Factor of the penalty in a merit or score for a shortfall below the baseline, the minimum speed or the
# required holding force.
SHORTFALL = 10.0


class Judge(NamedTuple):
    """Conversion of a candidate's merits under several conditions to one score, which a search maximises.

    The score is the `quantile` of the merits (0: the worst), minus a penalty for merits below the `baseline`
    [conditions] (None: no penalty). `scale` is the size of a typical merit, by which a candidate without a
    periodic motion gets a low score.
    """

    quantile: float
    baseline: Array | None
    scale: float

    def score(self, merits: Array, which: Index) -> Array:
        lost = np.isnan(merits)
        full = np.where(lost, 0.0, merits)
        worst = full.min(axis=1) if self.quantile == 0.0 else np.quantile(full, self.quantile, axis=1)
        if self.baseline is not None:
            short = np.maximum(self.baseline[which] - full, 0.0).max(axis=1)
            worst = worst - SHORTFALL * np.where(short > 1e-9 * self.scale, short, 0.0)
        return np.where(lost.any(axis=1), -100.0 * self.scale * (1.0 + lost.mean(axis=1)), worst)


class Task(NamedTuple):
    """Search for the candidate with the highest score.

    Fields: function of the `merits`; `judge`, which converts merits to a score; number of `conditions`;
    `budget`, number of candidates in the first search; generator of `random` numbers; and `progress`, called
    with activity and finished fraction.
    """

    merits: Merits
    judge: Judge
    conditions: int
    budget: int
    random: np.random.Generator
    progress: Progress


class Best(NamedTuple):
    """Result of a search: the best point `x` [coordinates from 0 to 1], its `score` under all conditions, the
    number of computed periodic motions (`evaluations`), and `interrupted`, True if Ctrl-C stopped the
    search."""

    x: Array
    score: float
    evaluations: int
    interrupted: bool = False


def robust(task: Task, starts: Array) -> Best:
    """Return the best candidate under all conditions.

    Args:
        task: the search.
        starts: initial guesses [n, coordinates]. With a single initial guess and one condition, the search is
            CMA-ES from this guess alone.

    Raises:
        QuantityError: the package cma is not installed.
    """
    everything = np.arange(task.conditions)
    merits = task.merits(starts, everything)
    scores = task.judge.score(merits, everything)
    first = int(np.argmax(scores))
    best, spent = Best(starts[first], float(scores[first]), 0), len(starts) * task.conditions
    active = worst_of(merits[first], task.judge, np.zeros(0, np.int64))
    initial, spread, share, begun = starts[first], WIDE, task.budget, 0.0
    if len(starts) > 1 or task.conditions > 1:
        # The search in one condition takes this share of the whole progress.
        begun = 1.0 if task.conditions == 1 else 0.5
        part = task._replace(progress=lambda doing, done: task.progress(doing, begun * done))
        initial, tried, stopped = _of_one(part, starts, _worst(merits[first]))
        found = task.merits(initial[None], everything)
        score, spent = float(task.judge.score(found, everything)[0]), spent + tried + task.conditions
        best = Best(initial, score, 0) if score > best.score else best
        if stopped or task.conditions == 1:
            return best._replace(evaluations=spent, interrupted=stopped)
        active, spread, share = worst_of(found[0], task.judge, active), NEAR, task.budget // 2
    for turn in range(ROUNDS):
        part = task._replace(
            progress=lambda doing, done, turn=turn: task.progress(
                doing, begun + (1.0 - begun) * (turn + done) / ROUNDS
            ),
        )
        found, tried, stopped = evolved(part, initial, spread, active, share)
        merits = task.merits(found[None], everything)
        score = float(task.judge.score(merits, everything)[0])
        spent += tried * active.size + task.conditions
        gained = score - best.score
        if gained > 0.0:
            best = Best(found, score, 0)
        if stopped:
            best = best._replace(interrupted=True)
            break
        wider = worst_of(merits[0], task.judge, active)
        if wider.size == active.size or (turn and gained < GAIN * task.judge.scale):
            break
        active, initial, spread, share = wider, found, NEAR, task.budget // LATER
    return best._replace(evaluations=spent)


def _worst(merits: Array) -> Index:
    """Return the index of the worst condition, as an array of one element, from a candidate's merits
    [conditions]; a condition without a periodic motion (NaN) is worst."""
    return np.array([int(np.argmin(np.where(np.isnan(merits), -np.inf, merits)))])


def _of_one(task: Task, starts: Array, which: Index) -> tuple[Array, int, bool]:
    """Search in one condition by differential evolution, then CMA-ES; return the best candidate, the number
    of computed candidates, and True if Ctrl-C stopped the search.

    If the task has several conditions, its baseline (the merits of the best sawtooth) is not used here:
    almost every other drive is worse than the baseline in some condition, so the penalty would lead back to
    the sawtooth. `which` is the index of the condition, [1].
    """
    if task.conditions > 1:
        task = task._replace(judge=Judge(0.0, None, task.judge.scale))
    told = task.progress
    part = task._replace(progress=lambda doing, done: told(doing, FOR_HILL * done))
    found, tried, stopped = _hill(part, starts, which)
    if stopped:
        return found, tried, True
    part = task._replace(progress=lambda doing, done: told(doing, FOR_HILL + (1.0 - FOR_HILL) * done))
    found, more, stopped = evolved(part, found, NEAR, which, max(task.budget - tried, 1))
    return found, tried + more, stopped


def _hill(task: Task, starts: Array, which: Index) -> tuple[Array, int, bool]:
    """Search by differential evolution; return the best point, the number of computed candidates, and True if
    Ctrl-C stopped the search.

    The initial population is the initial guesses `starts` [n, coordinates] and the best of random candidates.
    `which` are indices of the conditions by which candidates are judged.
    """
    x, scores = starts, task.judge.score(task.merits(starts, which), which)
    for _ in range(LOOKS):
        more = task.random.random((round(SCOUTS * task.budget), starts.shape[1]))
        x = np.concatenate([x, more])
        scores = np.concatenate([scores, task.judge.score(task.merits(more, which), which)])
        if scores.max() > np.median(scores) + LEVEL * task.judge.scale:
            break
    size = int(np.clip(OF_BUDGET * task.budget, 5, POPULATION))
    random = np.argsort(-scores[len(starts) :])[: max(size - len(starts), 0)]
    population = np.concatenate([starts, x[len(starts) + random]])
    k = int(np.argmax(scores))
    best, tried = (float(scores[k]), x[k]), len(x)
    # SciPy's differential evolution needs at least five candidates.
    if len(population) < 5:
        return best[1], tried, False

    def cost(columns: Array) -> Array:
        nonlocal best, tried
        own = np.clip(columns.T, 0.0, 1.0)
        scores, tried = task.judge.score(task.merits(own, which), which), tried + len(own)
        k = int(np.argmax(scores))
        best = max(best, (float(scores[k]), own[k]), key=lambda one: one[0])
        task.progress(DOING, min(tried / (FOR_HILL * task.budget), 1.0))
        return -scores / task.judge.scale

    generations = max(int((FOR_HILL - SCOUTS) * task.budget / len(population)) - 1, 0)
    try:
        scipy.optimize.differential_evolution(
            cost, [(0.0, 1.0)] * x.shape[1], maxiter=generations, rng=task.random,
            init=population,  # pyright: ignore[reportArgumentType]
            vectorized=True, updating="deferred", polish=False, tol=0.0,
        )  # fmt: skip
    except KeyboardInterrupt:
        return best[1], tried, True
    return best[1], tried, False


def worst_of(merits: Array, judge: Judge, before: Index) -> Index:
    """Return the ascending indices of the conditions by which candidates are judged next.

    They are the previous ones, those in which the best candidate has the lowest merits, and those in which
    its merits are farthest below the baseline. For a quantile, conditions of all ranks are chosen once,
    instead of those with the lowest merits.

    Args:
        merits: merits of the best candidate in all conditions, [conditions].
        judge: quantile, and baseline or None.
        before: indices of the previous conditions.
    """
    missing = np.where(np.isnan(merits), -np.inf, merits)
    order = np.argsort(missing)
    found = [before, order[: ACTIVE // 2]]
    if judge.quantile > 0.0:
        ranks = np.linspace(0, order.size - 1, min(order.size, RANKS)).astype(int)
        found = [before if before.size > 1 else order[np.unique(ranks)]]
    if judge.baseline is not None:
        short = missing - judge.baseline
        found.append(np.argsort(short)[: ACTIVE // 2])
    return np.unique(np.concatenate(found)).astype(np.int64)


def evolved(task: Task, initial: Array, spread: float, active: Index, budget: int) -> tuple[Array, int, bool]:
    """Search by CMA-ES; return the best point, the number of computed candidates, and True if Ctrl-C stopped
    the search.

    Args:
        task: the search.
        initial: initial guess [coordinates from 0 to 1].
        spread: initial standard deviation of the coordinates.
        active: indices of the conditions by which candidates are judged.
        budget: number of candidates, rounded up to whole generations; fewer if the search converges.
    """
    run = _evolution(task, initial, spread)
    best, tried = (float(task.judge.score(task.merits(initial[None], active), active)[0]), initial), 1
    try:
        while tried < budget and not run.stop():
            x = np.array(run.ask())
            scores = task.judge.score(task.merits(x, active), active)
            tried += scores.size
            run.tell(list(x), list(-scores / task.judge.scale))
            k = int(np.argmax(scores))
            best = max(best, (float(scores[k]), x[k]), key=lambda one: one[0])
            task.progress(DOING, min(tried / budget, 1.0))
    except KeyboardInterrupt:
        return np.clip(best[1], 0.0, 1.0), tried, True
    return np.clip(best[1], 0.0, 1.0), tried, False


def _evolution(task: Task, initial: Array, spread: float) -> Any:
    options = {
        "bounds": [0.0, 1.0],
        "popsize": GENERATION,
        # NaN: cma does not seed NumPy's global generator.
        "seed": np.nan,
        "randn": lambda *shape: task.random.standard_normal(shape),
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 1e-6,
        "tolx": 1e-5,
    }
    return _cma().CMAEvolutionStrategy(np.clip(initial, INSIDE, 1.0 - INSIDE), spread, options)


def _cma() -> Any:
    try:
        with warnings.catch_warnings():
            # The package cma warns about optional packages that are not installed.
            warnings.simplefilter("ignore")
            import cma
    except ImportError as error:
        raise QuantityError('this search needs cma: pip install "stickslip[design]"') from error
    return cma
