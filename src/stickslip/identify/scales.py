"""Systematic errors of fitted values from scale errors of the recorded channels.

A sensor with the relative scale error s shows (1 + s) times the motion. Least squares then give other values;
their change is linearised, as for all quantities that a fit takes as known (`estimate.moves`). Values
identified earlier with the same sensor, such as those of a stage, have the same scale error. If no other
known quantity has the sensor's unit, the relative change of a value is s times the power of this unit in its
own unit: s for a gain in m/V or a force, 0 for a damping ratio.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimate.covariance import decomposed
from ..estimate.moves import over_noise, tangent
from ..estimate.result import Fit
from ..estimate.systematic import Systematic
from ..recording import SCALE_UNCERTAINTY

if TYPE_CHECKING:
    import xarray as xr

DRIVE = "drive_voltage"
DIFFERENCE = 1e-3  # relative step of a channel's scale for numerical derivatives

Array = NDArray[np.float64]


def scale_uncertainty(recordings: Sequence[xr.Dataset], name: str) -> float:
    """Return the relative standard uncertainty of a channel's scale, the largest of all recordings; 0 if any
    recording lacks the channel or its attribute `scale_uncertainty`."""
    found = [float(one[name].attrs.get(SCALE_UNCERTAINTY, 0.0)) if name in one else 0.0 for one in recordings]
    return max(found) if min(found) > 0.0 else 0.0


def cause_of(name: str) -> str:
    """Return the words that name a channel's scale as a source of error in reports: "the scale of NAME"."""
    return f"the scale of {name}"


def model_values(fit: Fit) -> Array:
    """Return the values of the fitted channel by the model, for all recordings, joined: measured values plus
    residuals (model minus measured), in the unit of the data, shape (n,)."""
    return np.concatenate([x + r for x, r in zip(fit.measured, fit.residuals, strict=True)])


class ByKnown(NamedTuple):
    """Derivatives of a fit's residuals by quantities that the fit took as known, in the unit of the data,
    each of shape (samples of all recordings,).

    Attributes:
        inputs: derivatives by the logarithm of the scale of each input channel, by the name of the channel.
        by_stage: derivatives by the search coordinates (such as logarithms) of values from an earlier fit, by
            the name of the value.
    """

    inputs: Mapping[str, Array]
    by_stage: Mapping[str, Array] = MappingProxyType({})


def with_scales(
    fit: Fit,
    recordings: Sequence[xr.Dataset],
    derivatives: Callable[[Fit], ByKnown],
    stage: Fit | None = None,
    known: str = DRIVE,
) -> Fit:
    """Return the fit with its systematic errors (`systematics`), by scale errors of its own channels and of
    the channels of an earlier fit.

    Args:
        fit: complete fit to the channel `fit.observed`.
        recordings: recordings of the fit; a variable's attribute `scale_uncertainty` is the relative standard
            uncertainty of its scale.
        derivatives: function from the fit to the derivatives of its residuals; called only if any scale has
            an uncertainty.
        stage: earlier fit whose values this fit took as known or as a prior; None: there is no such fit.
        known: name of the input channel, which the model takes as exact.
    """
    shares = {
        cause_of(name): share
        for name in (fit.observed, known)
        if (share := scale_uncertainty(recordings, name)) > 0.0
    }
    of_stage = {one.cause: one for one in (stage.systematics if stage else ())}
    if fit.jacobian is None or not fit.measured or not (shares or of_stage):
        return replace(fit, systematics=())
    by = derivatives(fit)
    columns = {cause_of(name): column for name, column in by.inputs.items()}
    columns[cause_of(fit.observed)] = -model_values(fit)
    names = {p.name for p in fit.parameters}
    found = []
    for cause in dict.fromkeys([*shares, *of_stage]):
        column = shares.get(cause, 0.0) * columns.get(cause, np.zeros(len(fit.jacobian)))
        moves = of_stage[cause].moves if cause in of_stage else {}
        for name, slope in by.by_stage.items():
            if name not in names:
                column = column + slope * moves.get(name, 0.0)
        free = {name: moves.get(name, 0.0) for name in by.by_stage if name in names}
        share = shares.get(cause) or of_stage[cause].uncertainty
        found.append(Systematic(cause, share, moved(fit, column, free)))
    return replace(fit, systematics=tuple(found))


def by_prediction(recordings: Sequence[xr.Dataset], name: str) -> Callable[[Fit], ByKnown]:
    """Return a function for the argument `derivatives` of `with_scales`.

    The function computes the derivative by the scale of the input channel `name` from predictions of the
    recordings (`fit.predict`) with this channel multiplied by 1 - 1e-3 and 1 + 1e-3.
    """

    def of(fit: Fit) -> ByKnown:
        assert fit.predict is not None
        sides = [
            np.concatenate([fit.predict(one.assign({name: one[name] * (1.0 + h)})) for one in recordings])
            for h in (-DIFFERENCE, DIFFERENCE)
        ]
        return ByKnown({name: (sides[1] - sides[0]) / (2.0 * DIFFERENCE)})

    return of


def moved(fit: Fit, column: Array, known: Mapping[str, float]) -> dict[str, float]:
    """Return the changes of the fitted search coordinates (such as logarithms of the values), by parameter
    name, if a known quantity changes the residuals.

    Coordinates in `known` change by the values given there, coordinates at a bound do not change, and all
    others follow by least squares. Changes that are not finite are left out.

    Args:
        fit: fit with its Jacobian.
        column: change of the residuals (model minus measured), in the unit of the data, shape (n,).
        known: given changes of coordinates by the name of the parameter.
    """
    rows, target = tangent(fit), over_noise(fit, column[:, None])[:, 0]
    fixed = {i: known[p.name] for i, p in enumerate(fit.parameters) if p.name in known}
    rest = [i for i in range(len(fit.parameters)) if i not in fixed and not fit.uncertainty.bounded[i]]
    for i, move in fixed.items():
        target = target + rows[:, i] * move
    result = dict(known)
    if rest:
        directions, root, _ = decomposed(rows[:, rest])
        steps = -root @ (directions.T @ target)
        result |= {fit.parameters[i].name: float(step) for i, step in zip(rest, steps, strict=True)}
    return {name: move for name, move in result.items() if math.isfinite(move)}
