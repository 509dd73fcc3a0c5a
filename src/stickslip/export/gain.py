"""Compute the gain of the observer, which estimates a model's state from measured end-effector positions.

A Kalman filter is computed for each state of the contact (sticking or sliding). Among these gains and some
that correct the end-effector alone, the gain with the smallest error in its worst state of the contact is
taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimate.blas import single_threaded
from ..friction import elements
from .linear import Method, S, W, X, Y, Z, contacts

Matrix = NDArray[np.float64]
# Spectral radius of the transition matrix over one step, above which the contact only passes through a state:
# small errors of the state grow, for example where friction falls with speed.
_RUNS_AWAY = 1.001
# Largest element of the scaled transition matrix over one step for which there is a gain. It is 2^24, a
# float's resolution: with larger elements, rounding errors in single precision dominate.
_HELD = 2.0**24
# Gains that correct only the end-effector: fractions of the position error by which its position, and its
# velocity times the step, are corrected. They serve steps longer than a period of stage and contact, in which
# an error of the bristle's deflection decays.
_SHARES = ((1.0, 0.0), (1.0, 0.01), (1.0, 0.1), (1.0, 0.5), (0.3, 0.03), (0.1, 0.003))
# Number of times that the number of summed steps is doubled, to 2^36. An error that decreases by less than
# the fraction 5e-10 per step has not decayed by then, and counts as growing.
_DOUBLINGS = 36


@single_threaded
def observer_gain(model: Any, h: float, noise: float) -> Matrix | None:
    """Return the gain of the observer, or None if no gain bounds the error wherever the contact can stay.

    The motion is linearised at several states of the contact (`contacts`). The Kalman filter of each state,
    and gains that correct only the end-effector, are tried in all states. The error may grow only in states
    that the contact only passes through, where friction falls with speed and the model itself diverges. The
    gain with the fewest of these states is taken, and among equals the gain with the smallest stationary
    error in its worst other state. The filters assume unknown forces on both bodies as white noise of a tenth
    of the friction. A stage that follows the input exactly is not corrected. None is also returned if the
    step is too long for single precision (`_HELD`).

    Args:
        model: actuator or pulled slider.
        h: time between two measured positions, s.
        noise: standard deviation of a measured position, m, or rad for a rotary actuator.

    Returns:
        Corrections per unit of position error, shape (5 + 2 further modes,): position (1) and velocity (1/s)
        of the stage's first mode, position (1) and velocity (1/s) of the end-effector, bristle deflection
        (1), then position and velocity of each further mode of the stage.
    """
    method, law = Method(model, h), model.friction
    states, friction = contacts(law, h, method.push[S])
    wanted = _corrected(method, elements(law) == 0)
    seen = method.stage if method.clamped else [X]
    gain = np.zeros(method.size)
    if not wanted:
        return gain
    # Positions are divided by the noise, and velocities by noise / step, so that both are of order 1.
    scale = np.full(method.size, noise)
    scale[[W, S, *(i + 1 for i in method.stage)]] /= h
    c = np.zeros((1, method.size))
    c[0, seen] = 1.0
    push = method.forces * (0.1 * friction * h) / scale[:, None]
    noises = push @ push.T
    steps = np.array([method.after(state) * scale / scale[:, None] for state in states])
    stays = np.max(np.abs(np.linalg.eigvals(steps)), axis=1) < _RUNS_AWAY
    if np.max(np.abs(steps[stays]), initial=0.0) > _HELD:
        return None
    # Components of the state whose errors are computed: also those that no gain corrects, but not those that
    # are known exactly, such as the position of a stage that follows the input.
    whole = wanted if method.clamped or method.kinematic else list(range(method.size))
    whole = [i for i in whole if i != Z or elements(law)]
    filters = np.zeros((len(steps) + len(_SHARES), method.size))
    if not method.clamped:
        filters[len(steps) :, [X, S]] = _SHARES
    filters[: len(steps), wanted] = kalman_gains(_of(steps, wanted), c[0, wanted], _of(noises, wanted))
    errors = stationary_errors(_of(steps, whole), c[0, whole], _of(noises, whole), filters[:, whole])
    best, least = None, (np.inf, np.inf)
    for one, error in zip(filters, errors, strict=True):
        grows = ~np.isfinite(error)
        rank = (np.count_nonzero(grows), np.max(error[~grows], initial=-np.inf))
        if not np.any(grows & stays) and rank < least:
            best, least = one, rank
    if best is None:
        return None
    gain = best * scale / noise
    if method.clamped:
        gain[X], gain[S] = gain[method.stage].sum(), gain[[i + 1 for i in method.stage]].sum()
    return gain


def _corrected(method: Method, static: bool) -> list[int]:
    """Return the indices (Y, W, X, ... in `linear`) of the components of the state that the gain corrects.

    A stage that follows the input exactly is left out. `static` is True for a law without bristles, whose
    deflection is left out.
    """
    stage = [j for i in method.stage if i != Y or not method.kinematic for j in (i, i + 1)]
    if method.clamped:
        return stage
    return [X, S, *stage] if static else [X, S, Z, *stage]


def _of(matrices: Matrix, parts: list[int]) -> Matrix:
    return matrices[..., parts, :][..., parts]


@np.errstate(all="ignore")  # an iteration that diverges overflows; its gains stay NaN
def kalman_gains(steps: Matrix, seen: Matrix, noises: Matrix) -> Matrix:
    """Return the gains of the Kalman filters for several states of the contact.

    The Riccati equations :math:`P = A P A^T - A P c^T (c P c^T + 1)^{-1} c P A^T + Q` of all contact states
    are solved at once by the structure-preserving doubling algorithm [chu2004].

    Args:
        steps: A, transition matrix of the corrected components of the state over a step in each contact
            state, shape (states, parts, parts).
        seen: c, derivative of the measured position, over its noise, by each component, shape (parts,).
        noises: Q, covariance of the disturbance in a step, shape (parts, parts).

    Returns:
        The gains, shape (states, parts); NaN for a contact state in which no filter is stable.
    """
    count, size = steps.shape[:2]
    gains = np.full((count, size), np.nan)
    same = np.eye(size)
    still = np.arange(count)
    a = np.swapaxes(steps, 1, 2)
    g = np.broadcast_to(np.outer(seen, seen), a.shape)
    p = np.broadcast_to(noises + 1e-8 * same, a.shape)
    for _ in range(_DOUBLINGS):
        solved = _solved(same + g @ p, np.concatenate([a, g], axis=2))
        ahead, over = solved[..., :size], solved[..., size:]
        turned = np.swapaxes(a, 1, 2)
        more = turned @ p @ ahead
        g, p, a = g + a @ over @ turned, p + more, a @ ahead
        p = 0.5 * (p + np.swapaxes(p, 1, 2))
        g = 0.5 * (g + np.swapaxes(g, 1, 2))
        done = np.linalg.norm(a, axis=(1, 2)) < 1e-14
        found = p[done] @ seen
        gains[still[done]] = found / (found @ seen + 1.0)[:, None]
        keep = ~done & np.isfinite(p).all(axis=(1, 2)) & np.isfinite(g).all(axis=(1, 2))
        still, a, g, p = still[keep], a[keep], g[keep], p[keep]
        if not still.size:
            break
    return gains


def _solved(left: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Return the solutions x of a stack of linear systems `left` x = `right`; NaN for singular systems.

    `left` has the shape (systems, n, n), `right` and the result have the shape (systems, n, m).
    """
    try:
        return np.linalg.solve(left, right)
    except np.linalg.LinAlgError:
        if len(left) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([_solved(*one) for one in zip(left[:, None], right[:, None], strict=True)])


@np.errstate(all="ignore")
def stationary_errors(steps: Matrix, seen: Matrix, noises: Matrix, gains: Matrix) -> Matrix:
    r"""Return the stationary error of an observer for each gain in each state of the contact.

    The covariance :math:`P = \sum_k A^k Q (A^k)^T` of the corrected state is summed by doubling the number of
    terms [smith1968]. All terms are positive semi-definite, so rounding errors are not amplified as by
    solving a system of equations.

    Args:
        steps: transition matrix of an error over a step in each contact state, shape (states, parts, parts).
        seen: derivative of the measured position, over its noise, by each component, shape (parts,).
        noises: covariance of the disturbance in a step, shape (parts, parts).
        gains: the gains to be tried, shape (gains, parts).

    Returns:
        Standard deviation of the corrected position over that of a measured position, shape (gains, states);
        infinite where the error grows.
    """
    shape = (len(gains), len(steps))
    left = np.eye(seen.size) - gains[:, :, None] * seen
    noise = left @ noises @ np.swapaxes(left, 1, 2) + gains[:, :, None] * gains[:, None, :]
    after = (left[:, None] @ steps).reshape(-1, seen.size, seen.size)
    errors = np.full(after.shape[0], np.inf)
    still = np.flatnonzero(np.isfinite(after).all(axis=(1, 2)))
    after, p = after[still], noise[still // shape[1]]
    for _ in range(_DOUBLINGS):
        p = p + after @ p @ np.swapaxes(after, 1, 2)
        after = after @ after
        size = np.linalg.norm(after, axis=(1, 2))
        done = size < 1e-14
        errors[still[done]] = np.sqrt(np.maximum(seen @ p[done] @ seen, 0.0))
        keep = ~done & np.isfinite(size)
        still, after, p = still[keep], after[keep], p[keep]
        if not still.size:
            break
    return errors.reshape(shape)
