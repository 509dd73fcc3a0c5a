"""Test whether recordings show the reaction of the friction on the stage, if the model leaves it out
[kang2007, 3.4].

A real stage has this reaction. A model without it compensates by other values of the contact, which may
describe one walk nearly as well.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...estimate.lack import independent_samples
from ...estimate.problem import FitError
from ...estimate.result import Fit
from .walks import NEAR, Walks

# Difference of chi-squared at which one of two models with equally many parameters is clearly better: odds of
# e^5 to 1.
CLEAR = 10.0
# Smallest useful reduction per step; a search with smaller ones ends, because it follows an undetermined
# value.
SLOW = 1e-3 * CLEAR


def with_reaction(fit: Fit, walks: Walks, max_evaluations: int) -> Fit | None:
    """Return the fit with the reaction, starting from the fit without it; None if the model has it already,
    or cannot be simulated with it."""
    model = walks.model
    if model.stage_reaction or model.static or model.clamped:
        return None
    # In logarithms from distant values: along straightened minima 5 of 60 such searches did not end, this way
    # 2. They continue to their end, because a model that is far worse after a few evaluations may end better.
    start = [p.starting_at(fit.values[p.name])._replace(power=0) for p in fit.parameters]
    reacting = replace(walks, model=model.replace(stage_reaction=True))
    tolerance = SLOW / fit.degrees_of_freedom
    try:
        return reacting.searched(start, max_evaluations=max_evaluations, settled=NEAR, tolerance=tolerance)
    except FitError:
        return None


def with_reaction_asked(fit: Fit, other: Fit | None) -> Fit:
    """Return the fit with a sentence on the test of the reaction: a doubt if the reaction describes the
    recordings better; a remark if the recordings do not decide and a value would be outside its interval."""
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
    """Return the difference of chi-squared of two fits, each at its minimum rather than at a mean over all
    that fit."""
    if math.isnan(fit.log_likelihood):  # the loss is robust
        return other.n_data * math.log(fit.cost / other.cost)
    return 2.0 * (other.log_likelihood - fit.log_likelihood)
