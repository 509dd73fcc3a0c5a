r"""Steady stepping: computation of the periodic orbit by shooting, instead of simulating until it is reached.

In periodic motion all states except the position of the end-effector repeat from period to period, and that
position advances by the net step. Let r be the state without the position, and G the map of r over one
period; the orbit is r = G(r). It is found by Newton's method with difference quotients of G. This may not
reduce the defect G(r) - r (a static law makes G discontinuous, or the start is too far away). Then the map
itself is iterated for some periods, as a simulation would do, and Newton's method is tried again.

G is integrated coarsely at first, then more and more finely. Each refinement shows by how much it moves the
orbit; the last move, once within the tolerance, is the error. Derivatives of a coarse integration are also
used for finer ones, unless a disturbance decays slowly or the defect stops falling.
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

# Largest number of periods that are integrated for one orbit.
MAX_PERIODS = 2000


class Orbit(NamedTuple):
    """A periodic orbit.

    Fields: `step`, net displacement per period, m; `state` [states] at the start of the period;
    `multipliers`, growth factors of small disturbances over one period (stable if all are below 1 in size;
    those below a half come from a coarse integration and are accurate to about a hundredth; NaN if they
    could not be computed); `converged`, True if the orbit was found; `residual`, defect of state and step
    before the last correction, m; `periods`, number of periods integrated; `error`, estimated error of step
    and state, m. For a rotary actuator, m is rad.
    """

    step: float
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    converged: bool
    residual: float
    periods: int
    error: float


def has_neighbours(plant: Plant) -> bool:
    """Return True if derivatives can be computed by slightly changed runs with the same integration steps
    (`engine.near`).

    This excludes laws without states (which stick and slip at events), with several states (whose force has
    corners), or with jumps of the force: slightly changed runs meet these at different times.
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
    """Return the periodic orbits of members of one plant layout, found by `engine.orbits.find_orbits`.

    Args:
        plant: any plant of this layout.
        values: numbers of each plant [members, numbers].
        drives, load: drives of the members, and their relative normal force.
        outcomes: outcome of each member (see `engine.outcome`), changed in place; members that are not DONE
            at the start are left out.
        states: initial guesses [members, states], replaced by states on the orbits.
        periods: period of each drive [members], s.
        tolerance: tolerance of the net step, m.
        slider: column of the end-effector's position, which advances by the net step.
    """
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
    """Return the periodic orbit of one plant; see the module.

    Args:
        plant: the plant.
        slider: column of the end-effector's position in the state.
        drive: segment table of one period of the drive.
        load: segment table of the relative normal force.
        start: initial guess of the state [states].
        period: s.
        tolerance: tolerance of the net step, m.

    Raises:
        FloatingPointError: the motion could not be simulated over one period.
    """
    states, outcomes = start[None].copy(), np.full(1, DONE)
    drives = MemberDrives(common(drive), np.zeros(1, np.int64))
    every = np.array([period])
    found = orbits_of(plant, values_of(plant), drives, load, outcomes, states, every, tolerance, slider)
    if outcomes[0] not in (DONE, NOT_FOUND):
        raise FloatingPointError("the motion could not be followed over one period")
    moving = np.delete(np.delete(found.jacobian[0], slider, axis=0), slider, axis=1)
    # Without an orbit, slightly changed runs may diverge, so that derivatives are not finite.
    finite = bool(np.isfinite(moving).all())
    multipliers = (np.linalg.eigvals(moving) if finite else np.full(len(moving), np.nan)).astype(
        np.complex128
    )
    step, residual, error = (float(a[0]) for a in (found.steps, found.residuals, found.errors))
    return Orbit(
        step, states[0], multipliers, bool(outcomes[0] == DONE), residual, int(found.periods[0]), error
    )
