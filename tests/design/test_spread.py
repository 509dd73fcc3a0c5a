"""Intervals of the step: by derivatives, by samples, and what no interval is made of."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.design.solving import intervals
from stickslip.estimate import Fit, Parameter, Posterior, Residuals, fit_least_squares
from stickslip.quantities.units import QuantityError
from stickslip.simulation import SimulationWarning
from stickslip.simulation.varied import with_values
from stickslip.study import drawn_parameters

KANG = ss.load_actuator("kang2007")
TRUE = {"sigma_0": 1.399e6, "coulomb_force": 0.5401}
DRIVE = ss.Sawtooth(65.0, 50.0)


def fitted(deviations: tuple[float, float] = (0.02, 0.01), correlation: float = 0.8, **more: float) -> Fit:
    """With these relative standard errors, exactly at `TRUE`, by data that are linear in the logarithms."""
    spread = np.diag(deviations) @ [[1.0, correlation], [correlation, 1.0]] @ np.diag(deviations)
    rows = np.linalg.inv(np.linalg.cholesky(spread))
    names = [*TRUE, *more]
    rows = np.pad(rows, (0, len(more)))
    rows[2:, 2:] = 100.0 * np.eye(len(more))
    start = TRUE | more

    def residuals(values: dict[str, float]) -> np.ndarray:
        q = np.array([np.log(values[name] / start[name]) for name in names])
        return np.append(rows @ q, [0.0, 0.0])

    parameters = [Parameter(name, 1.001 * start[name], 0.0, np.inf) for name in names]
    data = [Residuals(residuals, None, 1.0)]
    return fit_least_squares(data, parameters, noise_known=True)


def model_of(fit: Fit) -> ss.Actuator:
    return with_values(KANG, {name: fit.values[name] for name in TRUE})


def test_interval_is_that_of_the_derivatives() -> None:
    fit = fitted(delay=1e-3)  # which no model has: of a channel
    model = model_of(fit)
    found = ss.step_map(model, DRIVE, load=[0.0, -0.1], direction=[1, -1], fit=fit, draws=500)
    assert found.attrs["draws"] == 500
    for load, way in ((0.0, 1.0), (-0.1, 1.0), (-0.1, -1.0)):
        at = found.sel(load=load, direction=way)
        drive = DRIVE if way > 0 else DRIVE._replace(amplitude=-65.0, offset=65.0)
        slopes = []
        for name, value in fit.values.items():
            if name in TRUE:
                ends = [
                    ss.steady_step(with_values(model, {name: value * s}).replace(external_force=load), drive)
                    for s in (1.001, 0.999)
                ]
                slopes.append((ends[0] - ends[1]) / 0.002)
        known = fit.uncertainty.covariance[:2, :2]
        half = float(1.96 * np.sqrt(np.array(slopes) @ known @ slopes))
        width = float(at.net_step_high - at.net_step_low)
        assert width == pytest.approx(2.0 * half, rel=0.12)
        middle = 0.5 * float(at.net_step_high + at.net_step_low)
        assert middle == pytest.approx(float(at.net_step), abs=0.1 * half)
        assert float(at.speed_low) == pytest.approx(50.0 * float(at.net_step_low))
    assert np.all(found.draws_converged == 500)


def test_interval_of_a_posterior_is_that_of_its_samples() -> None:
    rng = np.random.default_rng(0)
    chains = np.exp(np.log(TRUE["coulomb_force"]) + 0.05 * rng.standard_normal((2, 400)))
    dims = ("chain", "draw")
    samples = xr.Dataset({"coulomb_force": (dims, chains), "log_posterior": (dims, 0.0 * chains)})
    source = Posterior(samples, xr.Dataset(), True, "", 0.5)
    found = ss.step_map(KANG, DRIVE, load=0.0, fit=source, draws=800, seed=3)
    steps = ss.steady_steps(KANG, DRIVE, parameters={"coulomb_force": chains.ravel()}).net_step.values
    ends = np.quantile(steps, [0.025, 0.975])
    both = [float(found.net_step_low), float(found.net_step_high)]
    np.testing.assert_allclose(both, ends, atol=0.12 * np.diff(ends).item())


def test_the_same_seed_gives_the_same_interval_whatever_the_threads() -> None:
    fit = fitted()
    one, other, last = (
        ss.step_map(model_of(fit), DRIVE, load=[0.0, 0.1], fit=fit, draws=60, seed=s, threads=t)
        for s, t in ((1, 1), (1, 2), (2, 1))
    )
    assert one.identical(other)
    assert not np.array_equal(one.net_step_low, last.net_step_low)


def test_draws_without_a_step_leave_no_interval() -> None:
    """Where a load slides away with a fifth of the draws."""
    draws = {"coulomb_force": np.append(np.full(80, 0.54), np.full(20, 0.2))}
    columns = {"external_force": np.array([0.0, -0.3])}
    low, high, count, stopped = intervals(
        (KANG, DRIVE, columns, 1e-9, 1.0, None, None), draws, lambda doing, done: None
    )
    assert count.tolist() == [100, 80]
    assert not stopped
    assert np.isfinite(low[0])
    assert np.isnan([low[1], high[1]]).all()


def test_draws_before_an_interruption_are_no_interval_alone() -> None:
    told: list[float] = []

    def stop(doing: str, done: float) -> None:
        told.append(done)
        if done > 0.3:
            raise KeyboardInterrupt

    fit = fitted()
    with pytest.warns(SimulationWarning, match="stopped: the draws"):
        found = ss.step_map(model_of(fit), DRIVE, load=np.linspace(0.0, 0.1, 32), fit=fit, progress=stop)
    assert found.attrs["interrupted"] == 1
    assert np.all(found.status == 0)
    assert np.all(np.isnan(found.net_step_low))


def test_what_no_interval_is_made_of() -> None:
    fit = fitted()
    model = model_of(fit)
    with pytest.raises(QuantityError, match="the model has sigma_0"):
        ss.step_map(KANG.replace(friction=KANG.friction._replace(sigma_0=2e6)), DRIVE, load=0.0, fit=fit)
    with pytest.raises(QuantityError, match="'sigma_0' varies over the map"):
        ss.step_map(model, DRIVE, parameters={"sigma_0": [1e6]}, fit=fit)
    with pytest.raises(QuantityError, match="none of which the model has"):
        ss.step_map(model.replace(friction=ss.Coulomb(0.5)), DRIVE, load=0.0, fit=only("delay"))
    columns = {"sigma_0": np.full(100, 1e6)}
    with pytest.raises(QuantityError, match=r"draws of 'coulomb_forse' .did you mean 'coulomb_force'"):
        ss.step_map(KANG, DRIVE, load=0.0, fit=columns | {"coulomb_forse": np.full(100, 0.5)})
    with pytest.raises(QuantityError, match=r"draws of sigma_0.*'1 MN'.*expected N/m"):
        ss.step_map(KANG, DRIVE, load=0.0, fit={"sigma_0": ["1 MN"] * 100})
    with pytest.raises(QuantityError, match=r"draws = 10 is out of range.*whole number, 40"):
        ss.step_map(model, DRIVE, load=0.0, fit=fit, draws=10)


def test_as_many_draws_as_rows_are_all_of_them() -> None:
    rows = {"coulomb_force": np.linspace(0.4, 0.6, 200)}
    found = drawn_parameters(rows, KANG, 200, seed=1)
    assert np.array_equal(found["coulomb_force"], rows["coulomb_force"])
    assert np.unique(drawn_parameters(rows, KANG, 150, seed=1)["coulomb_force"]).size < 150


def only(name: str) -> Fit:
    data = [Residuals(lambda v: np.array([v[name] - 1.0, 0.0, 0.0]), None, 1.0)]
    return fit_least_squares(data, [Parameter(name, 1.1, 0.0, 2.0)], noise_known=True)


def test_what_the_data_do_not_determine_has_no_interval() -> None:
    data = [Residuals(lambda v: np.array([v["sigma_0"] / 1.399e6 - 1.0, 0.0, 0.0, 0.0]), None, 0.01)]
    parameters = [Parameter("sigma_0", 1.399e6, 1e5, 1e7), Parameter("coulomb_force", 0.5401, 0.1, 1.0)]
    fit = fit_least_squares(data, parameters, noise_known=True)
    with pytest.raises(QuantityError, match="do not determine coulomb_force"):
        ss.step_map(model_of(fit), DRIVE, load=0.0, fit=fit)
