"""Uncertainty from the steps of a converter or an encoder, which more samples do not average away.

Samples at one level say only that the quantity is within half a step of it. So each level is moved at random
by up to half a step, and what the fit would make of that is added to its uncertainty, linearised.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..estimate.coloured import with_inherited
from ..estimate.result import Fit
from ..units import with_prefix

# Draws of all levels, and the share of a variance from which on it is said.
DRAWS, WORTH_SAYING = 24, 0.1

Array = NDArray[np.float64]


def with_steps(
    fit: Fit,
    values: Sequence[Array],
    steps: Sequence[float],
    residuals: Callable[[Sequence[Array]], Array],
    what: str,
    unit: str,
) -> Fit:
    """The fit with the uncertainty that the steps of a recorded quantity leave.

    Args:
        fit: with its Jacobian.
        values: the quantity in each recording [n], in its unit.
        steps: of each, in its unit; 0: none.
        residuals: from other values of the quantity to all residuals of the fit, joined.
        what, unit: of the quantity, for what is said of it.
    """
    if fit.jacobian is None or not any(steps):
        return fit
    random = np.random.default_rng(0)
    before = residuals(values)
    drawn = [_drawn(x, step, random) for x, step in zip(values, steps, strict=True)]
    moved = [residuals(draw) - before for draw in zip(*drawn, strict=True)]
    wider = with_inherited(fit, np.column_stack(moved), np.eye(DRAWS) / DRAWS)
    with np.errstate(invalid="ignore"):
        share = 1.0 - np.diag(fit.uncertainty.covariance) / np.diag(wider.uncertainty.covariance)
    if not np.any(share > WORTH_SAYING):
        return wider
    step = with_prefix(max(steps), unit, 3)
    return replace(
        wider, remarks=(*fit.remarks, f"{what} stands at steps of {step}; the intervals allow for it")
    )


def _drawn(values: Array, step: float, random: np.random.Generator) -> Array:
    """The values [n] with the levels that they stand at moved, [draws, n]."""
    if not step > 0.0:
        return np.broadcast_to(values, (DRAWS, values.size))
    levels, place = np.unique(values, return_inverse=True)
    return values + random.uniform(-0.5 * step, 0.5 * step, (DRAWS, levels.size))[:, place]
