"""Test whether recordings show that friction acts back on the stage, if the model leaves this reaction out
[kang2007, 3.4].

A real stage has this reaction. A model without it has a minimum at wrong values of the contact, which may
describe one walk nearly as well.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...estimate.lack import independent_samples
from ...estimate.parameter import Parameter
from ...estimate.problem import FitError
from ...estimate.result import Fit
from .walks import NEAR, Walks

# Difference of chi-squared above which one of two models with equally many parameters is clearly better:
# odds of e^5 to 1.
CLEAR = 10.0
# Smallest reduction of chi-squared by a step of the search. With a smaller reduction the search ends, because
# the step only changes a value that the recordings do not determine.
SLOW = 1e-3 * CLEAR


def with_reaction(fit: Fit, walks: Walks, max_evaluations: int) -> Fit | None:
    """Return the fit of the same parameters with the reaction of friction on the stage, starting at the
    values of `fit`; None if the model has the reaction already, has no dynamic stage that can move, or cannot
    be fitted with it."""
    other = other_reaction(fit, walks, reacts=True)
    if other is None:
        return None
    # The search is not stopped early: a model that is far worse after a few evaluations may end better.
    reacting, start = other
    tolerance = SLOW / fit.degrees_of_freedom
    try:
        return reacting.searched(start, max_evaluations=max_evaluations, settled=NEAR, tolerance=tolerance)
    except FitError:
        return None


def other_reaction(fit: Fit, walks: Walks, reacts: bool) -> tuple[Walks, list[Parameter]] | None:
    """Return the walks for the model with the reaction (`reacts` is True) or without, and its parameters with
    the values of `fit`; None if the model is like that already, or has no dynamic stage that can move."""
    model = walks.model
    if model.stage_reaction == reacts or model.static or model.clamped:
        return None
    # power = 0: the search uses logarithms of the values, with which more searches from distant values
    # converge than with the powers that straighten minima.
    start = [p.starting_at(fit.values[p.name])._replace(power=0) for p in fit.parameters]
    return replace(walks, model=model.replace(stage_reaction=reacts)), start


def with_reaction_asked(fit: Fit, other: Fit | None) -> Fit:
    """Return the fit with the result of the test of the reaction.

    The fit gets a doubt if the reaction describes the recordings clearly better. It gets a remark if neither
    model is clearly better and a value with the reaction is outside its interval. Otherwise it is unchanged.

    Args:
        fit: fit without the reaction.
        other: fit with the reaction, from `with_reaction`; None: not tested.
    """
    if other is None:
        return fit
    left = np.concatenate(other.residuals)
    lower = independent_samples(left) / left.size * difference(fit, other)
    ends = fit.confidence_intervals()
    outside = [
        f"{p.name} = {p.shown(other.values[p.name], 3)}"
        for p in fit.parameters
        if not ends[p.name][0] <= other.values[p.name] <= ends[p.name][1]
    ]
    then = f"then {', '.join(outside)}" if outside else "the values are the same within their intervals"
    if lower > CLEAR:
        said = (
            "the recordings are explained better where friction acts back on the stage "
            f"(stage_reaction: true), chi-squared lower by {lower:.3g}; {then}"
        )
        return replace(fit, doubts=(*fit.doubts, said))
    if lower > -CLEAR and outside:
        said = (
            "the recordings do not tell whether friction acts back on the stage, as on a real one it does "
            f"(stage_reaction: true); {then}"
        )
        return replace(fit, remarks=(*fit.remarks, said))
    return fit


def difference(fit: Fit, other: Fit) -> float:
    """Return by how much chi-squared is lower in `other` than in `fit` (negative: higher), from their
    likelihoods or, with a robust loss, from their costs."""
    if math.isnan(fit.log_likelihood):  # a fit with a robust loss has no likelihood
        return other.n_data * math.log(fit.cost / other.cost)
    return 2.0 * (other.log_likelihood - fit.log_likelihood)
