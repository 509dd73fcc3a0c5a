"""Checks of the end-effector's position in a recording of a walk, and the channel's parameters (delay,
offset)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.parameter import Parameter
from ...physics.actuator import Actuator
from ...quantities.units import with_prefix
from ...recording import RecordingWarning
from ...waveform.signal import Waveform
from ..free import Bounds, linear
from ..recorded.channels import channel, refuse_clipped, unit_of
from ..recorded.drives import refuse_sampling

if TYPE_CHECKING:
    import xarray as xr

OBSERVED = "end_effector_position"
# Fit parameters of the position channel: delay [s] and offset [m or rad].
CHANNEL = ("delay", "offset")
# Default bound of the delay, positive or negative, relative to the duration of the shortest recording.
LONGEST_DELAY = 0.02
# Fewest samples in a period of the stage's vibration; with fewer, slips are not resolved.
FEWEST_SAMPLES = 1.5


def walked(recording: xr.Dataset, drive: Waveform | None, where: str) -> NDArray[np.float64]:
    """Return the measured positions of a walk, m (rad), shape (n,), after checks.

    Args:
        recording: dataset with "time" [s] and end_effector_position.
        drive: waveform of the drive, for the check of the sampling; None: as recorded.
        where: name of the recording for messages.

    Raises:
        RecordingError: the positions are missing, empty, constant, clipped, too few or too coarsely sampled.
    """
    position = channel(recording, OBSERVED, where, varies=True)
    refuse_clipped(position, OBSERVED, where)
    refuse_sampling(recording["time"].values, drive, where)
    return position


def warn_of_unseen_slips(recording: xr.Dataset, model: Actuator, where: str) -> None:
    """Warn (RecordingWarning) if a walk has fewer than `FEWEST_SAMPLES` samples in a period of the stage's
    vibration.

    Then several sets of values fit, but the intervals contain only one of them. `where` names the recording.
    """
    period = 2.0 * math.pi / model.natural_frequency
    interval = float(np.median(np.diff(recording["time"].values)))
    if 0.0 < period < FEWEST_SAMPLES * interval:
        warnings.warn(
            f"{OBSERVED} [m] of {where} is sampled every {with_prefix(interval, 's', 3)}, and the stage "
            f"vibrates with a period of {with_prefix(period, 's', 3)}: its slips are not seen, and other "
            "values of friction, outside the intervals, may fit as well",
            RecordingWarning,
            stacklevel=3,
        )


def of_channel(
    name: str, recordings: Sequence[xr.Dataset], bounds: Bounds, initial: Mapping[str, float]
) -> Parameter:
    """Return "delay" [s] or "offset" [m or rad] as one fit parameter of all recordings.

    Args:
        name: "delay" or "offset".
        recordings: recordings of walks, which give the default bounds.
        bounds: the user's bounds by name.
        initial: initial values by name, SI; 0 if the name is missing.
    """
    if name == "delay":
        reach = LONGEST_DELAY * min(float(np.ptp(r["time"].values)) for r in recordings)
        return linear(name, "s", initial.get(name, 0.0), (-reach, reach), bounds)
    positions = [r[OBSERVED].values for r in recordings]
    reach = max(float(np.ptp(x) + abs(x[0])) for x in positions)
    return linear(name, unit_of(recordings, OBSERVED), initial.get(name, 0.0), (-reach, reach), bounds)
