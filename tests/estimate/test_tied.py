"""Parameters that are tied to others, or fixed: against fits in which they were put in by hand."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import FitError, Problem, Residuals
from stickslip.estimate.result import Fit
from stickslip.estimate.tied import Ties, names_in
from stickslip.quantities.units import QuantityError

T = np.linspace(0.0, 1.0, 60)
A, B = Parameter("a", 1.0, 0.1, 10.0, "N"), Parameter("b", 2.0, 0.1, 10.0, "N")
STIFF, ZETA = Parameter("k", 4.0, 1.0, 9.0, "N/m"), Parameter("z", 0.3, 0.1, 1.0)
MASS = Parameter("m", 0.1, unit="kg", fixed=True)


def noisy(seed: int = 0) -> np.ndarray:
    """2 exp(-t) + 3 t, with noise."""
    return 2.0 * np.exp(-T) + 3.0 * T + 0.05 * np.random.default_rng(seed).standard_normal(T.size)


def line(*parameters: Parameter, seed: int = 0, exact: bool = False, **about) -> Fit:
    """a exp(-t) + b t; with its derivatives by a and b where `exact`."""
    y = noisy(seed)
    columns = np.column_stack([np.exp(-T), T])
    residuals = Residuals(lambda v: v["a"] * np.exp(-T) + v["b"] * T - y, y, None, "line", "N")
    jacobian = (lambda v: columns) if exact else None
    return fit_least_squares([residuals], parameters, jacobian=jacobian, **about)


@pytest.mark.parametrize("exact", [False, True], ids=["differences", "jacobian"])
def test_a_factor_is_as_if_put_in_by_hand(exact: bool) -> None:
    """b = 1.5 a leaves a line through the origin: closed form."""
    fit = line(A, Parameter("b", tied="1.5 * a", unit="N"), exact=exact)
    x, y = np.exp(-T) + 1.5 * T, noisy()
    a = float(x @ y / (x @ x))
    error = math.sqrt(np.sum((y - a * x) ** 2) / (T.size - 1) / (x @ x))
    assert fit.values == pytest.approx({"a": a, "b": 1.5 * a}, rel=1e-6)
    assert fit.standard_errors == pytest.approx({"a": error, "b": 1.5 * error}, rel=1e-4)
    ends = fit.confidence_intervals()
    assert ends["b"] == pytest.approx([1.5 * end for end in ends["a"]], rel=1e-9)
    assert [p.name for p in fit.parameters] == ["a"]
    assert fit.degrees_of_freedom == T.size - 1


def test_the_standard_error_of_an_expression_is_its_scatter() -> None:
    """c = 0.1 sqrt(b^3 / a), which the data do not see, over repeated experiments."""
    c = Parameter("c", tied="0.1 * sqrt(b**3 / a)", unit="N")
    fits = [line(A, B, c, seed=seed) for seed in range(60)]
    spread = np.std([fit.values["c"] for fit in fits], ddof=1)
    # A deviation of 60 samples is known to 9 %.
    assert np.mean([fit.standard_errors["c"] for fit in fits]) == pytest.approx(spread, rel=0.2)
    true = 0.1 * math.sqrt(27.0 / 2.0)
    inside = [low < true < high for low, high in (fit.confidence_intervals()["c"] for fit in fits)]
    assert np.mean(inside) > 0.89


def test_ties_follow_each_other_in_any_order() -> None:
    fit = line(Parameter("a", tied="c / 2", unit="N"), Parameter("c", tied="b", unit="N"), B)
    assert fit.values["a"] == pytest.approx(0.5 * fit.values["b"], rel=1e-12)
    direct = line(Parameter("a", tied="0.5 * b", unit="N"), B)
    assert fit.values["b"] == pytest.approx(direct.values["b"], rel=1e-9)
    assert fit.standard_errors["a"] == pytest.approx(0.5 * direct.standard_errors["b"], rel=1e-6)


def test_a_fixed_one_keeps_its_value_and_has_no_error() -> None:
    fit = line(A, Parameter("b", 3.0, unit="N", fixed=True))
    assert fit.values["b"] == 3.0
    assert fit.standard_errors["b"] == 0.0
    assert fit.confidence_intervals()["b"] == (3.0, 3.0)
    x = np.exp(-T)
    assert fit.values["a"] == pytest.approx(float(x @ (noisy() - 3.0 * T) / (x @ x)), rel=1e-6)


def test_what_hangs_on_a_bound_ends_there_too() -> None:
    fit = line(A._replace(upper=1.5), B, Parameter("c", tied="-2 * a", unit="N"), exact=False)
    low, high = fit.confidence_intervals()["a"]
    assert high == 1.5
    assert fit.confidence_intervals()["c"] == pytest.approx((-3.0, -2.0 * low), rel=1e-3)
    assert math.isnan(fit.standard_errors["c"])


def test_what_hangs_on_nothing_that_is_seen_is_open() -> None:
    blind = Parameter("z", 0.3, 0.1, 1.0)
    y = noisy()
    residuals = Residuals(lambda v: v["a"] * np.exp(-T) + 3.0 * T - y, y)
    fit = fit_least_squares([residuals], [A, blind, Parameter("d", tied="a * z", unit="N")])
    assert fit.standard_errors["d"] == math.inf
    assert any("z is not determined" in said for said in fit.undetermined)


def test_it_is_shown_saved_and_pickled(tmp_path: Path) -> None:
    fit = line(A, Parameter("b", tied="1.5 * a", unit="N"), Parameter("m", 0.1, unit="kg", fixed=True))
    assert "(tied: 1.5 * a)" in fit.summary
    assert "N (tied: 1.5 * a)" in fit.report()
    assert "kg (fixed)" in fit.report()
    assert "tied: 1.5 * a" in fit._repr_html_()
    told = json.loads(json.dumps(fit.to_dict()))["parameters"]
    assert told["b"]["tied"] == "1.5 * a"
    assert told["m"]["fixed"] is True
    assert "tied" not in told["a"]
    assert told["b"]["standard_error"] == pytest.approx(1.5 * told["a"]["standard_error"], rel=1e-9)
    ss.save_fit(fit, tmp_path / "fit.json")
    for back in (ss.load_fit(tmp_path / "fit.json"), pickle.loads(pickle.dumps(fit))):
        assert back.report() == fit.report()
        assert back.tied == {"b": "1.5 * a"}


def test_a_quantity_of_fit_values_knows_the_ties() -> None:
    fit = line(A, Parameter("b", tied="1.5 * a", unit="N"))
    value, error = fit.derived(lambda v: v["a"] + v["b"])
    assert value == pytest.approx(2.5 * fit.values["a"])
    assert error == pytest.approx(2.5 * fit.standard_errors["a"], rel=1e-6)


@pytest.mark.parametrize(
    ("expression", "slopes"),
    [
        ("2 * z * sqrt(k * m)", (0.3 * math.sqrt(0.1 / 4.0), 2.0 * math.sqrt(0.4))),
        ("'0.1 ms' * k", (1e-4, 0.0)),
        ("'2 N s/m' * exp(-z) * k ** 2 / '1 N/m' ** 2", (16.0 * math.exp(-0.3), -32.0 * math.exp(-0.3))),
        ("-'3 N s/m' * log(z + 1) / pi", (0.0, -3.0 / 1.3 / math.pi)),
    ],
)
def test_derivatives_have_no_error(expression: str, slopes: tuple[float, float]) -> None:
    ties = Ties([STIFF, ZETA, MASS, Parameter("c", tied=expression, unit="N s/m")])
    found = ties.slopes(ties({"k": 4.0, "z": 0.3}), ["k", "z"], ["c"])
    assert found[0] == pytest.approx(slopes, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize("value", [0.0, 5e-324])
def test_derivatives_by_next_to_nothing_are_finite(value: float) -> None:
    """Of a sum one addend may have been driven to its bound: 5e-324 is the least number above 0."""
    ties = Ties([A._replace(lower=0.0), B, Parameter("c", tied="a + b", unit="N")])
    found = ties.slopes(ties({"a": value, "b": 2.0}), ["a", "b"], ["c"])
    np.testing.assert_allclose(found[0], [1.0, 1.0])


@pytest.mark.parametrize(
    ("tied", "words"),
    [
        (
            "1.5 * aa",
            r"b is tied to '1.5 \* aa', but there is no 'aa' \(did you mean 'a'\?\): there are a, k",
        ),
        ("k", r"b \[N\] is tied to 'k', which is in newton / meter: a factor with a unit goes in quotes"),
        ("a + 1", "b is tied to 'a \\+ 1', whose units do not fit"),
        ("exp(a)", "whose units do not fit"),
        ("'1 foo' * k", "which has the unknown unit 'foo'"),
        ("2 *", "cannot be read"),
        ("a.real", "'a.real' is not one of: numbers, names"),
        ("__import__('os').getcwd()", "is not one of: numbers, names"),
        ("True * a", "'True' is not one of: numbers, names"),
        ("a" + " + a" * 100, "at most 300 characters"),
        ("b", "tied in a circle: b -> b"),
    ],
)
def test_wrong_expressions_are_refused(tied: str, words: str) -> None:
    with pytest.raises(QuantityError, match=words):
        Ties([A, STIFF, Parameter("b", tied=tied, unit="N")])


def test_circles_and_contradictions_are_refused() -> None:
    with pytest.raises(QuantityError, match="in a circle: b -> c -> b"):
        Ties([Parameter("b", tied="c", unit="N"), Parameter("c", tied="b", unit="N")])
    with pytest.raises(QuantityError, match="b is fixed, and tied to 'a': it can be one of both"):
        Parameter("b", 1.0, fixed=True, tied="a")
    with pytest.raises(QuantityError, match="b is tied and has a prior"):
        Parameter("b", tied="a", prior=(1.0, 0.1))
    with pytest.raises(QuantityError, match="b is tied to 'a' and has bounds"):
        Parameter("b", lower=0.0, tied="a")
    with pytest.raises(QuantityError, match="b is fixed at nan N: it must be finite"):
        Parameter("b", unit="N", fixed=True)
    with pytest.raises(FitError, match="at least one must be free"):
        line(Parameter("a", 2.0, unit="N", fixed=True), Parameter("b", tied="a", unit="N"))
    with pytest.raises(FitError, match="names of their own"):
        line(A, Parameter("a", 1.0, unit="N", fixed=True))


def test_what_is_no_number_at_the_start_is_refused() -> None:
    with pytest.raises(FitError, match=r"at a = 1 N: b, tied to .*, is -inf N"):
        line(A, Parameter("b", tied="'1 N' * log(1 - a / '1 N')", unit="N"))


def test_names_are_those_of_parameters() -> None:
    assert names_in("2 * pi * sqrt(a / b) + a", "c") == ["a", "b"]


def test_the_values_of_a_problem_have_those_that_are_searched_for_first() -> None:
    parts = [Residuals(lambda v: v["a"] * T + v["b"])]
    problem = Problem(parts, [Parameter("b", tied="a", unit="N"), A])
    assert list(problem.values(problem.start)) == ["a", "b"]
