"""How far simulated walks are from recordings, for many values of the parameters at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from ...actuator import Actuator
from ...simulation.ensemble import simulate_ensemble
from ...simulation.varied import with_values
from ...waveform.drive import Drive
from ...waveform.signal import Waveform
from ..recorded.channels import channel
from ..recorded.recorded_drive import drive_over
from .displacement import MAX_STEPS, Displacement
from .position_channel import CHANNEL, OBSERVED

# The position is sampled at so many delays, up to so many standard errors either side of the estimate.
NODES, REACH = 7, 4.0

Array = NDArray[np.float64]


class Tabulated:
    """A waveform whose segment table is made once, for one duration [s]: ensembles ask for it each time."""

    def __init__(self, source: Waveform, duration: float) -> None:
        self.unit, self.duration, self._range = source.unit, duration, source.range()
        self._table = source.drive(duration)

    def range(self) -> tuple[float, float]:
        """That of the source."""
        return self._range

    def drive(self, duration: float) -> Drive:
        """The table; it holds for every shorter duration."""
        return self._table


class Misfit:
    """The sum of squared residuals of one recording, all members in one ensemble.

    The members of an ensemble share their sample times, so each sample is taken at several delays around that
    of the estimate, and read at the delay of a member from the polynomial through them. A member whose delay
    is beyond them is simulated by itself.

    Args:
        recording, drive, slew_rate: as for `identify_friction`.
        name: what to call the recording in errors.
        model: the actuator that the members vary.
        delay: s, of the estimate, and its standard error.
        tolerance: m, of the simulation.
    """

    def __init__(
        self,
        recording: xr.Dataset,
        drive: Waveform | None,
        slew_rate: float | None,
        name: str,
        model: Actuator,
        delay: tuple[float, float],
        tolerance: float,
    ) -> None:
        self.measured = channel(recording, OBSERVED, name)
        self.model, self.tolerance = model, tolerance
        drive, time = drive_over(recording, drive, name, slew_rate)
        recording = recording.assign_coords(time=time)
        self.drive: Any = Tabulated(drive, float(time[-1]))
        self.one = Displacement(recording, drive, name, model, tolerance)
        self.delay, error = delay
        self.nodes = np.linspace(-REACH * error, REACH * error, NODES) if error > 0.0 else np.zeros(1)
        # What comes before the drive begins is the position at rest.
        wanted = np.maximum(time - self.delay - self.nodes[:, None], 0.0)
        self.times, self.place = np.unique(np.append(0.0, wanted), return_inverse=True)
        self.place = self.place[1:].reshape(wanted.shape)

    def __call__(self, values: Mapping[str, Array]) -> Array:
        """m^2, shape (members,); NaN where a member has no model. Values of the actuator and the channel."""
        own = {name: column for name, column in values.items() if name not in CHANNEL}
        count = next(iter(values.values())).size
        shift = values.get("delay", np.full(count, self.delay)) - self.delay
        offset = values.get("offset", np.zeros(count))
        found = simulate_ensemble(
            self.model,
            self.drive,
            parameters=own or {"load": np.ones(count)},
            times=self.times,
            tolerance=self.tolerance,
            max_steps=MAX_STEPS,
        )["end_effector_position"].values
        sums = np.empty(count)
        weights = _lagrange(self.nodes, shift)
        for m in range(count):
            if abs(shift[m]) <= self.nodes[-1]:
                position = weights[m] @ found[m][self.place]
            else:
                position = self._alone({k: float(v[m]) for k, v in own.items()}, self.delay + shift[m])
            r = position + offset[m] - self.measured
            sums[m] = r @ r
        return sums

    def _alone(self, own: Mapping[str, float], delay: float) -> Array:
        try:
            return self.one.position(with_values(self.model, own), delay)
        except (ValueError, ArithmeticError):
            return np.full(self.measured.size, np.nan)


def _lagrange(nodes: Array, at: Array) -> Array:
    """Weights [points, nodes] of the values at nodes in the polynomial through them."""
    columns: list[Any] = []
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i)
        basis: Any = Polynomial.fromroots(others) if others.size else Polynomial([1.0])
        columns.append(basis(at) / basis(node))
    return np.column_stack(columns)
