"""Reaction of the friction on the stage, asked of the recordings where a model leaves it out [kang2007, 3.4].

On a real stage it is there. Left out, it is made up for by other values of the contact, which may describe
one walk nearly as well.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...estimate.lack import independent_samples
from ...estimate.problem import FitError
from ...estimate.result import Fit
from .walks import NEAR, Walks

# Difference of chi-squared from which one of two models with as many parameters is the better one: e^5 to 1.
CLEAR = 10.0
# Where a step lowers it by less than this, the search is over: some go on for long along a value that is not
# determined.
SLOW = 1e-3 * CLEAR


def with_reaction(fit: Fit, walks: Walks, max_evaluations: int) -> Fit | None:
    """Return the fit with the reaction, searched for from there; None where the model has it, or where there
    is no motion with it from there."""
    model = walks.model
    if model.stage_reaction or model.static or model.clamped:
        return None
    # From afar, in logarithms: along straight valleys 5 of 60 such searches did not end, so 2.
    # To the end: what is far worse after a few evaluations may be the better one there.
    start = [p.starting_at(fit.values[p.name])._replace(power=0) for p in fit.parameters]
    reacting = replace(walks, model=model.replace(stage_reaction=True))
    tolerance = SLOW / fit.degrees_of_freedom
    try:
        return reacting.searched(start, max_evaluations=max_evaluations, settled=NEAR, tolerance=tolerance)
    except FitError:
        return None


def with_reaction_asked(fit: Fit, other: Fit | None) -> Fit:
    """Return the fit with a sentence on `with_reaction`: a doubt where that describes the recordings better,
    a remark where they do not tell and a value would be outside its interval."""
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
    """Of chi-squared of two fits, each where it is at its best, which a mean over all that fits is not."""
    if math.isnan(fit.log_likelihood):  # a robust loss
        return other.n_data * math.log(fit.cost / other.cost)
    return 2.0 * (other.log_likelihood - fit.log_likelihood)
