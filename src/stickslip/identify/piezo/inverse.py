"""Inverse of an identified piezo model: the drive voltage for wanted positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...physics.piezo.creep import Lags, before_creep
from ...quantities.units import QuantityError, array_si, optional_si
from ...waveform import Sampled
from .columns import DelayAndLag, Observed, at_piezo
from .prediction import PiezoPrediction, warn_beyond

# Distance of a computed drive outside the voltages of the fit, relative to their range, above which
# `inverse_drive` warns.
BEYOND = 0.02
# Number of repeated corrections for delay and lag. The slopes in the inverse of the lag come from
# neighbouring samples, which is inaccurate at corners.
CORRECTIONS = 3

Array = NDArray[np.float64]


def inverse_drive(
    fit: Fit,
    times: ArrayLike,
    positions: ArrayLike,
    *,
    rest_voltage: float | str | None = None,
) -> Sampled:
    """Return the drive that moves the piezo of a fit through positions, with creep, hysteresis, lag and delay
    compensated.

    Hysteresis and creep are inverted exactly, sample by sample. The lag is inverted by the slope of the
    result, so positions should be smooth over the time constant of the lag. `inverse_residual` estimates the
    error in operation: about the error on unseen recordings (`verify`), plus the errors of delay and lag.

    Args:
        fit: fit of `identify_piezo`.
        times: times of the positions, s, shape (n,), ascending from 0 or later.
        positions: wanted positions, m, shape (n,), as measured in the fit's recordings: the position at 0 V
            before any drive is the mean of `fit.values["offset_1"]`, ....
        rest_voltage: voltage at which the piezo rests before the drive, V, reached from 0 V; by default the
            voltage at which it rests at the first position.

    Returns:
        Waveform of voltages [V] at the times, joined by straight lines.

    Raises:
        FitError: the fit is not one of `identify_piezo`.
        QuantityError: times do not ascend, lengths differ, positions are not finite, or no voltage reaches a
            position.

    Warns:
        RecordingWarning: the drive leaves the range of voltages of the fitted recordings.
    """
    rest = optional_si(rest_voltage, "V", "rest_voltage")
    t, y = array_si(times, "s", "times"), array_si(positions, "m", "positions")
    prediction = _prediction(fit)
    if t.ndim != 1 or t.shape != y.shape or t.size < 2 or np.any(np.diff(t) <= 0.0) or t[0] < 0.0:
        raise QuantityError(
            f"times [s] of shape {t.shape} must ascend from 0 s or later, with as many positions [m], "
            f"which have the shape {y.shape}"
        )
    if not np.all(np.isfinite(y)):
        raise QuantityError(f"positions [m] are not finite at sample {int(np.argmin(np.isfinite(y)))}")
    wanted = (y - prediction.offset) / prediction.gain
    if rest is None:
        rest = prediction.piezo.resting_at(float(wanted[0]))
    h = _before_creep(prediction, t, wanted, rest)
    try:
        u = prediction.piezo.hysteresis.inverse(h, rest)
    except QuantityError as error:
        raise QuantityError(f"positions [m] cannot be reached: {error}") from None
    timing = DelayAndLag(prediction.delay, prediction.lag)

    def ahead(volts: Array) -> Array:
        return np.interp(t + timing.delay, t, volts + timing.lag * np.gradient(volts, t))

    drive = ahead(u)
    for _ in range(CORRECTIONS if any(timing) else 0):
        drive += ahead(u - at_piezo(Observed("", t - t[0], drive, y, rest), timing))
    warn_beyond(prediction, drive, "the drive goes", BEYOND)
    return Sampled(t, drive)


def inverse_residual(
    fit: Fit, drive: Sampled, positions: ArrayLike, *, rest_voltage: float | str | None = None
) -> float:
    """Return the expected rms error of positions under their `inverse_drive`, m, without a constant error.

    The error contains the rms residual of the fit on its recordings, and the difference between the wanted
    positions and the fit's own prediction of the positions under the drive.

    Args:
        fit: fit of `identify_piezo`.
        drive: result of `inverse_drive` for these positions.
        positions: m, shape (n,), wanted positions.
        rest_voltage: voltage at which the piezo rests before the drive, V, as given to `inverse_drive`.

    Raises:
        FitError: the fit is not one of `identify_piezo`.
        QuantityError: there are not as many positions as the drive has samples, or the rest voltage is not a
            voltage.
    """
    rest = optional_si(rest_voltage, "V", "rest_voltage")
    wanted, prediction = array_si(positions, "m", "positions"), _prediction(fit)
    t, u = np.array(drive.times), np.array(drive.values)
    if wanted.shape != t.shape:
        raise QuantityError(f"positions [m] have the shape {wanted.shape}, and the drive {t.size} samples")
    if rest is None:
        rest = prediction.piezo.resting_at(float(wanted[0] - prediction.offset) / prediction.gain)
    off = prediction.position(Observed("", t - t[0], u, wanted, rest)) - wanted
    return float(np.hypot(fit.rmse, np.std(off)))


def _prediction(fit: Fit) -> PiezoPrediction:
    prediction = getattr(getattr(fit, "predict", None), "__self__", None)
    if not isinstance(prediction, PiezoPrediction):
        raise FitError("inverse_drive needs a fit of identify_piezo")
    return prediction


def _before_creep(prediction: PiezoPrediction, t: Array, wanted: Array, rest: float) -> Array:
    creep = prediction.piezo.creep
    if creep is None:
        return wanted
    tau, h = np.array(creep.time_constants), np.empty(t.size)
    first = prediction.piezo.hysteresis.at_rest(rest)
    before_creep(Lags(tau), t, wanted, np.array(creep.shares), np.full(tau.size, first), h)
    return h
