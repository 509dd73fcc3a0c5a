r"""Steady stepping: the periodic orbit itself, by shooting, instead of waiting for it.

Once periodic, everything but the position of the end-effector repeats from period to period, and that
position moves on by the net step. So with r the state without the position, and G the map of r over one
period, the orbit is r = G(r). It is found by Newton's method on differences of G; where that does not bring
the residual down (a static law makes G discontinuous, or it starts too far away), the map itself is iterated
for some periods, which is what waiting would do, and then it is tried again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..plant.system import Plant, layout_of, values_of
from ..waveform.drive import Drive
from .neighbours import neighbours
from .outcome import DONE
from .periods import LOG_ROWS, integrate, integrate_near
from .resume import NO_RESUME

MAX_STEPS = 10_000_000
# Periods of waiting between two attempts of Newton's method.
PATIENCE = 20
NO_TIMES, NO_SAMPLES = np.zeros(0), np.zeros((0, 0))
# Below this part of the tolerance the integration is not refined any more.
FINEST = 1e-5
# Newton's method may go this many times as far as the motion itself has been: where a period hardly changes
# the state it would point to where nothing moves like this.
FARTHEST = 4.0
# By how much neighbours differ, m; rounding is all that limits it.
NUDGE = 1e-12


class Orbit(NamedTuple):
    """A periodic orbit: `step`, net displacement per period, m; `state` at the start of the period;
    `multipliers`, by which a small disturbance grows over one period (stable where all are below 1 in size);
    `converged`, with the `residual`, how far off state and step may still be, m; `periods` integrated to
    find it; `error`, how far step and state may be off for the errors of the integration, m."""

    step: float
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    converged: bool
    residual: float
    periods: int
    error: float


def find_orbit(
    plant: Plant,
    slider: int,
    drive: Drive,
    load: Drive,
    start: NDArray[np.float64],
    period: float,
    tolerance: float,
    max_periods: int = 2000,
) -> Orbit:
    """The periodic orbit reached from the state `start`; see the module. `tolerance` in m, on the net
    step, which is that of the entry `slider` of the state.

    Raises:
        FloatingPointError: the motion could not be followed over one period.
    """
    fine = 0.1 * tolerance
    layout = layout_of(plant)
    # Laws without states have events, those of several states corners that a neighbour does not turn at the
    # same time.
    smooth = all(shape.states == 1 for shape in layout.elements)
    rows = np.array([row for row in range(start.size) if row != slider])
    scale = np.ones(start.size)  # brings velocities to metres
    scale[1 : 2 * layout.modes : 2] /= plant.rate
    scale = scale[rows]
    count, span = 0, np.array([0.0, period])

    def state(r: NDArray[np.float64]) -> NDArray[np.float64]:
        q = start.copy()
        q[rows] = r
        q[slider] = 0.0
        return q

    def advance(r: NDArray[np.float64], coarser: float = 1.0) -> tuple[NDArray[np.float64], float]:
        nonlocal count
        count += 1
        q = state(r)
        outcome = integrate(
            plant, drive, load, q, span, coarser * fine, MAX_STEPS, NO_TIMES, NO_SAMPLES, NO_RESUME
        )[0]
        if outcome != DONE:
            raise FloatingPointError("the motion could not be followed over one period")
        return q[rows], float(q[slider])

    def slopes(
        r: NDArray[np.float64], at_r: NDArray[np.float64], step: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Of the map, and of the step."""
        nonlocal count
        if smooth:  # differences to neighbours that take the same steps
            count += 1
            nudges = NUDGE / scale
            states = np.array([state(nudged) for nudged in r + np.diag(nudges)])
            near = neighbours(values_of(plant, rows.size), states, slider, LOG_ROWS, 1)
            q, sample = state(r), np.zeros((1, start.size + 1))
            integrate_near(plant, drive, load, q, span, fine, MAX_STEPS, span[1:], sample, near)
            return (near.states[:, rows] - q[rows]).T / nudges, (near.states[:, slider] - q[slider]) / nudges
        jacobian, of_step = np.empty((rows.size, rows.size)), np.empty(rows.size)
        for c in range(rows.size):
            nudged = r.copy()
            nudge = 1e3 * fine / scale[c]
            nudged[c] += nudge
            moved, moved_step = advance(nudged)
            jacobian[:, c], of_step[c] = (moved - at_r) / nudge, (moved_step - step) / nudge
        return jacobian, of_step

    def size(r: NDArray[np.float64]) -> float:
        return float(np.max(np.abs(r) * scale, initial=0.0))

    r = start[rows].copy()
    r, _ = advance(r)
    after, step = advance(r)
    largest = size(r)
    wait = 0  # periods to go through before Newton's method is tried again
    while True:
        jacobian, of_step = slopes(r, after, step)
        change = _to_orbit(jacobian, after - r)
        # How far the orbit is away; where the multipliers come near 1, much further than one period shows.
        residual = max(size(after - r), size(change), abs(float(of_step @ change)))
        if residual <= tolerance or count >= max_periods:
            # What local errors four times as large do to the orbit, to first order.
            other, other_step = advance(r, 4.0)
            moved = _to_orbit(jacobian, other - after)
            error = max(size(moved), abs(other_step - step + float(of_step @ moved)))
            if not (error > tolerance and residual <= tolerance and fine > FINEST * tolerance):
                break
            fine *= max(0.01, 0.5 * tolerance / error)
            after, step = advance(r)
            continue
        largest = max(largest, size(after))
        if wait == 0 and size(change) <= FARTHEST * largest:
            try:
                trial = r + change
                trial_after, trial_step = advance(trial)
                if size(trial_after - trial) < 0.5 * size(after - r):
                    r, after, step = trial, trial_after, trial_step
                    continue
            except FloatingPointError:
                pass
            wait = PATIENCE
        for _ in range(max(wait, 1)):
            r = after
            after, step = advance(r)
        wait = 0
    multipliers = np.linalg.eigvals(jacobian).astype(np.complex128)
    return Orbit(step, state(r), multipliers, residual <= tolerance, residual, count, error)


def _to_orbit(jacobian: NDArray[np.float64], defect: NDArray[np.float64]) -> Any:
    """From a state whose period ends off by `defect` to the orbit, to first order; infinite where there is
    none."""
    try:
        return np.linalg.solve(np.eye(defect.size) - jacobian, defect)
    except np.linalg.LinAlgError:
        return np.full(defect.size, np.inf)
