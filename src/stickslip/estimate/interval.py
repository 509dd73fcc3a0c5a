"""Confidence interval of one parameter, from the uncertainty of its coordinate."""

from __future__ import annotations

import math

from .covariance import Uncertainty
from .judgement import DEFAULT
from .parameter import Parameter


def interval(p: Parameter, i: int, value: float, uncertain: Uncertainty, t: float) -> tuple[float, float]:
    """Return lower and upper end of the interval of a parameter about a minimum, in the parameter's unit.

    The parameter's limits (or, without limits, its bounds) cut the interval; the ends of a search range do
    not. On a side that the data do not bound, the interval extends to the limit. With a `shift`, and not at
    an upper bound, the interval is symmetric about the value if it reaches zero, and about the logarithm of
    the value otherwise; at a lower bound it starts at the least value.

    Args:
        p: the parameter.
        i: index of the parameter in `uncertain`.
        value: estimate of the parameter at the minimum.
        uncertain: uncertainty of all coordinates at the minimum.
        t: half width of the interval in standard errors.
    """
    spread, bounded, push, released, centre = uncertain
    slope = p.slope(value)
    if p.shift and centre is None and bounded[i] <= 0:
        if bounded[i] and t > 0.0:
            return p.least, min(value + slope * _inwards(t, push[i], released[i]), p.most)
        reach = t * slope * math.sqrt(spread[i, i]) if t > 0.0 else 0.0
        if reach >= value:
            return p.least, min(value + reach, p.most)
        return max(value * math.exp(-reach / value), p.least), min(value * math.exp(reach / value), p.most)
    if bounded[i] and t > 0.0:
        reach = _inwards(t, push[i], released[i])
        below, above = (0.0, reach) if bounded[i] < 0 else (reach, 0.0)
    else:
        below = above = t * math.sqrt(spread[i, i]) if t > 0.0 else 0.0
    q = p.coordinate(value) if centre is None else float(centre[i])
    low, high = max(p.value(q - below), p.least), min(p.value(q + above), p.most)
    if p.limits is not None:
        # The data do not bound the parameter on a side where the linearised interval is too wide, or where
        # the estimate is at the end of the search range. The interval then extends to the limit of the law.
        wide = high >= DEFAULT.wide_ratio * low if p.log else high - low >= p.upper - p.lower
        low = p.least if bounded[i] < 0 or (wide and low < p.lower) else low
        high = p.most if bounded[i] > 0 or (wide and high > p.upper) else high
    return min(low, value), max(high, value)


def _inwards(t: float, push: float, released: float) -> float:
    """Return the distance of a coordinate from its active bound at which half the chi-squared has risen by
    t^2/2: the end of the interval of t standard errors.

    Over a distance d into the range, half the chi-squared rises by push d + d^2 / (2 released).

    Args:
        t: half width of the interval in standard errors.
        push: derivative of half the chi-squared at the bound.
        released: variance of the coordinate without the bound.
    """
    return t**2 / (push + math.sqrt(push**2 + t**2 / released))
