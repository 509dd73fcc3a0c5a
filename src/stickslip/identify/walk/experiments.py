"""Expected standard errors of fits to planned recordings of walks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...physics.actuator import Actuator
from ...quantities.records import Quantity, record, refuse_too_many
from ...recording import make_recording
from ...waveform.signal import Waveform
from ..free import parameter
from .displacement import Displacement

# Error tolerance of the simulated positions, m (rad).
TOLERANCE = 1e-11


@record
class PlannedWalk(NamedTuple):
    """A planned recording of a walk: its `drive` (a waveform), `duration` [s], `sample_rate` of the position
    [Hz], `noise`, the standard deviation of a sample [m], and number of repetitions `repeats`."""

    drive: Waveform
    duration: Annotated[float, Quantity("s", "", "length of the recording", above=0.0)]
    sample_rate: Annotated[float, Quantity("Hz", "", "sample rate of the position", above=0.0)]
    noise: Annotated[float, Quantity("m", "", "standard deviation of a sample's noise", above=0.0)]
    repeats: int = 1

    @property
    def times(self) -> NDArray[np.float64]:
        """Return the times of the samples from 0 to the duration, s. Raises QuantityError for too many
        samples."""
        asked = f"PlannedWalk of {self.duration:g} s at {self.sample_rate:g} Hz"
        refuse_too_many(self.duration * self.sample_rate, asked)
        return np.arange(round(self.duration * self.sample_rate) + 1) / self.sample_rate

    def motion(self, model: Actuator, name: str) -> Displacement:
        """Return the simulation of the planned recording, as a fit would use it; `name` is for messages."""
        blank = make_recording(self.times, {"end_effector_position": np.zeros(self.times.size)}, title=name)
        return Displacement(blank, self.drive, name, model, TOLERANCE)


def expected_errors(
    model: Actuator, free: Sequence[str], experiments: Mapping[str, PlannedWalk]
) -> xr.Dataset:
    """Return the standard errors that a fit to each experiment would have, from the Fisher information.

    The errors hold for white noise and true values near those of the model. Offset and delay of the position
    channel are also free, as in practice.

    Args:
        model: actuator with a law of one internal state, and with the expected values.
        free: names of the parameters to be fitted.
        experiments: planned walks by name.

    Returns:
        Dataset over "experiment" and "parameter"; `standard_error` is relative to the parameter's value, and
        not finite if an experiment does not determine the parameter.
    """
    values = np.array([parameter(model, name, {}).start for name in free])
    rows = []
    for name, walk in experiments.items():
        j = walk.motion(model, name).slopes(model, 0.0, list(free))
        j = np.column_stack([j[:, :-1] * values, j[:, -1], np.ones(len(j))])
        norms = np.linalg.norm(j, axis=0)
        norms[norms == 0.0] = 1.0
        _, s, vt = np.linalg.svd(j / norms, full_matrices=False)
        with np.errstate(divide="ignore"):
            variance = np.sum((vt / s[:, None]) ** 2, axis=0) / norms**2 * walk.noise**2 / walk.repeats
        rows.append(np.sqrt(variance[: len(free)]))
    return xr.Dataset(
        {"standard_error": (("experiment", "parameter"), np.array(rows), {"units": ""})},
        coords={"experiment": list(experiments), "parameter": list(free)},
    )
