"""Steady friction fitted to points of velocity and force, from arrays, tables and identification files."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.estimate.problem import FitError
from stickslip.friction import Stribeck
from stickslip.identify import identify_stribeck
from stickslip.jobs.analysis.running import AnalysisError, run_file
from stickslip.recording import RecordingError
from stickslip.recording.readers import read_points

TRUTH = {"coulomb_force": 1.0, "stiction_excess": 0.4, "stribeck_velocity": 3e-3, "sigma_2": 3.0}
V = np.geomspace(3e-4, 0.1, 20)


def friction(v: np.ndarray, exponent: float = 2.0) -> np.ndarray:
    """The Stribeck curve, written once more."""
    g = 1.0 + 0.4 * np.exp(-((np.abs(v) / 3e-3) ** exponent))
    return np.sign(v) * g + 3.0 * v


@pytest.mark.parametrize("v", [V, -V, np.concatenate([-V, V])])
def test_points_without_noise_give_the_law_back(v: np.ndarray) -> None:
    fit = identify_stribeck(v, friction(v))
    for name, value in TRUTH.items():
        assert fit.values[name] == pytest.approx(value, rel=1e-5)
    assert isinstance(fit.model, Stribeck)
    assert fit.model.stiction_force == pytest.approx(1.4, rel=1e-5)
    assert fit.r_squared == pytest.approx(1.0)


def test_the_exponent_and_the_offset_of_the_sensor() -> None:
    v = np.concatenate([-V, V])
    fit = identify_stribeck(v, friction(v, 1.0) + 0.07, exponent=None, offset=True)
    assert fit.values["exponent"] == pytest.approx(1.0, rel=1e-3)
    assert fit.values["offset"] == pytest.approx(0.07, rel=1e-3)
    with pytest.raises(FitError, match="both signs"):
        identify_stribeck(V, friction(V), offset=True)


def test_intervals_hold_the_truth() -> None:
    """A small case of docs/decisions/steady-friction.md."""
    rng = np.random.default_rng(3)
    held = dict.fromkeys(TRUTH, 0)
    for _ in range(60):
        fit = identify_stribeck(V, friction(V) + 0.01 * rng.normal(size=V.size))
        for name, (low, high) in fit.confidence_intervals().items():
            held[name] += low <= TRUTH[name] <= high
    assert min(held.values()) >= 52, held  # of 60 at 95 %, fewer in 1 of 1,000
    assert max(held.values()) <= 60


def test_a_fall_that_noise_may_have_made_is_doubted() -> None:
    rng = np.random.default_rng(6)
    flat = 1.0 + 3.0 * V
    said = [identify_stribeck(V, flat + 0.01 * rng.normal(size=V.size)).doubts for _ in range(8)]
    assert sum("do not show that friction falls" in " ".join(one) for one in said) >= 7
    seen = identify_stribeck(V, friction(V) + 0.01 * rng.normal(size=V.size))
    assert seen.doubts == ()


@pytest.mark.parametrize(
    ("options", "fitted"),
    [({}, 2), ({"exponent": None}, 3), ({"tied": {"stribeck_velocity": "'3 mm/s'"}}, 1)],
)
def test_the_fall_is_tested_with_the_parameters_fitted(options: dict[str, Any], fitted: int) -> None:
    f = 1.0 + 3.0 * V + 0.01 * np.random.default_rng(6).normal(size=V.size)
    fit = identify_stribeck(V, f, **options)
    said = re.search(r"noise to show as much: ([0-9.e-]+)\)", " ".join(fit.doubts))
    line = np.polynomial.Polynomial.fit(V, f, 1)
    without, left = np.sum((f - line(V)) ** 2), np.sum(fit.residuals[0] ** 2)
    free = V.size - 2 - fitted
    chance = scipy.stats.f.sf((without - left) / fitted / (left / free), fitted, free)
    assert said is not None
    assert float(said[1]) == pytest.approx(chance, rel=0.05)


def test_known_deviations_weigh_the_points() -> None:
    rng = np.random.default_rng(4)
    deviation = np.where(V < 0.01, 0.002, 0.2)
    fit = identify_stribeck(V, friction(V) + deviation * rng.normal(size=V.size), deviation=deviation)
    assert fit.standard_errors["stribeck_velocity"] < 0.05 * TRUTH["stribeck_velocity"]
    assert fit.standard_errors["sigma_2"] > 0.5


def test_tied_values_follow() -> None:
    fit = identify_stribeck(V, friction(V), tied={"stiction_excess": "0.4 * coulomb_force"})
    assert fit.values["stiction_excess"] == pytest.approx(0.4, rel=1e-5)


def test_what_the_points_do_not_show_is_said() -> None:
    slow = V[V < 4e-3]
    assert any("measure faster" in one for one in identify_stribeck(slow, friction(slow)).doubts)
    fast = V[V > 2e-3]
    assert any("measure slower" in one for one in identify_stribeck(fast, friction(fast)).doubts)
    assert identify_stribeck(V, friction(V)).doubts == ()
    at_rest = identify_stribeck(np.append(V, 0.0), np.append(friction(V), 0.3))
    assert any("1 points at rest are left out" in one for one in at_rest.remarks)


@pytest.mark.parametrize(
    ("v", "f", "words"),
    [
        (V, -friction(V), "change its sign"),
        (V[:5], friction(V[:5]), "too few"),
        (np.repeat(V[:3], 5), friction(np.repeat(V[:3], 5)), "15 points at 3 speeds"),
        (V, friction(V)[:-1], "one value each per point"),
        (V, np.where(V > 0.05, np.nan, friction(V)), "force of point 17 is not finite"),
    ],
)
def test_points_that_cannot_be_fitted(v: np.ndarray, f: np.ndarray, words: str) -> None:
    with pytest.raises(FitError, match=words):
        identify_stribeck(v, f)


def test_a_deviation_of_zero_is_refused() -> None:
    with pytest.raises(FitError, match="deviation of point 0 is not above 0"):
        identify_stribeck(V, friction(V), deviation=0.0)


def _table(path: Path, header: str, v: np.ndarray, f: np.ndarray, sign: str = ",") -> Path:
    rows = "\n".join(f"{a:.8g}{sign}{b:.8g}" for a, b in zip(v, f, strict=True))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "v", "f", "sign"),
    [
        ("velocity (mm/s),friction force (N)", 1e3 * V, friction(V), ","),
        ("Speed [um/s];Force [mN]", 1e6 * V, 1e3 * friction(V), ";"),
        ("v (m/s)\tF (N)", V, friction(V), "\t"),
    ],
)
def test_tables_of_tribometers(tmp_path: Path, header: str, v: np.ndarray, f: np.ndarray, sign: str) -> None:
    found = read_points(_table(tmp_path / "a.csv", header, v, f, sign))
    np.testing.assert_allclose(found["velocity"], V, rtol=1e-6)
    np.testing.assert_allclose(found["force"], friction(V), rtol=1e-6)


def test_columns_and_units_are_asked_for(tmp_path: Path) -> None:
    path = _table(tmp_path / "a.csv", "a,b", 1e3 * V, friction(V))
    with pytest.raises(RecordingError, match=r"say columns=\{'velocity'.*The file has 0: 'a', 1: 'b'"):
        read_points(path)
    found = read_points(path, {"velocity": "a", "force": 1}, {"velocity": "mm/s", "force": "N"})
    assert identify_stribeck(**found).values["coulomb_force"] == pytest.approx(1.0, rel=1e-4)
    with pytest.raises(RecordingError, match="force is a quantity in N"):
        read_points(path, {"velocity": "a", "force": 1}, {"force": "V"})


def test_an_identification_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    _table(
        tmp_path / "a.csv",
        "velocity (mm/s),friction force (N)",
        1e3 * V,
        friction(V) + 0.01 * rng.normal(size=20),
    )
    file = tmp_path / "stribeck.yaml"
    file.write_text("title: Guide\nkind: stribeck\npoints: {file: a.csv}\n")
    result = CliRunner().invoke(app, ["identify", str(file), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    numbers = json.loads((tmp_path / "out" / "results.json").read_text())
    assert "coulomb_force" in json.dumps(numbers)
    found = read_points(tmp_path / "a.csv")
    fit = identify_stribeck(**found)
    document = run_file(file)
    low, high = fit.confidence_intervals()["sigma_2"]
    assert document.numbers["parameters"]["sigma_2"].low == pytest.approx(low)
    assert document.numbers["parameters"]["sigma_2"].high == pytest.approx(high)
    assert "steady_friction" in {one.name for section in document.sections for one in section.figures}
    file.write_text("title: Guide\nkind: stribeck\npoints: {file: a.csv}\nexponant: 1\n")
    with pytest.raises(AnalysisError, match="exponant"):
        run_file(file)


def test_the_fit_is_saved(tmp_path: Path) -> None:
    fit = identify_stribeck(V, friction(V))
    ss.save_fit(fit, tmp_path / "fit.json")
    assert ss.load_fit(tmp_path / "fit.json").model == fit.model
