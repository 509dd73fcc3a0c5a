"""Instruments between a program and the mechanism whose frequency response is measured.

The drive_voltage of a recording is often what was asked of the amplifier: held from sample to sample, before
its bandwidth and its current limit. A response to it holds all of these, and the limit makes it depend on the
drive. Known instruments are therefore taken into account before the response is estimated (the drive) or
divided out of it (linear filters behind the sensor).
"""

from __future__ import annotations

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...physics.electronics import Amplifier, Filter, amplifier_output
from ...physics.electronics.filters import sections
from ...quantities.units import to_si

# Oversampling and accuracy [V] of the computed output, which is then passed through a low-pass
# that leaves everything up to 0.8 of half the sample rate as it is.
_FINER, _TOLERANCE = 16, 1e-4
_SPAN, _EDGE = 32, 0.9


def applied_voltage(
    command: ArrayLike, sample_rate: float | str, amplifier: Amplifier, capacitance: float | str
) -> NDArray[np.float64]:
    """Return the output of an amplifier for a command, as an ideal recorder would see it.

    Bandwidth, slew rate, current limit and range are those of `amplifier`; its gain and
    offset are not used, because the command is in volts at the piezo. The command must hold for a whole
    sample each, so the output is set once or less per sample.

    Args:
        command: V, shape (n,); constant before its first sample.
        sample_rate: Hz.
        amplifier: see `Amplifier`.
        capacitance: F, of the piezo.

    Returns:
        V, shape (n,), without what lies above half the sample rate; right below 0.8 of that.

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
    """A frequency response without a known filter behind the sensor; its deviations are divided alike.

    Args:
        response: as `frequency_response` gives it.
        filter: linear; a sensor's bandwidth is one of order 1.
        sample_rate: Hz, at which the filter runs; of an analogue one, some ten times its corner.

    Raises:
        QuantityError: the corner is not below half the sample rate.
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
