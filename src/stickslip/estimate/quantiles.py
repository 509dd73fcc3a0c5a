"""Quantiles of distributions for intervals, as single numbers; the classes of `scipy.stats` take thirty times
as long."""

from __future__ import annotations

import scipy


def reach(level: float, degrees_of_freedom: float | None = None) -> float:
    """Return the half width, in standard errors, of a two-sided interval with this confidence level (0 to 1):
    by Student's t with these degrees of freedom, or by the normal distribution if they are None."""
    p = 0.5 + 0.5 * level
    return float(
        scipy.special.ndtri(p) if degrees_of_freedom is None else scipy.special.stdtrit(degrees_of_freedom, p)
    )


def chi_squared(level: float, degrees_of_freedom: int) -> float:
    """Return the value that chi-squared with these degrees of freedom does not exceed with the probability
    `level`."""
    return float(scipy.special.chdtri(degrees_of_freedom, 1.0 - level))
