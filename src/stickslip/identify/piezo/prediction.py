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

# Largest difference between predicted and measured first position, as a share of the stroke, at which an
# assumed rest voltage before the recording is accepted.
AT_REST = 0.05
# Smallest relative reduction of the residual by which another past of the drive (a motion instead of a rest,
# or another rest voltage) is preferred.
CLEARLY = 0.02
# Distance of a drive outside the voltages of the fit, relative to their range, above which a prediction
# warns.
BEYOND = 0.1
# Largest distance of an estimated rest voltage outside the drive's range (with 0 V), relative to this range;
# a voltage farther away is not believed.
FAR = 0.5

Array = NDArray[np.float64]


class PiezoPrediction(NamedTuple):
    """Prediction of positions by a fitted piezo model.

    Fields: `piezo`, the hysteresis and creep; static `gain` [m/V]; `offset`, the sensor's reading at 0 V
    before any drive, m; `delay` and `lag` of the voltage [s]; `low` and `high`, the range of the fitted
    drives and of the rests before them, V; and `observed`, the name of the position channel.
    """

    piezo: Piezo
    gain: float
    offset: float
    delay: float
    lag: float
    low: float
    high: float
    observed: str

    def predict(self, recording: xr.Dataset, drive: object = None) -> Array:
        """Return the predicted position, m, shape (n,), under the recording's drive_voltage; `drive` is not
        used.

        Recorded positions, if any, determine what the model cannot know: the zero of the sensor, and the rest
        or motion before the first sample. Otherwise the zero is `offset`, and the piezo rested at the first
        voltage.

        Raises:
            RecordingError: a channel is missing or unsuitable.

        Warns:
            RecordingWarning: the drive leaves the range of voltages of the fit.
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
        """Return the predicted position without the sensor's zero level, m, shape (n,)."""
        u = at_piezo(observed, DelayAndLag(self.delay, self.lag))
        return self.gain * after_hysteresis(self.piezo, observed, u)

    def begun(self, observed: Observed) -> Observed:
        """Return the recording with the fields `rest` and `cycled` that its positions show: a rest before the
        first sample or, if that fits clearly better, a periodic motion that the drive continues."""
        rested = observed._replace(rest=self._rest_shown(observed), cycled=False)
        cycled = observed._replace(rest=float(observed.drive[0]), cycled=True)
        left = [float(np.std(one.position - self.position(one))) for one in (rested, cycled)]
        return cycled if left[1] < (1.0 - CLEARLY) * left[0] else rested

    def _nearer(self, observed: Observed) -> Observed:
        """Return the recording with the rest voltage that its first position shows, if that fits clearly
        better than the present one; unchanged after a periodic motion.

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
        """Return the voltage [V] at which the piezo rested before the recording: `observed.rest` or 0 V if it
        fits the first position; else the voltage computed from this position or, if that is far outside the
        drive's range, `observed.rest`."""
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
    """Warn with RecordingWarning if a drive [V] leaves the range of the fitted voltages by more than the
    share `beyond` of this range; `what` starts the message, such as "the drive goes"."""
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
    """Return the output of hysteresis and creep, V, shape (n,): the position, less offset, over the gain.

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
