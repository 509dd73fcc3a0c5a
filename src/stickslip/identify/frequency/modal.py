r"""Modal models: second-order modes that share their poles over all channels, and a delay.

.. math:: G(s) = e^{-s\tau}\Big[D + \sum_m \Big(A_m + B_m \frac{s}{\omega_m}\Big)
          \frac{\omega_m^2}{s^2 + 2\zeta_m\omega_m s + \omega_m^2}\Big]

One mode with B = D = 0 is the stage of [kang2007, eq. 3.18]. Mode m has the natural frequency ω_m and the
damping ratio ζ_m; τ is the delay. A_m is a mode's static gain; B_m, its rate gain, is zero if the damping is
proportional (real mode shapes); D represents the modes above the band. Every matrix is (outputs, inputs).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy
import xarray as xr

from ...estimate.blas import single_threaded
from ...estimate.fit import fit_least_squares
from ...estimate.lack import Lack
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...estimate.separable import Design, SeparableRecording, separable
from ...physics.state_space import StateSpace
from ...quantities.progress import Progress, unheard
from ...quantities.units import to_si
from ..free import with_ties
from .above_noise import FALSE_ALARM, Left, chances, left_by_delay, said_of_noise
from .response import ratio_of, units_of

# Damping ratios that are tried as initial values of each mode, if only the number of modes is given.
TRIAL_DAMPING = (0.005, 0.01, 0.02, 0.05, 0.2)
LINES_IN_SEARCH = 1000  # number of frequencies to which a response is thinned for initial guesses
# Initial delays: shares of the phase of all modes (half a turn each) that the mean slope of the phase may
# contain besides the delay.
TURNED = (0.3, 0.6, 0.9)
# Largest residual, relative to the deviations, that passes as distortion and weak modes outside the model; a
# larger one is a failure of the fit.
MOST_LEFT = 10.0
LONGEST = 10.0  # largest delay of the first search, in periods of the highest frequency
LEAST_DAMPING, MOST_DAMPING = 1e-4, 3.0  # range of damping ratios that is searched first
ANY, POSITIVE = (-math.inf, math.inf), (0.0, math.inf)
UNPREDICTED = "it is of responses to a drive; predict_response(fit.model, recording) gives its response"


class ModalModel(NamedTuple):
    """Modal model: poles, delay and gains; see the module for the equation.

    Attributes:
        natural_frequency: shape (modes,), rad/s.
        damping_ratio: shape (modes,).
        delay: s.
        gain: static gains A, shape (modes, outputs, inputs), in `unit`.
        rate_gain: rate gains B (0 for real mode shapes), same shape and unit.
        remainder: gain D of the modes above the band, shape (outputs, inputs), same unit.
        units: SI units of drive and response.
    """

    natural_frequency: np.ndarray
    damping_ratio: np.ndarray
    delay: float
    gain: np.ndarray
    rate_gain: np.ndarray
    remainder: np.ndarray
    units: tuple[str, str] = ("V", "m")

    @property
    def unit(self) -> str:
        """Return the unit of the gains, response per drive, such as "m/V"."""
        return ratio_of(self.units)

    def state_space(self) -> StateSpace:
        """Return the model as a linear state-space system with the delay; the states are coordinate and
        velocity of each mode and input."""
        outputs, inputs = self.remainder.shape
        each, omega = np.eye(inputs), self.natural_frequency
        blocks = [
            np.kron(each, [[0.0, 1.0], [-(w**2), -2.0 * zeta * w]])
            for w, zeta in zip(omega, self.damping_ratio, strict=True)
        ]
        b = np.asarray(np.tile(np.kron(each, [[0.0], [1.0]]), (omega.size, 1)), dtype=float)
        c = [
            np.stack([gain * w**2, rate * w], axis=2).reshape(outputs, 2 * inputs)
            for w, gain, rate in zip(omega, self.gain, self.rate_gain, strict=True)
        ]
        a = np.asarray(scipy.linalg.block_diag(*blocks), dtype=float)
        return StateSpace(a, b, np.hstack(c), self.remainder, self.delay)


def modal_response(model: ModalModel, frequency: np.ndarray) -> np.ndarray:
    """Return the complex frequency response at frequencies [Hz], shape (frequencies, outputs, inputs)."""
    s = 2j * np.pi * np.asarray(frequency)
    modes, rates = _modes(s, model.natural_frequency, model.damping_ratio)
    summed = np.tensordot(modes, model.gain, 1) + np.tensordot(rates, model.rate_gain, 1) + model.remainder
    return summed * np.exp(-s * model.delay)[:, None, None]


def steady_response(model: ModalModel, drive: np.ndarray, sample_rate: float) -> np.ndarray:
    """Return the steady response to a periodic drive, in its unit, shape (samples, outputs, ...).

    The computation in the frequency domain is exact for a drive without power above half the sample rate.

    Args:
        model: modes, gains and delay.
        drive: one period, in the drive's unit, shape (samples, inputs, ...).
        sample_rate: Hz.
    """
    G = modal_response(model, np.fft.rfftfreq(len(drive), 1 / sample_rate))
    return np.fft.irfft(np.einsum("foi,fi...->fo...", G, np.fft.rfft(drive, axis=0)), len(drive), axis=0)


@single_threaded
def identify_frequency(
    response: xr.Dataset,
    modes: int | Sequence[tuple[float | str, float]] | ModalModel = 1,
    *,
    complex_modes: bool = True,
    remainder: bool = True,
    noise_known: bool = False,
    correlated: bool = False,
    tied: Mapping[str, str] | None = None,
    progress: Progress = unheard,
) -> Fit:
    """Fit a modal model to measured frequency responses; all channels share poles and delay.

    Args:
        response: result of `frequency_response`, or a selection of its outputs, inputs or frequencies. Each
            frequency is weighted by its `deviation`; without deviations, all weights are equal. Equal weights
            suit a model with too few modes: it then follows the largest motion instead of the most precise
            data.
        modes: number of modes; or initial natural frequency [Hz] and damping ratio of each; or a model with
            initial poles and delay. Given a number, the modes are found one after the other, each at the
            frequency where it explains most of the residual, at the best of several delays.
        complex_modes: fit rate gains (B) as well.
        remainder: fit the remainder (D).
        noise_known: take the deviations in `response` as they are; by default the misfit sets their level.
        correlated: allow for errors correlated between neighbouring frequencies: those of a model with too
            few modes, and those of `welch_frequency_response`.
        tied: poles and delay that follow from others, as for `identify_friction`; modes are numbered by
            frequency: ``{"damping_ratio_2": "damping_ratio_1"}``.
        progress: called during the work with a text and the fraction done.

    Returns:
        A `Fit` with natural_frequency_1 [rad/s], damping_ratio_1, ..., delay [s], gain_1, rate_gain_1, ...,
        remainder; with several channels gain_1[o,i] for output o and input i. Its `model` is a `ModalModel`.
        Its `failures` name residuals above ten times given deviations, unless `noise_known` (a wrong minimum,
        or missing modes), and modes that may be noise.

    Raises:
        QuantityError: an expression in `tied` is wrong, or an initial value in `modes` is no frequency.
        FitError: deviations that are not above 0 or, with `noise_known`, missing; too few frequencies for
            this number of modes; or no mode above the noise.
    """
    given = starts_of(modes)
    missing = [d for d in ("output", "input") if d not in response["response"].dims]
    response = response.expand_dims(missing).transpose("frequency", "output", "input")
    response, remarks = _with_deviation(response, noise_known)
    if not np.all(response["deviation"] > 0):
        raise FitError("the responses have no deviations: they need more realisations or periods")
    kind = ModalForm(complex_modes, remainder)
    starts, delay = _found(response, given, kind) if isinstance(given, int) else given
    options: dict[str, Any] = {"noise_known": noise_known, "correlated": correlated, "progress": progress}
    options["tied"] = tied
    fit = _fit(response, sorted(starts), delay, kind, **options)
    frequencies, dampings, delay = fit.model[:3]
    if np.any(np.diff(frequencies) < 0):  # the order of the modes has changed: number them again
        starts = sorted(zip(frequencies / (2 * np.pi), dampings, strict=True))
        fit = _fit(response, starts, delay, kind, **options)
    left = Lack("the responses", math.sqrt(fit.reduced_chi_squared), 0.0, "their deviations")
    # If the noise is known, each response is compared with its own deviations.
    doubts = [left.sentence] if left.ratio > MOST_LEFT and not noise_known and not remarks else []
    return replace(fit, doubts=(*doubts, *_unseen(fit, response, kind)), remarks=(*fit.remarks, *remarks))


def _with_deviation(response: xr.Dataset, noise_known: bool) -> tuple[xr.Dataset, tuple[str, ...]]:
    """Return the response with a `deviation` (if it had none, equal at all frequencies for equal weights),
    and a tuple with one sentence if it had none. Raises FitError if the noise is said to be known then."""
    if "deviation" in response:
        return response, ()
    if noise_known:
        raise FitError("noise_known = True, but the response has no `deviation`: add it, or leave that out")
    equal = xr.full_like(response["response"], float(np.abs(response["response"]).max()), dtype=float)
    said = "the response has no `deviation`: all its lines count alike, and what is left says their noise"
    return response.assign(deviation=equal), (said,)


def _unseen(fit: Fit, response: xr.Dataset, kind: ModalForm) -> tuple[str, ...]:
    """Return a tuple with one sentence on the modes of a fit that may be noise; empty without such modes.

    Raises:
        FitError: all of them may be noise.
    """
    model: ModalModel = fit.model
    frequency, n = response["frequency"].to_numpy(), len(model.natural_frequency)
    each = 2 if kind.complex_modes else 1
    empty = left_by_delay(fit, frequency, LONGEST / float(frequency[-1]), kind.remainder)
    trials = math.exp(min(n * math.log(frequency.size), 700.0))
    chance = Left.of(fit).chance(empty, n * (each * len(fit.residuals) + 2), trials)
    if chance > FALSE_ALARM:
        raise FitError(
            f"no mode above the noise: the chance of noise to show as much is {chance:.2g}. Check that drive "
            "and response belong together, drive more, or record longer"
        )
    poles = np.append(np.stack(model[:2], axis=1).ravel(), model.delay)
    columns = [[m + n * i for i in range(each)] for m in range(n)]
    matrix = modal_design(frequency, poles, kind).matrix
    found = chances(fit, [matrix] * len(fit.residuals), columns, frequency.size)
    unseen = [m for m, chance in enumerate(found) if chance > FALSE_ALARM]
    return (said_of_noise([m + 1 for m in unseen], [found[m] for m in unseen]),) if unseen else ()


def starts_of(
    modes: int | Sequence[tuple[float | str, float]] | ModalModel,
) -> int | tuple[list[tuple[float, float]], float]:
    """Return the number of modes; or pairs of natural frequency [Hz] and damping ratio, and the delay [s].

    Raises:
        QuantityError: a value is not a frequency.
    """
    if isinstance(modes, ModalModel):
        poles = zip(modes.natural_frequency / (2 * np.pi), modes.damping_ratio, strict=True)
        return [(float(frequency), float(damping)) for frequency, damping in poles], modes.delay
    if isinstance(modes, int):
        return modes
    return [(to_si(frequency, "Hz", "modes"), damping) for frequency, damping in modes], 0.0


def _found(response: xr.Dataset, n_modes: int, kind: ModalForm) -> tuple[list[tuple[float, float]], float]:
    """Return initial values: natural frequency [Hz] and damping ratio of each mode, and the delay [s].

    Each mode explains most of the residual of the previous ones. All frequencies have equal weights here;
    weighted by deviations, quiet bands would come before large motion.
    """
    response = response.assign(deviation=xr.ones_like(response["deviation"]))
    longest = LONGEST / float(response["frequency"][-1])
    every = max(1, response.sizes["frequency"] // LINES_IN_SEARCH)
    response = response.isel(frequency=slice(None, None, every))
    frequency = response["frequency"].to_numpy()
    measured = response["response"].to_numpy()
    trial = np.array([(f, zeta) for zeta in TRIAL_DAMPING for f in frequency[::2]])
    shapes, _ = _modes(2j * np.pi * frequency, 2 * np.pi * trial[:, 0], trial[:, 1])
    shapes = (shapes / np.linalg.norm(shapes, axis=0)).conj().T
    starts: list[tuple[float, float]] = []
    delay, left, delays = 0.0, measured, _delays(frequency, measured, n_modes)
    for _ in range(n_modes):
        undelayed = left.reshape(frequency.size, -1) * np.exp(2j * np.pi * frequency * delay)[:, None]
        explained = np.sum(np.abs(shapes @ undelayed) ** 2, axis=1)
        starts.append(tuple(trial[np.argmax(explained)]))
        tried = [_fit(response, starts, one, kind, tolerance=1e-4) for one in (delay, *delays)]
        model = min(tried, key=lambda fit: fit.cost).model
        starts = list(zip(model.natural_frequency / (2 * np.pi), model.damping_ratio, strict=True))
        delay, left = model.delay, measured - modal_response(model, frequency)
    return starts, float(np.clip(delay, -longest, longest))  # thinned responses allow longer delays


def _delays(frequency: np.ndarray, measured: np.ndarray, n_modes: int) -> list[float]:
    """Return initial guesses of the delay [s] from complex responses at evenly spaced frequencies [Hz].

    A delay that is wrong by half a period of a mode leads to a wrong sign of its gain. The mean slope of the
    phase is the sum of the delay and the phase of the modes.
    """
    turned = measured[1:] * measured[:-1].conj()
    mean = np.sum(turned / (np.abs(turned) + 1e-300))
    slope = -np.angle(mean) / (2 * np.pi * float(np.median(np.diff(frequency))))
    by_modes, longest = 0.5 * n_modes / (frequency[-1] - frequency[0]), LONGEST / frequency[-1]
    return [float(np.clip(slope - share * by_modes, -longest, longest)) for share in TURNED]


class ModalForm(NamedTuple):
    """Kinds of coefficients that a modal model has besides the gains: `complex_modes`, True for rate gains;
    `remainder`, True for the remainder."""

    complex_modes: bool
    remainder: bool

    def names(self, n_modes: int) -> list[str]:
        """Return the names of a channel's coefficients in the order of the design matrix's columns: gain_1,
        gain_2, ..., rate_gain_1, ..., remainder."""
        kinds = ["gain", "rate_gain"] if self.complex_modes else ["gain"]
        names = [f"{kind}_{m}" for kind in kinds for m in range(1, n_modes + 1)]
        return [*names, "remainder"] if self.remainder else names


def _fit(
    response: xr.Dataset, starts: Sequence[tuple[float, float]], delay: float, kind: ModalForm, **options: Any
) -> Fit:
    frequency = response["frequency"].to_numpy()
    outputs, inputs = response["output"].to_numpy(), response["input"].to_numpy()
    single = outputs.size * inputs.size == 1
    unit = response["response"].attrs["units"]
    ends = (np.pi * frequency[0], 4 * np.pi * frequency[-1])
    parameters = pole_parameters([(2 * np.pi * f, zeta) for f, zeta in starts], ends)
    parameters.append(delay_parameter(LONGEST / frequency[-1]).starting_at(delay))
    names = [p.name for p in parameters]
    recordings = []
    for o, i in product(range(outputs.size), range(inputs.size)):
        channel = "" if single else f"[{outputs[o]},{inputs[i]}]"
        recordings.append(
            SeparableRecording(
                real_over_imaginary(response["response"].to_numpy()[:, o, i]),
                np.tile(response["deviation"].to_numpy()[:, o, i] / math.sqrt(2), 2),
                tuple((name + channel, unit) for name in kind.names(len(starts))),
                f"response{channel}",
                unit,
            )
        )

    def designs(values: Values) -> list[Design]:
        return [modal_design(frequency, np.array([values[name] for name in names]), kind)] * len(recordings)

    about = {name: options.pop(name) for name in ("noise_known", "correlated") if name in options}
    problem = separable(recordings, designs, with_ties(parameters, options.pop("tied", None)), **about)
    fit = fit_least_squares(problem, **options)
    found = np.array([fit.values[name] for name in names])
    rest = np.array([fit.values[p.name] for p in fit.parameters if p.name not in names])
    gains = np.moveaxis(rest.reshape(outputs.size, inputs.size, -1), -1, 0)
    model = modal_model(found, gains, kind, units_of(response))
    return replace(fit, model=model, unpredicted=UNPREDICTED)


def delay_parameter(longest: float) -> Parameter:
    """Return the delay as a parameter, first searched from -`longest` to `longest` [s], and then without
    limit."""
    return Parameter("delay", 0.0, -longest, longest, "s", log=False, limits=ANY)


def pole_parameters(starts: Sequence[tuple[float, float]], ends: tuple[float, float]) -> list[Parameter]:
    """Return parameters natural_frequency_1 [rad/s], damping_ratio_1, natural_frequency_2, ... with these
    initial values; frequencies are first searched within `ends` [rad/s]."""
    parameters = []
    for m, (omega, zeta) in enumerate(starts, 1):
        frequency = Parameter(f"natural_frequency_{m}", ends[0], *ends, "rad/s", limits=POSITIVE)
        damping = Parameter(f"damping_ratio_{m}", MOST_DAMPING, LEAST_DAMPING, MOST_DAMPING, limits=POSITIVE)
        parameters += [frequency.starting_at(omega), damping.starting_at(zeta)]
    return parameters


def modal_model(
    poles: np.ndarray, coefficients: np.ndarray, kind: ModalForm, units: tuple[str, str]
) -> ModalModel:
    """Return the model of poles (natural frequency [rad/s] and damping ratio of each mode, then the delay
    [s]) and coefficients, in the order of `kind.names`, shape (names, outputs, inputs). Others are 0.
    `units` are those of drive and response."""
    n_modes = len(poles) // 2
    zero = np.zeros((n_modes, *coefficients.shape[1:]))
    return ModalModel(
        poles[0:-1:2],
        poles[1:-1:2],
        float(poles[-1]),
        coefficients[:n_modes],
        coefficients[n_modes : 2 * n_modes] if kind.complex_modes else zero,
        coefficients[-1] if kind.remainder else zero.sum(axis=0),
        units,
    )


def _modes(s: np.ndarray, omega: np.ndarray, zeta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each mode's response with unit gain, and with unit rate gain, without delay: two complex arrays
    of shape (frequencies, modes), at s = i omega [rad/s]."""
    s = s[:, None]
    mode = omega**2 / (s**2 + 2 * zeta * omega * s + omega**2)
    return mode, mode * s / omega


def real_over_imaginary(values: np.ndarray) -> np.ndarray:
    """Return complex values, shape (n, ...), as real ones, (2 n, ...): real parts, then imaginary parts."""
    return np.concatenate([np.real(values), np.imag(values)])


def modal_design(frequency: np.ndarray, values: np.ndarray, kind: ModalForm) -> Design:
    """Return the design matrix of a modal model, and its derivatives by poles and delay: responses of the
    modes at frequencies [Hz], real parts, then imaginary parts. `values` are natural frequency [rad/s] and
    damping ratio of each mode, then the delay [s]; `kind` says which coefficients there are."""
    omega, zeta, delay = values[0:-1:2], values[1:-1:2], values[-1]
    s = 2j * np.pi * frequency
    phase = np.exp(-s * delay)[:, None]
    mode, rate = _modes(s, omega, zeta)
    columns = [mode, rate] if kind.complex_modes else [mode]
    basis = phase * np.concatenate([*columns, np.ones((s.size, int(kind.remainder)))], axis=1)
    s = s[:, None]
    by_omega = phase * (2 * mode / omega - mode**2 * (2 * omega + 2 * zeta * s) / omega**2)
    by_zeta = phase * (-2 * mode * rate)
    rate_by_omega = by_omega * s / omega - phase * rate / omega

    def tangent(x: np.ndarray) -> np.ndarray:
        a = x[: omega.size]
        b = x[omega.size : 2 * omega.size] if kind.complex_modes else np.zeros(omega.size)
        slopes = np.empty((frequency.size, values.size), dtype=complex)
        slopes[:, 0:-1:2] = a * by_omega + b * rate_by_omega
        slopes[:, 1:-1:2] = by_zeta * (a + b * s / omega)
        slopes[:, -1] = -s[:, 0] * (basis @ x)
        return real_over_imaginary(slopes)

    return Design(real_over_imaginary(basis), tangent)
