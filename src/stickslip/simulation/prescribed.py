"""A friction law under a prescribed motion (a tribometer)."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from ..friction import NormalForce, elements, is_law
from ..friction.normal_force import leaning
from ..recording import make_recording
from ..solve.prescribed import follow_position
from ..units import QuantityError, array_si, to_si, with_prefix
from .errors import SimulationError
from .strain import strained
from .trajectory import checked_tolerance


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
    """The force of a friction law under a prescribed motion (a tribometer).

    Position and normal force are taken linear between the samples; at a sample, the force is that of the
    interval which ends there. A static law keeps at rest the force that it had when the motion stopped, as
    far as rest can hold it. With `reference_normal_force` = 1 N the law's forces are per newton: its Coulomb
    force is mu.

    Args:
        law: friction law record; its forces hold at `reference_normal_force`.
        time: s, [n], ascending.
        position: m, [n], of the driving body relative to the driven one.
        normal_force: N, [n], or how it changes over the position; the reference, if left out.
        reference_normal_force: N.
        proportional: the force is simply multiplied by the normal force, for a measured one whose noise
            would renew the contact again and again. Otherwise what is newly loaded carries no tangential
            force, and what is unloaded loses its share in proportion (see `plant.system`).
        initial_force: N, at the first sample: all elements begin equally deflected so that they carry it, or
            as much of it as the law can. 0 is a relaxed contact.
        initial_velocity: m/s, at which they carry it, with what is viscous of the law: of a record that
            begins amid motion.
        tolerance: m, on the bristle deflections.

    Returns:
        Dataset over "time" with position (m), friction_force (N) and the bristle deflections (m).

    Raises:
        QuantityError: arrays of different length, times not ascending, no law; a `NormalForce` that the
            stiffness does not follow in proportion, or under which the contact lifts off.
    """
    reference = to_si(reference_normal_force, "N", "reference_normal_force")
    initial_force = to_si(initial_force, "N", "initial_force")
    initial_velocity = to_si(initial_velocity, "m/s", "initial_velocity")
    tolerance = checked_tolerance(law, tolerance)
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
    samples = np.full((t.size, 1 + z.size), np.nan)
    reached = follow_position(law, t, x, ratio, z, tolerance, proportional, samples)
    if reached < t.size:
        raise SimulationError(
            f"the friction law could not be followed from t = {t[reached - 1]:.6g} s on within the tolerance "
            f"of {with_prefix(tolerance, 'm', 3)}: a greater one may do"
        )
    samples[:, 0] *= 1.0 + along.asymmetry * np.sign(samples[:, 0])
    variables: dict[str, Any] = {"position": x, "friction_force": samples[:, 0]}
    for e in range(elements(law)):
        variables[f"bristle_deflection_{e + 1}"] = (samples[:, 1 + e], "m")
    return make_recording(t, variables, title=f"{type(law).__name__} under a prescribed motion")
