"""Identifiability: the parameters that the recordings determine or leave open, in plain sentences."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..quantities.units import with_prefix

if TYPE_CHECKING:
    from .parameter import Parameter
    from .result import Fit

# Widest 95 % interval for which a linearised model is sufficient: ratio of its ends for a parameter on a
# logarithmic scale, share of the search range for a parameter on a linear scale.
LOOSE_RATIO, LOOSE_SHARE = 3.0, 0.2


def loosest(fit: Fit, apart: Collection[str]) -> str | None:
    """Return the name of the one parameter that the data hardly determine, or None.

    Parameters in `apart` do not count. The result is also None if several are undetermined, if there is no
    other parameter, or if the undetermined one has a prior.
    """
    among = [p.name for p in fit.parameters if p.name not in apart]
    known = {p.name for p in fit.parameters if p.prior is not None}
    loose = [name for name in _wider(fit, LOOSE_RATIO, LOOSE_SHARE) if name in among]
    lost = [name for name in _wider(fit, fit.judgement.wide_ratio, fit.judgement.wide_share) if name in among]
    one = lost or loose
    return one[0] if len(one) == 1 and len(among) > 1 and one[0] not in known else None


def _wider(fit: Fit, ratio: float, share: float) -> list[str]:
    """Return the names of parameters whose 95 % interval is wide. On a logarithmic scale its ends have a
    ratio of at least `ratio`; on a linear scale it covers more than `share` of the search range. An interval
    is also wide if it is infinite, or extends to zero as the least possible value."""
    found, intervals = [], fit.confidence_intervals()
    for p in fit.parameters:
        low, high = intervals[p.name]
        wide = high >= ratio * low if p.log else high - low > share * (p.upper - p.lower)
        from_zero = p.least == 0 and low == 0
        if wide or from_zero or not np.isfinite(high - low):
            found.append(p.name)
    return found


def _between(p: Parameter, low: float, high: float) -> str:
    """Return the interval from `low` to `high` of the parameter p in words, with units. For a parameter with
    limits of a law, an interval that extends to infinity or zero has one end: "above" or "below"."""
    if p.limits is not None and low <= p.least and high >= p.most:
        return "that it may have"
    if p.limits is not None and high == np.inf:
        return f"above {with_prefix(low, p.unit, 3)}"
    if p.limits is not None and low == 0.0:
        return f"below {with_prefix(high, p.unit, 3)}"
    return f"from {with_prefix(low, p.unit, 3) if low else 0} to {with_prefix(high, p.unit, 3)}"


def undetermined(fit: Fit) -> tuple[str, ...]:
    """Return a sentence for each parameter, and each group of parameters, that the data do not determine.

    It uses the linearised 95 % intervals and correlations; the tuple is empty if all are determined.
    """
    sentences, named = [], _wider(fit, fit.judgement.wide_ratio, fit.judgement.wide_share)
    intervals = fit.confidence_intervals()
    for p, side in zip(fit.parameters, fit.uncertainty.bounded, strict=True):
        low, high = intervals[p.name]
        as_well = f"any value {_between(p, low, high)} fits as well"
        if p.name in named:
            sentences.append(f"{p.name} is not determined by these recordings: {as_well}")
        elif side:
            bound = with_prefix(p.lower if side < 0 else p.upper, p.unit, 3)
            sentences.append(f"{p.name} ended at its bound {bound}, and {as_well}")
    strong = np.abs(fit.correlation.to_numpy()) > fit.judgement.indistinguishable
    names = np.array([p.name for p in fit.parameters])
    determined = ~np.isin(names, named)
    n_groups, group = scipy.sparse.csgraph.connected_components(
        strong & determined & determined[:, None], directed=False
    )
    for together in (names[group == g] for g in range(n_groups)):
        if together.size > 1:
            listed = ", ".join(together[:-1]) + f" and {together[-1]}"
            sentences.append(f"{listed} are hard to tell apart by these recordings: they act nearly alike")
    return tuple(sentences)
