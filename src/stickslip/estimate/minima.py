"""Several minima of one sum of squares: which others fit as well as the lowest, as far as the noise tells."""

from __future__ import annotations

from typing import NamedTuple

from .covariance import Uncertainty
from .quantiles import chi_squared

# A minimum is another one where a coordinate is further away than so many of its standard errors.
APART = 1.0
LEVEL = 0.95


class Minimum(NamedTuple):
    """Another minimum that the data do not reject.

    Attributes:
        values: there, in SI.
        uncertainty: of the coordinates there.
        excess: its chi-squared above that of the lowest, in variances of the noise.
        whole: whether intervals hold all of its own, as if it were the lowest: where one of many minima is
            that by chance, its excess says little. Otherwise they are the narrower the greater that is.
    """

    values: dict[str, float]
    uncertainty: Uncertainty
    excess: float
    whole: bool = False


def bound(n_parameters: int, level: float = LEVEL) -> float:
    """The excess above which a minimum is rejected, where so many parameters are fitted."""
    return chi_squared(level, n_parameters)


def still_fits(excess: float, n_parameters: int) -> bool:
    """Whether a minimum with that excess of chi-squared fits as well as the lowest."""
    return excess <= bound(n_parameters)
