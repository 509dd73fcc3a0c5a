"""Diagnosis of a fit that does not explain its walks: which term is missing in the model.

Each candidate term (such as viscous friction) is first tested by the effect of a small step of its parameters
on the simulated motion. The test is the reduction of chi-squared with all other parameters free, linearised
at the present optimum. One simulation of the model and its perturbed copies serves all terms. The most
promising terms are then fitted.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.advice import Advice
from ...estimate.disturbances import MOVES
from ...estimate.disturbed import lack_beside_faults
from ...estimate.lack import independent_samples
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...estimate.score import ASKED, Together, together
from ...estimate.tied import Ties
from ...estimate.whiteness import white
from ...quantities.units import QuantityError, coordinate_of
from ...simulation.varied import NORMAL_FIELDS, with_normal_force, with_values
from ..free import parameter
from .displacement import has_slopes
from .position_channel import CHANNEL
from .reaction import CLEAR, difference, other_reaction, with_reaction
from .several import from_points
from .terms import NO_REACTION, REACTION, RIPPLE, STAGE, Term, Way, bounds_about, terms_of
from .walks import DIFFERENCE_STEP, Walks, own_values

# Number of terms that are fitted even if one of them explains the walks already, because other terms may
# explain them equally well.
FEWEST_FITTED = 4
# CPU time of a diagnosis after which no further term is fitted, s.
SECONDS = 20.0
# Share of the sum of squares of correlated residuals that a term must explain to be reported as missing if
# the noise is unknown.
MOST = 0.5
# Largest rms residual, relative to the tolerance of the simulation, that may come from simulation errors
# alone; correlated residuals below it are not diagnosed.
SIMULATED = 3.0
# Largest number of evaluations in the search with a further term, which starts near its minimum.
EVALUATIONS = 60
# Difference of chi-squared between two fitted terms, in standard deviations of its noise, above which the
# recordings prefer one of them.
DEVIATIONS = 2.0
# Relative size of the small step along a term if the perturbed models share the integration steps of the
# motion (`has_slopes`); other models use DIFFERENCE_STEP.
NEIGHBOUR = 1e-6

Array = NDArray[np.float64]
# Type of a function that fits walks from distant initial guesses. It takes the walks, all parameters, and
# the bounds of the new parameters by name, and returns the fit.
Afar = Callable[[Walks, list[Parameter], Mapping[str, tuple[float, float]]], Fit]


class Scored(NamedTuple):
    """A candidate for the missing term: the `term`, its most promising variant `way`, and the linearised
    effect `does` of adding this variant (reduction of chi-squared, estimated parameters)."""

    term: Term
    way: Way
    does: Together

    @property
    def start(self) -> Values:
        """Return the initial guess of the term's parameters by name, SI, from the linearised estimate."""
        return self.way.start(self.does.steps)


class Tried(NamedTuple):
    """A missing term that was fitted, and how the user can add it to the model.

    Attributes:
        cause: the term in words.
        fit: fit of the walks with the term.
        bounds: bounds by name that the added parameters need, SI.
        added: names of the parameters to free.
        change: new values of fields of the actuator, by name, for a term without parameters.
        untied: names of parameters whose tie must be removed.
    """

    cause: str
    fit: Fit
    bounds: Mapping[str, tuple[float, float]] = MappingProxyType({})
    added: tuple[str, ...] = ()
    change: Mapping[str, bool] = MappingProxyType({})
    untied: tuple[str, ...] = ()

    @property
    def explains(self) -> bool:
        """Return True if no recording shows a lack of fit and, where the noise is not known, residuals are
        not correlated."""
        return not lacking(self.fit) and (_judged(self.fit) or not correlated(self.fit))


def lacking(fit: Fit) -> bool:
    """Return True if the residual of at least one recording exceeds its independently known noise (lack of
    fit)."""
    return any(one.seen for one in fit.lack)


def diagnosed(fit: Fit, walks: Walks, reacting: Fit | None, afar: Afar) -> Fit:
    """Return the fit with advice on the missing term; unchanged if the model explains the walks, the loss is
    robust, or only instrument faults cause the misfit.

    With a lack of fit, the advice is also a remark. If the noise is unknown or larger than the misfit, a term
    that explains most of the correlated residuals is reported as a doubt.

    Args:
        fit: fit of the walks, with its model.
        walks: the fitted walks.
        reacting: fit with the reaction of friction on the stage; None: this function makes the fit, if the
            model lacks the reaction.
        afar: function that fits from distant initial guesses, see `Afar`.
    """
    lacks = lacking(fit)
    if fit.loss != "linear" or not (lacks or (correlated(fit) and fit.rmse > _error_of_simulation(walks))):
        return fit
    if lacks and not any(one.seen for one in lack_beside_faults(fit)):
        return fit  # instrument faults, which are reported elsewhere, cause the whole lack of fit
    terms = scored(fit, walks)
    if not lacks:
        terms = [one for one in terms if one.does.share > MOST]
        if not terms:
            return fit
    advice = _advice(fit, walks, terms, reacting, afar)
    if not advice.explains and any(one.moves > MOVES for one in fit.disturbances):
        return fit  # an instrument fault changes the values, and no tried term explains the walks
    if lacks:
        return replace(fit, advice=advice, remarks=(*fit.remarks, advice.sentence))
    if not advice.explains or advice.after > math.sqrt(1.0 - MOST) * advice.before:
        return fit
    said = (
        f"the model leaves more than noise: {advice.sentence}; without it the intervals are not to be trusted"
    )
    return replace(fit, advice=advice, doubts=(*fit.doubts, said))


def with_advice_of(fit: Fit, other: Fit) -> Fit:
    """Return the fit with the advice of `other`, a fit of the same model to more walks, and with the remarks
    and doubts of `other` that contain the advice; unchanged if `other` has no advice."""
    advice = other.advice
    if advice is None:
        return fit
    remarks, doubts = (
        tuple(s for s in said if advice.sentence in s) for said in (other.remarks, other.doubts)
    )
    return replace(fit, advice=advice, remarks=(*fit.remarks, *remarks), doubts=(*fit.doubts, *doubts))


def _judged(fit: Fit) -> bool:
    """Return True if the fit has a lack-of-fit test against known noise for every recording."""
    return bool(fit.lack) and not any(math.isnan(one.ratio) for one in fit.lack)


def _error_of_simulation(walks: Walks) -> float:
    """Return the largest rms residual, in the unit of the positions, that simulation errors alone may
    cause."""
    return SIMULATED * max(motion.tolerance for motion in walks.motions)


def correlated(fit: Fit) -> bool:
    """Return True if the residuals are autocorrelated (not white), tested over all recordings."""
    return not white(np.concatenate(fit.residuals), [r.size for r in fit.residuals])


def _advice(fit: Fit, walks: Walks, terms: Sequence[Scored], reacting: Fit | None, afar: Afar) -> Advice:
    begun, tried = time.process_time(), list[Tried]()

    def spent() -> float:
        return time.process_time() - begun

    reacting = reacting or with_reaction(fit, walks, EVALUATIONS)
    if reacting is not None:
        tried.append(Tried(REACTION, walks.completed(reacting), change={"stage_reaction": True}))
    for search in (None, afar):  # fit from the present values (None), then from distant initial guesses
        for one in terms if search is None else _from_afar(fit, terms):
            explained = any(other.explains for other in tried)
            if spent() > SECONDS or (explained and (search or len(tried) >= FEWEST_FITTED)):
                break
            found = _fitted(fit, walks, one, search)
            if found is not None:
                bounds = bounds_about(one.term, found.values)
                untied = tuple(name for name in one.term.untied if name in fit.tied)
                tried.append(Tried(one.term.cause, found, bounds, one.term.names, untied=untied))
    if not any(one.explains for one in tried) and spent() < SECONDS:
        unmoved = _without_reaction(fit, walks, afar)
        if unmoved is not None:
            tried.append(Tried(NO_REACTION, unmoved, change={"stage_reaction": False}))
    return _verdict(fit, tried, spent())


def _without_reaction(fit: Fit, walks: Walks, afar: Afar) -> Fit | None:
    """Return the fit of the model without the reaction of friction on the stage, from distant initial guesses
    (`afar`); None if the model has no reaction, or cannot be fitted without it."""
    other = other_reaction(fit, walks, reacts=False)
    if other is None:
        return None
    unmoved, own = other
    try:
        return unmoved.completed(afar(unmoved, own, {}))
    except (FitError, QuantityError, ArithmeticError):
        return None


def _from_afar(fit: Fit, terms: Sequence[Scored]) -> list[Scored]:
    """Return the terms that are also fitted from distant initial guesses, because the present minimum may
    belong to a wrong model: all but stage and ripple, and none if the fit has no lack of fit."""
    return [one for one in terms if one.term.cause not in (STAGE, RIPPLE)] if lacking(fit) else []


def scored(fit: Fit, walks: Walks) -> list[Scored]:
    """Return the terms that the model may lack, each with its most promising variant, by decreasing expected
    reduction of chi-squared.

    Without a lack of fit, only terms that reduce chi-squared by more than chance are included. With a lack of
    fit all are, because the fit may be in a wrong minimum. The list is empty if the test cannot be simulated.
    """
    exact = has_slopes(fit.model)
    terms = terms_of(fit, walks, NEIGHBOUR if exact else DIFFERENCE_STEP)
    beside = [values for term in terms for way in term.ways for values in way.beside]
    if not beside or fit.jacobian is None:
        return []
    try:
        columns = _columns(fit, walks, beside)
    except (ArithmeticError, ValueError):
        return []
    found, at = [], 0
    for term in terms:
        best: Scored | None = None
        for way in term.ways:
            does = together(fit, columns[:, at : at + len(way.beside)])
            at += len(way.beside)
            if best is None or does.gain > best.does.gain:
                best = Scored(term, way, does)
        if best is not None and (best.does.gain > ASKED * len(term.names) or lacking(fit)):
            found.append(best)
    return sorted(found, key=lambda one: -one.does.gain)


def _columns(fit: Fit, walks: Walks, beside: Sequence[Values]) -> Array:
    """Return the changes of the simulated positions of `walks`, m (rad), for each perturbed model of the fit,
    shape (samples of all recordings, models); `beside` contains the changed values by name, SI, of each
    model."""
    delay = fit.values.get("delay", 0.0)
    model = fit.model
    if any(name in NORMAL_FIELDS for values in beside for name in values):
        model = with_normal_force(model, NORMAL_FIELDS)
    others = [with_values(model, values) for values in beside]
    return np.concatenate([motion.beside(model, delay, others) for motion in walks.motions])


def _fitted(fit: Fit, walks: Walks, one: Scored, afar: Afar | None) -> Fit | None:
    """Return the fit with one further term free; None if the model with the term cannot be fitted.

    Searches start at the present values and at the linearised estimate or, if `afar` is given, from distant
    initial guesses.
    """
    start = one.start
    bounds = one.term.bounds or bounds_about(one.term, start)
    try:
        model = with_values(walks.model, {**own_values(fit.values), **start})
        new = [parameter(model, name, bounds, coordinate_of(walks.unit)) for name in one.term.names]
        new = [p.starting_at(min(max(start[p.name], p.lower), p.upper)) for p in new]
        own = [p.starting_at(fit.values[p.name])._replace(power=0) for p in fit.parameters]
        free = [*own, *new]
        kept = [p for p in fit.beside if p.name not in one.term.untied]
        more = replace(walks, ties=Ties([*free, *kept]))
        if afar is not None:
            return afar(more, free, bounds)
        guesses = [{p.name: p.start for p in free}, _ahead(own, one.does.moves) | _starts(new)]
        return from_points(more, free, guesses, [p.name for p in free], EVALUATIONS)
    except (FitError, QuantityError, ArithmeticError):
        return None


def _starts(parameters: Sequence[Parameter]) -> Values:
    return {p.name: p.start for p in parameters}


def _ahead(parameters: Sequence[Parameter], moves: Array) -> Values:
    """Return the parameters' values by name, SI, after changes `moves` of their search coordinates (such as
    logarithms), shape (parameters,), limited to the bounds."""
    found = {}
    for p, move in zip(parameters, moves, strict=True):
        value = p.value(p.coordinate(p.start) + move)
        found[p.name] = min(max(value, p.lower), p.upper)
    return found


def _verdict(fit: Fit, tried: Sequence[Tried], seconds: float) -> Advice:
    """Return the advice: the best of the tried terms, and those that describe the walks equally well.

    Terms that explain the walks come first, then the lowest BIC decides. The cause is "" if no term lowers
    chi-squared clearly. `seconds` is the CPU time spent.
    """
    names, stopped = tuple(dict.fromkeys(one.cause for one in tried)), seconds > SECONDS
    better = [one for one in tried if _lower(fit, one.fit) > CLEAR]
    explaining = [one for one in better if one.explains]
    ranked = sorted(explaining or better, key=lambda one: one.fit.bic)
    if not ranked:
        left = _left(fit, fit)
        return Advice("", False, left, left, _unit(fit), tried=names, seconds=seconds, stopped=stopped)
    best, equal = ranked[0], dict[str, Tried]()
    for one in ranked[1:]:
        if one.cause != best.cause and not _told_apart(best.fit, one.fit):
            equal.setdefault(one.cause, one)
    others = tuple(_advice_of(fit, one) for one in equal.values())
    advice = _advice_of(fit, best)
    return advice._replace(tried=names, seconds=seconds, stopped=stopped, equal=others)


def _advice_of(fit: Fit, one: Tried) -> Advice:
    """Return the advice to add the term of one tried fit to the model of `fit`."""
    found = one.fit
    shown = ", ".join(
        f"{p.name} = {p.shown(found.values[p.name], 3)}"
        for p in found.parameters
        if p.name in one.added or p.name not in CHANNEL
    )
    return Advice(
        one.cause,
        one.explains,
        _left(fit, fit),
        _left(found, fit),
        _unit(fit),
        free=tuple(p.name for p in found.parameters if p.name not in CHANNEL),
        added=one.added,
        bounds=dict(one.bounds),
        change=dict(one.change),
        untied=one.untied,
        values={p.name: found.values[p.name] for p in found.parameters},
        shown=shown,
    )


def _told_apart(fit: Fit, other: Fit) -> bool:
    """Return True if the recordings distinguish two fits of different models (Vuong's test).

    The standard deviation of the difference of their chi-squared is twice the distance between their
    simulations, in standard deviations of the noise.
    """
    left = np.concatenate(fit.residuals)
    apart = np.concatenate(other.residuals) - left
    share = independent_samples(left) / left.size
    variance = float(left @ left) / max(fit.degrees_of_freedom, 1)
    noise = 2.0 * math.sqrt(share * float(apart @ apart) / variance)
    return abs(_lower(fit, other)) > max(CLEAR, DEVIATIONS * noise)


def _lower(fit: Fit, other: Fit) -> float:
    """Return by how much chi-squared is lower in `other` than in `fit` (negative: higher), scaled to the
    number of independent samples."""
    left = np.concatenate(other.residuals)
    return independent_samples(left) / left.size * difference(fit, other)


def _unit(fit: Fit) -> str:
    """Return the unit of the residuals in the advice, as `_left` gives them: "" with a lack of fit (they are
    then ratios to the noise), else the unit of the positions."""
    return "" if lacking(fit) else fit.recordings[0].unit


def _left(fit: Fit, of: Fit) -> float:
    """Return the residual of a fit for the advice: if the original fit `of` has a lack of fit, the largest
    ratio to the noise (NaN if unknown); otherwise the rms in the unit of the positions."""
    ratios = [one.ratio for one in fit.lack if not math.isnan(one.ratio)]
    return max(ratios, default=math.nan) if lacking(of) else fit.rmse
