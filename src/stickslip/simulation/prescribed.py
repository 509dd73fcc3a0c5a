"""Simulation of a friction law under a prescribed motion (a tribometer)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.motion import follow_position
from ..friction import NormalForce, elements, is_law
from ..friction.normal_force import leaning
from ..quantities.units import QuantityError, array_si, to_si, with_prefix
from ..recording import make_recording
from .errors import SimulationError, SimulationWarning
from .refinement import LOOSE, refined
from .strain import strained
from .trajectory import checked_tolerance, not_within

if TYPE_CHECKING:
    import xarray as xr


def friction_response(
    law: Any,
    time: ArrayLike,
    position: ArrayLike,
    *,
    normal_force: ArrayLike | NormalForce | None = None,
    reference_normal_force: float | str = 1.0,
    proportional: bool = False,
    initial_force: float | str = 0.0,
    initial_velocity: float | str = 0.0,
    tolerance: float | str = 1e-10,
) -> xr.Dataset:
    """Return the force of a friction law under a prescribed motion (a tribometer).

    Position and normal force are linear between the samples; at a sample, the force is that of the interval
    which ends there (at the first one, of the interval which starts there). At rest, a static law keeps the
    force that it had when the motion stopped, up to its stiction. With `reference_normal_force` = 1 N the
    law's forces are per newton: its Coulomb force is mu.

    Args:
        law: friction law record; its forces hold at `reference_normal_force`.
        time: s, [n], ascending.
        position: m, [n], of the driving body relative to the driven one.
        normal_force: N, [n], or a function of the position; by default the reference.
        reference_normal_force: N.
        proportional: multiply the force by the normal force; use it for measured normal forces, whose noise
            would renew the contact continually. Otherwise newly loaded area carries no tangential force, and
            unloaded area loses its share in proportion (see `simulation.plant.system`).
        initial_force: friction force at the first sample, N, with the sign as in the result: all elements
            start equally deflected so that they carry it, or as much as the law can. 0: a relaxed contact.
        initial_velocity: velocity at the first sample, m/s, for a recording that starts during motion; its
            viscous force is part of `initial_force`.
        tolerance: tolerance of the bristle deflections over the whole motion, m. The error is estimated by a
            second run with smaller steps; if it is larger, the steps are refined.

    Returns:
        Dataset over "time" with position (m), friction_force (N, positive while the position slides to
        greater values) and the bristle deflections (m).
        attrs["error_estimate"] (m): error of the deflections, 0 for static laws; if it stays above the
        tolerance, there is a `SimulationWarning`.

    Raises:
        QuantityError: arrays of different length, times not ascending, not a law; or a `NormalForce` with
            another stiffness exponent than 1, or that falls below zero.
        SimulationError: the law could not be simulated from one sample to the next.
    """
    tolerance = checked_tolerance(law, tolerance)
    run = prescribed(
        law,
        time,
        position,
        normal_force=normal_force,
        reference_normal_force=reference_normal_force,
        proportional=proportional,
        initial_force=initial_force,
        initial_velocity=initial_velocity,
    )

    def finer(level: float, careful: bool) -> Prescribed:
        # Divide the intervals between samples as well: if each is already a single integration step, a
        # smaller tolerance alone does not change the result.
        return run(level, math.ceil(math.sqrt(LOOSE * tolerance / level) - 1e-9))

    made, error = refined(finer, _apart, lambda made: 0, tolerance)
    _refuse_unfinished(made, tolerance)
    if not error <= tolerance:
        warnings.warn(not_within(error, tolerance, what="a deflection"), SimulationWarning, stacklevel=2)
    variables: dict[str, Any] = {"position": made.position, "friction_force": made.force}
    for e in range(elements(law)):
        variables[f"bristle_deflection_{e + 1}"] = (made.states[:, e], "m")
    found = make_recording(made.time, variables, title=f"{type(law).__name__} under a prescribed motion")
    found.attrs.update(tolerance=tolerance, error_estimate=error)
    return found


class Prescribed(NamedTuple):
    """Result of a law under a prescribed motion.

    Fields: `time` [s], `position` [m] and `force` [N], all [n]; `states` [n, elements], deflections [m] (one
    column for a static law: its force over its breakaway force); `reached`, number of samples that could be
    computed, after which force and states are NaN.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    force: NDArray[np.float64]
    states: NDArray[np.float64]
    reached: int


def _apart(one: Prescribed, other: Prescribed) -> float:
    """Return the largest difference of the states between the runs `one` and `other` at the same sample, m;
    NaN if a run does not reach the end."""
    return float(np.max(np.abs(one.states - other.states)))


def _refuse_unfinished(made: Prescribed, tolerance: float) -> None:
    if made.reached < made.time.size:
        raise SimulationError(
            f"the friction law could not be followed from t = {made.time[made.reached - 1]:.6g} s on within "
            f"the tolerance of {with_prefix(tolerance, 'm', 3)}: a greater one may do"
        )


def prescribed_once(
    law: Any, time: ArrayLike, position: ArrayLike, tolerance: float, **how: Any
) -> Prescribed:
    """Simulate a law under a motion once, for fits, which repeat this many times.

    The local error of a deflection in each step is within the tolerance [m]; the total error is not
    estimated. The other arguments (`how`: those by name) and the errors are those of `friction_response`.
    """
    made = prescribed(law, time, position, **how)(checked_tolerance(law, tolerance), 1)
    _refuse_unfinished(made, tolerance)
    return made


def prescribed(
    law: Any,
    time: ArrayLike,
    position: ArrayLike,
    *,
    normal_force: ArrayLike | NormalForce | None = None,
    reference_normal_force: float | str = 1.0,
    proportional: bool = False,
    initial_force: float | str = 0.0,
    initial_velocity: float | str = 0.0,
) -> Callable[[float, int], Prescribed]:
    """Return a function that simulates the law under the motion, as `friction_response` describes the
    arguments.

    The function gets the largest local error of a deflection [m], and the number of parts into which each
    interval between samples is divided. It returns a `Prescribed` at the original samples.

    Raises:
        QuantityError: see `friction_response`.
    """
    reference = to_si(reference_normal_force, "N", "reference_normal_force")
    initial_force = to_si(initial_force, "N", "initial_force")
    initial_velocity = to_si(initial_velocity, "m/s", "initial_velocity")
    if not is_law(law):
        raise QuantityError(f"{law!r} is no friction law")
    t, x = array_si(time, "s", "time"), array_si(position, "m", "position")
    if t.ndim != 1 or t.shape != x.shape or t.size < 2 or not np.all(np.diff(t) > 0.0):
        raise QuantityError("time [s] and position [m] must be of one length, at least 2, and time ascending")
    ratio, along = np.ones(t.size), NormalForce()
    if isinstance(normal_force, NormalForce):
        if normal_force.stiffness_exponent != 1.0:
            q = normal_force.stiffness_exponent
            raise QuantityError(f"NormalForce.stiffness_exponent = {q:g}: a prescribed motion knows 1 only")
        ratio, along = normal_force.factor(x), normal_force
    elif normal_force is not None:
        ratio = array_si(normal_force, "N", "normal_force") / reference
        if ratio.shape != t.shape:
            raise QuantityError("normal_force [N] must have one value per time")
    z = np.zeros(max(elements(law), 1))
    if initial_force != 0.0 and elements(law) > 0 and ratio[0] > 0.0:
        first = initial_force / (ratio[0] * leaning(along, initial_force))
        z[:] = strained(law, first, initial_velocity)

    def run(level: float, parts: int) -> Prescribed:
        when, where, load = (_in_parts(values, parts) for values in (t, x, ratio))
        samples = np.full((when.size, 1 + z.size), np.nan)
        reached = follow_position(law, when, where, load, z.copy(), level, proportional, samples)
        samples = samples[::parts]
        force = samples[:, 0] * (1.0 + along.asymmetry * np.sign(samples[:, 0]))
        return Prescribed(t, x, force, samples[:, 1:], (reached - 1) // parts + 1)

    return run


def _in_parts(values: NDArray[np.float64], parts: int) -> NDArray[np.float64]:
    """Return a signal that is linear between its samples `values` [n], with `parts` times as many
    intervals: each is divided into equal parts."""
    between = values[:-1, None] + np.diff(values)[:, None] * (np.arange(parts) / parts)
    return np.append(between.ravel(), values[-1])
