"""Test whether one set of values explains all walks, those of the fit and further ones.

A wrong friction law that fits one walk within its noise seldom fits all walks. But an error of the stage is
not an error of the law, and a stage with free values can hide a wrong law. So all walks are fitted twice:
with free values of the stage, and with the known stage. Residuals of the first fit test the law. Additional
residuals of the second fit, beyond the (linearised) uncertainty of the stage, test law and stage together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...estimate.disturbed import lack_beside_faults, left_beside_faults
from ...estimate.lack import Lack, left_over
from ...estimate.marginal import values_at
from ...estimate.minima import Minimum, still_fits
from ...estimate.parameter import Values
from ...estimate.result import Fit
from ...physics.actuator import Actuator
from ...simulation.varied import with_values
from ...waveform.signal import Waveform
from ..piezo.left_out import spread
from ..recorded.channels import names_of
from ..step.fit import STAGE_PARAMETERS
from .displacement import Displacement, has_slopes
from .friction import identify_friction
from .other_stages import moved_by
from .position_channel import CHANNEL
from .walks import NEAR, own_values, position_slopes, stage_beside

if TYPE_CHECKING:
    import xarray as xr

TOGETHER = "all walks together"
# A value from all walks contradicts a fit to some walks if it lies outside this fit's interval by more than
# this number of the interval's half-widths.
CONTRADICTS = 2.0


class Explained(NamedTuple):
    """Two fits to all walks, and their lack-of-fit tests.

    Attributes:
        free: fit with the stage's values free.
        known: fit with the stage's values fixed at the known ones.
        lacks: lack-of-fit tests of `free` for each walk with known noise, then one of `known` against `free`
            for all walks together, if the stage has values to free.
    """

    free: Fit
    known: Fit
    lacks: tuple[Lack, ...]

    @property
    def lacks_beside_faults(self) -> tuple[Lack, ...]:
        """Return the tests of `lacks` after the effect of instrument faults (such as jumps of the sensor) is
        removed from the residuals; the test of all walks is repeated only if it shows a lack of fit."""
        found = lack_beside_faults(self.free)
        if len(self.lacks) == len(found) or not self.lacks[-1].seen:
            return (*found, *self.lacks[len(found) :])
        known, free = left_beside_faults(self.known), left_beside_faults(self.free)
        fitted = len(self.free.parameters)
        more = fitted - len(self.known.parameters)
        return (*found, left_over(TOGETHER, float(known @ known), free, more, fitted))


def explained(
    fit: Fit,
    walks: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    free: Sequence[str],
    *,
    stage: Fit | None = None,
    stages: Sequence[Actuator] = (),
    slew_rate: float | None = None,
    **options: Any,
) -> Explained:
    """Fit all walks with the stage's values free and with the known stage, starting from a fit to some walks;
    return both fits and the tests of their residuals.

    Args:
        fit: fit of `identify_friction` to some of the walks.
        walks, drives, slew_rate: all walks, and their arguments as for `identify_friction`.
        free: names of the fitted parameters; delay and offset are added if `fit` contains them.
        stage: fit of the model's stage, for its uncertainty.
        stages: actuators whose stage comes from recordings with parts left out (see `piezo.left_out`); their
            scatter is an uncertainty too. With neither, the stage is taken as exact.
        options: further arguments of `identify_friction`.
    """
    initial = {name: fit.values[name] for name in CHANNEL if name in fit.values}
    free = [*free, *(name for name in initial if name not in free)]
    settings: dict[str, Any] = {"drive": drives, "channel": (), "initial": initial, "correlated": False}
    settings["diagnose"] = False
    # Only residuals are compared, so a search may end within a tenth of a standard error of the minimum,
    # which changes chi-squared by a hundredth.
    settings |= {"averaged": False, "settled": NEAR, "slew_rate": slew_rate, "tied": fit.tied, **options}
    more = [name for name in STAGE_PARAMETERS if name not in (*free, *fit.tied) and name in fit.model._fields]
    loose = identify_friction(walks, fit.model, [*free, *more], hops=0, **settings)
    if any(one.seen for one in loose.lack):  # a local minimum may cause the lack of fit: search for others
        again = identify_friction(walks, fit.model, [*free, *more], **settings)
        loose = min(loose, again, key=lambda one: one.cost)
    if not more:
        return Explained(loose, loose, loose.lack)
    ahead = _ahead(loose, {name: getattr(fit.model, name) for name in more})
    at: dict[str, Any] = {**settings, "initial": {name: ahead.get(name, initial[name]) for name in initial}}
    start = with_values(fit.model, own_values(ahead))
    known = identify_friction(walks, start, free, hops=0, **at)
    if (
        known.cost > loose.judgement.lack_ratio**2 * loose.cost
    ):  # the fit with the known stage may have ended in another local minimum than the fit with a free stage
        law = loose.model.friction
        others = [
            identify_friction(walks, fit.model, free, **settings),
            identify_friction(walks, fit.model.replace(friction=law), free, hops=0, **settings),
        ]
        known = min(known, *others, key=lambda one: one.cost)
    if known.cost < loose.cost:  # more free values cannot fit worse, so that search ended in a local minimum
        settings["initial"] = initial | {name: known.values[name] for name in initial}
        loose = identify_friction(walks, known.model, [*free, *more], hops=0, **settings)
    allowed = _allowed(known, walks, drives, slew_rate, stage, stages, loose.rmse)
    together = left_over(TOGETHER, allowed, np.concatenate(loose.residuals), len(more), len(loose.parameters))
    return Explained(loose, known, (*loose.lack, together))


def contradicted(fit: Fit, everything: Explained) -> tuple[str, ...]:
    """Return the names of friction parameters whose values in `everything`, the fits to all walks, are far
    outside their intervals in `fit`, a fit to some walks.

    The tuple is empty without such parameters, or if the model does not explain all walks.
    """
    if any(one.seen for one in (*fit.lack, *everything.lacks)):
        return ()
    far = []
    for name, (low, high) in fit.confidence_intervals().items():
        value, reach = everything.known.values.get(name), CONTRADICTS * 0.5 * (high - low)
        if name not in CHANNEL and value is not None and not low - reach <= value <= high + reach:
            far.append(name)
    return tuple(far)


def with_minimum_of_all(fit: Fit, there: Fit) -> Fit:
    """Return the fit to some walks, corrected for the minimum that the fit to all walks found.

    If that minimum is clearly lower, return `there` with the advice of `fit`. If it fits as well, return
    `fit` with intervals that include it. Otherwise return `fit` unchanged.

    Args:
        fit: fit to some walks, which contradicts the fit to all walks (see `contradicted`).
        there: fit to the same walks, started at the values of the fit to all walks.
    """
    variance = 1.0 if fit.noise_known else fit.cost / fit.degrees_of_freedom
    excess, count = (there.cost - fit.cost) / variance, len(fit.parameters)
    if not still_fits(-excess, count):
        return replace(there, advice=fit.advice)
    if still_fits(excess, count):
        return fit.with_minima([*fit.minima, Minimum(there.values, there.uncertainty, max(excess, 0.0))])
    return fit


def diagnosed_together(
    found: Explained,
    walks: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    free: Sequence[str],
    **options: Any,
) -> Fit:
    """Return the fit to all walks with the known stage, and with advice on a term that the model lacks.

    All walks are needed: if one walk hardly shows the missing term, another term explains that walk as well.

    Args:
        found: the fits to all walks, from `explained`.
        walks, drives, free: arguments with which `found` was made; see `explained`.
        options: further arguments of `identify_friction`.
    """
    known = found.known
    initial = {name: known.values[name] for name in CHANNEL if name in known.values}
    free = [*free, *(name for name in initial if name not in free)]
    settings: dict[str, Any] = {"channel": (), "initial": initial, "correlated": False, "averaged": False}
    settings |= {"settled": NEAR, "tied": known.tied, "hops": 0, **options}
    return identify_friction(walks, known.model, free, drive=drives, **settings)


def _ahead(fit: Fit, known: Values) -> Values:
    """Return the best values, by name, SI, of all other parameters if the `known` parameters are fixed at
    these values (by name, SI), by linearised least squares; empty if the fit has no finite derivatives."""
    if fit.jacobian is None or not np.all(np.isfinite(fit.jacobian)):
        return {}
    moved = np.array([p.name in known for p in fit.parameters])
    q = np.array([p.coordinate(fit.values[p.name]) for p in fit.parameters])
    to = np.array([p.coordinate(known.get(p.name, fit.values[p.name])) for p in fit.parameters])
    by_known = fit.jacobian[:, moved] @ (to - q)[moved]
    q[~moved] -= np.linalg.lstsq(fit.jacobian[:, ~moved], by_known, rcond=None)[0]
    return {name: value for name, value in values_at(fit.parameters, q).items() if name not in known}


def _allowed(
    fit: Fit,
    walks: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    slew_rate: float | None,
    stage: Fit | None,
    stages: Sequence[Actuator],
    noise: float,
) -> float:
    """Return the residual sum of squares, m^2 (rad^2), that remains of the fit with the known stage if the
    stage's values adapt within their uncertainty, linearised.

    Args:
        fit: fit of all walks with the known stage.
        walks, drives, slew_rate, stage, stages: as for `explained`.
        noise: standard deviation of the position's noise, m (rad).
    """
    r = np.concatenate(fit.residuals)
    if fit.jacobian is None or not has_slopes(fit.model) or (stage is None and not stages):
        return float(r @ r)
    # `moves` are changes of the positions by one standard deviation of the stage's values. The least squares
    # below count such a change of the stage like one residual of the size of the noise.
    moves = np.zeros((r.size, 0))
    if stage is not None:
        moves = _by_values(fit, walks, drives, slew_rate, stage)
    if stages:
        moves = np.column_stack([moves, spread(list(moved_by(fit, stages, walks, drives, slew_rate).T))])
    if not np.all(np.isfinite(moves)):  # the simulation has no derivatives for a very stiff contact
        return float(r @ r)
    own = fit.jacobian[:, np.linalg.norm(fit.jacobian, axis=0) > 0.0]
    own = own / np.linalg.norm(own, axis=0)
    count = moves.shape[1]
    rows = np.block([[own, moves], [np.zeros((count, own.shape[1])), noise * np.eye(count)]])
    wanted = np.append(-r, np.zeros(count))
    left = rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0] - wanted
    return float(left @ left)


def _by_values(
    fit: Fit,
    walks: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    slew_rate: float | None,
    stage: Fit,
) -> np.ndarray:
    """Return the changes of the positions, m (rad), by independent errors of the stage's values of one
    standard deviation each (columns of the Cholesky factor of their covariance), shape (samples of all walks,
    values). `drives` has the waveform of each walk, or None."""
    kept = stage_beside(stage, fit)
    parameters = [stage.parameters[i] for i in kept]
    motions = [
        Displacement(r, w, name, fit.model, 1e-10, slew_rate)
        for r, w, name in zip(walks, drives, names_of(walks), strict=True)
    ]
    by = position_slopes(motions, fit, [p.name for p in parameters])
    scales = [p.slope(stage.values[p.name]) for p in parameters]
    return by * scales @ np.linalg.cholesky(stage.uncertainty.covariance[np.ix_(kept, kept)])
