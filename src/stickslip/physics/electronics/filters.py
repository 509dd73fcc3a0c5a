"""Low-pass filters: the IIR filter of a signal processor, the anti-alias filter, or a sensor's bandwidth.

All filters start in the steady state of the first sample.
"""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, to_si, with_prefix

Family = Literal["butterworth", "bessel", "chebyshev", "elliptic"]
_DESIGN = {"butterworth": "butter", "chebyshev": "cheby1", "elliptic": "ellip"}


@record
class Filter(NamedTuple):
    """A low-pass filter by its family, order and corner frequency [Hz].

    The gain at the corner is -3 dB for the Butterworth and Bessel families; for the Chebyshev and elliptic
    families the corner is the end of the pass band. `ripple` [dB] in the pass band applies to the last two
    families, `attenuation` [dB] of the stop band to the elliptic one. A wrong value raises QuantityError.
    """

    order: Annotated[float, Quantity("", "n", "order", minimum=1, maximum=12)]
    corner: Annotated[float, Quantity("Hz", "f_c", "corner frequency", above=0)]
    family: Family = "butterworth"
    ripple: Annotated[float, Quantity("", "", "ripple in dB", above=0, maximum=20)] = 0.5
    attenuation: Annotated[float, Quantity("", "", "attenuation in dB", above=0, maximum=200)] = 60.0

    def _check(self) -> None:
        if self.order % 1:
            raise QuantityError(f"Filter.order = {self.order:g} is out of range: it must be a whole number")
        if self.family not in get_args(Family):
            known = ", ".join(get_args(Family))
            raise QuantityError(f"Filter.family = {self.family!r} is unknown; known are {known}")
        if self.family == "elliptic" and self.attenuation <= self.ripple:
            raise QuantityError(
                f"Filter.attenuation = {self.attenuation:g} dB must be > ripple = {self.ripple:g} dB"
            )


def sections(filter: Filter, sample_rate: float) -> NDArray[np.float64]:
    """Return the second-order sections of the digital filter for a sample rate [Hz], an array [sections, 6]
    as for ``scipy.signal.sosfilt``.

    Raises:
        QuantityError: the corner is not below half the sample rate.
    """
    if not filter.corner < 0.5 * sample_rate:
        corner, rate = with_prefix(filter.corner, "Hz"), with_prefix(sample_rate, "Hz")
        raise QuantityError(f"Filter.corner = {corner} must be below half the sample rate, {rate}")
    order = int(filter.order)
    # SciPy's general function `iirfilter` normalises a Bessel filter by its phase, and not by its gain at the
    # corner.
    if filter.family == "bessel":
        made = scipy.signal.bessel(order, filter.corner, norm="mag", output="sos", fs=sample_rate)
    else:
        made = scipy.signal.iirfilter(
            order,
            filter.corner,
            filter.ripple,
            filter.attenuation,
            "lowpass",
            ftype=_DESIGN[filter.family],
            output="sos",
            fs=sample_rate,
        )
    return np.asarray(made)


def filtered(filter: Filter, signal: NDArray[np.float64], sample_rate: float | str) -> NDArray[np.float64]:
    """Return the signal [n] after the filter, which starts in the steady state of the first sample.

    Raises:
        QuantityError: the corner frequency is not below half the sample rate.
    """
    made = sections(filter, to_si(sample_rate, "Hz", "sample_rate"))
    return scipy.signal.sosfilt(made, signal, zi=scipy.signal.sosfilt_zi(made) * signal[0])[0]


def first_order(signal: NDArray[np.float64], sample_rate: float, bandwidth: float) -> NDArray[np.float64]:
    """Return the signal [n] after a first-order low-pass with a bandwidth [Hz]; unchanged if the bandwidth is
    at least half the sample rate [Hz]."""
    if bandwidth >= 0.5 * sample_rate:
        return signal
    return filtered(Filter(1, bandwidth), signal, sample_rate)
