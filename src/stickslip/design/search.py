"""The search itself: candidates of a generation, under all active conditions, in one call.

Three evolutions (CMA-ES [hansen2016]) begin at different shapes, one of them the best of random ones, and
share the calls; the worst is given up after a part of the budget, and then the next. Of several conditions
the worst one alone comes first, twice, which is cheap and finds the right hill; from there on candidates are
judged by the worst few conditions, and which these are is found again each time that the best so far is
driven under all of them. Why there is no polish by derivatives: docs/decisions/design.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..progress import Progress
from ..units import QuantityError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# How good each candidate [n, parameters, 0 to 1] is under those conditions: [n, conditions], more is better,
# NaN where there is no periodic motion.
Merits = Callable[[Array, Index], Array]

# A generation of one evolution; parts of the budget after which the worst of them is given up.
GENERATION, GIVEN_UP = 16, (0.25, 0.5)
# Random candidates, the best of which is begun with in place of the last start.
SCOUTS = 256
# The first spread, of the range, and that of a search begun at what one before has found.
WIDE, NEAR = 0.3, 0.08
# How far inside of the bounds an evolution begins.
INSIDE = 0.02
# Conditions that candidates are judged by at first; how often more are added.
ACTIVE, ROUNDS = 4, 4
# The first budget over that of a later turn.
LATER = 6
# Those that stand for all where a quantile is asked for.
RANKS = 24
# Of the scale of merits: a gain below it is no reason to go on.
GAIN = 2e-5
# A falling short of the baseline counts so many times.
SHORTFALL = 10.0


class Judge(NamedTuple):
    """From merits to one number: the `quantile` of them (0: the worst), less what falls short of `baseline`
    [conditions] in any; `scale` is that of a merit."""

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
    """`conditions`, how many; `budget` of candidates."""

    merits: Merits
    judge: Judge
    conditions: int
    budget: int
    random: np.random.Generator
    progress: Progress


class Best(NamedTuple):
    """Where; how good under all conditions; members that the search took; whether it was stopped (Ctrl-C)."""

    x: Array
    score: float
    evaluations: int
    interrupted: bool = False


def robust(task: Task, starts: Array) -> Best:
    """The best under all conditions, from the starts [n, parameters] on."""
    everything = np.arange(task.conditions)
    merits = task.merits(starts, everything)
    scores = task.judge.score(merits, everything)
    first = int(np.argmax(scores))
    best, spent = Best(starts[first], float(scores[first]), 0), len(starts) * task.conditions
    active = worst_of(merits[first], task.judge, np.zeros(0, np.int64))
    if len(starts) > 1:
        starts = np.array([*starts[:-1], _scouted(task, starts.shape[1], _worst(merits[first]))])
        spent += SCOUTS
    begin, spread, share = starts, WIDE, task.budget
    if task.conditions > 1:
        found, merits, tried, stopped = _of_the_worst(task, starts, merits[first])
        spent += tried
        score = float(task.judge.score(merits[None], everything)[0])
        if score > best.score or stopped:
            best = (
                Best(found, score, spent, stopped) if score > best.score else best._replace(interrupted=True)
            )
        if stopped:
            return best._replace(evaluations=spent)
        active = worst_of(merits, task.judge, active)
        begin, spread, share = found[None], NEAR, task.budget // 2
    for turn in range(ROUNDS):
        part = task._replace(
            progress=lambda doing, done, turn=turn: task.progress(doing, (turn + done) / ROUNDS),
        )
        found, tried, stopped = evolved(part, begin, spread, active, share)
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
        active, begin, spread, share = wider, found[None], NEAR, task.budget // LATER
    return best._replace(evaluations=spent)


def _worst(merits: Array) -> Index:
    """Which condition is the worst of these merits, [1]."""
    return np.array([int(np.argmin(np.where(np.isnan(merits), -np.inf, merits)))])


def _scouted(task: Task, count: int, which: Index) -> Array:
    """The best of random candidates of so many numbers in a condition."""
    x = task.random.random((SCOUTS, count))
    scores = task.judge._replace(baseline=None).score(task.merits(x, which), which)
    return x[int(np.argmax(scores))]


def _of_the_worst(task: Task, starts: Array, merits: Array) -> tuple[Array, Array, int, bool]:
    """The better of two searches in the condition that is the worst of these merits, without a baseline:
    where it is, its merits in all conditions, members that it took, whether it was stopped.

    Far from the baseline every drive falls short of it somewhere, which would lead back to it.
    """
    one = _worst(merits)
    free = task._replace(
        judge=Judge(0.0, None, task.judge.scale), progress=lambda doing, done: task.progress(doing, 0.0)
    )
    found, spent, stopped = list[Array](), 0, False
    for begin in (starts, task.random.random(starts.shape)):
        x, tried, stopped = evolved(free, begin, WIDE, one, task.budget)
        found.append(x)
        spent += tried + task.conditions
        if stopped:
            break
    of_all = task.merits(np.array(found), np.arange(task.conditions))
    k = int(np.argmax(np.where(np.isnan(of_all), -np.inf, of_all).min(axis=1)))
    return found[k], of_all[k], spent, stopped


def worst_of(merits: Array, judge: Judge, before: Index) -> Index:
    """Conditions to judge by: those before, and the worst of the others; for a quantile, of all ranks."""
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


def evolved(task: Task, begin: Array, spread: float, active: Index, budget: int) -> tuple[Array, int, bool]:
    """The best of evolutions that begin there [n, parameters], how many candidates they took, and whether
    they were stopped before their end."""
    runs = [_evolution(task, one, spread) for one in begin]
    scores = task.judge.score(task.merits(begin, active), active)
    bests = [(float(score), one) for score, one in zip(scores, begin, strict=True)]
    kept, tried = max(bests, key=lambda one: one[0]), len(begin)
    given_up = list(GIVEN_UP)
    try:
        while tried < budget and runs:
            asked = [np.array(run.ask()) for run in runs]
            scores = task.judge.score(task.merits(np.concatenate(asked), active), active)
            tried += scores.size
            for i, (run, x) in enumerate(zip(runs, asked, strict=True)):
                own = scores[i * GENERATION : (i + 1) * GENERATION]
                run.tell(list(x), list(-own / task.judge.scale))
                k = int(np.argmax(own))
                bests[i] = max(bests[i], (float(own[k]), x[k]), key=lambda one: one[0])
            kept = max(kept, *bests, key=lambda one: one[0])
            stay = [i for i, run in enumerate(runs) if not run.stop()]
            if given_up and tried >= given_up[0] * budget:
                given_up.pop(0)
                if len(stay) > 1:
                    stay.remove(min(stay, key=lambda i: bests[i][0]))
            runs, bests = [runs[i] for i in stay], [bests[i] for i in stay]
            task.progress("searching for a drive signal", min(tried / budget, 1.0))
    except KeyboardInterrupt:
        return np.clip(max(kept, *bests, key=lambda one: one[0])[1], 0.0, 1.0), tried, True
    return np.clip(kept[1], 0.0, 1.0), tried, False


def _evolution(task: Task, begin: Array, spread: float) -> Any:
    options = {
        "bounds": [0.0, 1.0],
        "popsize": GENERATION,
        "seed": np.nan,  # leave NumPy's own generator alone
        "randn": lambda *shape: task.random.standard_normal(shape),
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 1e-6,
        "tolx": 1e-5,
    }
    return _cma().CMAEvolutionStrategy(np.clip(begin, INSIDE, 1.0 - INSIDE), spread, options)


def _cma() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its own, of what it imports
            import cma
    except ImportError as error:
        raise QuantityError('this search needs cma: pip install "stickslip[design]"') from error
    return cma
