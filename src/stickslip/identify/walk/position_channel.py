"""The end-effector's position in a recording: checked, and what is free of its channel in a fit."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...estimate.parameter import Parameter
from ...physics.actuator import Actuator
from ...quantities.units import with_prefix
from ...recording import RecordingWarning
from ...waveform.signal import Waveform
from ..free import Bounds, linear
from ..recorded.channels import channel, refuse_clipped, unit_of
from ..recorded.drives import refuse_sampling

OBSERVED = "end_effector_position"
# Parameters of the channel, not of the actuator.
CHANNEL = ("delay", "offset")
# A delay is looked for within this share of the shortest recording.
LONGEST_DELAY = 0.02
# In a period of the stage's own vibration; with fewer, its slips are not seen.
FEWEST_SAMPLES = 1.5


def walked(recording: xr.Dataset, drive: Waveform | None, where: str) -> NDArray[np.float64]:
    """The positions of a walk, m.

    Raises:
        RecordingError: they are missing, empty, constant, clipped, too few or too coarsely sampled.
    """
    position = channel(recording, OBSERVED, where, varies=True)
    refuse_clipped(position, OBSERVED, where)
    refuse_sampling(recording["time"].values, drive, where)
    return position


def warn_of_unseen_slips(recording: xr.Dataset, model: Actuator, where: str) -> None:
    """Warn of a walk so coarsely sampled that several sets of values fit: intervals hold one of them."""
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
    name: str, recordings: Sequence[xr.Dataset], bounds: Bounds, begin: Mapping[str, float]
) -> Parameter:
    """One of `CHANNEL` as a parameter of a fit to all recordings; it starts at 0 if `begin` does not say."""
    if name == "delay":
        reach = LONGEST_DELAY * min(float(np.ptp(r["time"].values)) for r in recordings)
        return linear(name, "s", begin.get(name, 0.0), (-reach, reach), bounds)
    positions = [r[OBSERVED].values for r in recordings]
    reach = max(float(np.ptp(x) + abs(x[0])) for x in positions)
    return linear(name, unit_of(recordings, OBSERVED), begin.get(name, 0.0), (-reach, reach), bounds)
