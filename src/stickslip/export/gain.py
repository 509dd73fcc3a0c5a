"""The observer's gain: of the Kalman filters of the contact's states, the one that serves all of them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, LinAlgWarning, solve_discrete_are, solve_discrete_lyapunov

from ..friction import elements
from .linear import Method, S, W, X, Y, Z, contacts

Matrix = NDArray[np.float64]
# By how much an error grows in a step where the contact does not stay: where friction falls with the speed.
_RUNS_AWAY = 1.001


def observer_gain(model: Any, h: float, noise: float) -> Matrix | None:
    """How stage position and velocity (of its first mode), end-effector position and velocity, bristles, and
    position and velocity of each further mode follow a measured position of the end-effector, shape (5 + 2
    further modes,); None if there is no gain at which the error stays bounded wherever the contact stays.

    The step method is taken as linear about each state in which the contact can be (`contacts`). The Kalman
    filter of each is tried in all, and that is taken whose greatest stationary error is smallest. Where the
    contact passes through, for friction falls with the speed and the model alone runs away, the error may
    grow if it must. What the
    model does not know is taken as white forces of a tenth of the friction on both bodies. A stage that
    follows the input is not corrected.

    Args:
        model: actuator or pulled slider.
        h: s, the step.
        noise: m, standard deviation of a measured position.
    """
    method, law = Method(model, h), model.friction
    states, friction = contacts(law, h, method.push[S] / h)
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
    steps = [method.after(state) * scale / scale[:, None] for state in states]
    stays = [bool(np.max(np.abs(np.linalg.eigvals(step))) < _RUNS_AWAY) for step in steps]
    # What is not corrected has errors of its own, but for what is known exactly.
    whole = wanted if method.clamped or method.kinematic else list(range(method.size))
    whole = [i for i in whole if i != Z or elements(law)]
    best, least = None, (np.inf, np.inf)
    for one in (_filter(step, c, noises, wanted) for step in steps):
        errors = [_error(step, c, noises, one, whole) for step in steps]
        grows = [stay for error, stay in zip(errors, stays, strict=True) if not np.isfinite(error)]
        rank = (len(grows), max((error for error in errors if np.isfinite(error)), default=np.inf))
        if not any(grows) and rank < least:
            best, least = one, rank
    if best is None:
        return None
    gain = best * scale / noise
    if method.clamped:
        gain[X], gain[S] = gain[method.stage].sum(), gain[[i + 1 for i in method.stage]].sum()
    return gain


def _corrected(method: Method, static: bool) -> list[int]:
    """Which parts of the state are."""
    stage = [j for i in method.stage if i != Y or not method.kinematic for j in (i, i + 1)]
    if method.clamped:
        return stage
    return [X, S, *stage] if static else [X, S, Z, *stage]


def _filter(step: Matrix, c: Matrix, noises: Matrix, of: list[int]) -> Matrix:
    """The gain of the Kalman filter of some parts of the state; NaN where the others leave it none."""
    gain, part = np.zeros(len(step)), np.ix_(of, of)
    seen = c[:, of]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)
            p = solve_discrete_are(step[part].T, seen.T, noises[part] + 1e-8 * np.eye(len(of)), np.eye(1))
    except (LinAlgError, LinAlgWarning):
        return np.full(len(step), np.nan)
    gain[of] = (p @ seen.T / (seen @ p @ seen.T + 1.0))[:, 0]
    return gain


def _error(step: Matrix, c: Matrix, noises: Matrix, gain: Matrix, of: list[int]) -> float:
    """The standard deviation of the corrected position over that of a measured one; infinite if it grows."""
    part, k, seen = np.ix_(of, of), gain[of, None], c[:, of]
    if not np.all(np.isfinite(k)):
        return np.inf
    left = np.eye(len(of)) - k @ seen
    after = left @ step[part]
    if not np.max(np.abs(np.linalg.eigvals(after))) < 1.0 - 1e-9:
        return np.inf
    noise = left @ noises[part] @ left.T + k @ k.T
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)
            p = solve_discrete_lyapunov(after, noise, method="direct")
    except (LinAlgError, LinAlgWarning):
        return np.inf
    return float(np.sqrt(max((seen @ p @ seen.T)[0, 0], 0.0)))
