r"""Steady stepping: the periodic orbit itself, by shooting, instead of waiting for it.

Once periodic, everything but the position of the end-effector repeats from period to period, and that
position moves on by the net step. So with r the state without the position, and G the map of r over one
period, the orbit is r = G(r). It is found by Newton's method on differences of G; where that does not bring
the defect G(r) - r down (a static law makes G discontinuous, or it starts too far away), the map itself is
iterated for some periods, which is what waiting would do, and then it is tried again.

G is integrated coarsely at first, then more and more finely: each integration tells by how much the finer
one moves the orbit, and the last of these moves, once within the tolerance, is its error. Derivatives of a
coarse integration serve the finer ones too, unless a disturbance lives long, or the defect stops falling.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.binding import DriveTable
from ..engine.members import ComposedMembers, MemberDrives
from ..engine.orbits import Orbits, find_orbits
from ..engine.outcome import DONE, NOT_FOUND
from ..friction.law import elements, has_jumps
from ..waveform.drive import Drive
from ..waveform.members import common
from .plant.system import Plant, values_of

# Periods integrated for one orbit, at most.
MAX_PERIODS = 2000


class Orbit(NamedTuple):
    """A periodic orbit: `step`, net displacement per period, m; `state` at the start of the period;
    `multipliers`, by which a small disturbance grows over one period (stable where all are below 1 in size;
    those below a half are of a coarse integration, good to about a hundredth); `converged`, with the
    `residual`, how far off state and step were before the last correction, m; `periods` integrated to find
    it; `error`, how far step and state may be off, by a coarser integration, m."""

    step: float
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    converged: bool
    residual: float
    periods: int
    error: float


def has_neighbours(plant: Plant) -> bool:
    """Return whether derivatives may come from `engine.near`.

    Not for laws without states (events), with several states (corners), or with jumps: neighbours do not meet
    these at the same time.
    """
    one_state = all(elements(element.law) == 1 for element in plant.elements)
    return one_state and not any(has_jumps(element.law) for element in plant.elements)


def orbits_of(
    plant: Plant,
    values: NDArray[np.float64],
    drives: MemberDrives,
    load: Drive,
    outcomes: NDArray[np.int64],
    states: NDArray[np.float64],
    periods: NDArray[np.float64],
    tolerance: float,
    slider: int,
) -> Orbits:
    """Look for the orbits of members of a plant that have these numbers; see `engine.orbits.find_orbits`.
    `slider`: the entry of the state that moves on."""
    return find_orbits(
        ComposedMembers(plant, values),
        drives,
        DriveTable(load),
        outcomes,
        states,
        periods,
        tolerance,
        MAX_PERIODS,
        slider,
        has_neighbours(plant),
    )


def find_orbit(
    plant: Plant,
    slider: int,
    drive: Drive,
    load: Drive,
    start: NDArray[np.float64],
    period: float,
    tolerance: float,
) -> Orbit:
    """The periodic orbit reached from the state `start`; see the module. `tolerance` in m, on the net
    step, which is that of the entry `slider` of the state.

    Raises:
        FloatingPointError: the motion could not be followed over one period.
    """
    states, outcomes = start[None].copy(), np.full(1, DONE)
    drives = MemberDrives(common(drive), np.zeros(1, np.int64))
    every = np.array([period])
    found = orbits_of(plant, values_of(plant), drives, load, outcomes, states, every, tolerance, slider)
    if outcomes[0] not in (DONE, NOT_FOUND):
        raise FloatingPointError("the motion could not be followed over one period")
    moving = np.delete(np.delete(found.jacobian[0], slider, axis=0), slider, axis=1)
    finite = bool(np.isfinite(moving).all())  # neighbours may diverge from a motion without an orbit
    multipliers = (np.linalg.eigvals(moving) if finite else np.full(len(moving), np.nan)).astype(
        np.complex128
    )
    step, residual, error = (float(a[0]) for a in (found.steps, found.residuals, found.errors))
    return Orbit(
        step, states[0], multipliers, bool(outcomes[0] == DONE), residual, int(found.periods[0]), error
    )
