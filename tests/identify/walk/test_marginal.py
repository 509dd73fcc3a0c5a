"""A value that the data do not determine: the others over all that it may be."""

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.marginal import Held, integrated, mixture, points
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import FitError
from stickslip.estimate.result import Fit
from stickslip.identify.walk.displacement import Displacement
from stickslip.identify.walk.likelihood import SimulatedWalks

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
SAW = ss.Sawtooth(amplitude=65.0, frequency=5.0, periods=4)


def slow_walk(seed: int, noise: float = 125e-9) -> xr.Dataset:
    """1 kHz sees of the contact's vibration, 595 Hz that last for some ms, next to nothing."""
    walk = ss.simulate(KANG, SAW, duration=0.95, sample_rate=1e3)
    random = np.random.default_rng(seed)
    position = walk["end_effector_position"].values + random.normal(0.0, noise, walk.sizes["time"])
    return ss.make_recording(walk["time"].values, {"end_effector_position": position}, title=f"seed {seed}")


def held(at: float, covariance: np.ndarray, mean: np.ndarray) -> Held:
    """What a fit to data of Gaussian noise and a linear model finds, by the conditional distribution."""
    inverse = np.linalg.inv(covariance)
    inner = np.asarray(np.linalg.inv(inverse[:2, :2]), dtype=np.float64)
    others = mean[:2] - inner @ inverse[:2, 2] * (at - mean[2])
    chi_squared = (at - mean[2]) ** 2 / covariance[2, 2]
    return Held(at, others, inner, 0.5 * (np.linalg.slogdet(inner)[1] - chi_squared))


def test_a_linear_model_gets_its_covariance() -> None:
    root = np.array([[1.0, 0.0, 0.0], [0.5, 0.8, 0.0], [-1.2, 0.4, 0.9]])
    covariance, mean = root @ root.T, np.array([0.3, -2.0, 5.0])
    found = mixture([held(at, covariance, mean) for at in np.linspace(15.0, -5.0, 41)])
    assert found.mean == pytest.approx(mean, abs=1e-6)
    assert found.covariance == pytest.approx(covariance, abs=1e-6)


def test_points_reach_both_bounds_and_are_close_at_zero() -> None:
    found = points(Parameter("sigma_1", 30.0, 0.0, 300.0, log=False))
    assert (found[0], found[-1]) == (300.0, 0.0)
    assert np.all(np.diff(found) < 0)
    assert abs(found[-1] - found[-2]) < 0.1 * abs(found[0] - found[1])
    logarithmic = points(Parameter("sigma_1", 30.0, 1.0, 900.0))
    assert np.diff(logarithmic) == pytest.approx(np.full(found.size - 1, -np.log(900.0) / (found.size - 1)))


def bent(values: dict[str, float]) -> np.ndarray:
    """Ten data that see a + b²: any b fits."""
    return np.full(10, values["a"] + values["b"] ** 2) + 0.1 * np.tile([1.0, -1.0], 5)


def hold(b: float, begin: dict[str, float]):
    a = [Parameter("a", begin["a"], -50.0, 50.0, log=False)]
    fit = fit_least_squares(lambda values: bent({**values, "b": b}), a)
    return fit, fit


def test_the_others_are_averaged_over_a_bent_valley() -> None:
    free = [Parameter("a", 0.0, -50.0, 50.0, log=False), Parameter("b", 0.5, 0.0, 3.0, log=False)]
    fit = integrated(fit_least_squares(bent, free), "b", hold)
    # b flat over 0 to 3, so a = -b² has mean -3 and variance 81/5 - 9.
    random = np.linspace(0.0, 3.0, 200_001)
    assert isinstance(fit, Fit)
    assert fit.values["b"] == pytest.approx(random.mean(), rel=0.03)
    assert fit.standard_errors["a"] == pytest.approx((random**2).std(), rel=0.06)
    assert fit.correlation.to_numpy()[0, 1] == pytest.approx(
        np.corrcoef(-(random**2), random)[0, 1], abs=0.01
    )
    assert "b, which is hardly determined" in fit.message


def test_where_there_is_no_model_is_left_out() -> None:
    def fails_far_out(b: float, begin: dict[str, float]):
        if b > 2.0:
            raise FitError("no model")
        return hold(b, begin)

    free = [Parameter("a", 0.0, -50.0, 50.0, log=False), Parameter("b", 0.5, 0.0, 3.0, log=False)]
    fit = integrated(fit_least_squares(bent, free), "b", fails_far_out)
    assert isinstance(fit, Fit)
    assert 0.7 < fit.values["b"] < 1.2


def test_it_is_said_where_the_others_cannot_be_fitted_at_all() -> None:
    def fails(b: float, begin: dict[str, float]):
        raise FitError("no model")

    free = [Parameter("a", 0.0, -50.0, 50.0, log=False), Parameter("b", 0.5, 0.0, 3.0, "V", log=False)]
    with pytest.raises(FitError, match=r"the other parameters cannot be fitted with b = 0\.\d+ V"):
        integrated(fit_least_squares(bent, free), "b", fails)


def test_a_second_valley_is_left_from_where_it_ends() -> None:
    """Where b is below 2, `a` has a valley at -1 that is no answer; the search begins in it."""

    def two_valleys(values: dict[str, float]) -> np.ndarray:
        a, b = values["a"], values["b"]
        wall = 10.0 * max(0.0, 1.0 - b / 2.0) * (a**2 - 1.0)
        return np.concatenate([[wall], np.full(50, a - 1.0) + 0.1 * np.tile([1.0, -1.0], 25)])

    def at(b: float, begin: dict[str, float]):
        a = [Parameter("a", begin["a"], -50.0, 50.0, log=False)]
        fit = fit_least_squares(lambda values: two_valleys({**values, "b": b}), a)
        return fit, fit

    free = [Parameter("a", -1.0, -50.0, 50.0, log=False), Parameter("b", 0.2, 0.0, 3.0, log=False)]
    begun = fit_least_squares(two_valleys, free, max_evaluations=2)
    assert begun.values["a"] < -0.5
    fit = integrated(begun, "b", at)
    assert isinstance(fit, Fit)
    assert fit.values["a"] == pytest.approx(1.0, abs=0.02)
    # What the wall adds to the information on `a` takes weight from where it stands.
    b = np.linspace(0.0, 3.0, 100_001)
    weight = (50.0 + (20.0 * np.maximum(0.0, 1.0 - b / 2.0)) ** 2) ** -0.5
    assert fit.values["b"] == pytest.approx(weight @ b / weight.sum(), abs=0.05)


FREE = ["sigma_0", "sigma_1", "coulomb_force", "delay"]


def test_the_truth_is_inside_where_sigma_1_is_hardly_seen() -> None:
    fit = ss.identify_friction(slow_walk(2), KANG, FREE, drive=SAW, hops=0)
    assert fit.converged
    assert fit.jacobian is not None
    assert fit.jacobian.shape == (fit.n_data, 4)
    for name, (low, high) in fit.confidence_intervals().items():
        assert name == "delay" or low <= getattr(KANG.friction, name) <= high


def test_a_value_that_is_seen_is_not_averaged() -> None:
    fit = ss.identify_friction(slow_walk(0, noise=2e-9), KANG, FREE, drive=SAW, hops=0)
    assert "mean over all" not in fit.message
    assert fit.values["sigma_1"] == pytest.approx(34.9, rel=0.2)


def test_importance_sampling_finds_the_same_spread(monkeypatch) -> None:
    """The integral itself, from simulations at random points around the path of the held fits."""
    paths = []

    def kept(fits):
        paths.append(fits)
        return mixture(fits)

    monkeypatch.setattr("stickslip.estimate.marginal.mixture", kept)
    recording = slow_walk(3)
    fit = ss.identify_friction(recording, KANG, FREE, drive=SAW, hops=0)
    path = sorted(paths[-1])
    at, others = np.array([one.at for one in path]), np.array([one.others for one in path])
    widths = np.gradient(at)
    weights = np.array([one.log_weight for one in path]) + np.log(widths)
    weights = np.exp(weights - weights.max())
    weights = 0.5 * weights / weights.sum() + 0.5 / at.size

    random = np.random.default_rng(0)
    cell = random.choice(at.size, 2000, p=weights)
    held_at = at[cell] + (random.random(cell.size) - 0.5) * widths[cell]
    roots = np.linalg.cholesky(np.array([1.5**2 * one.covariance for one in path]))[cell]
    z = random.standard_normal((cell.size, 3))
    q = np.column_stack([np.interp(held_at, at, column) for column in others.T])
    q += np.einsum("ijk,ik->ij", roots, z)
    log_proposal = np.log(weights / widths)[cell] - 0.5 * np.sum(z**2, axis=1)
    log_proposal -= np.log(np.abs(np.linalg.det(roots)))
    sigma_0, force, delay = np.exp(q[:, 0]), np.exp(q[:, 1]), q[:, 2]
    values = {"sigma_0": sigma_0, "sigma_1": np.exp(held_at), "coulomb_force": force, "delay": delay}
    motion = Displacement(recording, SAW, "walk", fit.model, 3e-10)
    members = SimulatedWalks([motion], [recording["end_effector_position"].values], fit.model, (0.0, 1e-4))
    own = {name: column for name, column in values.items() if name != "delay"}
    misfit = members(own, delay.size).chi_squared(members.weights(delay), np.zeros(delay.size))
    log_posterior = -0.5 * misfit / fit.rmse**2 - log_proposal
    share = np.exp(log_posterior - np.nanmax(log_posterior))
    share = np.nan_to_num(share / np.nansum(share))
    assert 1.0 / np.sum(share**2) > 50.0  # as many independent samples
    for i, found in enumerate((np.log(sigma_0), np.log(force), delay)):
        deviation = np.sqrt(np.sum(share * (found - np.sum(share * found)) ** 2))
        name = ("sigma_0", "coulomb_force", "delay")[i]
        place = list(fit.values).index(name)
        assert np.sqrt(fit.uncertainty.covariance[place, place]) == pytest.approx(deviation, rel=0.35), name
