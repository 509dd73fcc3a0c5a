r"""Steady friction from points of velocity and force, as a tribometer or a servo drive measures them.

.. math:: F = \mathrm{sgn}(v)\,\Big[F_C + (F_S - F_C)\, e^{-|v/v_s|^\delta}\Big] + \sigma_2 v + F_0

F is the friction force at the velocity v, with the Coulomb force F_C, the stiction F_S, the Stribeck velocity
v_s, its exponent δ and the viscous friction σ_2. F_0 is the offset of the force sensor, if it is fitted
[olsson1998; armstrong1994]. A point is one steady velocity and the mean friction force at it, not a sample of
a transient.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..estimate.blas import single_threaded
from ..estimate.fit import fit_least_squares
from ..estimate.parameter import Parameter
from ..estimate.problem import FitError, Residuals
from ..estimate.result import Fit
from ..friction import Stribeck
from .free import with_ties

Array = NDArray[np.float64]

TRIALS = 60  # number of Stribeck velocities, over the range of the points, that are tried as initial guess
LEAST_EXCESS = 1e-3  # smallest initial guess of stiction minus Coulomb friction, over the largest force
# Largest p-value of the F-test at which the points show that friction falls with speed.
FALSE_ALARM = 0.01
# Parameters of the fall of friction with speed.
FALL = ("stiction_excess", "stribeck_velocity", "exponent")
# A Stribeck velocity below NEAR_ENDS times the slowest measured speed, or above the fastest divided by
# NEAR_ENDS, is uncertain.
NEAR_ENDS = 3.0
UNPREDICTED = "it is of points of steady friction; its model is the law (fit.model) that a simulation takes"


@single_threaded
def identify_stribeck(
    velocity: ArrayLike,
    force: ArrayLike,
    *,
    deviation: ArrayLike | None = None,
    exponent: float | None = 2.0,
    offset: bool = False,
    tied: Mapping[str, str] | None = None,
) -> Fit:
    """Fit the Stribeck curve to points of steady friction.

    Args:
        velocity: m/s (rad/s), of both signs or of one, shape (n,). Points at rest are left out.
        force: N (N m), mean friction force at each velocity, shape (n,), with the sign of the velocity.
        deviation: standard deviation of each force, same unit, shape (n,) or one for all; by default all are
            equal, and estimated from the residuals.
        exponent: exponent of the Stribeck curve; None: fit it as well.
        offset: fit an offset of the force sensor as well; it needs points of both signs.
        tied: parameters that follow from others, as for `identify_friction`.

    Returns:
        A `Fit` with coulomb_force [N], stiction_excess (stiction less Coulomb friction) [N],
        stribeck_velocity [m/s], sigma_2 [N s/m] and, if fitted, exponent and offset [N]. Its `model` is the
        law, a `Stribeck`; `failures` say if the points do not show the fall of friction with speed.

    Raises:
        FitError: there are fewer than 6 points in motion or 4 speeds; points are not finite; the friction
            drives the motion (its sign is wrong); a deviation is not above 0; or an offset is requested for
            points of one sign.
        QuantityError: an expression in `tied` is wrong.
    """
    v, f, noise, remarks = _points(velocity, force, deviation)
    if offset and (np.all(v > 0.0) or np.all(v < 0.0)):
        raise FitError(
            "offset = True needs points of both signs: with one sign it is part of Coulomb friction"
        )
    start, shift = _start(v, f, noise, exponent or 2.0, offset)
    largest = float(np.abs(f).max())
    slowest, fastest = float(np.abs(v).min()), float(np.abs(v).max())
    ends = (1e-3 * largest, 10.0 * largest)
    parameters = [
        Parameter("coulomb_force", ends[0], *ends, "N", limits=(0.0, math.inf)).starting_at(start[0]),
        Parameter(
            "stiction_excess", 0.0, 0.0, 10.0 * largest, "N", log=False, limits=(0.0, math.inf)
        ).starting_at(max(start[1], LEAST_EXCESS * largest)),
        Parameter(
            "stribeck_velocity", slowest, slowest / 10.0, 10.0 * fastest, "m/s", limits=(1e-7, math.inf)
        ).starting_at(start[3]),
        Parameter(
            "sigma_2", 0.0, 0.0, 10.0 * largest / slowest, "N s/m", log=False, limits=(0.0, math.inf)
        ).starting_at(start[2]),
    ]
    if exponent is None:
        parameters.append(Parameter("exponent", 2.0, 0.3, 6.0, limits=(0.05, 10.0)))
    if offset:
        parameters.append(Parameter("offset", shift, -10.0 * largest, 10.0 * largest, "N", log=False))

    def residuals(values: dict[str, float]) -> Array:
        return _curve(v, {"exponent": exponent, "offset": 0.0, **values}) - f

    data = Residuals(residuals, f, noise, "points of velocity and force", "N")
    fit = fit_least_squares(
        [data], with_ties(parameters, tied), noise_known=deviation is not None, difference_step=1e-6
    )
    values = {"exponent": exponent, **fit.values}
    law = Stribeck(
        coulomb_force=values["coulomb_force"],
        stiction_force=values["coulomb_force"] + max(values["stiction_excess"], 0.0),
        stribeck_velocity=values["stribeck_velocity"],
        sigma_2=max(values["sigma_2"], 0.0),
        exponent=values["exponent"],
    )
    chance = _chance(v, f, noise, offset, fit)
    doubts = _unseen(chance) if chance > FALSE_ALARM else _doubts(law, slowest, fastest)
    return replace(
        fit,
        model=law,
        unpredicted=UNPREDICTED,
        doubts=(*fit.doubts, *doubts),
        remarks=(*fit.remarks, *remarks),
    )


def _points(
    velocity: ArrayLike, force: ArrayLike, deviation: ArrayLike | None
) -> tuple[Array, Array, Array | None, tuple[str, ...]]:
    """Return velocity, force and deviation (None if not given) of the points in motion, shape (n,) each, and
    a tuple of remarks: one sentence if points at rest are left out, else empty.

    Raises:
        FitError: the points are unsuitable, see `identify_stribeck`.
    """
    v, f = np.asarray(velocity, float), np.asarray(force, float)
    if v.ndim != 1 or v.shape != f.shape:
        raise FitError(f"velocity {v.shape} and force {f.shape} must be one value each per point")
    noise = None if deviation is None else np.broadcast_to(np.asarray(deviation, float), v.shape)
    for name, values in (("velocity", v), ("force", f), ("deviation", noise)):
        bad = [] if values is None else np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise FitError(f"{name} of point {bad[0]} is not finite: leave the point out")
    if noise is not None and np.any(noise <= 0.0):
        raise FitError(f"deviation of point {int(np.argmax(noise <= 0.0))} is not above 0")
    moves = v != 0.0
    remarks = () if np.all(moves) else (f"{int(np.sum(~moves))} points at rest are left out",)
    v, f = v[moves], f[moves]
    if v.size < 6 or np.unique(np.abs(v)).size < 4:
        raise FitError(
            f"{v.size} points at {np.unique(np.abs(v)).size} speeds are too few: at least 6 at 4 speeds"
        )
    if np.sum(v * f) < 0.0:
        raise FitError(
            "the force has the other sign than the velocity: friction opposes motion, so give the force that "
            "overcomes it (change its sign)"
        )
    return v, f, None if noise is None else noise[moves], remarks


def _curve(v: Array, values: dict[str, Any]) -> Array:
    fall = np.exp(-(np.abs(v / values["stribeck_velocity"]) ** values["exponent"]))
    steady = values["coulomb_force"] + values["stiction_excess"] * fall
    return np.sign(v) * steady + values["sigma_2"] * v + values["offset"]


def _start(
    v: Array, f: Array, noise: Array | None, exponent: float, offset: bool
) -> tuple[tuple[float, float, float, float], float]:
    """Return the initial guess, a tuple of four values, and the initial force offset [N] (0 without
    `offset`).

    The four values are Coulomb friction [N], stiction minus Coulomb friction [N], viscous friction [N s/m],
    and Stribeck velocity [m/s]. `TRIALS` Stribeck velocities are tried, each with the non-negative forces
    that fit best.

    Args:
        v: velocities, m/s.
        f: forces, N.
        noise: standard deviation of each force, N; None: equal.
        exponent: exponent of the Stribeck curve.
        offset: True: the force has an offset.
    """
    weight = np.ones(v.size) if noise is None else 1.0 / noise
    trials = np.geomspace(np.abs(v).min(), np.abs(v).max(), TRIALS)
    best: tuple[float, Array, float] = (math.inf, np.zeros(5), 1.0)
    for one in trials:
        fall = np.exp(-(np.abs(v / one) ** exponent))
        shifts = [np.ones(v.size), -np.ones(v.size)] if offset else [np.zeros(v.size)] * 2
        columns = np.stack([np.sign(v), np.sign(v) * fall, v, *shifts], axis=1)
        scale = np.linalg.norm(columns, axis=0) + 1e-300
        found, left = scipy.optimize.nnls(columns / scale * weight[:, None], f * weight)
        if left < best[0]:
            best = (left, found / scale, float(one))
    x = best[1]
    coulomb = max(float(x[0]), 1e-3 * float(np.abs(f).max()))
    shift = float(x[3] - x[4]) if offset else 0.0
    return (coulomb, float(x[1]), float(x[2]), best[2]), shift


def _chance(v: Array, f: Array, noise: Array | None, offset: bool, fit: Fit) -> float:
    """Return the p-value of an F-test of the fall of friction with speed: the probability that noise alone
    lowers the sum of squares as much as the parameters of the fall did.

    Args:
        v: velocities, m/s.
        f: forces, N.
        noise: standard deviation of each force, N; None: equal.
        offset: True: the force has an offset.
        fit: fit of the Stribeck curve. Its fitted parameters of the fall (see `FALL`) count; if all are tied,
            they count as 1.
    """
    left = np.concatenate([np.ravel(one) for one in fit.residuals])
    falls, freedom = max(sum(p.name in FALL for p in fit.parameters), 1), fit.degrees_of_freedom
    weight = np.ones(v.size) if noise is None else 1.0 / noise
    columns = np.stack([np.sign(v), v, *([np.ones(v.size)] if offset else [])], axis=1) * weight[:, None]
    without = f * weight - columns @ np.linalg.lstsq(columns, f * weight, rcond=None)[0]
    with_fall = float(np.sum((left * weight) ** 2))
    gain = max(float(np.sum(without**2)) - with_fall, 0.0) / falls
    return float(scipy.special.fdtrc(falls, freedom, gain * freedom / max(with_fall, 1e-300)))


def _unseen(chance: float) -> tuple[str, ...]:
    return (
        f"the points do not show that friction falls with speed (chance of noise to show as much: "
        f"{chance:.2g}): stiction and Stribeck velocity are not known",
    )


def _doubts(law: Stribeck, slowest: float, fastest: float) -> tuple[str, ...]:
    """Return a tuple with one sentence if the friction of the law falls with speed and its Stribeck velocity
    is near or beyond the slowest or fastest measured speed [m/s]; otherwise an empty tuple."""
    if law.stribeck_velocity < NEAR_ENDS * slowest and law.stiction_force > law.coulomb_force:
        return (
            f"the friction falls below {NEAR_ENDS * slowest:.3g} m/s, where there are hardly any points: "
            "stiction and Stribeck velocity depend on each other; measure slower",
        )
    if law.stribeck_velocity > fastest / NEAR_ENDS and law.stiction_force > law.coulomb_force:
        return (
            f"the friction still falls at the fastest points ({fastest:.3g} m/s): Coulomb and viscous "
            "friction depend on each other; measure faster",
        )
    return ()
