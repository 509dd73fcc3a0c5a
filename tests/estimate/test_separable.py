"""The separable fit against the same problem searched in full."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.separable import Design, SeparableRecording, _root, separable

T = np.linspace(0, 3, 80)
RATE = Parameter("rate", 0.5, 1e-2, 1e2, "1/s")
FREQUENCY = Parameter("frequency", 6.0, 1.0, 20.0, "rad/s", log=False)


def basis(p):
    decay = np.exp(-p["rate"] * T)
    return np.stack([decay, decay * np.sin(p["frequency"] * T)], axis=1)


def design(p) -> Design:
    B = basis(p)
    by_frequency = np.exp(-p["rate"] * T) * T * np.cos(p["frequency"] * T)
    return Design(B, lambda x: np.stack([-T * (B @ x), x[1] * by_frequency], axis=1))


def recordings(seed: int):
    rng = np.random.default_rng(seed)
    noise = 0.02 * (1 + T)
    truth = {"rate": 0.8, "frequency": 6.5}
    return noise, [basis(truth) @ x + noise * rng.standard_normal(T.size) for x in ([1.0, 0.5], [-2.0, 1.0])]


@pytest.mark.parametrize(("known", "correlated"), [(False, False), (True, False), (False, True)])
def test_equals_the_full_problem(known: bool, correlated: bool) -> None:
    noise, ys = recordings(1)
    linear = [
        SeparableRecording(y, noise, ((f"a{i}", "m"), (f"b{i}", "m")), f"run {i}", "m")
        for i, y in enumerate(ys, 1)
    ]
    designs = lambda p: [design(p)] * 2  # noqa: E731
    fit = fit_least_squares(
        separable(linear, designs, [RATE, FREQUENCY], noise_known=known, correlated=correlated)
    )

    def residuals(i):
        return lambda p: basis(p) @ [p[f"a{i}"], p[f"b{i}"]] - ys[i - 1]

    names = ["a1", "b1", "a2", "b2"]
    free = [Parameter(name, 0.1, -math.inf, math.inf, "m", log=False) for name in names]
    full = fit_least_squares(
        [Residuals(residuals(i), ys[i - 1], noise, f"run {i}") for i in (1, 2)],
        [RATE, FREQUENCY, *free],
        noise_known=known,
        correlated=correlated,
    )
    assert list(fit.values) == list(full.values)
    assert fit.values == pytest.approx(full.values, rel=1e-6)
    errors = np.array(list(full.standard_errors.values()))
    assert fit.covariance / np.outer(errors, errors) == pytest.approx(
        full.covariance / np.outer(errors, errors), abs=2e-4
    )
    assert fit.degrees_of_freedom == full.degrees_of_freedom == 2 * T.size - 6
    assert fit.bic == pytest.approx(full.bic)
    assert fit.n_evaluations < 0.3 * full.n_evaluations


def test_parameter_at_a_bound_leaves_finite_coefficients() -> None:
    noise, ys = recordings(2)
    slow = Parameter("rate", 0.3, 1e-2, 0.5, "1/s")
    linear = [SeparableRecording(ys[0], noise, (("a", "m"), ("b", "m")), "run", "m")]
    fit = fit_least_squares(separable(linear, lambda p: [design(p)], [slow, FREQUENCY]))
    assert fit.values["rate"] == pytest.approx(0.5)
    assert math.isnan(fit.standard_errors["rate"])

    def at_bound(p):
        return [Design(basis({**p, "rate": 0.5}), lambda x: design({**p, "rate": 0.5}).tangent(x)[:, 1:])]

    held = fit_least_squares(separable(linear, at_bound, [FREQUENCY]))
    for name in ("frequency", "a", "b"):
        assert fit.values[name] == pytest.approx(held.values[name], rel=1e-5)
        assert fit.standard_errors[name] == pytest.approx(held.standard_errors[name], rel=0.02)


@pytest.mark.parametrize("seed", range(2))
def test_no_variance_of_a_nearly_singular_covariance_is_negative(seed: int) -> None:
    """Two rates that the data hardly tell apart: large variances, correlated to the last digit."""
    rng = np.random.default_rng(seed)
    together = rng.standard_normal(2) * 10.0 ** rng.uniform(-6, 6, 2)
    singular = np.outer(together, together)
    across = np.array([together[1], -together[0]]) * rng.uniform(0.5, 2.0, (200, 1))
    root = _root(singular)
    assert root @ root.T == pytest.approx(singular, rel=1e-12)
    assert np.all(
        np.square(across @ root).sum(axis=1)
        <= 1e-14 * np.diag(across @ np.diag(np.diag(singular)) @ across.T)
    )
    assert np.min(np.diag(across @ singular @ across.T)) < 0.0
