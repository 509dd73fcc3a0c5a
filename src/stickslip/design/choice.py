"""Choice of the most informative set of recordings from candidates.

Recordings are added one after the other, each the best addition. Then each is exchanged for a better
candidate, until no exchange improves the set, at most `MOST_ROUNDS` times. Candidates are known only by their
information (`information.Seen`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .information import Seen, covariance, untold

Array = NDArray[np.float64]
Over = Literal["worst", "mean"]

# Largest number of rounds of exchanges. In a round, each recording of a set is exchanged once if that
# improves the set; usually a few rounds are enough.
MOST_ROUNDS = 20
# Number of first candidates, from each of which a set is built: the candidates with the best single scores.
# The best candidate for each draw of the parameters is used in addition.
MOST_BEGINS = 64
# Score that replaces infinity for a set that does not identify the goal. It is multiplied by 1 + the number
# of unidentified parameter combinations, so that such sets can be ranked.
UNTOLD = 1e6


class PlanGoal(NamedTuple):
    """Goal of a planned experiment: the quantity whose expected standard error is minimised.

    Attributes:
        name: the goal in words: "all", the name of a parameter, or "steady step of" a waveform.
        own: mask [k] of the coordinates that belong to the actuator, not to the position channel; without
            parameters that no candidate identifies.
        gradients: derivatives of the goal quantity (a coordinate, or the logarithm of a steady step) by the
            coordinates [draws, k]; None: the goal is all parameters of `own` together (D-optimal).
    """

    name: str
    own: NDArray[np.bool_]
    gradients: Array | None


def criterion(of: Seen, goal: PlanGoal) -> Array:
    """Return the natural logarithm of the expected standard error of the goal, shape [draws, ...].

    The logarithm is infinite if the recordings do not identify the goal. The error of a single quantity
    follows from the covariance of the coordinates and `goal.gradients`. For all parameters together, the
    error is the geometric mean of their errors, including correlations (the determinant of the covariance).

    Args:
        of: information in the recordings, with matrices [draws, ..., k, k] for k coordinates.
        goal: the quantity whose error is computed.
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
    """Return the score of each set of recordings, shape [...]; a choice minimises this score.

    The score is the `criterion` of the set plus half the logarithm of its duration, so that sets are compared
    at equal measuring time. Where a set does not identify the goal, a multiple of `UNTOLD` replaces this
    value.

    Args:
        of: information in each set, with matrices [draws, ..., k, k].
        goal: quantity whose expected error is minimised.
        over: "worst" (the largest value over the draws of the parameters) or "mean".
    """
    found = criterion(of, goal) + 0.5 * np.log(of.duration)
    # If no set identifies the goal, the set with the fewest unidentified parameter combinations is best.
    lost = np.isinf(found)
    if np.any(lost):
        found = np.where(lost, UNTOLD * (1.0 + untold(of)), found)
    return np.max(found, axis=0) if over == "worst" else np.mean(found, axis=0)


def chosen(of: Seen, goal: PlanGoal, over: Over, count: int) -> list[int]:
    """Return the indices of the best set of `count` candidates; a candidate may be taken several times.

    The indices are ordered by `_ordered`: the first one, the first two, ... are good sets too.

    Args:
        of: information of all candidates, arrays [draws, candidates, ...].
        goal: quantity whose expected error is minimised.
        over: "worst" or "mean" over the draws of the parameters.
        count: number of recordings in the set.
    """
    alone = criterion(of, goal) + 0.5 * np.log(of.duration)
    # Exchanges seldom lead from the best set for one draw of the parameters to the best set for another, and
    # the most informative recording is seldom part of the best set for one parameter. So the search is
    # repeated from many first candidates, including the best one for each draw.
    best = np.argsort(score(of, goal, over), kind="stable")[:MOST_BEGINS]
    begins = dict.fromkeys([*best.tolist(), *np.argmin(alone, axis=1).tolist()])
    found = [_exchanged(of, goal, over, _added(of, goal, over, [first], count)) for first in begins]
    return _ordered(of, goal, over, min(found, key=lambda taken: _of(of, goal, over, taken)))


def _added(of: Seen, goal: PlanGoal, over: Over, taken: list[int], count: int) -> list[int]:
    """Return the set `taken` extended to `count` candidates, each the best addition to the previous ones.

    A set is a list of indices of candidates; `of`, `goal` and `over` are as for `chosen`.
    """
    while len(taken) < count:
        taken = [*taken, _best(of, goal, over, taken)]
    return taken


def _exchanged(of: Seen, goal: PlanGoal, over: Over, taken: list[int]) -> list[int]:
    """Return the set `taken` with candidates exchanged one after the other until no exchange improves the
    `score`, or after `MOST_ROUNDS` rounds.

    A set is a list of indices of candidates; `of`, `goal` and `over` are as for `chosen`.
    """
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
    """Return the set `taken` (indices of candidates), ordered so that each next candidate improves the
    `score` of the candidates before it most. `of`, `goal` and `over` are as for `chosen`."""
    left, order = list(taken), []
    while left:
        best = min(left, key=lambda one: _of(of, goal, over, [*order, one]))
        left.remove(best)
        order.append(best)
    return order


def together(of: Seen, taken: Sequence[int]) -> Seen:
    """Return the combined information of some candidates, arrays [draws, ...].

    Args:
        of: information of all candidates, arrays [draws, candidates, ...].
        taken: indices of the candidates; one that occurs several times counts several times.
    """
    found = of.at((slice(None), taken[0]))
    for one in taken[1:]:
        found = found.plus(of.at((slice(None), one)))
    return found


def _of(of: Seen, goal: PlanGoal, over: Over, taken: Sequence[int]) -> float:
    return float(score(together(of, taken), goal, over))


def _best(of: Seen, goal: PlanGoal, over: Over, beside: Sequence[int]) -> int:
    """Return the index of the candidate that gives the lowest `score` together with the set `beside`; the
    first of equal ones.

    `beside` are indices of candidates, perhaps none; `of`, `goal` and `over` are as for `chosen`.
    """
    if not beside:
        return int(np.argmin(score(of, goal, over)))
    have = together(of, beside)
    widened = Seen(*(np.expand_dims(one, 1) for one in have))
    return int(np.argmin(score(of.plus(widened), goal, over)))
