r"""Steady stepping: the periodic orbit itself, by shooting, instead of waiting for it.

Once periodic, everything but the position of the end-effector repeats from period to period, and that
position moves on by the net step. So with r the state without the position, and G the map of r over one
period, the orbit is r = G(r). It is found by Newton's method on differences of G; where that does not bring
the residual down (a static law makes G discontinuous), the map itself is iterated, which is what waiting
would do.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction.law import elements
from ..mechanism import FIRST_BRISTLE, SLIDER, SLIDER_VELOCITY, STAGE, STAGE_VELOCITY, Mechanism
from ..waveform.drive import Drive
from .motion import motion, one_bristle
from .neighbours import neighbours
from .outcome import DONE
from .periods import LOG_ROWS, integrate_near

MAX_STEPS = 10_000_000
# By how much neighbours differ, m; rounding is all that limits it.
NUDGE = 1e-12


class Orbit(NamedTuple):
    """A periodic orbit: `step`, net displacement per period, m; `state` at the start of the period;
    `multipliers`, by which a small disturbance grows over one period (stable where all are below 1 in size);
    `converged`, with the `residual` left in it, m; `periods` integrated to find it."""

    step: float
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    converged: bool
    residual: float
    periods: int


def find_orbit(
    law: Any,
    mech: Mechanism,
    drive: Drive,
    load: Drive,
    start: NDArray[np.float64],
    period: float,
    tolerance: float,
    max_periods: int = 400,
) -> Orbit:
    """The periodic orbit reached from the state `start`; see the module. `tolerance` in m, on the net
    step.

    Raises:
        FloatingPointError: the motion could not be followed over one period.
    """
    fine = 0.1 * tolerance
    rows = np.array(_shooting_rows(law, mech))
    scale = np.ones(start.size)  # brings velocities to metres
    scale[[STAGE_VELOCITY, SLIDER_VELOCITY]] /= mech.rate
    scale = scale[rows]
    count = 0

    def state(r: NDArray[np.float64]) -> NDArray[np.float64]:
        q = start.copy()
        q[rows] = r
        q[SLIDER] = 0.0
        return q

    def advance(r: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        nonlocal count
        count += 1
        q = state(r)
        outcome = motion(law, mech, drive, load, q, (0.0, period), fine, MAX_STEPS)[0]
        if outcome != DONE:
            raise FloatingPointError("the motion could not be followed over one period")
        return q[rows], float(q[SLIDER])

    def slopes(r: NDArray[np.float64], at_r: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal count
        if one_bristle(law, mech):  # differences to neighbours that take the same steps
            count += 1
            nudges = NUDGE / scale
            states = np.array([state(nudged) for nudged in r + np.diag(nudges)])
            laws, mechs = (np.tile([float(v) for v in one], (rows.size, 1)) for one in (law, mech))
            near = neighbours(laws, mechs, states, LOG_ROWS, 1)
            q, ends, sample = state(r), np.array([0.0, period]), np.zeros((1, 6))
            integrate_near(law, mech, drive, load, q, ends, fine, MAX_STEPS, np.array([period]), sample, near)
            return (near.states[:, rows] - q[rows]).T / nudges
        jacobian = np.empty((rows.size, rows.size))
        for c in range(rows.size):
            nudged = r.copy()
            nudge = 1e3 * fine / scale[c]
            nudged[c] += nudge
            jacobian[:, c] = (advance(nudged)[0] - at_r) / nudge
        return jacobian

    def size(r: NDArray[np.float64]) -> float:
        return float(np.max(np.abs(r) * scale, initial=0.0))

    r = start[rows].copy()
    r, _ = advance(r)
    after, step = advance(r)
    newton = True
    while size(after - r) > tolerance and count < max_periods:
        if newton:
            try:
                trial = r + np.linalg.solve(np.eye(rows.size) - slopes(r, after), after - r)
                trial_after, trial_step = advance(trial)
            except (np.linalg.LinAlgError, FloatingPointError):
                trial, trial_after, trial_step = r, after + np.inf, step
            if size(trial_after - trial) < 0.5 * size(after - r):
                r, after, step = trial, trial_after, trial_step
                continue
            newton = False
        r = after
        after, step = advance(r)
    residual = size(after - r)
    multipliers = np.linalg.eigvals(slopes(r, after)).astype(np.complex128)
    return Orbit(step, state(r), multipliers, residual <= tolerance, residual, count)


def _shooting_rows(law: Any, mech: Mechanism) -> list[int]:
    stage = [] if mech.kinematic else [STAGE, STAGE_VELOCITY]
    return [*stage, SLIDER_VELOCITY, *range(FIRST_BRISTLE, FIRST_BRISTLE + elements(law))]
