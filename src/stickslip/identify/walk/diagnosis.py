"""Diagnosis of a fit that does not explain its walks: which term is missing in the model.

Each missing term is first tested by the effect of a small step along it on the simulated motion. The test is
the reduction of chi-squared with all other parameters free, linearised at the present optimum. One simulation
with its neighbours serves all terms. The most promising few terms are then fitted.
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
from .reaction import CLEAR, difference, with_reaction
from .several import from_points
from .terms import NO_REACTION, REACTION, RIPPLE, STAGE, Term, Way, bounds_about, terms_of
from .walks import DIFFERENCE_STEP, Walks, own_values

# Number of terms that are fitted even if an earlier one explains the walks, because others may explain them
# as well.
FEWEST_FITTED = 4
# CPU time [s] after which no further term is fitted.
SECONDS = 20.0
# Share of the sum of squares: a term that explains more of correlated residuals is missing, at any noise
# level.
MOST = 0.5
# Largest residual, in tolerances, that errors of simulations may cause; recordings may be simulated too.
SIMULATED = 3.0
# Evaluations of such a search; it starts near its end.
EVALUATIONS = 60
# Difference of chi-squared of two terms, in standard deviations, above which they are distinguished.
DEVIATIONS = 2.0
# Relative size of the small steps along a term: for models that use the integration steps of the motion
# itself, and for others.
NEIGHBOUR = 1e-6

Array = NDArray[np.float64]
# Function that fits walks from distant initial guesses; its arguments are walks, parameters and bounds of new
# parameters.
Afar = Callable[[Walks, list[Parameter], Mapping[str, tuple[float, float]]], Fit]


class Scored(NamedTuple):
    """A missing term, its most promising variant, and the expected reduction of chi-squared."""

    term: Term
    way: Way
    does: Together

    @property
    def start(self) -> Values:
        """Return the initial guess of a search for the term's parameters."""
        return self.way.start(self.does.steps)


class Tried(NamedTuple):
    """A term that was fitted: the fit, the `cause` in words, and how the user can add it to the model."""

    cause: str
    fit: Fit
    bounds: Mapping[str, tuple[float, float]] = MappingProxyType({})
    added: tuple[str, ...] = ()
    change: Mapping[str, bool] = MappingProxyType({})
    untied: tuple[str, ...] = ()

    @property
    def explains(self) -> bool:
        """Return True if no recording shows a lack of fit or, without known noise, correlated residuals."""
        return not lacking(self.fit) and (_judged(self.fit) or not correlated(self.fit))


def lacking(fit: Fit) -> bool:
    """Return True if a recording shows that the model does not explain it."""
    return any(one.seen for one in fit.lack)


def diagnosed(fit: Fit, walks: Walks, reacting: Fit | None, afar: Afar) -> Fit:
    """Return the fit with advice on the missing term, if it does not explain the walks.

    If the recordings do not show their noise, or the misfit hides in it, a term that explains most of
    correlated residuals is reported as a doubt.

    Args:
        fit: fit of the walks, with its model.
        walks: the fitted walks.
        reacting: fit of `with_reaction`, if there is one.
        afar: search of parameters from distant initial guesses.
    """
    lacks = lacking(fit)
    if fit.loss != "linear" or not (lacks or (correlated(fit) and fit.rmse > _error_of_simulation(walks))):
        return fit
    if lacks and not any(one.seen for one in lack_beside_faults(fit)):
        return fit  # the cause is a fault of the instrument, which is already reported
    terms = scored(fit, walks)
    if not lacks:
        terms = [one for one in terms if one.does.share > MOST]
        if not terms:
            return fit
    advice = _advice(fit, walks, terms, reacting, afar)
    if not advice.explains and any(one.moves > MOVES for one in fit.disturbances):
        return fit  # the cause is a fault of the instrument, which is reported
    if lacks:
        return replace(fit, advice=advice, remarks=(*fit.remarks, advice.sentence))
    if not advice.explains or advice.after > math.sqrt(1.0 - MOST) * advice.before:
        return fit
    said = (
        f"the model leaves more than noise: {advice.sentence}; without it the intervals are not to be trusted"
    )
    return replace(fit, advice=advice, doubts=(*fit.doubts, said))


def with_advice_of(fit: Fit, other: Fit) -> Fit:
    """Return the fit with the advice of another fit of the same model, to more walks."""
    advice = other.advice
    if advice is None:
        return fit
    remarks, doubts = (
        tuple(s for s in said if advice.sentence in s) for said in (other.remarks, other.doubts)
    )
    return replace(fit, advice=advice, remarks=(*fit.remarks, *remarks), doubts=(*fit.doubts, *doubts))


def _judged(fit: Fit) -> bool:
    """Return True if every recording shows its noise separately."""
    return bool(fit.lack) and not any(math.isnan(one.ratio) for one in fit.lack)


def _error_of_simulation(walks: Walks) -> float:
    """Return the residual, in the unit of the positions, that errors of the simulations may leave."""
    return SIMULATED * max(motion.tolerance for motion in walks.motions)


def correlated(fit: Fit) -> bool:
    """Return True if the residuals of a recording are correlated."""
    return not white(np.concatenate(fit.residuals), [r.size for r in fit.residuals])


def _advice(fit: Fit, walks: Walks, terms: Sequence[Scored], reacting: Fit | None, afar: Afar) -> Advice:
    begun, tried = time.process_time(), list[Tried]()

    def spent() -> float:
        return time.process_time() - begun

    reacting = reacting or with_reaction(fit, walks, EVALUATIONS)
    if reacting is not None:
        tried.append(Tried(REACTION, walks.completed(reacting), change={"stage_reaction": True}))
    for search in (None, afar):  # from the present values, then from distant guesses
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
    """Return the fit without the reaction of friction on the stage, from distant guesses. None if the model
    has no reaction, or cannot be fitted without it."""
    model = walks.model
    if not model.stage_reaction or model.static or model.clamped:
        return None
    own = [p.starting_at(fit.values[p.name])._replace(power=0) for p in fit.parameters]
    unmoved = replace(walks, model=model.replace(stage_reaction=False))
    try:
        return unmoved.completed(afar(unmoved, own, {}))
    except (FitError, QuantityError, ArithmeticError):
        return None


def _from_afar(fit: Fit, terms: Sequence[Scored]) -> list[Scored]:
    """Return the terms that are also searched from distant guesses, because the present minimum may belong to
    a wrong model."""
    return [one for one in terms if one.term.cause not in (STAGE, RIPPLE)] if lacking(fit) else []


def scored(fit: Fit, walks: Walks) -> list[Scored]:
    """Return the terms that the model lacks, the most promising first.

    First come those that would lower chi-squared by more than noise does. If the fit may be in a wrong
    minimum, the others follow.
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
    """Return the changes of all positions, joined, for each changed model in `beside`, shape (samples,
    models)."""
    delay = fit.values.get("delay", 0.0)
    model = fit.model
    if any(name in NORMAL_FIELDS for values in beside for name in values):
        model = with_normal_force(model, NORMAL_FIELDS)
    others = [with_values(model, values) for values in beside]
    return np.concatenate([motion.beside(model, delay, others) for motion in walks.motions])


def _fitted(fit: Fit, walks: Walks, one: Scored, afar: Afar | None) -> Fit | None:
    """Return the fit with a further term free, from the linearised estimate and from the present values; or
    from distant guesses with `afar`. None if it cannot be fitted."""
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
        begins = [{p.name: p.start for p in free}, _ahead(own, one.does.moves) | _starts(new)]
        return from_points(more, free, begins, [p.name for p in free], EVALUATIONS)
    except (FitError, QuantityError, ArithmeticError):
        return None


def _starts(parameters: Sequence[Parameter]) -> Values:
    return {p.name: p.start for p in parameters}


def _ahead(parameters: Sequence[Parameter], moves: Array) -> Values:
    """Return the values at the end of a linearised step, within the bounds."""
    found = {}
    for p, move in zip(parameters, moves, strict=True):
        value = p.value(p.coordinate(p.start) + move)
        found[p.name] = min(max(value, p.lower), p.upper)
    return found


def _verdict(fit: Fit, tried: Sequence[Tried], seconds: float) -> Advice:
    """Return the advice from the fits of all tried terms."""
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
    """Return the advice to add one term."""
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
    """Return whether the recordings distinguish two fits.

    Noise changes the difference of their chi-squared by twice the distance of their simulations, one standard
    deviation (Vuong's test).
    """
    left = np.concatenate(fit.residuals)
    apart = np.concatenate(other.residuals) - left
    share = independent_samples(left) / left.size
    variance = float(left @ left) / max(fit.degrees_of_freedom, 1)
    noise = 2.0 * math.sqrt(share * float(apart @ apart) / variance)
    return abs(_lower(fit, other)) > max(CLEAR, DEVIATIONS * noise)


def _lower(fit: Fit, other: Fit) -> float:
    """Return the difference of chi-squared between two fits, reduced if the residuals are correlated."""
    left = np.concatenate(other.residuals)
    return independent_samples(left) / left.size * difference(fit, other)


def _unit(fit: Fit) -> str:
    """Return the unit of reported residuals; empty for a ratio to the noise."""
    return "" if lacking(fit) else fit.recordings[0].unit


def _left(fit: Fit, of: Fit) -> float:
    """Return the residual of a fit: the largest ratio to its noise, or the rms if another fit shows no
    noise."""
    ratios = [one.ratio for one in fit.lack if not math.isnan(one.ratio)]
    return max(ratios, default=math.nan) if lacking(of) else fit.rmse
