r"""Initial guesses for fits of friction, from stroke, mass and natural frequency of the actuator.

Let A be the stroke of the stage under the drive. Friction moves the end-effector (mass m) along with the slow
stage. At a jump of the drive the stage accelerates by up to A omega_n^2, and the contact slips. So the
Coulomb force F_C is below m A omega_n^2, but not by many decades. The contact slips only if its deflection
before sliding is below A. And the contact, a spring and a damper between the masses, is neither undamped nor
rigid:

.. math::

    F_C < m A \omega_n^2, \qquad F_C / \sigma_0 < A, \qquad
    \zeta_c = \frac{\sigma_1}{2 \sqrt{\sigma_0 m}} \sim 10^{-2} \ldots 10^{0}

So the true values are within three decades of force and of deflection, wherever the user starts. Points fill
this range, all with the damping ratio 0.1, because the damping has the least effect. The residuals in the
first periods of a recording select the best points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from operator import itemgetter

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...estimate.fit import fit_least_squares
from ...estimate.parameter import REACH, Parameter, Values
from ...estimate.problem import FitError, Residuals
from ...physics.actuator import Actuator
from ...waveform.signal import Waveform
from ..recorded.drives import periodic_part
from .position_channel import CHANNEL

NAMES = ("coulomb_force", "sigma_0", "sigma_1")
# Initial guesses: range of the Coulomb force relative to m A omega_n^2 (FORCE; mass m of the end-effector,
# stroke A and natural frequency omega_n of the stage), range of the deflection before sliding relative to the
# stroke A (DEFLECTION), and damping ratio of the contact (DAMPING).
FORCE, DEFLECTION, DAMPING = (1e-3, 1.0), (1e-3, 1.0), 0.1
# Number of drive periods that are used for initial guesses. If they have at most FEWEST samples, the whole
# recording is used.
PERIODS, FEWEST = 3, 30
# Ratio of a value to its default bound (or the inverse ratio) below which the bound is near and is moved
# outwards.
NEAR = 3.0
# TRIED: number of points that are simulated. LOOKED_AT: number of the best of them that are refined by a
# short search. LOOK: largest number of evaluations of such a search.
TRIED, LOOKED_AT, LOOK = 64, 20, 6
LOOKED_AT_THERE = 2  # number of refined points in each part of the range, if the range is divided
# BEGINS: largest number of initial guesses if the range is not divided. APART: factor by which at least one
# value of two guesses must differ.
BEGINS, APART = 6, 1.25

Array = NDArray[np.float64]


def plausible(model: Actuator, stroke: float) -> Callable[[Array], dict[str, Array]]:
    """Return a function that maps points of the unit square, shape (n, 2), to plausible values of the
    friction law.

    The two coordinates are the logarithms of Coulomb force and deflection, from 0 to 1 over `FORCE` and
    `DEFLECTION`; the stiffness is the ratio of force to deflection. The function returns a dictionary of
    "coulomb_force", "sigma_0" and "sigma_1" as arrays [n], SI; parameters that the law lacks are left out.

    Args:
        model: the actuator, for its law, mass and natural frequency.
        stroke: stroke A of the stage under the drive, m.
    """
    law, mass = model.friction, model.end_effector_mass
    greatest = mass * stroke * model.natural_frequency**2

    def of(square: Array) -> dict[str, Array]:
        force, deflection = (
            low * (high / low) ** part
            for (low, high), part in zip((FORCE, DEFLECTION), square.T, strict=True)
        )
        force = force * greatest
        stiffness = force / (deflection * stroke)
        found = {
            "coulomb_force": force,
            "sigma_0": stiffness,
            "sigma_1": 2.0 * DAMPING * np.sqrt(stiffness * mass),
        }
        return {name: values for name, values in found.items() if name in law._fields}

    return of


def early_samples(time: Array, drive: Waveform) -> int:
    """Return the number of samples up to the end of the drive's first `PERIODS` periods; the number of all
    samples if the drive has no periods, or if these contain at most `FEWEST` samples.

    Args:
        time: sample times, s, in the time of the drive.
        drive: waveform of the drive.
    """
    begin, periodic = periodic_part(drive)
    if periodic is None:
        return time.size
    early = int(np.count_nonzero(time <= begin + PERIODS * float(periodic.period)))
    return early if early > FEWEST else time.size


def first_guess(
    residuals: Residuals,
    time: Array,
    jacobian: Callable[[Values], NDArray] | None,
    parameters: Sequence[Parameter],
    model: Actuator,
    stroke: float,
    given: Container[str] = (),
    beside: Sequence[Parameter] = (),
    parts: int = 1,
) -> tuple[list[Parameter], list[Values]]:
    """Find initial guesses of friction parameters by simulations of a part of one recording.

    Args:
        residuals: residual function of this part, with its measured positions.
        time: times of the samples of this part, s.
        jacobian: function for the derivatives of the residuals, as `fit_least_squares` takes it; None:
            numerical.
        parameters: parameters with the user's initial guess, which is tried too.
        model: the actuator.
        stroke: stroke of the stage under the drive, m.
        given: names of parameters with the user's bounds; the other bounds are widened to all plausible
            values.
        beside: parameters that are fixed, or tied to the free ones.
        parts: number of parts into which the ranges of forces and deflections are divided. With more than
            one, each pair of parts gives a guess, because the best points may all be of one kind, such as a
            slider that follows its stage with a delay.

    Returns:
        The parameters with wider bounds, and initial guesses by name, the best first: at most `BEGINS` in
            different local minima or, with several parts, at most one for each pair. Without a friction
            parameter to fit, the user's bounds and initial guess are returned unchanged.
    """
    names = [p.name for p in parameters if p.name in NAMES]
    if not names or not 0.0 < stroke * model.natural_frequency < math.inf:
        return list(parameters), [{p.name: p.start for p in parameters}]
    square = scipy.stats.qmc.LatinHypercube(2, rng=np.random.default_rng(0)).random(TRIED)
    found = plausible(model, stroke)(square)
    wide = [
        p._replace(
            lower=min(p.lower, 0.1 * found[p.name].min()), upper=max(p.upper, 10 * found[p.name].max())
        )
        if p.name in names and p.name not in given
        else p
        for p in parameters
    ]
    measured = np.asarray(residuals.measured)
    limits = {p.name: (p.lower, p.upper) for p in wide}
    start = {p.name: p.start for p in parameters}
    tried = [{name: float(np.clip(found[name][i], *limits[name])) for name in names} for i in range(TRIED)]
    at = [p for p in parameters if p.name in CHANNEL]

    def cost(point: Values) -> tuple[float, Values]:
        """Return the mean square of the residuals, m^2, after a linear correction by delay and offset, if
        these are free, and the point (values by name, SI) with the corrected ones; infinity and the unchanged
        point if it cannot be simulated."""
        try:
            r = np.asarray(residuals.function(point), dtype=float)
        except (ValueError, ArithmeticError):
            return math.inf, point
        if not np.all(np.isfinite(r)):
            return math.inf, point
        moved = {"delay": -np.gradient(r + measured, time), "offset": np.ones(r.size)}
        columns = np.column_stack([moved[p.name] for p in at]) if at else np.zeros((r.size, 1))
        step = np.linalg.lstsq(columns, -r, rcond=None)[0]
        found = {
            p.name: min(max(point[p.name] + s, p.lower), p.upper) for p, s in zip(at, step, strict=False)
        }
        return float(np.mean((r + columns @ step) ** 2)), point | found

    def with_slopes(values: Values) -> ArrayLike:
        if jacobian is not None:
            jacobian(values)  # the simulation for the derivatives also caches the position for the residuals
        return residuals.function(values)

    def look(point: Values) -> tuple[float, Values]:
        begun = [p.starting_at(point[p.name])._replace(prior=None) for p in wide]
        searched = residuals._replace(function=with_slopes)
        try:
            both = [*begun, *beside]
            fit = fit_least_squares([searched], both, jacobian=jacobian, max_evaluations=LOOK)
        except (FitError, np.linalg.LinAlgError):
            return math.inf, start
        return fit.reduced_chi_squared, {p.name: fit.values[p.name] for p in wide}

    costs = [cost(start | values) for values in tried]
    if parts > 1:
        cells = np.floor(parts * square).astype(int) @ [parts, 1]
        best = []
        for cell in np.unique(cells):
            there = sorted((costs[i] for i in np.flatnonzero(cells == cell)), key=itemgetter(0))
            best.append(min((look(point) for _, point in there[:LOOKED_AT_THERE]), key=itemgetter(0)))
        return wide, [values for _, values in sorted(best, key=itemgetter(0))]
    costs = sorted([cost(start), *costs], key=itemgetter(0))
    looks = sorted((look(point) for _, point in costs[:LOOKED_AT]), key=itemgetter(0))
    begins: list[Values] = []
    for _, values in looks:
        if all(far(values, known, names) for known in begins):
            begins.append(values)
    return wide, begins[:BEGINS]


def far(one: Values, other: Values, names: Sequence[str]) -> bool:
    """Return True if at least one named value of two points differs by more than the factor `APART`.

    Points at the ends of short searches are then taken to be in different local minima.
    """
    ends = [sorted((abs(one[name]), abs(other[name]))) for name in names]  # no ratios: a value may be 0
    return any(high > APART * low for low, high in ends)


def beside(parameters: Sequence[Parameter], values: Values, given: Container[str] = ()) -> list[Parameter]:
    """Return the parameters with their original bounds, starting at the end of a search within wide bounds.

    Default bounds of friction parameters are moved outwards if a value is beyond or near them.

    Args:
        parameters: parameters with original bounds.
        values: values at the end of the search, by name, SI.
        given: names of parameters with the user's bounds, which stay.
    """

    def at(p: Parameter) -> Parameter:
        value = values[p.name]
        if p.name in NAMES and p.name not in given and p.log:
            low = p.lower if value > p.lower * NEAR or p.shift else value / REACH
            high = p.upper if value < p.upper / NEAR else value * REACH
            return p._replace(start=value, lower=low, upper=high)
        return p.starting_at(value)

    return [at(p) for p in parameters]
