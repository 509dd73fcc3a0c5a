"""Identification of the hysteresis and creep of a campaign's stage.

They are identified before the vibration mode and the friction. Their errors are represented by alternative
stages, each identified without a part of the recordings (jackknife).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...estimate.result import Fit
from ...identify.piezo.fit import identify_piezo
from ...identify.piezo.left_out import spread, without_parts
from ...identify.step.fit import STAGE_PARAMETERS
from ...physics.actuator import Actuator
from ..analysis.alignment import POSITION, Aligned
from .file import CampaignFile

if TYPE_CHECKING:
    import xarray as xr


class Hysteresis(NamedTuple):
    """Identified hysteresis and creep of a stage.

    `fit` is the fit, `straight` a fit without hysteresis and creep (position proportional to voltage) to the
    same recordings, and `stages` are the alternative stages, as actuators.
    """

    fit: Fit
    straight: Fit
    stages: tuple[Actuator, ...]

    @property
    def straight_leaves(self) -> float:
        """Return the rms residual of the straight line over that of the fit with hysteresis and creep."""
        return self.straight.rmse / self.fit.rmse

    @property
    def needed(self) -> bool:
        """Return True if a stage without hysteresis and creep does not explain the recordings.

        The criterion is `straight_leaves`, compared with the threshold `lack_ratio` of the fit's judgement.
        """
        return self.straight_leaves >= self.fit.judgement.lack_ratio

    @property
    def sentence(self) -> str:
        """Return a clause for the report on the need for hysteresis and creep, with the ratio
        `straight_leaves`."""
        does = "does not explain" if self.needed else "explains"
        return (
            f"a stage without hysteresis and creep {does} these recordings: it leaves "
            f"{self.straight_leaves:.3g} times as much"
        )

    def refitted(self, stage_of: Callable[[Actuator], Fit]) -> Hysteresis:
        """Return a copy whose alternative stages have the vibration mode and gain that the steps give.

        `stage_of` takes an actuator with hysteresis; it returns the fit of the steps with this hysteresis.
        """
        return self._replace(stages=tuple(stage_of(one).model for one in self.stages))

    def widened(self, stage: Fit) -> Fit:
        """Return a fit of the steps whose covariance also contains the errors of hysteresis and creep.

        `stage` is the fit. The added covariance is that of its parameters over the alternative stages
        (jackknife). These must come from `refitted`: other stages have the same vibration mode, which then
        gets no added error.
        """
        at = [i for i, p in enumerate(stage.parameters) if p.name in STAGE_PARAMETERS]
        kept = [stage.parameters[i] for i in at]
        moved = [np.array([p.coordinate(getattr(one, p.name)) for p in kept]) for one in self.stages]
        root, covariance = spread(moved), stage.uncertainty.covariance.copy()
        covariance[np.ix_(at, at)] += root @ root.T
        return replace(stage, uncertainty=stage.uncertainty._replace(covariance=covariance))


def hysteresis_of(file: CampaignFile, recordings: Sequence[Aligned], model: Actuator) -> Hysteresis:
    """Identify hysteresis and creep from the recordings with `use: piezo`; at least one is needed.

    The observed channel is the campaign's reference, or without one the position.
    """
    shown = [one for one in recordings if one.use == "piezo"]
    return hysteresis_in([one.recording for one in shown], model, file.reference or POSITION)


def hysteresis_in(data: Sequence[xr.Dataset], model: Actuator, observed: str) -> Hysteresis:
    """Identify hysteresis and creep from recordings of a slow drive to and fro, the end-effector clamped.

    Alternative stages without a part of the recordings, and a straight line for comparison, are fitted, too.

    Args:
        data: recordings with drive_voltage.
        model: actuator whose gain and piezo model are replaced.
        observed: name of the channel that shows the displacement.
    """
    fit = identify_piezo(data, model, observed=observed)
    plain: dict[str, Any] = {"operators": 1, "asymmetric": False, "creep": False}
    plain |= {"delay": fit.values["delay"], "lag": fit.values["lag"]}
    straight = identify_piezo(data, observed=observed, **plain)
    stages = [model.replace(gain=gain, piezo=piezo) for gain, piezo in without_parts(fit, data)]
    return Hysteresis(fit, straight, tuple(stages))
