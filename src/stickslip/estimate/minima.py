"""Several minima of one sum of squares: those that fit as well as the lowest within the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from .covariance import Uncertainty
from .parameter import Parameter, Values
from .quantiles import chi_squared

# Two minima differ if a coordinate differs by more than this number of standard errors.
APART = 1.0
LEVEL = 0.95  # a minimum is rejected if its excess of chi-squared is beyond this quantile


class Minimum(NamedTuple):
    """Another minimum that the data do not reject.

    Attributes:
        values: values at the minimum, in SI.
        uncertainty: uncertainty of the coordinates there.
        excess: chi-squared above the lowest minimum, in variances of the noise.
        whole: True if the fit's intervals include the whole interval about this minimum, as if it were the
            lowest: for one of many minima, of which the lowest is so by chance. If False, they include a part
            of it that shrinks with the excess.
    """

    values: dict[str, float]
    uncertainty: Uncertainty
    excess: float
    whole: bool = False


def bound(n_parameters: int, level: float = LEVEL) -> float:
    """Return the excess of chi-squared above which a minimum is rejected, for this number of parameters and
    this confidence level."""
    return chi_squared(level, n_parameters)


def still_fits(excess: float, n_parameters: int) -> bool:
    """Return True if a minimum with that excess of chi-squared fits as well as the lowest."""
    return excess <= bound(n_parameters)


def relabelled(
    one: Minimum, parameters: Sequence[Parameter], like: Values, groups: Sequence[Sequence[str]]
) -> Minimum:
    """Return a minimum with its exchangeable groups of parameters (such as alike elements) in the order
    closest to `like`; unchanged if that order would violate bounds.

    A sum of alike elements has each minimum once for every order of the elements.
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
