"""Fit of damping, natural frequency, gain, delay and sensor lag to all samples of all step responses; and the
errors of the classical formulas, if the fitted response is the true one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...estimate.blas import single_threaded
from ...estimate.coloured import with_own_noise
from ...estimate.disturbed import with_disturbances
from ...estimate.drift import drift_seen, said_drift
from ...estimate.fit import fit_least_squares
from ...estimate.lack import KnownNoise
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import Problem, Residuals
from ...estimate.result import Fit
from ...estimate.several import lowest
from ...physics.actuator import Actuator
from ...physics.electronics import Filter
from ...physics.piezo import Piezo
from ...quantities.units import optional_si, to_si
from ...recording import RecordingError
from ..free import check_motion, with_ties
from ..quantised import Inexact, moved_by, said_steps, with_moved
from ..recorded.channels import channel, names_of, recordings_of, unit_of
from ..recorded.known_noise import resolution
from ..recorded.screen import PositionUnderDrive, refuse_noise, refuse_swapped, said_gain
from ..scales import DRIVE, ByKnown, model_values, with_scales
from .at_piezo import check_known
from .at_piezo import response as piezo_response
from .first_look import Look, Response, common_look, first_look
from .formulas import Timing, classical, second_order, timing_of
from .linear import filter_zeros_poles, second_order_poles
from .recorded_step import POSITION, StepTest, step_tests

# Fitted duration after the step: the longer of WINDOW peak times, and DECAYS decay times plus the delay of
# the response. Later samples only show the drift of the sensor.
WINDOW, DECAYS = 8.0, 3.0
# Fitted duration before the step, in durations after the step: a longer rest hardly improves the estimate of
# the drift.
REST = 8.0
# First search range of damping ratios: from a good tuning fork to two poles a factor of 3600 apart.
DAMPING_RATIOS = (1e-4, 30.0)
# Lags of the sensor below this fraction of 1/natural_frequency are left out of the model.
LEAST_LAG = 1e-6
# Drifts of the sensor above this number of standard errors are reported, and subtracted before the first
# estimate.
SEEN = 3.0
STAGE_PARAMETERS = ("damping_ratio", "natural_frequency", "gain")

Array = NDArray[np.float64]


@single_threaded
def identify_step(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Actuator | None = None,
    *,
    voltages: Sequence[float | str] | None = None,
    start: float | str | None = None,
    filter: Filter | None = None,
    slew_rate: float | str | None = None,
    lag: bool = True,
    window: float | str | None = None,
    timing: Timing | None = None,
    observed: str = POSITION,
    tied: Mapping[str, str] | None = None,
) -> Fit:
    """Fit a second-order system, seen through a sensor with delay and lag, to step responses.

    The model response is exact (a sum of exponentials). A filtered sensor has autocorrelated noise, which the
    intervals allow for (see `coloured`).

    Args:
        recordings: with end_effector_position [m, or rad for a rotary actuator], the end-effector fixed to
            the stage, and drive_voltage [V] unless voltages and start are given.
        model: actuator for the result. Its `piezo`, taken as known and annealed before each step, is part of
            the model; the gain multiplies its output.
        voltages: height of each step, V; by default from drive_voltage.
        start: instant of the steps in the time of the recordings, s; by default from drive_voltage.
        filter: low-pass filter that the position went through, if it is known; its analogue counterpart is
            part of the model. Otherwise delay and lag approximate it.
        slew_rate: slew rate of the amplifier into the piezo, V/s, if known. By default the step is a jump.
        lag: fit a first-order lag of the sensor.
        window: fitted duration before and after the step, s; by default eight peak times or three decay times
            after it, and eight times as much before it.
        timing: times of the classical numbers, which start the fit; by default times and start come from
            the second-order response most similar to a recording.
        observed: name of the position channel.
        tied: parameters that follow from others, as for `identify_friction`.

    Returns:
        A fit of damping_ratio, natural_frequency [rad/s], gain [m/V], delay [s], lag [s], and of each
        recording the offset [m] and the drift of its sensor [m/s]; `predict(recording)` gives the position
        without these two, which `step_level` returns. The delay is the total delay of the sensor, the lag
        included, counted from the sample after the step of drive_voltage. Where the stage is overdamped,
        its two poles cannot be distinguished from the lag's: the intervals include all three assignments, and
        `other_minima` lists them. Without a lag (``lag=False``) there is one.

    Raises:
        RecordingError: a channel is missing, empty, constant, clipped, too short or too coarsely sampled;
            or the position is noise, or swapped with the drive.
        QuantityError: an expression in `tied` is wrong, a piezo model has no closed form of its steps, or the
            position is in m for a rotary model or in rad for an inclined one.
        FitError: as `fit_least_squares`.
    """
    piezo = None if model is None else model.piezo
    check_known(piezo)
    _screen(recordings_of(recordings), observed)
    slew_rate = optional_si(slew_rate, "V/s", "slew_rate")
    window, start = optional_si(window, "s", "window"), optional_si(start, "s", "start")
    tests = step_tests(recordings, voltages, start, observed)
    response = _response(filter, slew_rate, piezo)
    known = filter is not None or bool(slew_rate) or piezo is not None
    first, look = _begun(tests, timing, _seen(response) if known else None)
    after = _reach(first, look) if window is None else window
    kept = [_within(test, -after * (REST if window is None else 1.0), after) for test in tests]

    def residuals(test: StepTest, number: int) -> Callable[[Values], Array]:
        return lambda values: response(test, values) + step_level(values, number, test.time) - test.position

    unit = unit_of(recordings_of(recordings), observed) or "m"
    check_motion(model, unit)
    parts = [
        Residuals(residuals(test, i), test.position, None, test.name, unit, _known(test), test.time)
        for i, test in enumerate(kept, start=1)
    ]
    problem = Problem(parts, with_ties(_parameters(first, look, lag, unit), tied))
    fit = _with_exchanged(problem, fit_least_squares(problem))
    fit = with_own_noise(fit)
    known = [Inexact.seen(test.position, noisy=False) for test in kept]
    moved = moved_by(known, lambda drawn: -np.concatenate(drawn))
    fit = with_moved(fit, moved, said_steps(observed, known, unit))

    stage = {name: fit.values[name] for name in STAGE_PARAMETERS}
    heights = {to_si(height, "V", "voltages") for height in voltages or ()}
    voltage = heights.pop() if len(heights) == 1 else None
    fit = replace(
        fit,
        model=model and model.replace(**stage, rotary=unit == "rad"),
        observed=observed,
        remarks=(
            *fit.remarks,
            *_said_drifts(fit, unit),
            *said_gain(fit.values["gain"], unit, model and model.gain),
        ),
        predict=StepPrediction(fit.values, filter, slew_rate, voltage, start, observed, piezo).predict,
    )
    return with_disturbances(with_scales(fit, recordings_of(recordings), _by_drive))


def _by_drive(fit: Fit) -> ByKnown:
    """Return the derivatives of a step fit's residuals by the scale of the drive, for `with_scales`: the
    model's response without offsets and drifts."""
    assert fit.jacobian is not None
    level = [i for i, p in enumerate(fit.parameters) if p.name.startswith(("offset_", "drift_"))]
    own = fit.jacobian[:, level] @ [fit.values[fit.parameters[i].name] for i in level]
    return ByKnown({DRIVE: model_values(fit) - own})


def _screen(recordings: Sequence[xr.Dataset], observed: str) -> None:
    """Raise RecordingError if a recording is only noise, or its columns are swapped."""
    for one, name in zip(recordings, names_of(recordings), strict=True):
        position = channel(one, observed, name, varies=True)
        drive = channel(one, "drive_voltage", name) if "drive_voltage" in one else None
        refuse_noise(position, observed, name, drive)
        if drive is not None:
            unit = unit_of([one], observed) or "m"
            refuse_swapped(PositionUnderDrive(name, observed, unit, one["time"].values, position, drive))


def _with_exchanged(problem: Problem, fit: Fit) -> Fit:
    """Return the step fit with intervals that include equivalent solutions: of three real poles, any one may
    be the lag's, and the other two those of an overdamped stage. Unchanged for damping ratios up to 1."""
    free, limits = {p.name for p in fit.parameters}, {p.name: (p.lower, p.upper) for p in fit.parameters}
    zeta, omega, delay = (fit.values[name] for name in ("damping_ratio", "natural_frequency", "delay"))
    lag = fit.values.get("lag", 0.0)
    if not free >= {"damping_ratio", "natural_frequency", "delay", "lag"} or not (zeta > 1.0 and lag > 0.0):
        return fit
    ends, poles = [fit], [-p.real for p in second_order_poles(zeta, omega)]
    for of_lag, kept in (poles, poles[::-1]):
        root = math.sqrt(kept / lag)
        other = {
            "damping_ratio": 0.5 * (kept + 1.0 / lag) / root,
            "natural_frequency": root,
            "lag": 1.0 / of_lag,
            "delay": delay - lag + 1.0 / of_lag,
        }
        if all(limits[name][0] < value < limits[name][1] for name, value in other.items()):
            ends.append(fit_least_squares(problem, initial={**fit.values, **other}))
    return lowest(ends)


def step_level(values: Values, number: int, since: Array) -> Array:
    """Return the level of the sensor without the step, m, shape (n,): offset and drift of recording `number`
    (from 1), among the `values` of a fit, at the times `since` [s] after its step."""
    return values[f"offset_{number}"] + values[f"drift_{number}"] * since


def _straightened(test: StepTest) -> StepTest:
    """Return the recording without a linear drift of the sensor, if the samples before the step show a drift;
    otherwise unchanged."""
    rest = test.time < 0.0
    drift = drift_seen(test.time[rest], test.position[rest], SEEN)
    return test._replace(position=test.position - drift.at(test.time)) if drift else test


def _said_drifts(fit: Fit, unit: str) -> list[str]:
    """Return a sentence on each recording whose drift exceeds `SEEN` standard errors."""
    said, errors = [], fit.standard_errors
    for i, one in enumerate(fit.recordings, start=1):
        slope, error = fit.values[f"drift_{i}"], errors[f"drift_{i}"]
        if abs(slope) > SEEN * error:
            said.append(f"{one.name} {said_drift(slope, error, unit)}: it is part of the fit")
    return said


class StepPrediction(NamedTuple):
    """Prediction of a step response by the `values` of a fit (by name, SI); the other fields are arguments of
    `identify_step`. `voltage` is the height of every step, V; None, as after a fit of steps of different
    heights: from drive_voltage."""

    values: Values
    filter: Filter | None
    slew_rate: float | None
    voltage: float | None
    start: float | None
    observed: str
    piezo: Piezo | None = None

    def predict(self, recording: xr.Dataset, drive: float | None = None) -> Array:
        """Return the predicted position, m (rad), shape (n,), without offset and drift. `drive` is the height
        of the step, V; by default `voltage`."""
        height = self.voltage if drive is None else drive
        heights = None if height is None else [height]
        (test,) = step_tests(recording, heights, self.start, self.observed)
        return _response(self.filter, self.slew_rate, self.piezo)(test, self.values)


def _known(test: StepTest) -> KnownNoise:
    at_rest = int(np.count_nonzero(test.time < 0.0))
    return KnownNoise(at_rest=at_rest, step=resolution(test.position), straightened=True)


def _within(test: StepTest, first: float, last: float) -> StepTest:
    kept = (test.time >= first) & (test.time <= last)
    return test._replace(time=test.time[kept], position=test.position[kept])


def _begun(
    tests: Sequence[StepTest], timing: Timing | None, seen: Response | None
) -> tuple[list[dict[str, float]], Look]:
    """Return the classical numbers of each step by name, and the initial guess of the fit. `seen` is the
    response through known amplifier, piezo and filter; None if none of these is known."""
    tests = [_straightened(test) for test in tests]
    if timing is not None:
        first = [classical(test, timing) for test in tests]
        return first, _by_formulas(first)
    looks = [first_look(test) for test in tests]
    first = [classical(test, timing_of(test, look)) for test, look in zip(tests, looks, strict=True)]
    best = common_look(tests, looks)
    return first, looks[best] if seen is None else first_look(tests[best], seen)


def _by_formulas(first: Sequence[dict[str, float]]) -> Look:
    """Return the second-order response with the mean of the steps' classical numbers (by name); without an
    overshoot, a critically damped one with about the same peak time."""
    names = ("natural_frequency", "damping_ratio", "delay", "peak_time")
    omega, zeta, delay, peak = (float(np.mean([row[name] for row in first])) for name in names)
    if not np.isfinite(zeta):  # no overshoot: the time of the peak is determined by noise
        return Look(5.0 / peak, 1.0, delay)
    return Look(omega, zeta, delay)


def _seen(response: Callable[[StepTest, Values], Array]) -> Response:
    """Return the `Response` (a function of a recorded step and a `Look`, with a gain of 1) that calls
    `response`, a function of the step and parameter values by name."""
    return lambda test, look: response(test, {**look._asdict(), "gain": 1.0})


def _reach(first: Sequence[dict[str, float]], look: Look) -> float:
    """Return the fitted duration after the step, s, from the classical numbers `first` of each step (by name)
    and the second-order response `look`."""
    return max(WINDOW * float(np.mean([row["peak_time"] for row in first])), look.delay + DECAYS / look.decay)


def _parameters(first: Sequence[dict[str, float]], look: Look, lag: bool, unit: str) -> list[Parameter]:
    omega, zeta, delay = look
    length, gain = (float(np.mean([row[name] for row in first])) for name in ("peak_time", "gain"))
    least, most = DAMPING_RATIOS
    found = [
        Parameter(
            "damping_ratio", max(zeta, 2.0 * least), least, max(most, 2.0 * zeta), "", limits=(0.0, np.inf)
        ),
        Parameter("natural_frequency", omega, omega / 30, omega * 30, "rad/s", limits=(0.0, np.inf)),
        Parameter("gain", gain, -np.inf, np.inf, f"{unit}/V", log=False),
        Parameter("delay", delay, delay - length, delay + length, "s", log=False, limits=(-np.inf, np.inf)),
    ]
    if lag:
        found.append(Parameter("lag", 0.05 / omega, 0.0, 2.0 / omega, "s", log=False, square=True))
    for i, row in enumerate(first, start=1):
        found.append(Parameter(f"offset_{i}", row["bias"], -np.inf, np.inf, unit, log=False))
        found.append(Parameter(f"drift_{i}", 0.0, -np.inf, np.inf, f"{unit}/s", log=False))
    return found


def _response(
    filter: Filter | None, slew_rate: float | None, piezo: Piezo | None
) -> Callable[[StepTest, Values], Array]:
    """Return a function for the response of the position channel to a step, relative to the position before
    the step, m (rad), shape (n,). Its arguments are the recorded step and the parameters by name, SI."""
    zeros, known = filter_zeros_poles(filter) if filter else ([], [])
    stepped = piezo_response(piezo, slew_rate)

    def of(test: StepTest, values: Values) -> Array:
        poles = [*known, *second_order_poles(values["damping_ratio"], values["natural_frequency"])]
        lag = values.get("lag", 0.0)
        if lag > LEAST_LAG / values["natural_frequency"]:
            poles.append(complex(-1.0 / lag))
        since = test.time - values["delay"] + lag
        return values["gain"] * stepped(since, test.voltage, test.rest, poles, zeros)

    return of


def step_formula_errors(
    fit: Fit,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    voltages: Sequence[float | str] | None = None,
    start: float | str | None = None,
    timing: Timing | None = None,
    n: int = 200,
    seed: int = 0,
) -> xr.Dataset:
    """Return the errors of the classical formulas if the fitted response is the true one, and their causes.

    The formulas are first applied to the fitted response without noise: that error comes from the sensor
    (lag, filter, undetected onset). Then noise is added, taken from the residuals at random positions. The
    additional mean error comes from the noise, mainly at the peak, because the largest of many noisy samples
    is too large.

    Args:
        fit: fit of `identify_step`.
        recordings: recordings of the fit.
        voltages, start, timing: as for the fit; by default the times and the start of the rise come from the
            second-order response most similar to the fitted one.
        n: number of noisy repetitions.
        seed: seed of the random noise.

    Returns:
        Dataset over "parameter" (damping_ratio, natural_frequency, gain): `fitted`, the true value;
        `by_sensor` and `by_noise`, mean errors of the formula; and `scatter`, the standard deviation of its
        result; all in the parameter's unit. The last two are over the repetitions in which the formulas give
        a result; NaN without any.
    """
    tests = step_tests(recordings, voltages, start, observed=fit.observed)
    assert fit.predict is not None
    clean = [fit.predict(r, of.voltage) for r, of in zip(recordings_of(recordings), tests, strict=True)]
    timings = [timing] * len(tests) if timing else []
    if not timings:
        look = first_look(tests[0]._replace(position=clean[0]))
        timings = [timing_of(test, look) for test in tests]
    random = np.random.default_rng(seed)

    def read(noisy: bool) -> list[float]:
        rows = []
        for test, x, one in zip(tests, clean, timings, strict=True):
            noise = test.position - x
            moved = np.roll(noise - noise.mean(), int(random.integers(noise.size))) if noisy else 0.0
            try:
                rows.append(classical(test._replace(position=x + moved), one))
            except RecordingError:  # the noise hides the rise or makes a false peak
                return [np.nan] * len(STAGE_PARAMETERS)
        mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
        return [*second_order(mean["overshoot"], mean["peak_time"]), mean["gain"]]

    exact = np.array(read(False))
    noisy = np.array([read(True) for _ in range(n)])
    truth = np.array([fit.values[name] for name in STAGE_PARAMETERS])
    columns = {
        "fitted": truth,
        "by_sensor": exact - truth,
        "by_noise": np.nanmean(noisy, axis=0) - exact,
        "scatter": np.nanstd(noisy, axis=0),
    }
    return xr.Dataset(
        {k: ("parameter", v) for k, v in columns.items()}, coords={"parameter": list(STAGE_PARAMETERS)}
    )
