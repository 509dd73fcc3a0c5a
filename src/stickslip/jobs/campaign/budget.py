"""Uncertainty budget of the friction parameters, with the errors of the stage, of hysteresis and creep, of
drifts and of the sensor's scale.

The friction fit takes the stage's parameters, which were identified before, as known, unless it varies them,
too. The effect of errors of known values is linearised: an error g of these values moves the estimate by
-(JᵀJ + P)⁻¹ Jᵀ G g. J and G are the derivatives of the position with respect to the fitted and to the known
values, and P is the information matrix of the priors. Hysteresis and creep have no such derivatives. For them
G g is the change of the position if another stage is used, identified without a part of the recordings
(jackknife).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.drift import off_by_drifts
from ...estimate.moves import noise_of_data, of_priors
from ...estimate.result import Fit
from ...identify.piezo.left_out import spread
from ...identify.step.fit import STAGE_PARAMETERS
from ...identify.walk.displacement import Displacement, has_slopes
from ...identify.walk.other_stages import moved_by
from ...identify.walk.position_channel import CHANNEL
from ...identify.walk.walks import by_coordinates, by_values, columns_of
from ...physics.actuator import Actuator
from ..analysis.alignment import POSITION, Aligned
from .gathering import SensorScale

LEVEL = 0.95  # confidence level of the intervals
_TOLERANCE = 1e-11  # error tolerance of simulated positions for derivatives, m (or rad)

Array = NDArray[np.float64]


class ErrorBudget(NamedTuple):
    """Error budget of the fitted friction parameters, in their units.

    `sources` has a standard error for each source of error (such as "noise of the recordings") and parameter.
    `total` has the standard error from all sources, and `intervals` the lower and upper end of the 95 %
    interval from all sources, by parameter.
    """

    sources: dict[str, dict[str, float]]
    total: dict[str, float]
    intervals: dict[str, tuple[float, float]]


class Inherited(NamedTuple):
    """Effect of errors of the values that a friction fit took as known on its coordinates.

    The coordinates of a fit are its parameters, or their logarithms.

    Attributes:
        moved: shift of the coordinates per change of each stage parameter, and ("scale") of the logarithm of
            the sensor's scale; arrays [coordinates] by name.
        stage: covariance matrix of the stage's parameters, in the order of `STAGE_PARAMETERS`; None if they
            are exact or fitted, too.
        others: shift of the coordinates with each alternative stage [coordinates, stages]; None without
            recordings of hysteresis.
        drift: shift per standard error of the drift that was subtracted from each walk [coordinates, walks];
            None if no drift was subtracted.
    """

    moved: dict[str, Array]
    stage: Array | None
    others: Array | None = None
    drift: Array | None = None

    def by_stage(self) -> Array:
        """Return the shift of the coordinates per change of each stage parameter.

        The shape is [coordinates, parameters], in the order of `STAGE_PARAMETERS`.
        """
        return np.column_stack([self.moved[name] for name in STAGE_PARAMETERS])


def budget(fit: Fit, taken: Inherited | None, scale: SensorScale | None) -> ErrorBudget:
    """Return the error budget of a friction fit: noise, stage, hysteresis and creep, drift, and sensor scale.

    Sources without data are left out. Delay and offset of the sensor are not in the budget.

    Args:
        fit: friction fit.
        taken: effect of the values that the fit took as known; None: only errors of the values that it fitted
            itself count.
        scale: scale of the sensor; None without a reference channel.
    """
    names = [p.name for p in fit.shown if p.name not in CHANNEL and not p.fixed]
    by_source = {"noise of the recordings": fit.uncertainty.covariance}
    if freed(fit):
        by_source["noise of the recordings"], by_source["stage from the steps"] = _shares(fit)
    if taken is not None:
        moved = taken.moved
        if taken.stage is not None:
            by = taken.by_stage()
            by_source["stage from the steps"] = by @ taken.stage @ by.T
        if taken.others is not None:
            root = spread(list(taken.others.T))
            by_source["hysteresis and creep"] = root @ root.T
        if taken.drift is not None:
            by_source["drift of the sensor"] = taken.drift @ taken.drift.T
        if scale is not None and scale.standard_error > 0:
            # A sensor that reads too large by a factor makes the identified gain too large by the same
            # factor.
            relative = scale.standard_error / scale.value
            by_scale = moved["scale"] - (moved["gain"] * fit.model.gain if taken.stage is not None else 0.0)
            by_source["scale of the sensor"] = relative**2 * np.outer(by_scale, by_scale)

    def with_covariance(covariance: Array) -> Fit:
        return replace(fit, uncertainty=fit.uncertainty._replace(covariance=covariance))

    whole = with_covariance(np.sum(list(by_source.values()), axis=0))
    intervals, deviations = whole.confidence_intervals(LEVEL), whole.standard_errors
    errors = {source: with_covariance(one).standard_errors for source, one in by_source.items()}
    return ErrorBudget(
        {source: {name: of[name] for name in names} for source, of in errors.items()},
        {name: deviations[name] for name in names},
        {name: intervals[name] for name in names},
    )


def freed(fit: Fit) -> list[int]:
    """Return the indices of the stage's parameters in `fit.parameters`; [] if the fit has none of them."""
    return [i for i, p in enumerate(fit.parameters) if p.name in STAGE_PARAMETERS]


def _shares(fit: Fit) -> tuple[Array, Array]:
    """Split the covariance of a fit to which stage and friction were free at once; return both parts.

    Their order is: the covariance if the stage were known exactly, and the contribution of the stage's
    uncertainty. Both have the shape [coordinates, coordinates] and add up to the whole covariance.
    """
    whole, at = fit.uncertainty.covariance, freed(fit)
    deviations = np.sqrt(np.diag(whole)[at])
    by = whole[:, at] / deviations
    by_stage = by @ np.linalg.inv(by[at] / deviations[:, None]) @ by.T
    alone = whole - by_stage
    alone[at] = alone[:, at] = 0.0
    return alone, by_stage


def inherited(
    fit: Fit,
    fitted: list[Aligned],
    stage: Fit | None,
    slew_rate: float | None,
    stages: Sequence[Actuator] = (),
) -> Inherited | None:
    """Return the effect of errors of known values on a friction fit; None for a law without derivatives.

    The known values are the stage's parameters, the scale of the sensor, hysteresis and creep, and drifts.

    Args:
        fit: friction fit.
        fitted: walks of the fit.
        stage: fit of the stage, with its covariance; None without steps.
        slew_rate: slew rate of the amplifier, V/s; None if unknown.
        stages: alternative stages, each identified without a part of the recordings of hysteresis.
    """
    if fit.model is None or not has_slopes(fit.model):
        return None
    columns, names = [], [*(p.name for p in fit.parameters), *STAGE_PARAMETERS]
    for one in fitted:
        motion = Displacement(one.recording, one.drive, one.name, fit.model, _TOLERANCE, slew_rate)
        columns.append({**columns_of(motion, fit, names), "scale": one.recording[POSITION].values})
    stacked = {name: np.concatenate([c[name] for c in columns]) for name in columns[0]}
    jacobian = by_coordinates(stacked, fit)
    held = np.zeros((0, jacobian.shape[1]))
    # If the stage was fitted, too, the fit used the result of the steps as a prior. It is a prior here as
    # well.
    if stage is not None and freed(fit):
        held = np.zeros((len(freed(fit)), jacobian.shape[1]))
        own = [[p.name for p in stage.parameters].index(fit.parameters[i].name) for i in freed(fit)]
        known = stage.uncertainty.covariance[np.ix_(own, own)]
        held[:, freed(fit)] = fit.rmse * np.linalg.cholesky(np.linalg.inv(known)).T
    held = np.concatenate([held, noise_of_data(fit)[0] * of_priors(fit)])
    jacobian = np.concatenate([jacobian, held])
    size = np.linalg.norm(jacobian, axis=0)

    def answer(columns: Array) -> Array:
        """Return the shift of the fitted coordinates [coordinates, k] by changes [samples, k] of the
        residuals, simulated minus measured position."""
        columns = np.concatenate([columns, np.zeros((len(held), columns.shape[1]))])
        return -np.linalg.lstsq(jacobian / size, columns, rcond=None)[0] / size[:, None]

    taken = np.column_stack([by_values(stacked, fit, STAGE_PARAMETERS), stacked["scale"]])
    moved = {name: column for name, column in zip((*STAGE_PARAMETERS, "scale"), answer(taken).T, strict=True)}
    others = drift = None
    if stages:
        recordings, drives = [one.recording for one in fitted], [one.drive for one in fitted]
        others = answer(moved_by(fit, stages, recordings, drives, slew_rate))
    if any(one.drift is not None for one in fitted):
        times = [one.recording["time"].values for one in fitted]
        drift = answer(off_by_drifts(times, [one.drift for one in fitted]))
    if stage is None or freed(fit):
        return Inherited(moved, None, others, drift)
    names = [p.name for p in stage.parameters]
    at = [names.index(name) for name in STAGE_PARAMETERS]
    return Inherited(moved, stage.covariance[np.ix_(at, at)], others, drift)
