"""Effect of alternative stages (other mode, gain or piezo) on the simulated positions of fitted walks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.result import Fit
from ...physics.actuator import Actuator
from ...waveform.signal import Waveform
from ..recorded.channels import names_of
from ..step.fit import STAGE_PARAMETERS
from .displacement import Displacement

if TYPE_CHECKING:
    import xarray as xr

_TOLERANCE = 1e-11

Array = NDArray[np.float64]


def moved_by(
    fit: Fit,
    stages: Sequence[Actuator],
    recordings: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    slew_rate: float | None,
) -> Array:
    """Return the change of the simulated positions, m (rad), from the fitted to each alternative stage, shape
    (samples of all walks, stages).

    Args:
        fit: fit of the walks.
        stages: actuators whose mode, gain and piezo replace those of the fit; values of the stage that were
            fitted to the walks stay.
        recordings, drives, slew_rate: arguments of the fit.
    """
    delay, names = fit.values.get("delay", 0.0), names_of(recordings)

    def positions(model: Actuator) -> Array:
        return np.concatenate(
            [
                Displacement(r, w, name, model, _TOLERANCE, slew_rate).position(model, delay)
                for r, w, name in zip(recordings, drives, names, strict=True)
            ]
        )

    here = positions(fit.model)
    # Values of the stage that were fitted to the walks themselves stay at their estimates.
    own = {name for name in STAGE_PARAMETERS if name in fit.values}
    return np.column_stack(
        [
            positions(
                fit.model.replace(
                    piezo=one.piezo,
                    **{name: getattr(one, name) for name in STAGE_PARAMETERS if name not in own},
                )
            )
            - here
            for one in stages
        ]
    )
