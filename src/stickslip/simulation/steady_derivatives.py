"""Derivatives of the steady step by the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..friction.law import project
from ..physics.actuator import Actuator
from ..quantities.units import QuantityError
from ..waveform.drive import Drive, value_slope_curvature
from ..waveform.signal import Waveform
from .drives import endless, tables
from .errors import NotPeriodicError
from .models import System, contact_load
from .periodic import has_neighbours
from .plant.system import speeds
from .sensitivity import (
    BY_ROW,
    INITIAL,
    NeighbouringModels,
    checked_names,
    follow_moved,
    internal,
    moved,
    refuse_law,
    until_settled,
    warn_unsettled,
)
from .steady import period_of, refuse_unsettled, steady_orbit
from .trajectory import checked_tolerance
from .varied import value_of

Array = NDArray[np.float64]

# Smallest distance of a multiplier (growth of a disturbance over one period) from 1 for which there are
# derivatives. With a multiplier of 1, a disturbance stays for ever, and the orbit is not unique.
KEPT = 1e-6
# Distance, over the bound of an element's state, by which `_off_edges` moves the state to the side where the
# element slips. It is much larger than the changes for difference quotients.
ASIDE = 1e-4


def steady_step_derivatives(
    model: Actuator,
    waveform: Waveform,
    *,
    parameters: Sequence[str],
    tolerance: float | str = 1e-10,
    load: Waveform | float = 1.0,
) -> dict[str, float]:
    """Return the derivative of `steady_step` by each parameter, by name, in m (rad) per unit of the
    parameter.

    The arguments are those of `steady_step`; `parameters` are names as for `sensitivities`, without those of
    the initial state.

    Let r be the periodic state, G the map of one period and p a parameter. The orbit changes by dr = (I -
    dG/dr)^-1 dG/dp, and the step by its own derivatives by r and p. As for `sensitivities`, they are computed
    at a tenth of the tolerance and less, until two agree within a hundredth or their difference, times the
    parameter's value, is below the tolerance. Otherwise a `SimulationWarning` names the parameter.

    Raises:
        QuantityError: see `steady_step` and `sensitivities`; a name of the initial state, or a frequency or
            period under a varying load.
        SimulationError: the motion could not be simulated over one period.
        NotPeriodicError: no orbit of the drive's period was found, or it is unstable, as for `steady_step`;
            or an element never slips within a period, and so keeps its initial state.
    """
    tolerance = checked_tolerance(model, tolerance)
    parameters = checked_names(parameters)
    if set(parameters) & set(INITIAL):
        raise QuantityError("the steady step does not depend on the initial state")
    refuse_law(model)
    orbit = steady_orbit(model, waveform, tolerance=tolerance, load=load)
    refuse_unsettled(orbit, model)
    period = period_of(waveform)
    drive = tables(model, endless(waveform), period, periodic=True)(tolerance)
    contact, times = contact_load(load, period), np.array([0.0, period])
    whole = contact.system(model)
    slipping = _on_bounds(whole, orbit.state, drive)

    def neighbours_of(state: Array, names: Sequence[str]) -> NeighbouringModels:
        return moved(model, names, state, None, contact, endless(waveform), period, slipping, True, tolerance)

    def last_states(of: NeighbouringModels, state: Array, tolerance: float) -> tuple[Array, Array]:
        """Return the state one period after `state`, and its derivatives [states, names] by the varied
        values, integrated at a tolerance [m]."""
        last = state.copy()
        _, _, by = follow_moved(of, drive, last, times, tolerance, load=contact.table, over_period=True)
        return last, by

    state = orbit.state
    if not has_neighbours(whole.plant):
        alone = neighbours_of(state, [])
        state = _off_edges(whole, state, slipping, lambda one: last_states(alone, one, 0.1 * tolerance)[0])
    rows = [row for row in range(state.size) if row != whole.slider]
    free = [k for k, row in enumerate(rows) if row not in slipping]
    of, n = neighbours_of(state, [*parameters, *(f"{BY_ROW}{rows[k]}" for k in free)]), len(parameters)
    if contact.table is not None and of.periods is not None and np.any(of.periods[:n] != period):
        raise QuantityError(
            "the load keeps its period, which fits into that of the drive alone: there is no steady step "
            f"beside it, and no derivative by {parameters[int(np.argmax(of.periods[:n] != period))]!r}"
        )

    def derivatives(tolerance: float) -> tuple[Array, Array]:
        last, by = last_states(of, state, tolerance)
        by_state, by_parameter = np.zeros((state.size, len(rows))), by[:, :n]
        by_state[:, free] = by[:, n:]
        if np.abs(1.0 - np.linalg.eigvals(by_state[rows])).min() < KEPT:
            raise NotPeriodicError(
                "no derivatives: an element of contact or piezo that never slips within a period keeps its "
                "initial state; take differences of `steady_step` instead",
                orbit,
            )
        shift = np.linalg.solve(np.eye(len(rows)) - by_state[rows], by_parameter[rows])
        return last, (by_parameter[whole.slider] + by_state[whole.slider] @ shift)[None]

    least = tolerance / np.array([abs(value_of(model, name, waveform)) or 1.0 for name in parameters])
    _, by, errors = until_settled(derivatives, 0.1 * tolerance, least)
    warn_unsettled(parameters, by, errors, least)
    return dict(zip(parameters, by[0].tolist(), strict=True))


def _off_edges(of: System, state: Array, slipping: set[int], after: Callable[[Array], Array]) -> Array:
    """Return a periodic state in which elements at the limit between slipping and not slipping are moved.

    An element that only just reaches its bound in the period slips if its state is changed to one side. On
    the other side it would never slip, and would keep its initial state for ever: there would be no
    derivative. The state is changed by `ASIDE` towards the side where the element slips.

    Args:
        of: the system.
        state: state [states] at the start of a period.
        slipping: indices of states that slip at the start; they are not changed.
        after: function from a state to the state one period later.
    """
    found, last = state.copy(), after(state)
    for row, one in internal(of):
        if row in slipping:
            continue
        ways = ASIDE * abs(project(one, 1.0)) * np.array([1.0, -1.0])
        kept = [abs(after(state + way * (np.arange(state.size) == row))[row] - last[row]) for way in ways]
        if abs(kept[0] - kept[1]) > 0.5 * ways[0]:
            found[row] += ways[int(kept[0] > kept[1])]
    return found


def _on_bounds(of: System, state: NDArray[np.float64], drive: Drive) -> set[int]:
    """Return the indices of the element states that are at their bound and slip at the start of the period.

    The orbit does not depend on a small change of such a state, because slipping removes the change at once.

    Args:
        of: the system.
        state: state [states] at the start of the period.
        drive: segment table of the drive.
    """
    u, rate, _ = value_slope_curvature(drive, 0, 0.0)
    v, found = speeds(of.plant, state, u, rate), set()
    for row, one in internal(of):
        beyond = state[row] * (1.0 + 1e-9)
        e = 0 if row < of.inner else len(of.plant.elements) - 1
        if project(one, beyond) != beyond and v[e] * state[row] > 0.0:
            found.add(row)
    return found
