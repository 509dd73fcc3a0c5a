"""The least-squares engine against certified results, closed forms and repeated simulated experiments."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy import optimize, signal, stats

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import FitError, Residuals
from stickslip.estimate.search import SearchState
from stickslip.quantities.units import QuantityError

from . import nist

FREE = (-math.inf, math.inf)


def certified_fit(case: nist.Certified, start: list[float], log: bool, bounds=FREE, **options):
    x, y = np.array(case.x, dtype=float), np.array(case.y)
    low, high = (max(bounds[0], 0.0), bounds[1]) if log else bounds
    parameters = [Parameter(f"b{i}", b, low, high, log=log) for i, b in enumerate(start, 1)]
    return fit_least_squares([Residuals(lambda b: case.model(x, *b.values()) - y, y)], parameters, **options)


# Eckerle4's first start leads into another valley on the logarithmic scale: see the test of many starts.
CERTIFIED = [
    pytest.param(case, start, log, id=f"{case.name}-{i}-{'log' if log else 'linear'}")
    for case in nist.ALL
    for i, start in enumerate(case.starts, 1)
    for log in (False, True)
    if not (log and case is nist.ECKERLE4 and i == 1)
]


@pytest.mark.parametrize(("case", "start", "log"), CERTIFIED)
def test_certified_regressions(case: nist.Certified, start: list[float], log: bool) -> None:
    fit = certified_fit(case, start, log)
    assert fit.converged
    assert list(fit.values.values()) == pytest.approx(case.values, rel=2e-5)
    assert list(fit.standard_errors.values()) == pytest.approx(case.deviations, rel=1e-4)
    assert fit.recordings[0].sse == pytest.approx(case.residual_sum_of_squares, rel=1e-8)
    y = np.array(case.y)
    assert fit.r_squared == pytest.approx(1 - case.residual_sum_of_squares / np.sum((y - y.mean()) ** 2))


def line_problem(rng: np.random.Generator):
    x = np.linspace(-1.0, 2.0, 40)
    noise = 0.1 * (1 + x**2)
    y = 3.0 - 2.0 * x + noise * rng.standard_normal(x.size)
    design = np.stack([np.ones_like(x), x], axis=1)
    recording = Residuals(lambda p: p["a"] + p["b"] * x - y, y, noise, "line", "m")
    parameters = [Parameter("a", 1.0, *FREE, "m", log=False), Parameter("b", 1.0, *FREE, "m", log=False)]
    return design / noise[:, None], y / noise, noise, recording, parameters


@pytest.mark.parametrize("known", [False, True])
def test_linear_problem_has_the_closed_form(known: bool) -> None:
    A, b, noise, recording, parameters = line_problem(np.random.default_rng(1))
    solution, (chi_squared,), *_ = np.linalg.lstsq(A, b)
    scale = 1.0 if known else chi_squared / 38
    expected = np.linalg.inv(A.T @ A) * scale
    fit = fit_least_squares([recording], parameters, noise_known=known)
    assert list(fit.values.values()) == pytest.approx(solution, rel=1e-8)
    assert fit.covariance == pytest.approx(expected, rel=1e-6)
    assert fit.reduced_chi_squared == pytest.approx(chi_squared / 38)
    assert fit.correlation.sel(parameter="a", other="b").item() == pytest.approx(
        expected[0, 1] / math.sqrt(expected[0, 0] * expected[1, 1]), rel=1e-6
    )
    quantile = stats.norm.ppf(0.95) if known else stats.t.ppf(0.95, 38)
    half = quantile * math.sqrt(expected[1, 1])
    assert fit.confidence_intervals(0.9)["b"] == pytest.approx((solution[1] - half, solution[1] + half))
    level = 1.0 if known else math.sqrt(chi_squared / 40)
    likelihood = stats.norm.logpdf((A @ solution - b) * noise, scale=noise * level).sum()
    count = 2 if known else 3
    assert fit.aic == pytest.approx(2 * count - 2 * likelihood)
    assert fit.bic == pytest.approx(count * math.log(40) - 2 * likelihood)


def test_derived_quantity_has_the_propagated_error() -> None:
    *_, recording, parameters = line_problem(np.random.default_rng(2))
    fit = fit_least_squares([recording], parameters)
    zero, error = fit.derived(lambda p: -p["a"] / p["b"])
    a, b = fit.values.values()
    gradient = np.array([-1 / b, a / b**2])
    assert zero == pytest.approx(-a / b)
    assert error == pytest.approx(math.sqrt(gradient @ fit.covariance @ gradient), rel=1e-6)


def test_unit_of_the_data_does_not_matter() -> None:
    """Nanometres in metres: squares of 1e-18 must not look converged from the beginning."""
    t = np.linspace(0, 1, 50)
    y = 3e-9 * np.exp(-4 * t) + 1e-11 * np.sin(99 * t)
    parameters = [Parameter("height", 1e-7, 1e-12, 1e-3, "m"), Parameter("rate", 0.3, 1e-3, 1e3, "1/s")]

    def fit(unit: float):
        return fit_least_squares(
            lambda p: (p["height"] * np.exp(-p["rate"] * t) - y) * unit, parameters
        ).values

    assert fit(1.0) == pytest.approx(fit(1e9), rel=1e-7)
    assert fit(1.0)["rate"] == pytest.approx(4, rel=0.01)


def decay(rng: np.random.Generator, n: int = 60):
    t = np.linspace(0, 2, n)
    return t, 2.0 * np.exp(-1.5 * t) + 0.05 * rng.standard_normal(n)


DECAY = [Parameter("height", 1.0, 1e-3, 1e3), Parameter("rate", 1.0, 1e-3, 1e3)]


def test_standard_errors_are_the_scatter_of_repeated_experiments() -> None:
    rng = np.random.default_rng(3)
    off = []
    for _ in range(60):
        t, y = decay(rng)
        fit = fit_least_squares(lambda p, t=t, y=y: p["height"] * np.exp(-p["rate"] * t) - y, DECAY)
        off.append((fit.values["rate"] - 1.5) / fit.standard_errors["rate"])
    assert np.std(off) == pytest.approx(1.0, abs=0.27)  # three standard errors
    low, high = fit.confidence_intervals()["rate"]
    assert math.sqrt(low * high) == pytest.approx(fit.values["rate"])  # symmetric in the logarithm


def test_correlated_noise_is_only_covered_when_allowed_for() -> None:
    rng, t, held = np.random.default_rng(4), np.linspace(0, 1, 1500), []
    parameters = [Parameter("a", 1.0, *FREE, log=False), Parameter("b", 0.5, *FREE, log=False)]
    for _ in range(100):
        y = 2.0 + t + signal.lfilter([1.0], [1.0, -0.9], 0.05 * rng.standard_normal(2000))[500:]
        plain, allowed = (
            fit_least_squares(lambda p, y=y: p["a"] + p["b"] * t - y, parameters, correlated=correlated)
            for correlated in (False, True)
        )
        ends = [fit.confidence_intervals()["b"] for fit in (plain, allowed)]
        held.append([low <= 1.0 <= high for low, high in ends])
    assert np.mean(held, axis=0)[0] < 0.6
    assert np.mean(held, axis=0)[1] > 0.86
    assert plain.recordings[0].lag_one_correlation == pytest.approx(0.9, abs=0.05)
    assert "they are too narrow" in plain.report()
    assert "they are too narrow" not in allowed.report()


def test_undetermined_parameter_is_named_with_the_values_that_fit_as_well() -> None:
    """A damper that hardly moves: the record says only that it is small."""
    rng = np.random.default_rng(6)
    x = np.linspace(0, 1, 100)
    y = 3.0 * x + 0.02 * rng.standard_normal(100)
    wobble = 1e-3 * np.cos(20 * x)

    def residuals(p):
        return p["stiffness"] * x + p["sigma_1"] * wobble - y

    sigma_1 = Parameter("sigma_1", 1.0, 0.0, 1e4, "N s/m", log=False)
    fit = fit_least_squares(residuals, [Parameter("stiffness", 1.0, 0.01, 100, "N/m"), sigma_1])
    low, high = fit.confidence_intervals()["sigma_1"]
    assert low == 0.0
    assert fit.undetermined == (
        f"sigma_1 is not determined by these recordings: any value from 0 to {high:.3g} N s/m fits as well",
    )
    # It is true: with sigma_1 held there, the rest fits within the F-test's limit, and beyond it does not.
    best = fit.recordings[0].sse
    limit = best * (1 + stats.f.ppf(0.95, 1, 98) / 98)

    def sse_with(held: float) -> float:
        stiffness = Parameter("stiffness", 1.0, 0.01, 100, "N/m")
        return fit_least_squares(lambda p: residuals({**p, "sigma_1": held}), [stiffness]).recordings[0].sse

    assert sse_with(0.95 * high) < limit < sse_with(1.3 * high)


def test_parameter_without_any_effect_and_parameters_that_only_act_together() -> None:
    t, y = decay(np.random.default_rng(7))
    idle = [*DECAY, Parameter("idle", 5.0, 1.0, 80.0, "N")]
    fit = fit_least_squares(lambda p: p["height"] * np.exp(-p["rate"] * t) - y, idle)
    assert fit.standard_errors["idle"] == math.inf
    assert fit.confidence_intervals()["idle"] == (1.0, 80.0)
    assert fit.undetermined == (
        "idle is not determined by these recordings: any value from 1 N to 80 N fits as well",
    )
    alone = fit_least_squares(lambda p: p["height"] * np.exp(-p["rate"] * t) - y, DECAY)
    assert fit.standard_errors["rate"] == pytest.approx(alone.standard_errors["rate"], rel=0.02)

    split = [DECAY[1], Parameter("area", 1.0, 1e-3, 1e3), Parameter("pressure", 1.0, 1e-3, 1e3)]
    fit = fit_least_squares(lambda p: p["area"] * p["pressure"] * np.exp(-p["rate"] * t) - y, split)
    assert [sentence.split()[0] for sentence in fit.undetermined] == ["area", "pressure"]
    assert fit.values["area"] * fit.values["pressure"] == pytest.approx(alone.values["height"], rel=1e-5)


def test_parameters_that_are_hard_to_tell_apart_are_named() -> None:
    x = np.linspace(10, 11, 50)
    y = 1 + 2 * x + 0.001 * np.cos(50 * x)
    parameters = [Parameter("offset", 1.0, -9, 9, log=False), Parameter("slope", 1.0, -9, 9, log=False)]
    fit = fit_least_squares(lambda p: p["offset"] + p["slope"] * x - y, parameters)
    (sentence,) = fit.undetermined
    assert sentence.startswith("offset and slope are hard to tell apart")


def test_active_bound() -> None:
    x = np.linspace(0, 1, 30)
    y = -0.1 + 2 * x + 0.05 * np.cos(40 * x)
    parameters = [Parameter("a", 0.5, 0.0, 10, "m", log=False), Parameter("b", 1.0, *FREE, log=False)]
    fit = fit_least_squares(lambda p: p["a"] + p["b"] * x - y, parameters)
    expected = optimize.nnls(np.stack([np.ones_like(x), x], axis=1), y)[0]
    assert fit.values["a"] == 0.0
    assert fit.values["b"] == pytest.approx(expected[1], rel=1e-6)
    assert math.isnan(fit.standard_errors["a"])
    alone = fit_least_squares(lambda p: p["b"] * x - y, parameters[1:])
    ratio = fit.standard_errors["b"] / alone.standard_errors["b"]
    assert ratio == pytest.approx(math.sqrt(29 / 28), rel=1e-5)  # the bounded one still costs a degree
    low, high = fit.confidence_intervals()["a"]
    assert low == 0.0
    # Where the sum of squares, b fitted anew, has risen by t^2 of the noise.
    held = fit_least_squares(lambda p: high + p["b"] * x - y, parameters[1:])
    rise = (held.recordings[0].sse - fit.recordings[0].sse) / fit.reduced_chi_squared
    assert rise == pytest.approx(stats.t.ppf(0.975, 28) ** 2, rel=1e-4)
    assert "any value from 0 to" in fit.undetermined[0]


def test_upper_bound_on_a_log_scale() -> None:
    t, y = decay(np.random.default_rng(8))
    slow = [DECAY[0], Parameter("rate", 0.5, 1e-3, 1.2, "1/s")]
    fit = fit_least_squares(lambda p: p["height"] * np.exp(-p["rate"] * t) - y, slow)
    assert fit.values["rate"] == pytest.approx(1.2)
    assert fit.confidence_intervals()["rate"][1] == pytest.approx(1.2)
    assert fit.undetermined[0].startswith("rate ended at its bound 1.2 1/s")


def test_many_starts_escape_the_wrong_minimum() -> None:
    t = np.linspace(0, 1, 100)
    y = np.sin(2 * np.pi * 7 * t) + 0.1 * np.random.default_rng(14).standard_normal(t.size)

    def fit(starts: int):
        frequency = Parameter("frequency", 3.0, 1.0, 20.0, "Hz")
        return fit_least_squares(
            lambda p: np.sin(2 * np.pi * p["frequency"] * t) - y, [frequency], starts=starts, seed=1
        )

    assert fit(1).values["frequency"] < 4
    many = fit(40)
    assert many.values["frequency"] == pytest.approx(7, abs=0.02)
    assert many.starts == 40
    assert 1 < many.starts_agreeing < 20
    assert many.doubt == f"several local minima: {many.starts_agreeing} of 40 searches ended in the lowest"
    assert fit(1).doubt == ""
    assert fit(40).values == many.values


@pytest.mark.parametrize("loss", ["soft_l1", "arctan"])
def test_robust_loss(loss: str) -> None:
    rng = np.random.default_rng(9)
    fits, plain = [], []
    for _ in range(40):
        t, y = decay(rng)
        y[rng.choice(t.size, 5, replace=False)] += 1.0
        recording = [Residuals(lambda p, t=t, y=y: p["height"] * np.exp(-p["rate"] * t) - y, y, 0.05)]
        fits.append(fit_least_squares(recording, DECAY, loss=loss, loss_scale=1.5))
        plain.append(fit_least_squares(recording, DECAY))

    def error(fits):
        return np.mean([abs(f.values["rate"] - 1.5) for f in fits])

    assert error(fits) < 0.3 * error(plain)
    spread = np.std([f.values["rate"] for f in fits])
    assert np.mean([f.standard_errors["rate"] for f in fits]) == pytest.approx(spread, rel=0.3)
    assert math.isnan(fits[0].aic)


def test_robust_loss_and_correlation_go_together() -> None:
    """White noise with outliers: allowing for correlation finds none, and the M-estimator's errors remain."""
    rng = np.random.default_rng(15)
    ratios = []
    for _ in range(6):
        t, y = decay(rng, 400)
        y[rng.choice(t.size, 60, replace=False)] += 1.0
        recording = [Residuals(lambda p, t=t, y=y: p["height"] * np.exp(-p["rate"] * t) - y, y, 0.05)]
        white, allowed = (
            fit_least_squares(recording, DECAY, loss="soft_l1", correlated=correlated)
            for correlated in (False, True)
        )
        ratios.append(allowed.standard_errors["rate"] / white.standard_errors["rate"])
    assert np.mean(ratios) == pytest.approx(1, abs=0.1)


def test_several_recordings_with_their_own_noise() -> None:
    rng = np.random.default_rng(10)
    x = np.linspace(0, 1, 50)
    good, bad = 2 * x + 0.01 * rng.standard_normal(50), 2 * x + 1 + 1.0 * rng.standard_normal(50)
    fit = fit_least_squares(
        [
            Residuals(lambda p: p["slope"] * x - good, good, 0.01, "good", "m"),
            Residuals(lambda p: p["slope"] * x - bad, bad, 1.0, "bad", "m"),
        ],
        [Parameter("slope", 1.0, 0.1, 10)],
    )
    weights = np.concatenate([np.full(50, 1e4), np.ones(50)])
    xx, yy = np.tile(x, 2), np.concatenate([good, bad])
    slope = np.sum(weights * xx * yy) / np.sum(weights * xx**2)
    assert fit.values["slope"] == pytest.approx(slope)
    assert [g.name for g in fit.recordings] == ["good", "bad"]
    errors = [np.sum((slope * x - y) ** 2) for y in (good, bad)]
    totals = [np.sum((y - y.mean()) ** 2) for y in (good, bad)]
    for g, sse, sst in zip(fit.recordings, errors, totals, strict=True):
        assert g.r_squared == pytest.approx(1 - sse / sst)
        assert g.rmse == pytest.approx(math.sqrt(sse / 50))
    assert fit.r_squared == pytest.approx(1 - sum(errors) / sum(totals))


def test_given_jacobian_saves_evaluations() -> None:
    t, y = decay(np.random.default_rng(11))

    def jacobian(p):
        e = np.exp(-p["rate"] * t)
        return np.stack([e, -p["height"] * t * e], axis=1)

    def residuals(p):
        return p["height"] * np.exp(-p["rate"] * t) - y

    with_it = fit_least_squares(residuals, DECAY, jacobian=jacobian)
    without = fit_least_squares(residuals, DECAY)
    assert with_it.values == pytest.approx(without.values, rel=1e-6)
    assert with_it.standard_errors == pytest.approx(without.standard_errors, rel=1e-5)
    assert with_it.n_evaluations < 0.5 * without.n_evaluations


def test_derivatives_that_fail_somewhere_are_replaced_by_differences() -> None:
    x = np.linspace(0.0, 1.0, 30)
    y = np.exp(-2.0 * x)
    failed = []

    def jacobian(p):
        if p["rate"] < 1.0:  # where the search begins
            failed.append(p["rate"])
            return np.full((x.size, 1), math.nan)
        return (-x * np.exp(-p["rate"] * x))[:, None]

    start = [Parameter("rate", 0.1, *FREE, "1/s", log=False)]
    fit = fit_least_squares([Residuals(lambda p: np.exp(-p["rate"] * x) - y, y)], start, jacobian=jacobian)
    assert failed
    assert fit.values["rate"] == pytest.approx(2.0, rel=1e-8)


def test_progress_budget_and_a_model_that_fails_at_trial_points() -> None:
    t, y = decay(np.random.default_rng(12))
    seen: list[SearchState] = []
    refused = []

    def residuals(p):
        if p["rate"] > 1.7:
            refused.append(p["rate"])
            raise ValueError("the solver gave up")
        return p["height"] * np.exp(-p["rate"] * t) - y

    # Next to the edge: even the first difference step is refused on one side.
    edge = Parameter("rate", 1.69995, 1e-3, 1e3)
    fit = fit_least_squares(residuals, [DECAY[0], edge], each=seen.append)
    assert refused
    assert fit.values["rate"] == pytest.approx(1.5, rel=0.1)
    assert [p.evaluations for p in seen] == sorted({p.evaluations for p in seen})
    squares = [p.sum_of_squares for p in seen]
    assert squares == sorted(squares, reverse=True)
    assert squares[-1] == pytest.approx(fit.recordings[0].sse, rel=1e-9)

    short = fit_least_squares(residuals, [DECAY[0], edge], max_evaluations=7)
    assert not short.converged
    assert short.message == "stopped after 7 evaluations"
    assert "NOT CONVERGED" in short.report()
    assert short.doubt == "not converged: stopped after 7 evaluations"


def test_failure_at_the_start_names_the_values() -> None:
    def nowhere(p):
        return np.full(9, np.nan)

    def refuses(p):
        raise ValueError("stiction below Coulomb friction")

    parameters = [Parameter("force", 0.5, 0.1, 1.0, "N")]
    with pytest.raises(FitError, match=r"not finite at force = 0\.5 N"):
        fit_least_squares(nowhere, parameters)
    with pytest.raises(FitError, match=r"at force = 0\.5 N: stiction below"):
        fit_least_squares(refuses, parameters)


@pytest.mark.parametrize(
    ("recordings", "parameters", "options", "text"),
    [
        (lambda p: np.ones(9), [], {}, "at least one"),
        (lambda p: np.ones(9), [DECAY[0], DECAY[0]], {}, "names of their own"),
        (lambda p: np.ones(2), DECAY, {}, "2 data cannot determine 2 parameters"),
        (lambda p: np.ones(9), DECAY, {"n_eliminated": 7}, "9 data cannot determine 9 parameters"),
        (lambda p: np.ones(9), DECAY, {"loss": "hubert"}, "no loss 'hubert'"),
        (lambda p: np.ones(9), [Parameter("a", 1.0, 0.0, 9)], {"starts": 3}, "finite bounds"),
        ([Residuals(lambda p: np.ones(9), noise=0.0)], DECAY, {}, "noise of a recording must be > 0"),
        (
            [Residuals(lambda p: np.ones(9), noise=1.0), Residuals(lambda p: np.ones(9))],
            DECAY,
            {},
            "of every recording, or of none",
        ),
    ],
)
def test_refusals(recordings, parameters, options, text: str) -> None:
    with pytest.raises(FitError, match=text):
        fit_least_squares(recordings, parameters, **options)


@pytest.mark.parametrize(
    ("start", "lower", "upper", "log"),
    [
        (0.0, 0.0, 1.0, True),
        (3.0, 1.0, 2.0, False),
        (1.0, 1.0, 1.0, False),
        (math.nan, 0.0, 1.0, False),
    ],
)
def test_parameter_out_of_range(start: float, lower: float, upper: float, log: bool) -> None:
    with pytest.raises(QuantityError, match=r"sigma_0.*N/m.*out of range"):
        Parameter("sigma_0", start, lower, upper, "N/m", log)


def test_report_and_results_say_values_units_and_doubts() -> None:
    t, y = decay(np.random.default_rng(13))
    parameters = [Parameter("height", 1.0, 1e-3, 1e3, "m"), DECAY[1], Parameter("idle", 5.0, 1.0, 80.0, "N")]
    recording = Residuals(lambda p: p["height"] * np.exp(-p["rate"] * t) - y, y, None, "run 7", "m")
    fit = fit_least_squares([recording], parameters, starts=3)
    text = fit.report()
    for part in (f"{fit.values['height']:.6g}", "run 7", "of 3 searches", "converged", *fit.undetermined):
        assert part in text
    found = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
    assert found["parameters"]["height"]["unit"] == "m"
    assert found["parameters"]["height"]["value"] == fit.values["height"]
    assert found["parameters"]["idle"]["standard_error"] is None
    assert found["recordings"]["run 7"]["rmse"] == fit.rmse
    assert found["undetermined"] == list(fit.undetermined)


@pytest.mark.parametrize("known", [False, True])
def test_the_reduced_chi_squared_is_told_only_with_the_noise(known: bool) -> None:
    """Otherwise it is a variance in the squared unit of the data."""
    *_, recording, parameters = line_problem(np.random.default_rng(1))
    fit = fit_least_squares([recording], parameters, noise_known=known)
    assert (f"reduced chi-squared {fit.reduced_chi_squared:.4g}, AIC" in fit.report()) == known
    assert ("chi-squared" in fit.report()) == known
    assert fit.to_dict()["reduced_chi_squared"] == (fit.reduced_chi_squared if known else None)


def wavy(noise: float):
    """Data with valleys of the sum of squares beside the deepest one, which is at 2.3."""
    t = np.linspace(0.0, 6.0, 400)
    measured = np.sin(2.3 * t) + np.random.default_rng(3).normal(0.0, noise, t.size)
    return lambda values: np.sin(values["omega"] * t) - measured


def test_hops_find_the_lowest_minimum() -> None:
    omega = Parameter("omega", 9.0, 0.3, 30.0)
    stuck = fit_least_squares(wavy(0.1), [omega])
    assert abs(stuck.values["omega"] - 2.3) > 1.0
    found = fit_least_squares(wavy(0.1), [omega], hops=4)
    assert found.values["omega"] == pytest.approx(2.3, abs=0.02)


def test_a_prior_is_a_datum_more() -> None:
    """Of a straight line through noise: the estimate is the weighted mean of what data and prior say."""
    x = np.linspace(0.0, 1.0, 50)
    y = 2.0 * x + 0.1 * np.random.default_rng(0).standard_normal(x.size)
    recording = [Residuals(lambda p: p["slope"] * x - y, y, 0.1)]
    free = Parameter("slope", 1.0, 0.0, 9.0, "m/s", log=False)
    alone = fit_least_squares(recording, [free], noise_known=True)
    weights = np.array([np.sum(x**2) / 0.1**2, 1.0 / 0.05**2])
    expected = weights @ [alone.values["slope"], 3.0] / weights.sum()
    for jacobian in (None, lambda p: x[:, None]):
        prior = free._replace(prior=(3.0, 0.05))
        fit = fit_least_squares(recording, [prior], noise_known=True, jacobian=jacobian)
        assert fit.values["slope"] == pytest.approx(expected, rel=1e-6)
        assert fit.standard_errors["slope"] == pytest.approx(weights.sum() ** -0.5, rel=1e-6)
        assert fit.jacobian is not None
        assert fit.jacobian.shape == (50, 1)
        assert fit.residuals[0].size == 50
        assert fit.cost > alone.cost
        assert fit.n_estimated == pytest.approx(weights[0] / weights.sum(), rel=1e-6)
    for spread, of_data in ((1e4, 1.0), (1e-5, 0.0)):  # a prior that says nothing, one that says all
        fit = fit_least_squares(recording, [free._replace(prior=(2.0, spread))], noise_known=True)
        assert fit.aic == pytest.approx(2.0 * of_data - 2.0 * fit.log_likelihood, abs=1e-3)
    logarithmic = Parameter("slope", 1.0, 0.1, 9.0, "m/s", prior=(3.0, 0.05))
    fit = fit_least_squares(recording, [logarithmic], noise_known=True)
    assert alone.values["slope"] < fit.values["slope"] < 3.0
    assert fit.values["slope"] == pytest.approx(expected, rel=0.05)


def test_a_prior_wants_a_known_noise_and_a_place_within_the_bounds() -> None:
    free = Parameter("a", 1.0, 0.1, 9.0, "N", prior=(2.0, 0.1))
    with pytest.raises(FitError, match="a prior weighs against the noise"):
        fit_least_squares(lambda p: np.arange(5.0) - p["a"], [free])
    for prior in ((10.0, 0.1), (2.0, 0.0), (2.0, -1.0)):
        with pytest.raises(QuantityError, match="prior of a is out of range"):
            Parameter("a", 1.0, 0.1, 9.0, "N", prior=prior)
