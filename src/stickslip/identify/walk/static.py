r"""Pohl's static model of walks [pohl1987; kang2007, eq. 1.1]: the piezo moves by a gain D times the voltage.

The end-effector follows all slow motion of the piezo and does not move in all fast motion, whatever the
friction: :math:`x = D\,w(t)`, where w is the drive voltage without its jumps and fast flanks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Values
from ...estimate.problem import Residuals
from ...estimate.result import Fit
from ...physics.actuator import Actuator
from ...quantities.units import unit_for
from ...waveform.drive import Drive, evaluate, segment_at
from ...waveform.drive import value_slope_curvature as value_at
from ..free import Bounds, linear
from ..recorded.channels import channel, drives_of, names_of, recordings_of
from ..recorded.recorded_drive import drive_over
from .position_channel import CHANNEL, OBSERVED, of_channel

if TYPE_CHECKING:
    import xarray as xr

# A segment of the drive counts as fast if its mean slope exceeds the usual slope (the median over the time in
# which the voltage changes) by this factor.
FAST = 10.0

Array = NDArray[np.float64]


def slow_part(drive: Drive, end: float) -> Callable[[Array], Array]:
    """Return a function of sample times [s], shape (n,), up to `end` [s], that returns the drive voltage
    without its jumps and fast flanks, V; it is 0 for t < 0 and does not jump at t = 0."""
    ends = np.append(drive.start[1:], max(end, float(drive.start[-1])))
    first = np.array([value_at(drive, i, t)[0] for i, t in enumerate(drive.start)])
    last = np.array([value_at(drive, i, t)[0] for i, t in enumerate(ends)])
    length = np.maximum(ends - drive.start, 1e-12)
    speed = np.abs(last - first) / length
    moving = speed > 0.0
    order = np.argsort(speed[moving])
    share = np.cumsum(length[moving][order])
    usual = float(speed[moving][order][np.searchsorted(share, 0.5 * share[-1])]) if share.size else 0.0
    fast = speed > FAST * usual
    jumps = first - np.append(drive.before, last[:-1])
    # Voltage change [V] up to the start of each segment that the end-effector has not followed: the sum of
    # all jumps so far and of the earlier fast segments.
    behind = np.cumsum(jumps) + np.append(0.0, np.cumsum(np.where(fast, last - first, 0.0))[:-1])

    def of(times: Array) -> Array:
        at = segment_at(drive, times)
        u = np.where(fast[at], first[at], evaluate(drive, times)[0])
        return np.where(times < 0.0, 0.0, u - behind[at] - drive.before)

    return of


def identify_static_walk(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Actuator,
    *,
    drive: Any = None,
    slew_rate: float | None = None,
    bounds: Bounds | None = None,
) -> Fit:
    """Fit Pohl's static model to walks: D as `gain` [m/V], and delay [s] and offset [m] of the channel.

    Args:
        recordings: with end_effector_position [m].
        model: actuator whose gain is the initial value.
        drive: waveform of each recording, or one for all, as for `identify_friction`.
        slew_rate: rate at which the amplifier follows jumps of a recorded drive, V/s; None: at once.
        bounds: bounds of gain, delay and offset by name, in SI or as strings.

    Returns:
        The fit, which can predict recordings, but has no actuator as `model`.

    Raises:
        RecordingError: a channel is missing, too short or constant.
        QuantityError: a bound is wrong.
        FitError: see `fit_least_squares`.
    """
    found = recordings_of(recordings)
    names = names_of(found)
    known = dict(bounds or {})

    unit, parts, most = unit_for(model, "m"), [], 10.0 * abs(model.gain)
    for recording, waveform, name in zip(found, drives_of(drive, found), names, strict=True):
        x = channel(recording, OBSERVED, name, varies=True)
        of = _walk(recording, waveform, name, slew_rate)
        time = recording["time"].values
        parts.append(Residuals(lambda values, of=of, x=x: of(values) - x, x, None, name, unit, time=time))
    fit = fit_least_squares(
        parts,
        [
            linear("gain", unit_for(model, "m/V"), model.gain, (-most, most), known),
            *(of_channel(name, found, known, {}) for name in CHANNEL),
        ],
        central=True,
        hops=2,
    )

    return replace(fit, observed=OBSERVED, predict=StaticPrediction(fit.values, slew_rate).predict)


class StaticPrediction(NamedTuple):
    """Prediction of a walk by the static model with the fitted `values` (gain, delay and offset by name, SI);
    `slew_rate` [V/s] of recorded jumps as for `identify_static_walk`."""

    values: Values
    slew_rate: float | None

    def predict(self, recording: xr.Dataset, drive: Any = None) -> Array:
        """Return the predicted position at the recording's samples, m (rad), shape (n,); `drive` is a
        waveform in the recording's time, or None for the recorded drive."""
        return _walk(recording, drive, names_of([recording])[0], self.slew_rate)(self.values)


def _walk(
    recording: xr.Dataset, waveform: Any, name: str, slew_rate: float | None
) -> Callable[[Values], Array]:
    waveform, time = drive_over(recording, waveform, name, slew_rate)
    slow = slow_part(waveform.drive(float(time[-1])), float(time[-1]))
    return lambda values: values["gain"] * slow(time - values["delay"]) + values["offset"]
