"""A fit that draws itself: what is shown is what it holds, on new axes or on those given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import stickslip as ss
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import FitError, Residuals
from stickslip.estimate.result import Fit
from stickslip.quantities.units import QuantityError

DRIVE = ss.Sawtooth(65.0, 100.0, periods=2)
NOISE = 60e-9  # m


@pytest.fixture(scope="module")
def fit() -> Fit:
    """Of two walks under Coulomb friction."""
    model = ss.load_actuator("kang2007").replace(stage_reaction=False, friction=ss.Coulomb(0.5))
    walks = []
    for seed in (0, 1):
        walk = ss.simulate(model, DRIVE, 0.02, sample_rate=5e3, tolerance=1e-10)
        noise = NOISE * np.random.default_rng(seed).standard_normal(walk["time"].size)
        walks.append(walk.assign(end_effector_position=walk["end_effector_position"] + noise))
    return ss.identify_friction(walks, model, ["coulomb_force"], drive=DRIVE, hops=0, noise=NOISE)


def test_measured_model_and_residuals_stand_over_time_with_the_noise(fit: Fit, tmp_path: Path) -> None:
    axes = ss.plot(fit)
    assert axes.shape == (2, 2)
    for i, (above, below) in enumerate(axes):
        measured, model = above.lines
        np.testing.assert_allclose(measured.get_xdata(), 1e3 * fit.times[i])
        np.testing.assert_allclose(measured.get_ydata(), 1e6 * fit.measured[i])
        np.testing.assert_allclose(model.get_ydata(), 1e6 * (fit.measured[i] + fit.residuals[i]))
        np.testing.assert_allclose(below.lines[-1].get_ydata(), 1e9 * fit.residuals[i], atol=1e-6)
        (band,) = below.collections
        edges = band.get_paths()[0].vertices[:, 1]
        assert (edges.min(), edges.max()) == pytest.approx((-120.0, 120.0))
        assert above.get_ylabel() == "end-effector position (µm)"
        assert (below.get_ylabel(), below.get_xlabel()) == ("residual (nm)", "time (ms)")
        assert [t.get_text() for t in below.get_legend().get_texts()] == ["95 % of the noise that was given"]
        assert above.get_title("right").startswith(f"recording {i + 1}: r² = 0.99")
    axes[0, 0].figure.savefig(tmp_path / "fit.png")
    assert (tmp_path / "fit.png").stat().st_size > 20_000


def test_it_draws_on_axes_that_are_given_and_as_it_was_saved(fit: Fit, tmp_path: Path) -> None:
    ss.save_fit(fit, tmp_path / "fit.json")
    given = Figure().subplots(2, 2).T
    axes = ss.plot(ss.load_fit(tmp_path / "fit.json"), given)
    assert axes[1, 0] is given[1, 0]
    np.testing.assert_allclose(given[1, 0].lines[0].get_ydata(), 1e6 * fit.measured[1])
    with pytest.raises(QuantityError, match="3 axes are given, and 2 recordings need 4"):
        ss.plot(fit, Figure().subplots(3))


def test_without_known_noise_the_band_is_that_of_the_residuals(fit: Fit) -> None:
    unknown = replace(fit, known=())
    (band,) = ss.plot(unknown)[1, 1].collections
    half = 2e9 * np.sqrt(np.mean(fit.residuals[1] ** 2))
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(half)
    assert "as large as the residuals" in band.get_label()


def test_what_is_no_recording_over_time_is_not_drawn() -> None:
    y = np.array([1.0, 2.1, 2.9])
    line = fit_least_squares(
        [Residuals(lambda v: v["a"] * np.arange(1.0, 4.0) - y, y)], [Parameter("a", 2.0, 0.1, 9.0)]
    )
    with pytest.raises(FitError, match="not of recordings over time"):
        ss.plot(line)
