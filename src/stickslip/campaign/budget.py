"""How sure the friction parameters are when the stage and the sensor's scale are not known exactly either.

The fit takes the stage's values as they were identified before. What their errors do to it is linearised:
a change g of what was taken as known moves the estimate by -(JᵀJ)⁻¹ Jᵀ G g, with J and G the derivatives of
the position by what was fitted and by what was taken.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimate.result import Fit
from ..identify.walk.displacement import Displacement, has_slopes
from ..identify.walk.position_channel import CHANNEL
from ..study.alignment import POSITION, Aligned
from .gathering import Scale

STAGE = ("gain", "natural_frequency", "damping_ratio")
LEVEL = 0.95
_TOLERANCE = 1e-11

Array = NDArray[np.float64]


class Budget(NamedTuple):
    """Standard errors of each parameter, by source, and their sum; in the unit of the parameter."""

    sources: dict[str, dict[str, float]]
    total: dict[str, float]
    intervals: dict[str, tuple[float, float]]


class Inherited(NamedTuple):
    """What a fit took as known: how its coordinates move with each of the stage's values and with the log of
    the sensor's scale, and the covariance of the stage's values [`STAGE`], None where they are exact."""

    moved: dict[str, Array]
    stage: Array | None

    def by_stage(self) -> Array:
        """How the coordinates move with the stage's values, [coordinates, `STAGE`]."""
        return np.column_stack([self.moved[name] for name in STAGE])


def budget(fit: Fit, taken: Inherited | None, scale: Scale | None) -> Budget:
    """The error budget of a friction fit, with what it took as known and the scale of a sensor."""
    own = [p for p in fit.parameters if p.name not in CHANNEL]
    spread = fit.uncertainty.covariance
    variances = {"noise of the recordings": np.diag(spread).copy()}
    if taken is not None:
        moved = taken.moved
        if taken.stage is not None:
            by = taken.by_stage()
            variances["stage from the steps"] = np.einsum("ij,jk,ik->i", by, taken.stage, by)
        if scale is not None and scale.standard_error > 0:
            # A position read too large by a share makes the gain too large by the same.
            relative = scale.standard_error / scale.value
            by_scale = moved["scale"] - (moved["gain"] * fit.model.gain if taken.stage is not None else 0.0)
            variances["scale of the sensor"] = (relative * by_scale) ** 2
    total = np.sum(list(variances.values()), axis=0)
    known = fit.uncertainty
    with_all = replace(
        fit, uncertainty=known._replace(covariance=known.covariance + np.diag(total - np.diag(spread)))
    )
    intervals = with_all.confidence_intervals(LEVEL)
    deviations = with_all.standard_errors
    sources = {
        source: {
            p.name: math.sqrt(variance[i]) * (fit.values[p.name] if p.log else 1.0)
            for i, p in enumerate(fit.parameters)
            if p in own
        }
        for source, variance in variances.items()
    }
    return Budget(
        sources, {p.name: deviations[p.name] for p in own}, {p.name: intervals[p.name] for p in own}
    )


def inherited(
    fit: Fit, fitted: list[Aligned], stage: Fit | None, slew_rate: float | None
) -> Inherited | None:
    """Of a friction fit to `fitted` with the stage of `stage`; None for a law without derivatives."""
    if fit.model is None or not has_slopes(fit.model):
        return None
    own = [p.name for p in fit.parameters if p.name not in CHANNEL]
    delay = fit.values.get("delay", 0.0)
    columns = []
    for one in fitted:
        motion = Displacement(one.recording, one.drive, one.name, fit.model, _TOLERANCE, slew_rate)
        slopes = motion.slopes(fit.model, delay, [*own, *STAGE])
        known = dict(zip([*own, *STAGE, "delay"], slopes.T, strict=True))
        known["offset"] = np.ones(len(slopes))
        known["scale"] = one.recording[POSITION].values
        columns.append(known)
    stacked = {name: np.concatenate([c[name] for c in columns]) for name in columns[0]}
    jacobian = np.column_stack(
        [stacked[p.name] * (fit.values[p.name] if p.log else 1.0) for p in fit.parameters]
    )
    size = np.linalg.norm(jacobian, axis=0)
    moved = {
        name: -np.linalg.lstsq(jacobian / size, stacked[name], rcond=None)[0] / size
        for name in (*STAGE, "scale")
    }
    if stage is None:
        return Inherited(moved, None)
    names = [p.name for p in stage.parameters]
    at = [names.index(name) for name in STAGE]
    return Inherited(moved, stage.covariance[np.ix_(at, at)])
