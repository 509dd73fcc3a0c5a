"""Quantiles of distributions for intervals, of single numbers; the classes of `scipy.stats` take thirty times
as long."""

from __future__ import annotations

import scipy


def reach(level: float, degrees_of_freedom: float | None = None) -> float:
    """Return the half width, in standard errors, of an interval with this level: by Student's t, or the
    normal distribution without degrees of freedom."""
    p = 0.5 + 0.5 * level
    return float(
        scipy.special.ndtri(p) if degrees_of_freedom is None else scipy.special.stdtrit(degrees_of_freedom, p)
    )


def chi_squared(level: float, degrees_of_freedom: int) -> float:
    """Return the quantile of chi-squared with this probability."""
    return float(scipy.special.chdtri(degrees_of_freedom, 1.0 - level))
