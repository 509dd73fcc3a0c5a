"""Modal models against recordings in time: simulated freely from the drive, and fitted to the response.

Each mode is a state-space system of two states, advanced exactly over a sample in which the drive is held
(zero-order hold, as a DAC does). The hold is half a sample of delay by itself, so the delay here is that much
shorter than with frequency responses, which take the drive to have no power above half the sample rate; close
to that frequency the two assumptions differ more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import scipy

from ...estimate.blas import single_threaded
from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...estimate.separable import Design, SeparableRecording, separable
from ...quantities.progress import Progress, unheard
from ...quantities.units import to_si
from ..free import with_ties
from .above_noise import FALSE_ALARM, chances, said_of_noise
from .modal import UNPREDICTED, ModalModel, pole_parameters


def held_response(
    model: ModalModel, drive: np.ndarray, sample_rate: float, *, periodic: bool = False
) -> np.ndarray:
    """Return the response to a drive that is held between samples, in the unit of the response, shape
    (samples, outputs, ...).

    Args:
        model: modes, gains and a delay. With a negative delay, the response leads the drive, which keeps its
            last value after its last sample.
        drive: in the drive's unit, shape (samples, inputs, ...).
        sample_rate: Hz.
        periodic: True: the drive is one period of a steady state; False: the motion starts at rest.
    """
    u, sample, delay = np.moveaxis(drive, 0, -1), 1 / sample_rate, model.delay
    # The motion that a negative delay moves before the first sample is simulated too, and cut off at the end.
    lead = 0 if periodic else max(math.ceil(-delay / sample), 0)
    if lead:
        u = np.concatenate([u, np.repeat(u[..., -1:], lead, axis=-1)], axis=-1)
        delay += lead * sample
    found = np.einsum("oi,i...->o...", model.remainder, _held_delay(u, delay, sample, periodic))
    for omega, zeta, *gains in zip(*model[:2], model.gain, model.rate_gain, strict=True):
        parts = _held_mode(u, omega, zeta, delay, sample, periodic)
        for gain, part in zip(gains, parts, strict=True):
            found += np.einsum("oi,i...->o...", gain, part)
    return np.moveaxis(found[..., lead:], -1, 0)


def _held_mode(
    drive: np.ndarray, omega: float, zeta: float, delay: float, sample: float, periodic: bool
) -> np.ndarray:
    """Return the responses of one mode to a drive, V, shape (2, ..., samples): with unit gain, and with unit
    rate gain.

    The delay need not be a multiple of the sampling interval: a held drive is known at every instant within
    it.

    Args:
        drive: V, shape (..., samples).
        omega: natural frequency, rad/s.
        zeta: damping ratio.
        delay: s; not negative, unless `periodic`.
        sample: sampling interval, s.
        periodic: True: the drive is one period of a steady state; False: the motion starts at rest.
    """
    A = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2 * zeta * omega, omega**2], [0.0, 0.0, 0.0]])
    step, within = scipy.linalg.expm(A * sample), scipy.linalg.expm(A * (sample - delay % sample))
    (a, b, p), (c, d, q) = step[:2]
    poles = [1.0, -(a + d), a * d - b * c]
    delayed = _held_delay(drive, delay, sample, periodic)
    found = []
    for x, v, u in within[:2]:
        zeros = [u, x * p + v * q + u * poles[1], x * (b * q - d * p) + v * (c * p - a * q) + u * poles[2]]
        begin = np.zeros((*drive.shape[:-1], 2))
        if periodic:
            # The filter starts in the state (two numbers in SciPy's form) that repeats after one period.
            period = np.linalg.matrix_power([[-poles[1], 1.0], [-poles[2], 0.0]], drive.shape[-1])
            _, end = scipy.signal.lfilter(zeros, poles, delayed, zi=begin)
            begin = end @ np.linalg.inv(np.eye(2) - period).T
        found.append(scipy.signal.lfilter(zeros, poles, delayed, zi=begin)[0])
    return np.stack([found[0], found[1] / omega])


def _held_delay(drive: np.ndarray, delay: float, sample: float, periodic: bool) -> np.ndarray:
    """Return the drive, V, shape (..., samples), delayed by `delay` [s]: at each sample, the value that was
    held just before, `delay` earlier. `sample` is the sampling interval [s]. Before its first sample, the
    drive is 0 or, if `periodic`, repeats. The delay must not be negative, unless `periodic`."""
    n = math.floor(delay / sample) + 1
    late = np.roll(drive, n, axis=-1)
    if not periodic:
        late[..., :n] = 0.0
    return late


@single_threaded
def identify_in_time(
    drive: np.ndarray,
    response: np.ndarray,
    sample_rate: float | str,
    start: ModalModel,
    *,
    periodic: bool = False,
    correlated: bool = True,
    tied: Mapping[str, str] | None = None,
    progress: Progress = unheard,
) -> Fit:
    """Fit a modal model to recordings by free simulation; all recordings and channels share poles and delay.

    Args:
        drive: drive, shape (samples, inputs, recordings), in the first of the units of `start`.
        response: response, shape (samples, outputs, recordings), in the second of the units of `start`.
        sample_rate: Hz.
        start: model with the initial poles. Its delay, less the half sample by which the hold delays (at
            least 0), is kept fixed: within a sample, gain and rate gain can replace a delay. Its gains are
            not used; all gains are found by linear least squares.
        periodic: the recordings are one period of a steady state; otherwise they start at rest.
        correlated: allow for residuals that are correlated in time, as model errors always are.
        tied: poles that follow from others, as for `identify_frequency`.
        progress: called during the work with a text and the fraction done.

    Returns:
        A fit with the values of `identify_frequency`, always with rate gains and remainder, and without the
        delay. Its `model`, a `ModalModel`, contains the fixed delay. All samples have equal weights, so the
        fit follows the largest motion. Its `failures` name modes that may be noise.

    Raises:
        QuantityError: an expression in `tied` is wrong, or `sample_rate` is not a frequency.
        FitError: the shapes do not fit, or see `fit_least_squares`.
    """
    sample_rate = to_si(sample_rate, "Hz", "sample_rate")
    if drive.ndim != 3 or response.ndim != 3 or drive.shape[::2] != response.shape[::2]:
        raise FitError(f"drive {drive.shape}, response {response.shape}: not (samples, channels, recordings)")
    n_samples, n_inputs, _ = drive.shape
    n_outputs, n_modes, sample = response.shape[1], len(start.natural_frequency), 1 / sample_rate
    u = np.moveaxis(drive, 0, -1)
    delay = max(start.delay - sample / 2, 0.0)

    def in_rows(simulated: np.ndarray) -> np.ndarray:
        """Reshape (..., channels, recordings, samples) to (..., channels, rows): all recordings joined."""
        return simulated.reshape(*simulated.shape[:-2], -1)

    direct = in_rows(_held_delay(u, delay, sample, periodic))

    def mode(omega: float, zeta: float) -> np.ndarray:
        return in_rows(_held_mode(u, omega, zeta, delay, sample, periodic))

    def designs(values: Values) -> list[Design]:
        pairs = [
            (values[f"natural_frequency_{m}"], values[f"damping_ratio_{m}"]) for m in range(1, n_modes + 1)
        ]
        modes = np.stack([mode(w, z) for w, z in pairs])

        @cache
        def slopes() -> list[np.ndarray]:
            h, found = 1e-6, []
            for unmoved, (w, z) in zip(modes, pairs, strict=True):
                found.append((mode(w * (1 + h), z) - unmoved) / (h * w))
                found.append((mode(w, z * (1 + h)) - unmoved) / (h * z))
            return found

        def tangent(x: np.ndarray) -> np.ndarray:
            gains = x[: 2 * n_modes * n_inputs].reshape(n_modes, 2, n_inputs)
            return np.stack([np.tensordot(gains[i // 2], d, 2) for i, d in enumerate(slopes())], axis=1)

        return [Design(np.concatenate([modes.reshape(-1, direct.shape[-1]), direct]).T, tangent)] * n_outputs

    names = [f"{kind}_{m}" for m in range(1, n_modes + 1) for kind in ("gain", "rate_gain")]
    recordings = []
    for o, measured in enumerate(in_rows(np.moveaxis(response, 0, -1)), 1):
        channels = [""] if n_inputs * n_outputs == 1 else [f"[{o},{i}]" for i in range(1, n_inputs + 1)]
        coefficients = tuple(
            (name + channel, start.unit) for name in [*names, "remainder"] for channel in channels
        )
        recordings.append(SeparableRecording(measured, None, coefficients, f"output {o}", start.units[1]))
    poles = list(zip(start.natural_frequency, start.damping_ratio, strict=True))
    parameters = pole_parameters(poles, (np.pi / (n_samples * sample), np.pi * sample_rate))
    problem = separable(recordings, designs, with_ties(parameters, tied), correlated=correlated)
    fit = fit_least_squares(problem, tolerance=1e-8, progress=progress)
    names = [p.name for p in parameters]
    searched = np.array([fit.values[name] for name in names])
    found = np.array([fit.values[p.name] for p in fit.parameters if p.name not in names])
    found = found.reshape(n_outputs, 2 * n_modes + 1, n_inputs)
    gain, rate_gain = found[:, :-1].reshape(n_outputs, n_modes, 2, n_inputs).transpose(2, 1, 0, 3)
    model = ModalModel(searched[0::2], searched[1::2], delay, gain, rate_gain, found[:, -1], start.units)
    matrices = [one.matrix for one in designs(fit.values)]
    per_mode = [list(range(2 * m * n_inputs, 2 * (m + 1) * n_inputs)) for m in range(n_modes)]
    seen = chances(fit, matrices, per_mode, n_samples)
    unseen = [m for m, chance in enumerate(seen) if chance > FALSE_ALARM]
    doubts = [said_of_noise([m + 1 for m in unseen], [seen[m] for m in unseen])] if unseen else []
    return replace(fit, model=model, unpredicted=UNPREDICTED, doubts=(*fit.doubts, *doubts))
