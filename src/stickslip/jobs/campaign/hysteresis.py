"""Hysteresis and creep of a campaign's stage: identified first, and their errors handed on as stages that
recordings without a part of each would have given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ...estimate.result import Fit
from ...identify.piezo.fit import identify_piezo
from ...identify.piezo.left_out import spread, without_parts
from ...identify.step.fit import STAGE_PARAMETERS
from ...physics.actuator import Actuator
from ..analysis.alignment import POSITION, Aligned
from .file import CampaignFile


class Hysteresis(NamedTuple):
    """The fit, that of a straight line to the same recordings, and the stages (each an actuator) that those
    without a part of them give."""

    fit: Fit
    straight: Fit
    stages: tuple[Actuator, ...]

    @property
    def straight_leaves(self) -> float:
        """What the straight line leaves, over what the fit does."""
        return self.straight.rmse / self.fit.rmse

    @property
    def needed(self) -> bool:
        """Whether a stage without hysteresis does not explain the recordings."""
        return self.straight_leaves >= self.fit.judgement.lack_ratio

    @property
    def sentence(self) -> str:
        """On the straight line."""
        does = "does not explain" if self.needed else "explains"
        return (
            f"a stage without hysteresis and creep {does} these recordings: it leaves "
            f"{self.straight_leaves:.3g} times as much"
        )

    def refitted(self, stage_of: Callable[[Actuator], Fit]) -> Hysteresis:
        """With the mode and gain that steps give each of the stages."""
        return self._replace(stages=tuple(stage_of(one).model for one in self.stages))

    def widened(self, stage: Fit) -> Fit:
        """The fit of steps with what the errors of hysteresis and creep do to it."""
        at = [i for i, p in enumerate(stage.parameters) if p.name in STAGE_PARAMETERS]
        kept = [stage.parameters[i] for i in at]
        moved = [np.array([p.coordinate(getattr(one, p.name)) for p in kept]) for one in self.stages]
        root, covariance = spread(moved), stage.uncertainty.covariance.copy()
        covariance[np.ix_(at, at)] += root @ root.T
        return replace(stage, uncertainty=stage.uncertainty._replace(covariance=covariance))


def hysteresis_of(file: CampaignFile, recordings: Sequence[Aligned], model: Actuator) -> Hysteresis:
    """Return what the recordings with `use: piezo` show, of which there is at least one."""
    shown = [one for one in recordings if one.use == "piezo"]
    return hysteresis_in([one.recording for one in shown], model, file.reference or POSITION)


def hysteresis_in(data: Sequence[xr.Dataset], model: Actuator, observed: str) -> Hysteresis:
    """Of recordings of the clamped end-effector, driven slowly to and fro, in the channel `observed`."""
    fit = identify_piezo(data, model, observed=observed)
    plain: dict[str, Any] = {"operators": 1, "asymmetric": False, "creep": False}
    plain |= {"delay": fit.values["delay"], "lag": fit.values["lag"]}
    straight = identify_piezo(data, observed=observed, **plain)
    stages = [model.replace(gain=gain, piezo=piezo) for gain, piezo in without_parts(fit, data)]
    return Hysteresis(fit, straight, tuple(stages))
