r"""Frequency responses of linear systems from recordings of drive and response.

The measured response is the best linear approximation plus a residual. For periodic drives, noise shows as
differences between periods, and noise together with nonlinear distortion as differences between realisations
[pintelon2012, ch. 4]. With a piezo, the differences between realisations are often twenty times as large and
are then the true uncertainty of the response. The response also contains the instruments: see `instruments`.
"""

from __future__ import annotations

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from ...estimate.blas import single_threaded
from ...quantities.units import to_si
from ...recording.conversion import to_si_unit

# Smallest rms amplitude of the drive at which a frequency counts as excited, relative to the largest of all
# frequencies.
EXCITED = 0.01


class ResponseError(ValueError):
    """Error: these recordings do not determine the requested frequency response."""


def ratio_of(units: tuple[str, str]) -> str:
    """Return the unit of response per drive, such as "m/V", given the SI units of drive and response.

    A drive that is a plain number has the unit "".
    """
    drive, response = units
    return f"{response or '1'}/{drive}" if drive else response or "1"


def units_of(response: xr.Dataset) -> tuple[str, str]:
    """Return the units of drive and response of a frequency response: ("V", "m") if it is in m/V.

    Without the coordinate `drive_rms`, the drive's unit stands after the last "/".
    """
    unit = str(response["response"].attrs["units"])
    said = response["drive_rms"].attrs if "drive_rms" in response.coords else {}
    drive = str(said.get("units", unit.rpartition("/")[2] if "/" in unit else ""))
    over = unit.removesuffix(f"/{drive}") if drive else unit
    return drive, "" if over == "1" else over


@single_threaded
def frequency_response(
    drive: ArrayLike,
    response: ArrayLike,
    sample_rate: float | str,
    *,
    band: tuple[float | str, float | str] = (0.0, np.inf),
    smoothing: int = 21,
    units: tuple[str, str] = ("V", "m"),
) -> xr.Dataset:
    """Return the response to a periodic drive (multisine), from whole periods in the steady state.

    The response is a least-squares fit over all realisations (drives with different phases) at each excited
    frequency, so the realisations need not be orthogonal.

    Args:
        drive: drive at the mechanism (see `applied_voltage` for a command), in the first of `units`, shape
            (samples of a period, inputs, realisations, periods); trailing axes may be omitted.
        response: measured response, in the second of `units`, in the same shape with outputs for inputs.
        sample_rate: Hz.
        band: lowest and highest frequency to keep, Hz.
        smoothing: number of neighbouring frequencies over which variances are averaged, because each has few
            realisations.
        units: units of drive and response, such as ("V", "um").

    Returns:
        A dataset at the excited frequencies [Hz], in SI units. Over "frequency", "output" and "input"
        (numbers from 1): `response`, complex; `deviation`, its standard deviation by noise and nonlinear
        distortion, from the realisations in excess of the number of inputs (without any in excess: by noise
        alone); and `noise_deviation`, the standard deviation by noise alone, from the periods. Each deviation
        is sqrt(E|error|^2), in the unit of the response, and NaN without the repetitions that it needs. Over
        "frequency" and "output": `coherence`, the share of the power that is explained, 0 to 1; NaN if both
        deviations are NaN. The coordinate `drive_rms` is the amplitude of the drive, over all inputs, for
        `identify_levels`.

    Raises:
        ResponseError: the shapes do not fit, values are not finite, or the inputs cannot be distinguished
            (fewer realisations than inputs, or dependent ones).
        QuantityError: `sample_rate` or `band` is not a frequency, or one of `units` is not known.
    """
    sample_rate, lowest, highest = _hertz(sample_rate, band)
    (u, y), units = _in_si(drive, response, units)
    if (u.shape[0], *u.shape[2:]) != (y.shape[0], *y.shape[2:]):
        raise ResponseError(
            f"drive {u.shape} and response {y.shape} differ in samples, realisations or periods"
        )
    n_inputs, n_realisations, n_periods = u.shape[1:]
    if n_realisations < n_inputs:
        raise ResponseError(f"{n_inputs} inputs need as many realisations; there are {n_realisations}")
    frequency = np.fft.rfftfreq(u.shape[0], 1 / sample_rate)
    # Complex Fourier amplitudes: U of the drive's mean over the periods, shape (frequencies, inputs,
    # realisations); Y of the response in each period, with the periods as last axis.
    U = np.fft.rfft(u.mean(axis=3), axis=0) * 2 / u.shape[0]
    Y = np.fft.rfft(y, axis=0) * 2 / u.shape[0]
    power = np.sqrt(np.mean(np.abs(U) ** 2, axis=(1, 2)))
    power[0] = 0.0
    lines = (power > EXCITED * power.max()) & (frequency >= lowest) & (frequency <= highest)
    U, Y = U[lines], Y[lines]
    if np.linalg.cond(U).max() > 1e3:
        raise ResponseError("the realisations do not distinguish the inputs: drive them independently")

    gram = np.linalg.inv(U @ _adjoint(U))
    mean = Y.mean(axis=3)
    G = mean @ _adjoint(U) @ gram
    factor = np.real(np.diagonal(gram, axis1=1, axis2=2))[:, None, :]
    unexplained = np.sum(np.abs(mean - G @ U) ** 2, axis=2)
    total = _variance(unexplained, n_realisations - n_inputs, smoothing)
    scatter = np.sum(np.abs(Y - mean[..., None]) ** 2, axis=(2, 3))
    noise = _variance(scatter, n_realisations * (n_periods - 1), smoothing) / n_periods
    worst = np.where(np.isnan(total), noise, total)
    coherence = np.clip(1 - worst / np.mean(np.abs(mean) ** 2, axis=2), 0, 1)
    return _labelled(
        frequency[lines],
        G,
        np.sqrt(worst[:, :, None] * factor),
        np.sqrt(noise[:, :, None] * factor),
        coherence,
        units,
        drive_rms(u),
    )


@single_threaded
def welch_frequency_response(
    drive: ArrayLike,
    response: ArrayLike,
    sample_rate: float | str,
    *,
    segment: int,
    band: tuple[float | str, float | str] = (0.0, np.inf),
    units: tuple[str, str] = ("V", "m"),
) -> xr.Dataset:
    """Return the response to a persistent drive that does not repeat (noise, sweeps), by Welch's method with
    Hann's window.

    Leakage biases the response by the relative error 20 (T/L)^2, about, with a mode's decay time T and the
    length L of a segment, however long the record. Neighbouring frequencies share their window, so their
    errors are correlated: identify with `correlated=True`. Use `frequency_response`, which has neither fault,
    for a drive that repeats (also a chirp).

    Args:
        drive: in the first of `units`, shape (samples,) or (samples, inputs).
        response: in the second of `units`, shape (samples,) or (samples, outputs).
        sample_rate: Hz.
        segment: number of samples in a segment; segments overlap by half.
        band: lowest and highest frequency to keep, Hz.
        units: units of drive and response, such as ("V", "um").

    Returns:
        A dataset as by `frequency_response`, at all frequencies of the band except 0. Noise and distortion
        cannot be distinguished here, so `noise_deviation` is NaN.

    Raises:
        ResponseError: the shapes do not fit, values are not finite, or the record is too short: it must have
            more than two segments for each input.
        QuantityError: `sample_rate` or `band` is not a frequency, or one of `units` is not known.
    """
    sample_rate, lowest, highest = _hertz(sample_rate, band)
    both, units = _in_si(drive, response, units)
    u, y = (array[:, :, 0, 0].T for array in both)
    averages = 2 * u.shape[1] // segment - 1
    if u.shape[1] != y.shape[1]:
        raise ResponseError(f"drive and response differ in length: {u.shape[1]} and {y.shape[1]}")
    if averages <= 2 * len(u):
        raise ResponseError(f"{u.shape[1]} samples are too few for segments of {segment}")

    def spectra(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return cross spectra a b* between the channels of a and b, shape (frequencies, channels of a,
        channels of b). The arguments are exchanged because SciPy conjugates its first one."""
        _, s = scipy.signal.csd(b[None, :], a[:, None], sample_rate, nperseg=segment)
        return np.moveaxis(s, -1, 0)

    frequency = np.fft.rfftfreq(segment, 1 / sample_rate)
    lines = (frequency > 0) & (frequency >= lowest) & (frequency <= highest)
    uu, yu, yy = spectra(u, u)[lines], spectra(y, u)[lines], spectra(y, y)[lines]
    inverse = np.linalg.inv(uu)
    G = yu @ inverse
    measured = np.real(np.diagonal(yy, axis1=1, axis2=2))
    explained = np.real(np.diagonal(G @ _adjoint(yu), axis1=1, axis2=2))
    # Hann segments that overlap by half contain as much information as 18/19 of their number of independent
    # segments [welch1967].
    freedom = averages * 18 / 19 - len(u)
    rest = np.maximum(measured - explained, 0) * averages / freedom
    factor = np.real(np.diagonal(inverse, axis1=1, axis2=2))[:, None, :] / averages * 19 / 18
    nothing = np.full(G.shape, np.nan)
    coherence = np.clip(explained / measured, 0, 1)
    return _labelled(
        frequency[lines], G, np.sqrt(rest[:, :, None] * factor), nothing, coherence, units, drive_rms(u.T)
    )


def drive_rms(drive: ArrayLike) -> float:
    """Return the rms amplitude of a drive of shape (samples, ...), in its unit, over all samples, inputs and
    realisations, each about its mean."""
    values = np.asarray(drive, dtype=float)
    return float(np.sqrt(np.mean((values - values.mean(axis=0)) ** 2)))


def _hertz(sample_rate: float | str, band: tuple[float | str, float | str]) -> tuple[float, float, float]:
    """Return sample rate, lowest and highest frequency of the band, in Hz."""
    lowest, highest = band
    return to_si(sample_rate, "Hz", "sample_rate"), to_si(lowest, "Hz", "band"), to_si(highest, "Hz", "band")


def _in_si(
    drive: ArrayLike, response: ArrayLike, units: tuple[str, str]
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[str, str]]:
    """Return drive and response in SI, with four axes each, and their SI units. The offset of a temperature
    is left out, because a frequency response shows changes alone."""
    u, y = (to_si_unit(unit) for unit in units)
    arrays = _four_axes(drive, "drive") * u.factor, _four_axes(response, "response") * y.factor
    return arrays, (u.unit, y.unit)


def _four_axes(data: ArrayLike, name: str) -> np.ndarray:
    array = np.asarray(data, dtype=float)
    if not 1 <= array.ndim <= 4:
        raise ResponseError(f"{name} has {array.ndim} axes: (samples, channels, realisations, periods)")
    if not np.all(np.isfinite(array)):
        raise ResponseError(f"{name} holds values that are not finite")
    return array.reshape(array.shape + (1,) * (4 - array.ndim))


def _adjoint(matrices: np.ndarray) -> np.ndarray:
    return np.conj(np.swapaxes(matrices, -1, -2))


def _variance(squares: np.ndarray, freedom: int, smoothing: int) -> np.ndarray:
    if freedom < 1:
        return np.full(squares.shape, np.nan)
    return scipy.ndimage.uniform_filter1d(squares / freedom, smoothing, axis=0, mode="nearest")


def _labelled(frequency, response, deviation, noise_deviation, coherence, units, rms) -> xr.Dataset:
    full, unit = ("frequency", "output", "input"), ratio_of(units)
    return xr.Dataset(
        {
            "response": (full, response, {"units": unit, "long_name": "frequency response"}),
            "deviation": (full, deviation, {"units": unit, "long_name": "standard deviation"}),
            "noise_deviation": (
                full,
                noise_deviation,
                {"units": unit, "long_name": "standard deviation by noise"},
            ),
            "coherence": (full[:2], coherence, {"units": "1", "long_name": "coherence"}),
        },
        coords={
            "frequency": ("frequency", frequency, {"units": "Hz", "long_name": "frequency"}),
            "output": np.arange(1, response.shape[1] + 1),
            "input": np.arange(1, response.shape[2] + 1),
            "drive_rms": ((), rms, {"units": units[0], "long_name": "rms drive"}),
        },
    )
