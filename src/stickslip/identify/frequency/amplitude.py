r"""One modal model for all amplitudes of the drive: modes that soften, gains that rise.

A piezo's gain and losses grow with its field, and its modes soften, so a modal model is right at one
amplitude alone. Here every parameter follows the rms drive a by one law, the same exponent p for all,

.. math:: \xi(a) = \frac{(a/a_0)^p - 1}{p}, \qquad
          \omega_m = \omega_{m0}\, e^{\omega_m' \xi}, \quad \zeta_m = \zeta_{m0}\, e^{\zeta_m' \xi}, \quad
          A_m = A_{m0} + A_m' \xi

(B and D like A; p = 0 is the logarithm; the delay stays). ω_m, ζ_m and A_m are natural frequency, damping
ratio and static gain of mode m (see `modal`), with an index 0 their values at the reference amplitude a_0,
with a prime their slopes. p = 1 is Rayleigh's law, in which the coefficients are linear in the amplitude
[hall2001]. Slopes are per relative change of the amplitude at a_0, whatever p is.

The model is valid for drives whose spectra have one shape: only then does one number say what the amplitude
is. The response at each amplitude is the best linear approximation [pintelon2012]; predictions do not contain
distortion.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...estimate.problem import FitError
from ...quantities.units import optional_si, to_si
from ...recording import RecordingWarning
from ..recorded.channels import channel, names_of
from .in_time import held_response
from .modal import ModalModel, steady_response
from .response import drive_rms

Array = NDArray[np.float64]

# Relative difference of two drive amplitudes up to which they count as equal, and up to which an amplitude
# outside the fitted range gives no warning.
ALIKE = 0.02


class AmplitudeModel(NamedTuple):
    """A modal model that depends on the amplitude; see the module for the equation.

    Attributes:
        reference: the model at the reference amplitude.
        slope: change per relative change of the amplitude there: relative for natural frequencies and damping
            ratios, in their unit for gain, rate gain and remainder, 0 for the delay.
        exponent: p, the exponent of the amplitude law.
        amplitude: the reference amplitude a_0 of the drive, rms, in the drive's unit.
        lowest, highest: range of the fitted amplitudes, rms, in the drive's unit.
    """

    reference: ModalModel
    slope: ModalModel
    exponent: float
    amplitude: float
    lowest: float
    highest: float

    @property
    def units(self) -> tuple[str, str]:
        """Return the SI units of drive and response."""
        return self.reference.units


def at_amplitude(model: AmplitudeModel, amplitude: float | str) -> ModalModel:
    """Return the modal model at an amplitude of the drive (rms, in the drive's unit).

    Raises:
        QuantityError: the amplitude has another dimension than the drive.
        FitError: the amplitude is not above zero.

    Warns:
        RecordingWarning: the amplitude is outside the range that the model was fitted to.
    """
    unit = model.units[0]
    rms = to_si(amplitude, unit, "amplitude")
    if not 0.0 < rms < np.inf:
        raise FitError(f"amplitude = {rms:g} {unit} must be above 0 {unit}: a model has no modes at rest")
    if not model.lowest * (1 - ALIKE) <= rms <= model.highest * (1 + ALIKE):
        warnings.warn(
            f"{rms:.4g} {unit} rms is outside of the levels that the model was fitted to, {model.lowest:.4g} "
            f"to {model.highest:.4g} {unit} rms: nothing says that its law holds there",
            RecordingWarning,
            stacklevel=2,
        )
    start, slope, x = model.reference, model.slope, float(law(rms / model.amplitude, model.exponent))
    return ModalModel(
        start.natural_frequency * np.exp(slope.natural_frequency * x),
        start.damping_ratio * np.exp(slope.damping_ratio * x),
        start.delay,
        start.gain + slope.gain * x,
        start.rate_gain + slope.rate_gain * x,
        start.remainder + slope.remainder * x,
        start.units,
    )


def predict_response(
    model: ModalModel | AmplitudeModel,
    drive: ArrayLike | xr.Dataset,
    sample_rate: float | str | None = None,
    *,
    amplitude: float | str | None = None,
    periodic: bool = True,
) -> Array:
    """Return the response to a drive; an amplitude-dependent model is used at the drive's own amplitude.

    Args:
        model: `model` of a fit by `identify_levels`, or by `identify_frequency`, which is the same at all
            amplitudes.
        drive: in the unit of the model's drive, shape (samples,), (samples, inputs) or (samples, inputs,
            realisations); or a recording with drive_voltage, of an actuator with one input.
        sample_rate: sample rate of an array, Hz; a recording's own rate is used instead.
        amplitude: rms amplitude of the drive, in its unit, for all realisations; by default the rms of each
            realisation's drive about its mean, over all inputs. Give the amplitude if the drive contains a
            long rest.
        periodic: True: the drive is whole periods of a steady state, without power above half the sample
            rate. False: the motion starts at rest, and the drive is held from sample to sample.

    Returns:
        Response in the unit of the model's response, in the shape of the drive with outputs for inputs. A
        drive of shape (samples,) gives (samples,) for one output, else (samples, outputs).

    Raises:
        QuantityError: the sample rate is not a frequency, or the amplitude has another dimension than the
            drive.
        RecordingError: the drive_voltage of a recording is missing, too short, not finite or in a wrong unit.
        FitError: the drive's shape does not fit, the sample rate of an array is missing, or the amplitude is
            0, as for a constant drive; or a recording is given and the model's drive is not a voltage.

    Warns:
        RecordingWarning: an amplitude is outside the range that the model was fitted to.
    """
    rate, rms = (
        optional_si(sample_rate, "Hz", "sample_rate"),
        optional_si(amplitude, model.units[0], "amplitude"),
    )
    if isinstance(drive, xr.Dataset):
        if model.units[0] != "V":
            raise FitError(f"the model's drive is in {model.units[0]}, not V: give the drive as an array")
        (name,) = names_of([drive])
        time = drive["time"].to_numpy()
        drive, rate = channel(drive, "drive_voltage", name), float((time.size - 1) / (time[-1] - time[0]))
    if rate is None:
        raise FitError("sample_rate is missing: an array does not have its own")
    given = np.asarray(drive, dtype=float)
    reference = model if isinstance(model, ModalModel) else model.reference
    n_outputs, n_inputs = reference.remainder.shape
    values = given.reshape(*given.shape, *(1,) * (3 - given.ndim))
    if values.ndim != 3 or values.shape[1] != n_inputs:
        raise FitError(
            f"the drive has the shape {given.shape}, not (samples, {n_inputs} inputs, realisations)"
        )
    found = np.empty((len(values), n_outputs, values.shape[2]))
    for r in range(values.shape[2]):
        u = values[..., r]
        own = _at(model, drive_rms(u) if rms is None else rms)
        found[..., r] = steady_response(own, u, rate) if periodic else held_response(own, u, rate)
    if given.ndim == 1 and n_outputs == 1:
        return found[:, 0, 0]
    return found if given.ndim == 3 else found[..., 0]


def _at(model: ModalModel | AmplitudeModel, rms: float) -> ModalModel:
    return model if isinstance(model, ModalModel) else at_amplitude(model, rms)


def law(ratio: float | Array, p: float) -> Array:
    """Return the function xi of the amplitude, by which all parameters change: (ratio^p - 1) / p, or the
    logarithm for p = 0. `ratio` is the amplitude divided by the reference amplitude."""
    logarithm = np.log(ratio)
    return logarithm * _mean_power(p * logarithm)


def _mean_power(z: Array) -> Array:
    """Return (e^z - 1)/z; 1 at z = 0."""
    return np.where(np.abs(z) < 1e-12, 1.0, np.expm1(z) / np.where(z == 0.0, 1.0, z))


def law_by_exponent(ratio: Array, p: float) -> Array:
    """Return the derivative of `law` by the exponent p at these amplitude ratios, in their shape."""
    logarithm = np.log(ratio)
    z = p * logarithm
    series = logarithm**2 * (0.5 + z / 3 + z**2 / 8)
    exact = (logarithm * np.exp(z) - law(ratio, p)) / (p or 1.0)
    return np.where(np.abs(z) < 1e-4, series, exact)
