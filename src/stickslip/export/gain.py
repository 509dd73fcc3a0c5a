"""Compute the observer's gain: among the Kalman filters for the states of the contact, the one that is best
in the worst state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimate.blas import single_threaded
from ..friction import elements
from .linear import Method, S, W, X, Y, Z, contacts

Matrix = NDArray[np.float64]
# Largest growth of an error in one step in a state through which the contact only passes, where friction
# falls with speed.
_RUNS_AWAY = 1.001
# Largest amplification of one part of an error into another in a step; beyond it the rounding of a float
# dominates.
_HELD = 2.0**24
# Pairs of shares of an error by which the position of the end-effector, and its velocity over the step, are
# corrected alone: for steps longer than a period of stage and contact, after which a deflection has decayed.
_SHARES = ((1.0, 0.0), (1.0, 0.01), (1.0, 0.1), (1.0, 0.5), (0.3, 0.03), (0.1, 0.003))
# Number of doublings for 2^36 steps: an error that falls by less than a part in 1e10 a step
# counts as growing.
_DOUBLINGS = 36


@single_threaded
def observer_gain(model: Any, h: float, noise: float) -> Matrix | None:
    """Return the gain of the observer, or None.

    The gain says how stage position and velocity (of its first mode), end-effector position and velocity,
    bristles, and each further mode's position and velocity follow a measured position; shape (5 + 2 further
    modes,). None if no gain bounds the error wherever the contact stays.

    The motion is linearised at each possible state of the contact (`contacts`). The Kalman filter of each
    state, and gains that correct the end-effector alone, are tried in all states; the one with the smallest
    worst stationary error is taken. The error may grow in states that the contact only passes, where friction
    falls with speed and the model itself diverges. Unknown forces are white, a tenth of the friction on both
    bodies. A stage that follows the input is not corrected.

    Args:
        model: actuator or pulled slider.
        h: s, the step.
        noise: m, standard deviation of a measured position.
    """
    method, law = Method(model, h), model.friction
    states, friction = contacts(law, h, method.push[S])
    wanted = _corrected(method, elements(law) == 0)
    seen = method.stage if method.clamped else [X]
    gain = np.zeros(method.size)
    if not wanted:
        return gain
    # Scaled, for positions and velocities are far apart.
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
    # States without correction have errors too, except those known exactly.
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
    """Return the indices of the corrected states."""
    stage = [j for i in method.stage if i != Y or not method.kinematic for j in (i, i + 1)]
    if method.clamped:
        return stage
    return [X, S, *stage] if static else [X, S, Z, *stage]


def _of(matrices: Matrix, parts: list[int]) -> Matrix:
    return matrices[..., parts, :][..., parts]


@np.errstate(all="ignore")  # gains with growing errors are rejected
def kalman_gains(steps: Matrix, seen: Matrix, noises: Matrix) -> Matrix:
    """Return the gains of the Kalman filters of some parts of the state, shape (states, parts); NaN where the
    others leave none.

    Solves the Riccati equations :math:`P = A P A^T - A P c^T (c P c^T + 1)^{-1} c P A^T + Q` of all states at
    once by the structure-preserving doubling algorithm [chu2004].

    Args:
        steps: A, shape (states, parts, parts).
        seen: c, of the measured position over its noise, shape (parts,).
        noises: Q, shape (parts, parts).
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
    """Return the solution of each system of a stack; NaN for singular ones."""
    try:
        return np.linalg.solve(left, right)
    except np.linalg.LinAlgError:
        if len(left) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([_solved(*one) for one in zip(left[:, None], right[:, None], strict=True)])


@np.errstate(all="ignore")
def stationary_errors(steps: Matrix, seen: Matrix, noises: Matrix, gains: Matrix) -> Matrix:
    r"""Return the standard deviation of the corrected position relative to that of a measured one, for each
    gain in each state, shape (gains, states); infinite where the error grows.

    The sum :math:`P = \sum_k A^k Q (A^k)^T` by doubling the number of its terms [smith1968]: all of them are
    positive semi-definite, so that no rounding is blown up by a system of equations.

    Args:
        steps: shape (states, parts, parts).
        seen: of the measured position over its noise, shape (parts,).
        noises: covariance of what the model does not know in a step, shape (parts, parts).
        gains: shape (gains, parts).
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
