"""Prediction of the position in a recording by a fitted piezo model."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...physics.piezo import Piezo
from ...recording import RecordingWarning
from ..recorded.channels import channel, names_of
from .columns import DelayAndLag, Observed, at_piezo, lagged, observe

if TYPE_CHECKING:
    import xarray as xr

# A rest voltage before the recording is accepted if the first position, predicted with it, differs from the
# measured one by less than this share of the stroke.
AT_REST = 0.05
# Relative reduction of the residual that a motion before the recording must bring, compared with a rest.
CLEARLY = 0.02
# Distance outside the fitted drives, relative to their range, above which a prediction gives a warning.
BEYOND = 0.1
# Largest distance of a rest voltage outside the used voltages, relative to their range.
FAR = 0.5

Array = NDArray[np.float64]


class PiezoPrediction(NamedTuple):
    """A fitted piezo model with its `gain` [m/V], the level `offset` [m], `delay` and `lag` [s]; `low` and
    `high` [V] are the range of the fitted drives."""

    piezo: Piezo
    gain: float
    offset: float
    delay: float
    lag: float
    low: float
    high: float
    observed: str

    def predict(self, recording: xr.Dataset, drive: object = None) -> Array:
        """Return the position, m, shape (n,), under the recording's drive_voltage.

        Recorded positions, if any, determine what the model cannot know: the zero of the sensor, and the
        voltage at which the piezo rested before. Otherwise the zero is that of the fit, and the piezo rested
        at the first voltage.
        """
        del drive
        name = names_of([recording])[0]
        warn_beyond(self, channel(recording, "drive_voltage", name), f"the drive of {name} goes")
        if self.observed not in recording:
            voltage = channel(recording, "drive_voltage", name)
            time = recording["time"].values - float(recording["time"].values[0])
            return self.position(Observed(name, time, voltage, voltage, float(voltage[0]))) + self.offset
        one = self._nearer(self.begun(observe(recording, name, self.observed, None)))
        shown = self.position(one)
        return shown + float(np.mean(one.position - shown))

    def position(self, observed: Observed) -> Array:
        """Return the position without the sensor's zero level, m, shape (n,)."""
        u = at_piezo(observed, DelayAndLag(self.delay, self.lag))
        return self.gain * after_hysteresis(self.piezo, observed, u)

    def begun(self, observed: Observed) -> Observed:
        """Return the recording with the past that its positions show: a rest, or a motion that the drive
        continues.

        A rest is preferred unless a continued motion fits clearly better.
        """
        rested = observed._replace(rest=self._rest_shown(observed), cycled=False)
        cycled = observed._replace(rest=float(observed.drive[0]), cycled=True)
        left = [float(np.std(one.position - self.position(one))) for one in (rested, cycled)]
        return cycled if left[1] < (1.0 - CLEARLY) * left[0] else rested

    def _nearer(self, observed: Observed) -> Observed:
        """Return the recording with the rest voltage that its first position shows, if that fits clearly
        better.

        An error of a few volts would add slow creep to the whole recording.
        """
        if observed.cycled:
            return observed
        left = observed.position - self.position(observed)
        rest = self.piezo.resting_at(float(observed.position[0] - np.median(left)) / self.gain)
        other = observed._replace(rest=rest)
        less = float(np.std(other.position - self.position(other)))
        return other if less < (1.0 - CLEARLY) * float(np.std(left)) else observed

    def _rest_shown(self, observed: Observed) -> float:
        """Return the voltage [V] at which the piezo rested before: the assumed one or 0 V if they fit the
        first position, else the one that does."""
        first = 0.0
        for rest in (observed.rest, 0.0):
            shown = self.position(observed._replace(rest=rest))
            first = float(observed.position[0] - np.median(observed.position - shown))
            if abs(first - float(shown[0])) < AT_REST * float(np.ptp(shown)):
                return rest
        found = self.piezo.resting_at(first / self.gain)
        low, high = min(0.0, float(observed.drive.min())), max(0.0, float(observed.drive.max()))
        margin = FAR * (high - low)
        return found if low - margin < found < high + margin else observed.rest


def warn_beyond(prediction: PiezoPrediction, drive: Array, what: str, beyond: float = BEYOND) -> None:
    """Warn with RecordingWarning if a drive [V] leaves the fitted range of voltages by more than the share
    `beyond`."""
    low, high = prediction.low, prediction.high
    margin = beyond * (high - low)
    if drive.min() < low - margin or drive.max() > high + margin:
        warnings.warn(
            f"{what} from {drive.min():.4g} V to {drive.max():.4g} V; the fit is of recordings from "
            f"{low:.4g} V to {high:.4g} V, beyond which it is not known",
            RecordingWarning,
            stacklevel=3,
        )


def after_hysteresis(piezo: Piezo, observed: Observed, u: Array) -> Array:
    """Return the output of hysteresis and creep, V, shape (n,): the position divided by the gain.

    Args:
        piezo: hysteresis and creep.
        observed: recording, for its times and the drive before its first sample.
        u: voltage at the piezo, V, shape (n,).
    """
    way = observed.way
    h = piezo.hysteresis.output(np.append(way, u), way[0])
    before, h = float(h[way.size - 1]), h[way.size :]
    if piezo.creep is None:
        return h
    begun = float(h.mean()) if observed.cycled else before
    return h + lagged(observed.time, h, np.array(piezo.creep.time_constants), begun) @ np.array(
        piezo.creep.shares
    )
