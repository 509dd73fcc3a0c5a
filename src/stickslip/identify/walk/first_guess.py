r"""Starting values for fits of friction, from the sizes of the actuator itself.

Let A be the stroke of the stage under the drive. Friction moves the end-effector (mass m) along with the slow
stage and loses it at a jump, where the stage accelerates by up to A omega_n^2: it is below m A omega_n^2, and
not by many decades. It loses it only if the contact deflects by less than A before it slides. And the
contact, a spring and a damper between the masses, is neither undamped nor rigid:

.. math::

    F_C < m A \omega_n^2, \qquad F_C / \sigma_0 < A, \qquad
    \zeta_c = \frac{\sigma_1}{2 \sqrt{\sigma_0 m}} \sim 10^{-2} \ldots 10^{0}

So three decades of force and of deflection hold the truth, wherever the user starts. They are filled with
points, with a damping in the middle, which shows least; the first periods of a recording choose among them.
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
# Ranges of force and deflection, relative to the largest force and the stroke; and the damping ratio of the
# contact.
FORCE, DEFLECTION, DAMPING = (1e-3, 1.0), (1e-3, 1.0), 0.1
# number of periods that are used, and the fewest samples in them; otherwise all samples are used
PERIODS, FEWEST = 3, 30
# Bounds closer to the estimate than this factor are treated as defaults, not as the user's choice.
NEAR = 3.0
# Number of points that are tried, number of these that are refined, and evaluations for each refinement.
TRIED, LOOKED_AT, LOOK = 64, 20, 6
LOOKED_AT_THERE = 2  # number of refined points in each part of the range, if it is divided
# Number of initial guesses, and the factor by which their values must differ.
BEGINS, APART = 6, 1.25

Array = NDArray[np.float64]


def plausible(model: Actuator, stroke: float) -> Callable[[Array], dict[str, Array]]:
    """Return a function that gives values of the law, by name, [n] each in SI, for points [n, 2] of the unit
    square; `stroke` is A in m.

    Values that the law lacks are left out; the stiffness is the ratio of force to deflection.
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
    """Return the number of samples in the first periods, or of all samples without periods."""
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
    """Return the parameters with wide enough bounds, and initial guesses.

    The first guess fits a short part of a recording best; other local minima follow, at most `BEGINS` in all.

    Args:
        residuals: function for the residuals of this part, with the measured positions.
        time: times of its samples, s.
        jacobian: derivatives of the residuals, as `fit_least_squares` takes them.
        parameters: parameters with the user's initial guess, which is tried too.
        model: the actuator.
        stroke: stroke of the stage under the drive, m.
        given: parameters with the user's bounds; the other bounds are widened to all plausible values.
        beside: parameters that are fixed, or tied to the free ones.
        parts: number of parts of the ranges of forces and deflections; with more than one, a start in each
            pair. The best points may all be of one kind, such as a slider that follows its stage with a
            delay.
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
        """Return the mean square of the residuals at the best delay and offset, and the point with these."""
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
            jacobian(values)  # position and slopes come from the same simulation
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
    """Return whether two points are in different local minima, judged by a short search."""
    ends = [sorted((abs(one[name]), abs(other[name]))) for name in names]  # one value may be 0, at its bound
    return any(high > APART * low for low, high in ends)


def beside(parameters: Sequence[Parameter], values: Values, given: Container[str] = ()) -> list[Parameter]:
    """Return the parameters at the end of a search within wide bounds, with their own bounds again.

    Default bounds are widened if a value is beyond or near them.
    """

    def at(p: Parameter) -> Parameter:
        value = values[p.name]
        if p.name in NAMES and p.name not in given and p.log:
            low = p.lower if value > p.lower * NEAR or p.shift else value / REACH
            high = p.upper if value < p.upper / NEAR else value * REACH
            return p._replace(start=value, lower=low, upper=high)
        return p.starting_at(value)

    return [at(p) for p in parameters]
