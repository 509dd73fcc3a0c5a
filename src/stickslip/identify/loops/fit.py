r"""Friction of a contact whose motion and force are measured: a tribometer, prescribed motion.

The measured force differs from the law's force by properties of the channel and of the contact, which are
identified together with the law:

.. math:: F_{meas} = b + \left(\frac{N}{N_0}\right)^p \left( 1 + c\,(t - t_0) \right)
          \left( q + F + a |F| + h F^2 \right), \qquad F = F_{law}

N is the normal force (reference: N_0); b [N] is the bias of the channel without a contact; p the exponent of
the load (1: Amontons; 2/3: one elastic asperity); c [1/s] the drift of the strength from t_0 on, as in
running-in; and three terms that differ forward and backward: a part q [N] of the force that does not reverse
with the motion, a share a of strength, a curvature h [1/N]. Each is 0 (p: 1) unless it is free. Under a
constant load b and q have the same effect; samples without load distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...estimate.budget import EvaluationBudget
from ...estimate.coloured import with_own_noise
from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import Problem, Residuals
from ...estimate.result import Fit
from ...estimate.several import ENOUGH, followed, from_several, lowest
from ...quantities.progress import Progress, unheard
from ...quantities.units import ANGLE, Coordinate, coordinate_of, optional_si, to_si
from ...recording import RecordingError
from ...simulation.varied import free_names, with_values
from ..free import (
    Bounds,
    beside,
    check_names,
    check_priors,
    exchangeable,
    known_of,
    linear,
    parameter,
    said_of,
    with_prior,
)
from ..quantised import Inexact, moved_by, said_steps, with_moved
from ..recorded.channels import channel, names_of, recordings_of, refuse_clipped, unit_of
from ..recorded.known_noise import white_noise
from ..recorded.screen import refuse_loop, said_far
from ..scales import by_prediction, with_scales
from .first import with_first
from .misfit import alike, said_minima
from .missing import Slope, left_over, missing, viscous_slope
from .profiled import ladder, profile_points, stiffness_of, with_profile
from .response import CHANNEL, OBSERVED, LoopPrediction, own_of, response_of
from .sampled import with_sampling
from .starts import loop_starts, stribeck_starts

if TYPE_CHECKING:
    import xarray as xr

# Terms (c, a, q of the module's equation) that are reported if they would explain residuals but are not free.
NOTICED = ("drift", "asymmetry", "contact_offset")
LOAD_EXPONENTS = (0.2, 2.0)  # first search range of the load exponent p
# Limits of the search (lower, upper) that physics sets: the force does not fall with the load, and friction
# opposes the motion in both directions.
LIMITS = {"load_exponent": (0.0, math.inf), "asymmetry": (-0.99, 0.99)}
# CLIMBS: largest number of times that the fit starts again at another stiffness with a lower sum of squares.
# SAME_COST: smallest relative decrease of the sum of squares for such a start.
CLIMBS, SAME_COST = 3, 1e-6
# Relative step of numerical derivatives: its effect on the force far exceeds simulation errors at 1e-9 m.
DIFFERENCE_STEP = 1e-3


def identify_loops(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Any,
    free: Sequence[str | Parameter],
    *,
    reference_normal_force: float | str | None = None,
    bounds: Bounds | None = None,
    priors: Bounds | None = None,
    tied: Mapping[str, str] | None = None,
    noise: float | str | None = None,
    starts: int = 1,
    seed: int = 0,
    tolerance: float | str = 1e-9,
    correlated: bool = True,
    max_evaluations: int = 3000,
    progress: Progress = unheard,
) -> Fit:
    """Fit a friction law to friction loops: position prescribed, force measured.

    Every recording is one free-running prediction from its first sample, where all elements of the law are
    equally deflected and carry the measured force minus its viscous part (their true state is not known). The
    measured force is that of the first sample, or the median while the position is constant. Start recordings
    at rest: the noise of a single first sample persists until the contact slips and widens the intervals. The
    intervals do not include the error of equal deflections, which are wrong just after a reversal. Between
    samples the motion is smooth (see `sampled`). The motion may pass the Stribeck range too quickly to
    determine the Stribeck velocity. Then the other values are fitted again at several fixed velocities, and
    the intervals contain all of these fits that the noise does not reject.

    Args:
        recordings: with position [m] and friction_force [N], positive when the driving body moves towards +x;
            or with an angle [rad] and a torque [N m] in these channels, and all parameters in their units.
        model: friction law with the initial values; its forces hold at `reference_normal_force`.
        free: parameters to fit: scalar fields of the law, values of its elements ("stiffness_2"),
            "stiction_ratio" and "breakaway_share" (see `identify_friction`), and values of the channel and
            contact: "bias", "contact_offset" (a force that does not reverse), "asymmetry" and "curvature"
            (differences of the directions), "drift" and "load_exponent", in the module's equation b, q, a, h,
            c and p. Each is a name or a `Parameter`, as for `identify_friction`.
        reference_normal_force: N; the recordings then have normal_force [N], and the law's forces follow it,
            in proportion unless load_exponent is free. By default, the normal force is constant.
        bounds: lower and upper bound of free parameters by name, in SI or as strings. By default they are
            first searched within a factor 30 of the initial guess and of an estimate from the size of the
            loops; for the channel up to the largest force, half its inverse, the inverse of the duration, 0.9
            (asymmetry), or from 0.2 to 2 (load_exponent); and then as far as the law allows.
        priors: value and standard deviation of free parameters by name, as for `identify_friction`; priors
            need a given noise.
        tied: parameters that follow from others, as for `identify_friction`:
            ``{"strength_2": "0.5 * strength_1"}``.
        noise: standard deviation of the force, N (N m); by default estimated from the residuals.
        starts, seed, max_evaluations, progress: as for `identify_friction`.
        tolerance: largest error of simulated deflections, m; at most a millionth of the stroke.
        correlated: the uncertainty allows for residuals correlated in time, as model errors are: as in
            `identify_friction` or, with a given `noise`, by a window over lags.

    Returns:
        A fit whose `model` is the law with the fitted values, and whose ``predict(recording)`` is the force
        of the channel, simulated from the first sample.

    Raises:
        RecordingError: a channel is missing, too short or constant; the force is clipped; a channel is noise;
            the force does negative work; or only one of position and force is rotary.
        QuantityError: a name that cannot be free, priors without a noise, or bounds that do not fit.
        FitError: see `fit_least_squares`.
    """
    tolerance = to_si(tolerance, "m", "tolerance")
    reference = optional_si(reference_normal_force, "N", "reference_normal_force")
    found = recordings_of(recordings)
    names, along = names_of(found), _coordinate(found)
    units = {name: along.unit(unit) for name, unit in CHANNEL.items()}
    noise = optional_si(noise, units["bias"], "noise")
    neutral = {name: (1.0 if name == "load_exponent" else 0.0, unit) for name, unit in units.items()}
    free, bounds, priors, tied, starting = said_of(
        free, known_of(model, neutral, along), bounds, priors, tied
    )
    check_names(free, [*free_names(model), *CHANNEL], bounds)
    check_priors(priors, free, noise, "[N], the force's deviation")
    measured = [channel(r, OBSERVED, name, varies=True) for r, name in zip(found, names, strict=True)]
    for name, force in zip(names, measured, strict=True):
        refuse_clipped(force, OBSERVED, name, rests=True)
    for r, name, force in zip(found, names, measured, strict=True):
        refuse_loop(channel(r, "position", name, varies=True), force, name, ("position", OBSERVED))
    origin = float(found[0]["time"].values[0])
    settings = (reference, origin, tolerance)
    responses = [response_of(r, name, *settings) for r, name in zip(found, names, strict=True)]
    model = with_values(model, own_of(starting)) if starting else model
    reach = _reach(found, measured, origin)
    parameters = [
        _of_channel(name, units[name], starting.get(name, neutral[name][0]), reach.get(name, 0.0), bounds)
        if name in CHANNEL
        else parameter(model, name, bounds, along)
        for name in free
    ]
    parameters = [with_prior(p, priors) for p in parameters]
    parameters, guesses = loop_starts(given := parameters, found, measured, bounds)
    others = beside(free, tied, known_of(model, neutral, along))

    parts = [
        Residuals(
            _residuals(model, response, force), force, noise, name, units["bias"], time=one["time"].values
        )
        for response, force, name, one in zip(responses, measured, names, found, strict=True)
    ]
    described = partial(
        Problem,
        parts,
        noise_known=noise is not None,
        correlated=correlated and noise is not None,
        difference_step=DIFFERENCE_STEP,
        exchangeable=exchangeable(model, parameters, others),
    )
    guesses = [{p.name: p.start for p in parameters}, *guesses]
    budget = EvaluationBudget.of(measured, [white_noise(force) for force in measured], noise or 1.0)
    how = (partial(alike, measured=measured), starts, seed, max_evaluations, progress, budget)
    fit = budget.told(_lowest(described, [*parameters, *others], guesses, found, *how))
    fit = with_own_noise(fit) if correlated and noise is None else fit
    fit, left_by = _with_inexact(fit, found, measured, model, settings)
    asked = _unasked({*free, *tied})
    beside_it = [Slope(name, reach[name], _slope(fit, name, responses, model, reach)) for name in asked]
    noticed, doubts = missing(fit, model, viscous_slope(found, along), beside_it)
    if noise is None:
        said, beyond = left_over(fit, measured, left_by)
        noticed, doubts = [*noticed, *said], [*doubts, *beyond]
    doubts = [*doubts, *said_minima(fit, measured)]
    sizes = {p.name: p.start for p in given if p.name not in CHANNEL and p.log and not p.shift}
    fit = replace(
        fit,
        model=with_values(model, own_of(fit.values)),
        observed=OBSERVED,
        predict=LoopPrediction(model, fit.values, *settings).predict,
        doubts=(*fit.doubts, *doubts),
        remarks=(*fit.remarks, *noticed, *said_far(sizes, fit.values)),
    )
    return with_scales(fit, found, by_prediction(found, "position"), known="position")


def _lowest(
    described: Callable[[Sequence[Parameter]], Problem],
    parameters: Sequence[Parameter],
    guesses: Sequence[Values],
    recordings: Sequence[xr.Dataset],
    less: Callable[[Fit], float],
    *how: Any,
) -> Fit:
    """Return the fit at the lowest minimum; searches also start at other Stribeck velocities and, for a wrong
    law, at other stiffnesses. The intervals contain the other solutions of `profiled`. `described` returns
    the problem of given parameters; `how` are the arguments of `_searched` after `less`, the budget last."""
    problem = described(parameters)
    fit = _searched(problem, guesses, less, *how)
    if how[-1].over:
        return fit
    if falls := stribeck_starts(problem.parameters, fit.values, recordings):
        fit = _searched(problem, [fit.values, *falls], less, *how)
    points = profile_points(fit, parameters, described)
    if any(one.cost < fit.cost for one in points):  # the fit was not at the lowest minimum
        fit = _searched(problem, [fit.values, min(points, key=lambda one: one.cost).values], less, *how)
    fit = with_profile(fit, points)
    return _with_other_stiffnesses(
        fit, parameters, described, lambda at: _searched(problem, at, less, *how), less
    )


def _with_other_stiffnesses(
    fit: Fit,
    parameters: Sequence[Parameter],
    described: Callable[[Sequence[Parameter]], Problem],
    search: Callable[[Sequence[Values]], Fit],
    less: Callable[[Fit], float],
) -> Fit:
    """Return the fit, or a better one at another stiffness, with intervals that include other stiffnesses
    that fit as well; unchanged without a single free stiffness, or if the law describes the forces. `search`
    takes initial guesses; the others are as for `_lowest`."""
    name, points, counts = stiffness_of(fit), (), less(fit)
    if name is None or counts <= 1.0:
        return fit
    for _ in range(CLIMBS):
        counts = less(fit)
        points = ladder(fit, name, counts, parameters, described)
        low = min(points, key=lambda one: one.cost, default=fit)
        if low.cost >= fit.cost * (1.0 - SAME_COST):
            break
        fit = lowest([search([low.values, fit.values]), fit], less)
    return with_profile(fit, points, name, counts)


def _searched(
    problem: Problem,
    guesses: Sequence[Values],
    less: Callable[[Fit], float],
    starts: int,
    seed: int,
    max_evaluations: int,
    progress: Progress,
    budget: EvaluationBudget,
) -> Fit:
    """Return the fit at the lowest minimum of searches from the initial guesses `guesses` and, if `starts` is
    above 1, from `starts` - 1 random ones within the bounds. `less` returns the factor by which excesses of
    chi-squared are divided, as in `lowest`; the others are as for `identify_loops`."""
    problem.budget = budget

    def search(initial: Values, most: int, starts: int = 1) -> Fit:
        return fit_least_squares(
            problem,
            initial=initial,
            starts=starts,
            seed=seed,
            tolerance=1e-7,
            max_evaluations=min(most, max_evaluations),
            progress=progress,
        )

    fit = from_several(
        guesses,
        lambda initial: search(initial, ENOUGH * (1 + len(guesses[0]))),
        lambda kept: [followed(one, lambda one=one: search(one.values, max_evaluations)) for one in kept],
        less,
    )
    more = starts > 1 and not budget.over
    return lowest([fit, search(fit.values, max_evaluations, starts)], less) if more else fit


def _residuals(
    model: Any, response: Callable[..., Any], force: NDArray[np.float64]
) -> Callable[[Values], NDArray[np.float64]]:
    def of(values: Values) -> NDArray[np.float64]:
        return response(model, values) - force

    return of


def _unasked(had: Collection[str]) -> list[str]:
    """Return the names in `NOTICED` that are not in `had`, the free and tied parameters of a fit.

    With a free bias "contact_offset" is left out: under a constant load both have the same effect.
    """
    return [n for n in NOTICED if n not in had and not (n == "contact_offset" and "bias" in had)]


def _coordinate(recordings: Sequence[xr.Dataset]) -> Coordinate:
    """Return the coordinate of the motion: a length (with a force), or an angle (with a torque).

    Raises:
        RecordingError: only one of position and force is rotary.
    """
    motion, force = unit_of(recordings, "position"), unit_of(recordings, OBSERVED)
    along = coordinate_of(motion)
    if (along is ANGLE) != (force == ANGLE.unit("N")):
        raise RecordingError(
            f"position is in {motion}, but {OBSERVED} in {force}: rad goes with N m, m with N"
        )
    return along


def _reach(
    recordings: Sequence[xr.Dataset], measured: Sequence[NDArray[np.float64]], origin: float
) -> dict[str, float]:
    """Return the largest plausible size, SI, of each value in `CHANNEL` except the exponent, by name, from
    the measured forces [N] and the time from `origin` [s] to the last sample."""
    largest = max(float(np.max(np.abs(force))) for force in measured)
    span = max(float(r["time"].values[-1]) for r in recordings) - origin
    return {
        "bias": largest,
        "contact_offset": largest,
        "asymmetry": 0.9,
        "curvature": 0.5 / largest,
        "drift": 1.0 / span,
    }


def _with_inexact(
    fit: Fit,
    recordings: Sequence[xr.Dataset],
    measured: Sequence[NDArray[np.float64]],
    model: Any,
    settings: tuple[float | None, float, float],
) -> tuple[Fit, list[float]]:
    """Return the fit with further uncertainty, and the rms of its effect on each recording's force [N].

    The causes are noise of the initial force, converter steps and noise of the recorded position and normal
    force, their sampling, and converter steps of the force. The rms contains the effects of position, normal
    force and sampling only. `settings` are reference, origin and tolerance of `response_of`.
    """
    names, squares, best = names_of(recordings), np.zeros(len(recordings)), fit.values

    def of_one(recording: xr.Dataset) -> NDArray[np.float64]:
        return response_of(recording, names[0], *settings)(model, best)

    fit = with_first(fit, recordings, of_one)
    ends = np.cumsum([force.size for force in measured])[:-1]
    for what in ("position",) if settings[0] is None else ("position", "normal_force"):
        values = [channel(r, what, name) for r, name in zip(recordings, names, strict=True)]

        def shown(drawn: Sequence[NDArray[np.float64]], what: str = what) -> NDArray[np.float64]:
            changed = [r.assign({what: ("time", x)}) for r, x in zip(recordings, drawn, strict=True)]
            return np.concatenate([of_one(r) for r in changed])

        known = [Inexact.seen(x) for x in values]
        moved = moved_by(known, shown)
        fit = with_moved(fit, moved, said_steps(what, known, unit_of(recordings, what)))
        if moved is not None:
            squares += [float(np.mean(part**2)) for part in np.split(moved, ends, axis=1)]
    fit, more = with_sampling(fit, recordings, of_one)
    squares += more
    forces = [Inexact.seen(force, noisy=False) for force in measured]
    moved = moved_by(forces, lambda drawn: -np.concatenate(drawn))
    fit = with_moved(fit, moved, said_steps(OBSERVED, forces, unit_of(recordings, OBSERVED)))
    return fit, [*np.sqrt(squares)]


def _slope(
    fit: Fit, name: str, responses: Sequence[Callable[..., Any]], model: Any, reach: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return the derivatives of all forces by the named term of the channel, which is not free, shape
    (samples of all recordings,). `responses` predict the forces; `reach` has typical sizes by name."""
    h = DIFFERENCE_STEP * reach[name]
    sides = [
        np.concatenate([response(model, {**fit.values, name: x}) for response in responses]) for x in (h, -h)
    ]
    return (sides[0] - sides[1]) / (2.0 * h)


def _of_channel(name: str, unit: str, start: float, reach: float, bounds: Bounds) -> Parameter:
    ends = LOAD_EXPONENTS if name == "load_exponent" else (-reach, reach)
    return linear(name, unit, start, ends, bounds, LIMITS.get(name, (-math.inf, math.inf)))
