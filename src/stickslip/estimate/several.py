"""Several fits to the same data as one: the lowest, and the others that fit as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .coloured import inflation
from .minima import Minimum, still_fits
from .result import Fit
from .search import SAME_MINIMUM


def lowest(fits: Sequence[Fit]) -> Fit:
    """The fit with the lowest sum of squares; in its intervals, the others that the noise does not reject.

    Args:
        fits: of the same parameters to the same data. Those that have not converged are no minima.
    """
    best = min(fits, key=lambda fit: fit.cost)
    variance = 1.0 if best.noise_known else best.cost / best.degrees_of_freedom
    raised = float(np.median([inflation(best, i) for i in range(len(best.parameters))]))
    others, agreeing, searches = [], 0, 0
    for fit in fits:
        excess = (fit.cost - best.cost) / variance if variance > 0.0 else 0.0
        searches += fit.starts
        agreeing += fit.starts_agreeing if excess < SAME_MINIMUM else 0
        others += [m._replace(excess=m.excess + excess / raised) for m in fit.minima]
        if fit.converged and fit is not best:
            others.append(Minimum(fit.values, fit.uncertainty, excess / raised))
    n = len(best.parameters)
    return replace(
        best.with_minima([m for m in others if still_fits(m.excess, n)]),
        starts=searches,
        starts_agreeing=agreeing,
        n_evaluations=sum(fit.n_evaluations for fit in fits),
    )
