"""Which parameters the recordings determine, in plain sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components

if TYPE_CHECKING:
    from .result import Fit

# An interval over more than a decade, or over more than half of the allowed range, says almost nothing.
WIDE_RATIO = 10.0
WIDE_SHARE = 0.5
INDISTINGUISHABLE = 0.99


def undetermined(fit: Fit) -> tuple[str, ...]:
    """A sentence for each parameter, and each group of them, that the data of the fit do not determine.

    From the 95 % intervals and correlations, so linearised; empty if all is well.
    """
    sentences, named = [], set()
    intervals = fit.confidence_intervals()
    for p, side in zip(fit.parameters, fit.uncertainty.bounded, strict=True):
        low, high = intervals[p.name]
        as_well = f"any value from {low:.3g} to {p.shown(high, 3)} fits as well"
        wide = high >= WIDE_RATIO * low if p.log else high - low > WIDE_SHARE * (p.upper - p.lower)
        from_zero = p.lower == 0 and low == 0
        if wide or from_zero or not np.isfinite(high - low):
            sentences.append(f"{p.name} is not determined by these recordings: {as_well}")
            named.add(p.name)
        elif side:
            bound = p.shown(p.lower if side < 0 else p.upper, 3)
            sentences.append(f"{p.name} ended at its bound {bound}, and {as_well}")
    strong = np.abs(fit.correlation.to_numpy()) > INDISTINGUISHABLE
    names = np.array(list(fit.values))
    determined = ~np.isin(names, list(named))
    n_groups, group = connected_components(strong & determined & determined[:, None], directed=False)
    for together in (names[group == g] for g in range(n_groups)):
        if together.size > 1:
            listed = ", ".join(together[:-1]) + f" and {together[-1]}"
            sentences.append(f"{listed} are hard to tell apart by these recordings: they act nearly alike")
    return tuple(sentences)
