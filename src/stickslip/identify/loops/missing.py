"""Residuals of a fit of friction loops, and the missing term of the model that would explain them.

Measured loops leave more than white noise with any law. For the tribometer of [christopherson2021], two
Maxwell elements leave 75 times the white noise (1.4 % of the range of the force), Dahl's law 5 % of the
range. So the ratio to the noise does not show whether the law is wrong, and residuals are normally a remark.
They become a doubt if they exceed `MEASURED` of the range, or if one missing term explains most of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.result import Fit
from ...estimate.score import ASKED, gain, step
from ...quantities.units import Coordinate, with_prefix
from ..recorded.known_noise import more_than_white, white_noise

if TYPE_CHECKING:
    import xarray as xr

# Largest usual rms residual, relative to the range of the force: Dahl's law leaves as much on measured loops.
# A larger residual is a doubt, not a remark.
MEASURED = 0.05
# Viscous friction that would explain more than this share of the residual sum of squares is a doubt, not a
# remark.
MOST = 0.5

Array = NDArray[np.float64]


class Slope(NamedTuple):
    """A term of the force that is not free.

    Fields: `name` of the term; `reach`, its largest plausible size, SI; `by`, the derivatives of all forces
    by the term, shape (samples of all recordings,).
    """

    name: str
    reach: float
    by: Array


def viscous_slope(recordings: Sequence[xr.Dataset], along: Coordinate) -> Slope:
    """Return viscous friction as a `Slope`: the derivative of the force by the coefficient is the velocity,
    m/s (rad/s). Its name is the unit of the coefficient, and its size is not limited. `along` is the
    coordinate of the motion, which determines this unit."""
    velocity = [
        np.gradient(one["position"].values.astype(float), one["time"].values, edge_order=2)
        for one in recordings
    ]
    return Slope(along.unit("N s/m"), math.inf, np.concatenate(velocity))


def missing(fit: Fit, model: Any, viscous: Slope, others: Sequence[Slope]) -> tuple[list[str], list[str]]:
    """Return two lists of sentences, remarks and doubts, on terms that would lower the sum of squares by more
    than noise does.

    A changing speed looks like a drift to a law without viscous friction. So the term that explains most is
    reported, and others only if they explain something in addition.

    Args:
        fit: fit of the loops.
        model: friction law of the fit.
        viscous: viscous friction, from `viscous_slope`; not tested if the law's sigma_2 is fitted.
        others: terms of the channel in `NOTICED` that are not free.
    """
    asked = [one for one in others if gain(fit, one.by) > ASKED]
    # A free viscous coefficient sigma_2 also changes the initial state of the prediction, which would look
    # like an error of the first force.
    if "sigma_2" in fit.values:
        return [_said(fit, one) for one in asked], []
    share = _explained(fit, viscous)
    if gain(fit, viscous.by) <= ASKED or share <= max([_explained(fit, one) for one in asked], default=0.0):
        return [_said(fit, one) for one in asked], []
    said = _said_viscous(fit, model, viscous, share)
    if share > MOST:
        return [], [f"{said}; its values are not to be trusted"]
    beside = _with(fit, viscous)
    return [said, *(_said(beside, one) for one in asked if gain(beside, one.by) > ASKED)], []


def left_over(fit: Fit, measured: Sequence[Array], inexact: Sequence[float]) -> tuple[list[str], list[str]]:
    """Return two lists of sentences, remarks and doubts, on recordings with residuals above their noise.

    A residual is a doubt if it also exceeds the share `MEASURED` of the range of the force.

    Args:
        fit: fit of the loops.
        measured: measured forces of each recording, N (N m).
        inexact: rms effect of noise and sampling of position and normal force on each recording, same unit.
    """
    remarks, doubts = [], []
    for g, force, left in zip(fit.recordings, measured, inexact, strict=True):
        words = (g.name, g.unit, "forces", "the contact follows another law")
        said = more_than_white(g.rmse, math.hypot(white_noise(force), left), force, words)
        if said:
            (doubts if g.rmse > MEASURED * float(np.ptp(force)) else remarks).append(said)
    return remarks, doubts


def _explained(fit: Fit, one: Slope) -> float:
    """Return the share, 0 to 1, of the residual sum of squares of a fit that the further free term `one`
    would explain, linearised; 0 without residuals."""
    left = sum(float(r @ r) for r in _with(fit, one).residuals)
    whole = sum(float(r @ r) for r in fit.residuals)
    return 1.0 - left / whole if whole > 0.0 else 0.0


def _with(fit: Fit, one: Slope) -> Fit:
    """Return the fit, which must have its Jacobian, with a term added, linearised: its Jacobian has the
    term's derivatives as last column, and its residuals are those that remain if all values and the term are
    fitted. Its values stay."""
    assert fit.jacobian is not None
    r = np.concatenate(fit.residuals)
    columns = np.column_stack([fit.jacobian, one.by])
    norms = np.linalg.norm(columns, axis=0)
    q, _ = np.linalg.qr(columns[:, norms > 0.0] / norms[norms > 0.0])
    left = np.split(r - q @ (q.T @ r), np.cumsum([part.size for part in fit.residuals])[:-1])
    return replace(fit, jacobian=columns, residuals=tuple(left))


def _said_viscous(fit: Fit, model: Any, viscous: Slope, share: float) -> str:
    has = hasattr(model, "sigma_2")
    put_right = "sigma_2 can be free, with bounds" if has else "a law with sigma_2 has it, such as LuGre"
    force = with_prefix(step(fit, viscous.by), viscous.name, 3)
    return (
        f"viscous friction of {force} more would explain {100.0 * share:.0f} % of the squares that are left: "
        f"{put_right}"
    )


def _said(fit: Fit, one: Slope) -> str:
    """Return a sentence with the linearised size of `one`, a term of the channel that would explain residuals
    of the fit."""
    found = step(fit, one.by)
    unit = fit.recordings[0].unit
    percent = abs(100.0 * found / one.reach)
    said = {
        "drift": f"friction {'rose' if found > 0 else 'fell'} by {percent:.2g} % during the recordings",
        "asymmetry": f"friction differs forward and backward by {abs(200.0 * found):.2g} %",
        "contact_offset": f"{abs(found):.3g} {unit} of the force do not turn with the motion",
    }[one.name]
    return f"{said}, which the model does not have: {one.name} can be free"
