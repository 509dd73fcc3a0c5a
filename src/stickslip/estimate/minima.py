"""Several minima of one sum of squares: those that fit as well as the lowest within the noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from .covariance import Uncertainty
from .parameter import Parameter, Values
from .quantiles import chi_squared

# Two minima are different if a coordinate differs by more than APART standard errors of the lower minimum,
# or, if that standard error is not finite, by more than APART_SHARE of the search range.
APART, APART_SHARE = 1.0, 0.1
# Confidence level at which a minimum is rejected: its excess of chi-squared is beyond this quantile.
LEVEL = 0.95


class Minimum(NamedTuple):
    """Another minimum that the data do not reject.

    Attributes:
        values: values at the minimum, in SI, by name.
        uncertainty: `Uncertainty` of the coordinates q there.
        excess: chi-squared above that of the lowest minimum, in variances of the noise.
        whole: True if the fit's intervals include the whole interval about this minimum, because only chance
            decides which of many minima is lowest. False: they include a part of it that shrinks with the
            excess.
    """

    values: dict[str, float]
    uncertainty: Uncertainty
    excess: float
    whole: bool = False


def bound(n_parameters: int, level: float = LEVEL) -> float:
    """Return the excess of chi-squared above which a minimum is rejected, for this number of parameters and
    this confidence level (0 to 1)."""
    return chi_squared(level, n_parameters)


def still_fits(excess: float, n_parameters: int) -> bool:
    """Return True if a minimum with this excess of chi-squared (in variances of the noise) fits as well as
    the lowest, so that the data do not reject it."""
    return excess <= bound(n_parameters)


def apart(one: Minimum, lower: Minimum, parameters: Sequence[Parameter]) -> bool:
    """Return True if two minima are different, see `APART`.

    Args:
        one: a minimum.
        lower: a minimum that fits better, whose standard errors count.
        parameters: parameters in the order of the uncertainty; those without a value in one of the minima are
            not compared.
    """
    for i, p in enumerate(parameters):
        if p.name not in one.values or p.name not in lower.values:
            continue
        away = abs(p.coordinate(one.values[p.name]) - p.coordinate(lower.values[p.name]))
        deviation = math.sqrt(max(lower.uncertainty.covariance[i, i], 0.0))
        span = p.coordinate(p.upper) - p.coordinate(p.lower)
        if away > (APART * deviation if math.isfinite(deviation) else APART_SHARE * span):
            return True
    return False


def relabelled(
    one: Minimum, parameters: Sequence[Parameter], like: Values, groups: Sequence[Sequence[str]]
) -> Minimum:
    """Return a minimum with its exchangeable groups of parameters (such as identical elements) in the order
    closest to the values `like`; unchanged if that order would violate bounds.

    A sum of identical elements has each minimum once for every order of the elements.

    Args:
        one: the minimum.
        parameters: parameters in the order of the minimum's uncertainty.
        like: values by name, such as the estimate.
        groups: names of the parameters of each element, in the same order in all groups.
    """
    place = {p.name: i for i, p in enumerate(parameters)}

    def away(here: Sequence[str], there: Sequence[str]) -> float:
        pairs = [(parameters[place[a]], like[a], one.values[b]) for a, b in zip(here, there, strict=True)]
        return sum(abs(p.coordinate(x) - p.coordinate(y)) for p, x, y in pairs)

    _, order = scipy.optimize.linear_sum_assignment(
        np.array([[away(here, there) for there in groups] for here in groups])
    )
    values, index = dict(one.values), np.arange(len(parameters))
    for here, there in zip(groups, map(int, order), strict=True):
        for a, b in zip(here, groups[there], strict=True):
            values[a], index[place[a]] = one.values[b], place[b]
    if not all(p.lower <= values[p.name] <= p.upper for p in parameters):
        return one
    known = one.uncertainty
    moved = Uncertainty(
        known.covariance[np.ix_(index, index)],
        known.bounded[index],
        known.push[index],
        known.released[index],
        None if known.centre is None else known.centre[index],
    )
    return one._replace(values=values, uncertainty=moved)
