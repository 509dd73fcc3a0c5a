"""Prediction bands for the figures: 95 % intervals of the model's position, due to uncertain parameters.

The prediction depends on the fitted parameters and on the stage's parameters, which the fit took as known.
The stage acts directly, and through the fit, which it shifts. All effects are linearised. G are the
derivatives of the position with respect to the fitted coordinates, P with respect to the stage's parameters,
and M is the shift of the fitted coordinates per change of the stage's parameters. With the covariances V of
the fit and S of the stage, the covariance of the position is G V Gᵀ + (G M + P) S (G M + P)ᵀ. The variances
by hysteresis and creep (from alternative stages) and by drifts are added.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...estimate.quantiles import reach
from ...estimate.result import Fit
from ...identify.piezo.left_out import spread
from ...identify.step.fit import STAGE_PARAMETERS
from ...identify.step.recorded_step import step_tests
from ...identify.walk.displacement import Displacement, has_slopes
from ...identify.walk.other_stages import moved_by
from ...identify.walk.walks import by_coordinates, by_values, columns_of
from ...physics.actuator import Actuator
from ..analysis.alignment import Aligned
from .budget import LEVEL, Inherited

_TOLERANCE = 1e-10  # error tolerance of simulated positions for derivatives, m (or rad)

Array = NDArray[np.float64]


def walk_bands(
    fit: Fit,
    taken: Inherited | None,
    shown: Sequence[Aligned],
    slew_rate: float | None,
    stages: Sequence[Actuator] = (),
) -> list[Array] | None:
    """Return the half widths of the 95 % bands of the position, an array [samples] for each walk.

    They are in m, or rad for a rotary actuator. The result is None for a friction law without derivatives.

    Args:
        fit: friction fit.
        taken: effect of errors of known values on the fit; None: only the fitted parameters are uncertain.
        shown: the walks.
        slew_rate: slew rate of the amplifier, V/s; None if unknown.
        stages: alternative stages with which `taken` was made.
    """
    if not has_slopes(fit.model):
        return None
    known = np.flatnonzero(np.isfinite(np.diag(fit.uncertainty.covariance)))
    own = fit.uncertainty.covariance[np.ix_(known, known)]
    count = len(STAGE_PARAMETERS)
    moves, of_stage = np.zeros((len(fit.parameters), count)), np.zeros((count, count))
    if taken is not None and taken.stage is not None:
        moves, of_stage = taken.by_stage(), taken.stage
    bands, names = [], [*(p.name for p in fit.parameters), *STAGE_PARAMETERS]
    for one in shown:
        motion = Displacement(one.recording, one.drive, one.name, fit.model, _TOLERANCE, slew_rate)
        columns = columns_of(motion, fit, names)
        g = by_coordinates(columns, fit)
        whole = g @ moves + by_values(columns, fit, STAGE_PARAMETERS)
        variance = np.einsum("ij,jk,ik->i", g[:, known], own, g[:, known])
        variance += np.einsum("ij,jk,ik->i", whole, of_stage, whole)
        if taken is not None and taken.others is not None:
            by = moved_by(fit, stages, [one.recording], [one.drive], slew_rate)
            variance += np.sum(spread(list((by + g @ taken.others).T)) ** 2, axis=1)
        if taken is not None and taken.drift is not None:
            variance += np.sum((g @ taken.drift) ** 2, axis=1)
        bands.append(_t(fit) * np.sqrt(variance))
    return bands


def step_bands(stage: Fit, steps: Sequence[Aligned]) -> list[tuple[NDArray[np.intp], Array]]:
    """Return the 95 % bands of the fit of the steps, a pair for each step.

    The pair has the indices of the fitted samples in the recording, and the half widths of the band there, m
    or rad.

    Args:
        stage: fit of the steps.
        steps: recordings of the fit, in its order.
    """
    assert stage.jacobian is not None
    free = np.flatnonzero(stage.uncertainty.bounded == 0)
    own = stage.uncertainty.covariance[np.ix_(free, free)]
    ends = np.cumsum([g.n_data for g in stage.recordings])[:-1]
    found = []
    for one, rows, time in zip(steps, np.split(stage.jacobian[:, free], ends), stage.times, strict=True):
        (test,) = step_tests(one.recording)
        samples = np.searchsorted(test.time, time)
        found.append((samples, _t(stage) * np.sqrt(np.einsum("ij,jk,ik->i", rows, own, rows))))
    return found


def _t(fit: Fit) -> float:
    return reach(LEVEL, fit.degrees_of_freedom)
