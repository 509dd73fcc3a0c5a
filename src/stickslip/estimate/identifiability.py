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

# Widest 95 % interval for which a linearised model is sufficient: LOOSE_RATIO is the ratio of its ends for a
# parameter on a logarithmic scale, LOOSE_SHARE its width as a share of the search range for a parameter on a
# linear scale.
LOOSE_RATIO, LOOSE_SHARE = 3.0, 0.2


def loosest(fit: Fit, apart: Collection[str]) -> str | None:
    """Return the name of the only parameter with a wide interval, or None. The thresholds in `fit.judgement`
    decide; if no interval is wide by these, `LOOSE_RATIO` and `LOOSE_SHARE` do.

    Parameters with a name in `apart` do not count. The result is also None if several have wide intervals, if
    there is no other parameter, or if the found one has a prior.
    """
    among = [p.name for p in fit.parameters if p.name not in apart]
    known = {p.name for p in fit.parameters if p.prior is not None}
    loose = [name for name in _wider(fit, LOOSE_RATIO, LOOSE_SHARE) if name in among]
    lost = [name for name in _wider(fit, fit.judgement.wide_ratio, fit.judgement.wide_share) if name in among]
    one = lost or loose
    return one[0] if len(one) == 1 and len(among) > 1 and one[0] not in known else None


def _wider(fit: Fit, ratio: float, share: float) -> list[str]:
    """Return the names of parameters whose 95 % interval is wide: the ratio of its ends is at least `ratio`
    (logarithmic scale), or its width exceeds `share` times the search range (linear scale). An interval is
    also wide if it is infinite, or starts at a least possible value of zero."""
    found, intervals = [], fit.confidence_intervals()
    for p in fit.parameters:
        low, high = intervals[p.name]
        wide = high >= ratio * low if p.log else high - low > share * (p.upper - p.lower)
        from_zero = p.least == 0 and low == 0
        if wide or from_zero or not np.isfinite(high - low):
            found.append(p.name)
    return found


def _between(p: Parameter, low: float, high: float) -> str:
    """Return the interval from `low` to `high` (SI) of the parameter p as words that follow "any value", with
    units.

    For a parameter with limits of a law, an interval that ends at infinity becomes "above ...", one that
    starts at zero "below ...", and one over all limits "that it may have".
    """
    if p.limits is not None and low <= p.least and high >= p.most:
        return "that it may have"
    if p.limits is not None and high == np.inf:
        return f"above {with_prefix(low, p.unit, 3)}"
    if p.limits is not None and low == 0.0:
        return f"below {with_prefix(high, p.unit, 3)}"
    return f"from {with_prefix(low, p.unit, 3) if low else 0} to {with_prefix(high, p.unit, 3)}"


def undetermined(fit: Fit) -> tuple[str, ...]:
    """Return a sentence for each parameter that the data do not determine or that ended at a bound, and for
    each group of otherwise determined parameters with nearly the same effect. The tuple is empty if there are
    none of these.

    The sentences follow from the linearised 95 % intervals and correlations, with the thresholds in
    `fit.judgement`.
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
