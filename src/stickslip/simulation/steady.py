"""Steady stepping of an actuator: the periodic motion, its stability, and its net step."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.actuator import Actuator
from ..quantities.units import QuantityError, unit_for, with_prefix
from ..waveform.drive import Drive
from ..waveform.signal import Waveform
from .drives import endless, tables
from .errors import NotPeriodicError, SimulationError, SimulationWarning
from .load import refuse_other_period
from .models import contact_load
from .periodic import Orbit, find_orbit
from .refinement import FINER
from .trajectory import checked_tolerance, not_within

# Largest multiplier (growth factor of a disturbance per period) that counts as stable. Multipliers of exactly
# 1 are allowed; the margin is for their errors.
STABLE = 1.0 + 1e-5
NOT_FOLLOWED = "the motion could not be followed over one period"


def steady_orbit(
    model: Actuator, waveform: Waveform, *, tolerance: float | str = 1e-10, load: Waveform | float = 1.0
) -> Orbit:
    """Return the periodic motion under a periodic drive, with its multipliers; see `simulation.periodic`.

    Args:
        model: an actuator.
        waveform: periodic waveform (one with a `period`), V. A limit on the number of periods is ignored.
        tolerance: tolerance of the net step, m, or rad for a rotary actuator.
        load: normal force relative to its reference: a number, or a waveform whose period is that of the
            drive or an integer fraction of it.

    With creep, or hysteresis of Duhem's form, the drive of the stage is only approximated by its table. The
    orbit is then computed a second time with a finer table; the change is added to its error. If no orbit is
    found, the last iterate is returned, with `converged` False; an unstable orbit is returned as well.

    Raises:
        QuantityError: the waveform has no period, the load another one, the end-effector is clamped, its
            normal force changes along the stroke, or see `simulate`.
        SimulationError: the motion could not be simulated over one period.
    """
    tolerance, period = checked_tolerance(model, tolerance), period_of(waveform)
    by_tolerance = tables(model, endless(waveform), period, periodic=True)
    contact = contact_load(load, period)
    refuse_other_period(load, period)
    of = contact.system(model)

    def orbit(table: Drive, start: NDArray[np.float64]) -> Orbit:
        try:
            return find_orbit(of.plant, of.slider, table, contact.drive, start, period, tolerance)
        except FloatingPointError as error:
            raise SimulationError(f"no steady stepping: {error}") from error

    coarse, fine = by_tolerance(tolerance), by_tolerance(FINER * tolerance)
    found = orbit(coarse, contact.rest(of, coarse.before))
    if fine is coarse or not found.converged:
        return found
    again, positions = orbit(fine, found.state), [*of.stages, *range(of.bodies, of.states)]
    off = max(abs(again.step - found.step), *np.abs(again.state - found.state)[positions])
    return again._replace(error=again.error + off, periods=found.periods + again.periods)


def period_of(waveform: Waveform) -> float:
    """Return the period of a waveform, s.

    Raises:
        QuantityError: the waveform has no period.
    """
    period = getattr(waveform, "period", None)
    if period is None:
        raise QuantityError(
            f"steady stepping needs a periodic waveform, such as Sawtooth or Sine; {type(waveform).__name__} "
            "has no period"
        )
    return float(period)


def stable(largest: Any) -> Any:
    """Return True where a periodic motion is stable, from its largest absolute multiplier: a number, or an
    array whose shape the result has. NaN (multipliers not computed) counts as stable."""
    return ~(np.asarray(largest) > STABLE)


def not_found(periods: int, residual: float, largest: float, unit: str) -> str:
    """Return the message that no periodic motion was found in `periods` periods. `residual` is the remaining
    change of the state per period in `unit` (m or rad), `largest` the largest absolute multiplier."""
    return (
        f"no motion with the period of the drive was found in {periods} periods: the state still "
        f"changes by {with_prefix(residual, unit)} per period (largest multiplier {largest:.3g})"
    )


def refuse_unsettled(orbit: Orbit, model: Actuator) -> None:
    """Raise NotPeriodicError if an orbit of the model was not found, or is unstable."""
    largest = float(np.max(np.abs(orbit.multipliers), initial=0.0))
    if not orbit.converged:
        raise NotPeriodicError(not_found(orbit.periods, orbit.residual, largest, unit_for(model, "m")), orbit)
    if not stable(largest):
        raise NotPeriodicError(unstable(largest), orbit)


def unstable(largest: float) -> str:
    """Return the message that the periodic motion is unstable; `largest` is the largest absolute
    multiplier."""
    return (
        f"the motion with the period of the drive is unstable (largest multiplier {largest:.3g}): the "
        "actuator will not settle into it"
    )


def steady_step(
    model: Actuator, waveform: Waveform, *, tolerance: float | str = 1e-10, load: Waveform | float = 1.0
) -> float:
    """Return the net displacement of the end-effector per period of the periodic motion, m (rad for a rotary
    actuator); negative if it walks backward.

    The periodic orbit is computed directly, without a long simulation, and its error is estimated (see
    `steady_orbit`, which has the same arguments and also returns the multipliers). A `SimulationWarning` is
    issued if the error may exceed the tolerance.

    Raises:
        NotPeriodicError: no orbit of the drive's period was found, or it is unstable.
        QuantityError, SimulationError: see `steady_orbit`.
    """
    tolerance = checked_tolerance(model, tolerance)
    orbit = steady_orbit(model, waveform, tolerance=tolerance, load=load)
    refuse_unsettled(orbit, model)
    if not orbit.error <= tolerance:
        warnings.warn(not_within(orbit.error, tolerance, model), SimulationWarning, stacklevel=2)
    return orbit.step
