"""Fit of one modal model to frequency responses at several drive amplitudes (levels); see `amplitude`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.blas import single_threaded
from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...estimate.separable import Design, SeparableRecording, separable
from ...quantities.progress import Progress, unheard, within
from ...quantities.units import to_si
from .amplitude import ALIKE, AmplitudeModel, law, law_by_exponent
from .modal import (
    ANY,
    LINES_IN_SEARCH,
    UNPREDICTED,
    ModalForm,
    ModalModel,
    delay_parameter,
    identify_frequency,
    modal_design,
    modal_model,
    pole_parameters,
    real_over_imaginary,
    starts_of,
)
from .response import ratio_of, units_of

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

# Exponent p of the amplitude law that is assumed for two levels. Fits of three levels of a mirror's piezos
# gave 0.41 to 0.60; an exponent of 1 predicts the outer levels worse.
TWO_LEVELS_EXPONENT = 0.5
LEAST_EXPONENT, MOST_EXPONENT = -3.0, 4.0  # range of the exponent p of the amplitude law
# Largest slope of a natural frequency or damping ratio that is searched first: its relative change per
# relative change of the amplitude.
STEEPEST = 1.0
# Shifts of all natural frequencies between two neighbouring levels that are tried, as natural logarithms of
# the frequency ratio. Their spacing of 0.5 % is half the usual relative width of a mode.
SHIFTS = np.linspace(-0.2, 0.2, 81)


@single_threaded
def identify_levels(
    responses: Sequence[xr.Dataset],
    modes: int | Sequence[tuple[float | str, float]] | ModalModel,
    amplitudes: Sequence[float | str] | None = None,
    *,
    exponent: float | None = None,
    complex_modes: bool = True,
    remainder: bool = True,
    noise_known: bool = False,
    correlated: bool = False,
    progress: Progress = unheard,
) -> Fit:
    """Fit one modal model to the frequency responses at several amplitudes of the drive.

    Args:
        responses: one for each level, from `frequency_response`, or selections of the same outputs and
            inputs; weighted as in `identify_frequency`.
        modes: number of modes, or their initial values at the middle level; see `identify_frequency`.
        amplitudes: rms of the drive at each level, in the drive's unit; by default the "drive_rms" of each
            response.
        exponent: fixed exponent p of the law, see `amplitude`; by default it is fitted to three or more
            levels. Two levels do not determine the exponent; it is then 0.5, and a remark says so.
        complex_modes, remainder, noise_known, correlated, progress: as for `identify_frequency`.

    Returns:
        The fit with the values of `identify_frequency` at the reference amplitude (the geometric mean of the
        levels), and in addition natural_frequency_slope_1, damping_ratio_slope_1, ..., exponent,
        gain_slope_1, .... Slopes are changes per relative change of the amplitude: relative for frequencies
        and damping ratios, in the unit of the value for gains. The fit's `model` is an `AmplitudeModel`, for
        `at_amplitude` and `predict_response`.

    Raises:
        QuantityError: an amplitude has another dimension than the drive, or an initial value in `modes` is no
            frequency.
        FitError: fewer than two levels, two of nearly the same amplitude, levels of different channels or
            units, responses without deviations, missing amplitudes, an exponent outside -3 to 4, or see
            `identify_frequency`.
    """
    units = units_of(responses[0]) if responses else ("V", "m")
    given = None if amplitudes is None else [to_si(one, units[0], "amplitudes") for one in amplitudes]
    starts_of(modes)
    rms = _amplitudes(responses, given, units[0])
    order = np.argsort(rms)
    rms, levels = rms[order], [_with_channels(responses[i]) for i in order]
    _check(levels, rms, units)
    kind = ModalForm(complex_modes, remainder)
    progress("fitting the level in the middle", 0.0)
    middle = levels[len(levels) // 2]
    found = identify_frequency(middle, modes, complex_modes=complex_modes, remainder=remainder).model
    poles = np.append(np.stack(found[:2], axis=1).ravel(), found.delay)
    start, remarks = _exponent(exponent, len(levels))
    problem = _Levels(levels, rms, poles, start, kind)
    options = {"noise_known": noise_known, "correlated": correlated}
    described = separable(problem.recordings(), problem.designs, problem.parameters, **options)
    fit = fit_least_squares(described, tolerance=1e-8, progress=_second_half(progress))
    model, remarks = problem.model(fit), (*fit.remarks, *remarks)
    return replace(fit, model=model, remarks=remarks, unpredicted=UNPREDICTED)


def _exponent(given: float | None, n_levels: int) -> tuple[Parameter, tuple[str, ...]]:
    """Return the exponent of the amplitude law as a parameter of the fit, and a tuple of remarks: one
    sentence if the value is assumed, else empty. The exponent is fixed if it is `given`, or if there are two
    levels.

    Raises:
        FitError: the given exponent is outside -3 to 4.
    """
    remarks: tuple[str, ...] = ()
    if given is None and n_levels == 2:
        given = TWO_LEVELS_EXPONENT
        remarks = (f"two levels do not show the exponent of their law: taken as {given:g}",)
    if given is None:
        return Parameter("exponent", 1.0, LEAST_EXPONENT, MOST_EXPONENT, log=False), remarks
    if not LEAST_EXPONENT <= given <= MOST_EXPONENT:
        raise FitError(f"exponent = {given:g} must be from {LEAST_EXPONENT:g} to {MOST_EXPONENT:g}")
    return Parameter("exponent", float(given), log=False, fixed=True), remarks


def _second_half(progress: Progress) -> Progress:
    return lambda said, share: within(progress, 0.5, 0.5, said, share)


def _amplitudes(responses: Sequence[xr.Dataset], given: Sequence[float] | None, unit: str) -> Array:
    """Return the rms amplitude of each level, in the drive's `unit`, shape (levels,): `given`, or else
    "drive_rms" of each response.

    Raises:
        FitError: a response lacks "drive_rms", the numbers differ, or an amplitude is not above 0.
    """
    if given is None:
        without = [i for i, r in enumerate(responses, 1) if "drive_rms" not in r.coords]
        if without:
            raise FitError(f"response {without[0]} has no drive_rms: say the amplitudes")
        given = [float(r["drive_rms"]) for r in responses]
    if len(given) != len(responses):
        raise FitError(f"{len(given)} amplitudes for {len(responses)} responses")
    rms = np.array(given, dtype=float)
    if not np.all((rms > 0.0) & np.isfinite(rms)):
        raise FitError(f"amplitudes {rms.tolist()} {unit} must be above 0 {unit}")
    return rms


def _with_channels(response: xr.Dataset) -> xr.Dataset:
    missing = [d for d in ("output", "input") if d not in response["response"].dims]
    return response.expand_dims(missing).transpose("frequency", "output", "input")


def _check(levels: Sequence[xr.Dataset], rms: Array, units: tuple[str, str]) -> None:
    """Raise FitError unless there are at least two levels with the same channels and `units`, different
    amplitudes `rms` (ascending), and deviations above 0."""
    if len(levels) < 2:
        raise FitError("one level does not show what changes with the amplitude: there must be two or more")
    for low, high in pairwise(rms):
        if high <= low * (1 + ALIKE):
            raise FitError(
                f"two levels are alike, {low:.4g} and {high:.4g} {units[0]} rms: join their realisations"
            )
    for other in map(units_of, levels):
        if other != units:
            raise FitError(f"the levels differ in their units: {ratio_of(units)} and {ratio_of(other)}")
    for axis in ("output", "input"):
        if any(not np.array_equal(level[axis], levels[0][axis]) for level in levels):
            raise FitError(f"the levels differ in their {axis}s")
    if not all(np.all(level["deviation"] > 0) for level in levels):
        raise FitError("the responses have no deviations: they need more realisations or periods")


def _softening(levels: Sequence[xr.Dataset], poles: Array, kind: ModalForm) -> Array:
    """Return the common shift of all natural frequencies at each level, shape (levels,): the natural
    logarithm of the frequency ratio to the middle level, 0 there.

    Modes of two levels are not paired one by one, because weak modes differ between levels.

    Args:
        levels: responses at ascending amplitudes.
        poles: natural frequency [rad/s] and damping ratio of each mode at the middle level, then the delay
            [s].
        kind: kinds of coefficients that the modal model has.
    """
    middle = len(levels) // 2
    shifts = np.zeros(len(levels))
    for side in (range(middle + 1, len(levels)), range(middle - 1, -1, -1)):
        so_far = 0.0
        for i in side:
            trial = so_far + np.array([0.0, *SHIFTS])
            so_far = shifts[i] = trial[np.argmin([_left(levels[i], poles, t, kind) for t in trial])]
    return shifts


def _left(level: xr.Dataset, poles: Array, shift: float, kind: ModalForm) -> float:
    """Return the residual sum of squares of one level's responses, fitted by modes whose natural frequencies
    are all shifted by the same factor. All measured frequencies have equal weights.

    Args:
        level: responses of the level.
        poles: natural frequency [rad/s] and damping ratio of each mode, then the delay [s].
        shift: logarithm of the factor on all natural frequencies.
        kind: kinds of coefficients that the modal model has.
    """
    level = level.isel(frequency=slice(None, None, max(1, level.sizes["frequency"] // LINES_IN_SEARCH)))
    shifted = np.append(poles[:-1].reshape(-1, 2) * [np.exp(shift), 1.0], poles[-1])
    basis = modal_design(level["frequency"].to_numpy(), shifted, kind).matrix
    measured = real_over_imaginary(level["response"].to_numpy().reshape(level.sizes["frequency"], -1))
    return float(np.sum((measured - basis @ np.linalg.lstsq(basis, measured, rcond=None)[0]) ** 2))


class _Levels:
    """Separable least-squares problem over all levels, for one modal model with slopes.

    The rows of a design matrix go level by level. Its columns belong to the coefficients (gains, rate gains,
    remainder) at the reference amplitude, and then to their slopes.

    Args:
        levels: responses at ascending amplitudes.
        rms: amplitude of each level, in the drive's unit, shape (levels,).
        poles: initial natural frequency [rad/s] and damping ratio of each mode at the middle level, then the
            delay [s].
        exponent: exponent of the amplitude law, free or fixed.
        kind: kinds of coefficients that the modal model has.
    """

    def __init__(
        self, levels: Sequence[xr.Dataset], rms: Array, poles: Array, exponent: Parameter, kind: ModalForm
    ) -> None:
        self.levels, self.kind, self.rms = levels, kind, rms
        self.amplitude = float(np.exp(np.mean(np.log(rms))))
        self.ratios = rms / self.amplitude
        self.frequencies = [level["frequency"].to_numpy() for level in levels]
        self.n_modes = len(poles) // 2
        self.parameters = [*self._at_reference(poles, exponent.start), exponent]
        self.names = [p.name for p in self.parameters]
        self.outputs, self.inputs = (levels[0][axis].to_numpy() for axis in ("output", "input"))

    def _at_reference(self, poles: Array, exponent: float) -> list[Parameter]:
        """Return poles and delay at the reference amplitude, and the slopes of the poles, as free parameters.

        Initial values come from `poles`, the values at the middle level, and from a straight line through the
        common shifts of the modes over the law with this exponent. Slopes of damping ratios start at 0.
        """
        lowest, highest = min(f[0] for f in self.frequencies), max(f[-1] for f in self.frequencies)
        longest = 10 / highest
        lines = np.stack([np.ones(len(self.levels)), law(self.ratios, exponent)], axis=1)
        shifts = _softening(self.levels, poles, self.kind)
        shift, slope = np.linalg.lstsq(lines, shifts, rcond=None)[0]
        starts = [(float(w * np.exp(shift)), float(z)) for w, z in poles[:-1].reshape(-1, 2)]
        found = pole_parameters(starts, (np.pi * lowest, 4 * np.pi * highest))
        found.append(delay_parameter(longest).starting_at(float(poles[-1])))
        for m in range(1, self.n_modes + 1):
            for name, value in (("natural_frequency", float(slope)), ("damping_ratio", 0.0)):
                steep = Parameter(f"{name}_slope_{m}", 0.0, -STEEPEST, STEEPEST, log=False, limits=ANY)
                found.append(steep.starting_at(value))
        return found

    def recordings(self) -> list[SeparableRecording]:
        """Return the data of each channel (pair of output and input) for the least squares, one after the
        other by outputs: the responses of all levels, their deviations, and the names of the coefficients."""
        unit = self.levels[0]["response"].attrs["units"]
        single = self.outputs.size * self.inputs.size == 1
        names = self.kind.names(self.n_modes)
        names = [*names, *(_slope_of(name) for name in names)]
        found = []
        for o, i in product(range(self.outputs.size), range(self.inputs.size)):
            label = "" if single else f"[{self.outputs[o]},{self.inputs[i]}]"
            measured, deviation = (
                [level[what].to_numpy()[:, o, i] for level in self.levels]
                for what in ("response", "deviation")
            )
            found.append(
                SeparableRecording(
                    np.concatenate([real_over_imaginary(one) for one in measured]),
                    np.concatenate([np.tile(one / np.sqrt(2), 2) for one in deviation]),
                    tuple((name + label, unit) for name in names),
                    f"response{label}",
                    unit,
                )
            )
        return found

    def designs(self, values: Values) -> list[Design]:
        """Return the design matrix and its derivatives for each channel at these values of poles, delay,
        slopes and exponent by name; all channels have the same."""
        base, slope, p = self._split(values)
        along, by_p = law(self.ratios, p), law_by_exponent(self.ratios, p)
        factors = np.exp(along[:, None] * slope)
        parts = [
            modal_design(f, base * factor, self.kind)
            for f, factor in zip(self.frequencies, factors, strict=True)
        ]
        half = parts[0].matrix.shape[1]
        matrix = np.concatenate(
            [np.hstack([d.matrix, x * d.matrix]) for d, x in zip(parts, along, strict=True)]
        )

        def tangent(c: Array) -> Array:
            rows = []
            for d, x, dx, factor in zip(parts, along, by_p, factors, strict=True):
                at_level = d.tangent(c[:half] + x * c[half:]) * factor
                # The last column belongs to the delay, which has no slope because the amplitude has no
                # effect.
                by_slope = (at_level * (base * x))[:, :-1]
                by_exponent = dx * (d.matrix @ c[half:] + at_level @ (base * slope))
                columns = [at_level, by_slope, by_exponent[:, None]]
                rows.append(np.hstack(columns[: 2 if self.parameters[-1].fixed else 3]))
            return np.concatenate(rows)

        return [Design(matrix, tangent)] * (self.outputs.size * self.inputs.size)

    def _split(self, values: Values) -> tuple[Array, Array, float]:
        """Return three parts of the values by name: the array of natural frequency [rad/s] and damping ratio
        of each mode and the delay [s] at the reference amplitude; the array of their slopes (0 for the
        delay); and the exponent of the amplitude law."""
        given = np.array([values[name] for name in self.names])
        n = 2 * self.n_modes + 1
        return given[:n], np.append(given[n:-1], 0.0), float(given[-1])

    def model(self, fit: Fit) -> AmplitudeModel:
        """Return the `AmplitudeModel` with the values of a fit, valid between the lowest and highest
        level."""
        base, slope, p = self._split(fit.values)
        rest = np.array([fit.values[q.name] for q in fit.parameters if q.name not in self.names])
        rest = np.moveaxis(rest.reshape(self.outputs.size, self.inputs.size, 2, -1), (2, 3), (0, 1))
        units = units_of(self.levels[0])
        whole = [
            modal_model(poles, c, self.kind, units) for poles, c in zip((base, slope), rest, strict=True)
        ]
        ends = float(self.rms[0]), float(self.rms[-1])
        return AmplitudeModel(whole[0], whole[1], p, self.amplitude, *ends)


def _slope_of(name: str) -> str:
    """Return the name of a coefficient's slope, such as gain_slope_1 for gain_1 or remainder_slope."""
    kind, _, number = name.rpartition("_")
    return f"{kind}_slope_{number}" if kind else f"{name}_slope"
