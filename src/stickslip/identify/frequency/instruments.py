"""Corrections for amplifier and sensor in a measured frequency response.

The drive_voltage of a recording is often the command to the amplifier: held from sample to sample, before the
amplifier's bandwidth and current limit. A response to the command contains these, and the limit makes it
depend on the drive. So a known amplifier is applied to the drive before the response is estimated, and a
known linear filter of the sensor is divided out afterwards.
"""

from __future__ import annotations

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...physics.electronics import Amplifier, Filter, amplifier_output
from ...physics.electronics.filters import sections
from ...quantities.units import to_si

# Computed output of the amplifier: points per sample of the command, and error tolerance [V].
_FINER, _TOLERANCE = 16, 1e-4
# Low-pass filter that band-limits this output before it is sampled: half its length in samples of the
# command, and corner relative to half the sample rate. Frequencies up to 0.8 of half the sample rate pass
# unchanged.
_SPAN, _EDGE = 32, 0.9


def applied_voltage(
    command: ArrayLike, sample_rate: float | str, amplifier: Amplifier, capacitance: float | str
) -> NDArray[np.float64]:
    """Return the output voltage of an amplifier for a command, band-limited to half the sample rate.

    Bandwidth, slew rate, current limit and range are those of `amplifier`; its gain and offset are not used,
    because the command is in volts at the piezo. Each command value must hold for at least one whole sample.

    Args:
        command: command to the amplifier, in volts at the piezo, shape (n,); constant before its first
            sample.
        sample_rate: Hz.
        amplifier: properties of the amplifier.
        capacitance: capacitance of the piezo, F.

    Returns:
        Voltage in V, shape (n,), without frequencies above half the sample rate; accurate below 0.4 times the
        sample rate.

    Raises:
        QuantityError: the capacitance or the rate is out of range.
    """
    sample_rate = to_si(sample_rate, "Hz", "sample_rate")
    capacitance = to_si(capacitance, "F", "capacitance")
    volts = np.asarray(command, dtype=float)
    own = amplifier._replace(gain=1.0, offset=0.0)
    times, output = amplifier_output(own, volts, sample_rate, capacitance, tolerance=_TOLERANCE)
    fine = np.arange(-_SPAN * _FINER, (volts.size + _SPAN) * _FINER) / (_FINER * sample_rate)
    taps = scipy.signal.firwin(2 * _SPAN * _FINER + 1, _EDGE / _FINER, window="blackman")
    seen = scipy.signal.fftconvolve(np.interp(fine, times, output), taps, "valid")
    return seen[: volts.size * _FINER : _FINER]


def without_filter(response: xr.Dataset, filter: Filter, sample_rate: float | str) -> xr.Dataset:
    """Divide a frequency response by a known linear filter of the sensor; return the corrected response.

    Its `deviation` and `noise_deviation` are divided by the magnitude of the filter; `coherence` stays.

    Args:
        response: result of `frequency_response`.
        filter: filter that the sensor's signal went through; a sensor's bandwidth is a filter of order 1.
        sample_rate: rate at which the filter runs, Hz; for an analogue filter, some ten times its corner
            frequency.

    Raises:
        QuantityError: the corner frequency is not below half the sample rate.
    """
    sample_rate = to_si(sample_rate, "Hz", "sample_rate")
    frequency = response["frequency"]
    passed = scipy.signal.sosfreqz(sections(filter, sample_rate), frequency.to_numpy(), fs=sample_rate)[1]
    by = xr.DataArray(passed, {"frequency": frequency})
    changed = {
        name: (response[name] / (by if name == "response" else abs(by))).assign_attrs(response[name].attrs)
        for name in ("response", "deviation", "noise_deviation")
    }
    return response.assign(changed)
