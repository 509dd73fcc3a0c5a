"""Choice of the most informative set of recordings: one after the other, then each exchanged for a better
one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .information import Seen, covariance, untold

Array = NDArray[np.float64]
Over = Literal["worst", "mean"]

# Largest number of rounds of exchanges; each improves the set, and few are needed.
MOST_ROUNDS = 20
# Largest number of sets that start with one candidate each.
MOST_BEGINS = 64
# Substitute for an infinite logarithm, for each parameter combination that is not identified.
UNTOLD = 1e6


class PlanGoal(NamedTuple):
    """Goal of a planned experiment: the quantity whose expected standard error is minimised.

    Attributes:
        name: the goal in words.
        own: mask [k] of the coordinates that belong to the actuator.
        gradients: derivatives of the goal quantity by the coordinates [draws, k]; None: all parameters
            together (D-optimal).
    """

    name: str
    own: NDArray[np.bool_]
    gradients: Array | None


def criterion(of: Seen, goal: PlanGoal) -> Array:
    """Return the logarithm of the expected standard error of the goal, shape [draws, ...].

    The logarithm is infinite if the recordings do not identify the goal.

    Args:
        of: information in the recordings, with arrays [draws, ..., k, k] for k coordinates.
        goal: the quantity. For all parameters together, the error is the geometric mean of the errors,
            including correlations.
    """
    spread = covariance(of)
    if goal.gradients is None:
        inner = spread[..., goal.own, :][..., goal.own]
        lost = ~np.all(np.isfinite(inner), axis=(-2, -1))
        inner = np.where(lost[..., None, None], np.eye(inner.shape[-1]), inner)
        sign, logarithm = np.linalg.slogdet(inner)
        found = 0.5 * logarithm / inner.shape[-1]
        return np.where(lost | (sign <= 0), np.inf, found)
    g = goal.gradients.reshape(len(goal.gradients), *(1,) * (spread.ndim - 3), -1)
    lost = np.any(np.isinf(np.diagonal(spread, axis1=-2, axis2=-1)) & (g != 0.0), axis=-1)
    finite = np.where(np.isfinite(spread), spread, 0.0)
    variance = (g[..., None, :] @ finite @ g[..., :, None])[..., 0, 0]
    with np.errstate(divide="ignore"):
        return np.where(lost, np.inf, 0.5 * np.log(np.maximum(variance, 0.0)))


def score(of: Seen, goal: PlanGoal, over: Over) -> Array:
    """Return the number that a choice minimises: the worst or mean `criterion` over the draws.

    The criterion is corrected for the duration, so that sets of recordings are compared at equal time.
    """
    found = criterion(of, goal) + 0.5 * np.log(of.duration)
    # If no set identifies the goal, choose the set with the fewest unidentified parameter combinations.
    lost = np.isinf(found)
    if np.any(lost):
        found = np.where(lost, UNTOLD * (1.0 + untold(of)), found)
    return np.max(found, axis=0) if over == "worst" else np.mean(found, axis=0)


def chosen(of: Seen, goal: PlanGoal, over: Over, count: int) -> list[int]:
    """Return the best set of `count` candidates [draws, candidates]; a candidate may be taken several times.

    Its first one, two, ... candidates are good sets too.
    """
    alone = criterion(of, goal) + 0.5 * np.log(of.duration)
    # If draws need different recordings, the search seldom gets from the best set for one draw to the best
    # set for another. And the most informative recording is seldom in the best set for one parameter.
    best = np.argsort(score(of, goal, over), kind="stable")[:MOST_BEGINS]
    begins = dict.fromkeys([*best.tolist(), *np.argmin(alone, axis=1).tolist()])
    found = [_exchanged(of, goal, over, _added(of, goal, over, [first], count)) for first in begins]
    return _ordered(of, goal, over, min(found, key=lambda taken: _of(of, goal, over, taken)))


def _added(of: Seen, goal: PlanGoal, over: Over, taken: list[int], count: int) -> list[int]:
    """Return `count` candidates, each the best addition to the previous ones."""
    while len(taken) < count:
        taken = [*taken, _best(of, goal, over, taken)]
    return taken


def _exchanged(of: Seen, goal: PlanGoal, over: Over, taken: list[int]) -> list[int]:
    """Return the set with candidates exchanged one after the other until no exchange improves it."""
    for _ in range(MOST_ROUNDS):
        before = list(taken)
        for i in range(len(taken)):
            rest = taken[:i] + taken[i + 1 :]
            other = _best(of, goal, over, rest)
            if _of(of, goal, over, [*rest, other]) < _of(of, goal, over, taken) - 1e-9:
                taken = [*rest, other]
        if sorted(taken) == sorted(before):
            break
    return taken


def _ordered(of: Seen, goal: PlanGoal, over: Over, taken: Sequence[int]) -> list[int]:
    """Return the same set in the order in which each next candidate adds most information."""
    left, order = list(taken), []
    while left:
        best = min(left, key=lambda one: _of(of, goal, over, [*order, one]))
        left.remove(best)
        order.append(best)
    return order


def together(of: Seen, taken: Sequence[int]) -> Seen:
    """Return the combined information of several candidates of [draws, candidates, ...], shape [draws,
    ...]."""
    found = of.at((slice(None), taken[0]))
    for one in taken[1:]:
        found = found.plus(of.at((slice(None), one)))
    return found


def _of(of: Seen, goal: PlanGoal, over: Over, taken: Sequence[int]) -> float:
    return float(score(together(of, taken), goal, over))


def _best(of: Seen, goal: PlanGoal, over: Over, beside: Sequence[int]) -> int:
    """Return the candidate that adds most to the candidates `beside`; the first of equal ones."""
    if not beside:
        return int(np.argmin(score(of, goal, over)))
    have = together(of, beside)
    widened = Seen(*(np.expand_dims(one, 1) for one in have))
    return int(np.argmin(score(of.plus(widened), goal, over)))
