"""Thresholds of the statements on a fit: they are seen, can be changed, and change no value."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import stickslip as ss
from stickslip.estimate import Judgement
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.lack import KnownNoise
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.jobs.analysis import run_file
from stickslip.recording import save_recording
from stickslip.report import write_report

T = np.linspace(0.0, 1.0, 400)


def line(bend: float):
    """A straight line fitted to a bent one, with noise of 1 that is known."""
    y = 3.0 + 2.0 * T + bend * (T - 0.5) ** 2 + np.random.default_rng(5).standard_normal(T.size)
    free = [
        Parameter("a", 1.0, -50.0, 50.0, "m", log=False),
        Parameter("b", 1.0, -50.0, 50.0, "m/s", log=False),
    ]
    one = Residuals(lambda p: p["a"] + p["b"] * T - y, y, 1.0, "ramp", "m", KnownNoise(given=1.0))
    return fit_least_squares([one], free, noise_known=True)


def test_a_stricter_threshold_says_less_and_a_laxer_one_more() -> None:
    fit = line(7.0)
    chance = fit.lack[0].chance
    assert 1e-9 < chance < 0.2
    stricter, laxer = (fit.judged(false_alarm=chance * by, lack_ratio=1.0) for by in (0.5, 1.1))
    assert not stricter.failures
    assert "does not explain ramp" in laxer.failures[0]
    assert fit.values == stricter.values == laxer.values


def test_what_is_not_determined_follows_the_thresholds() -> None:
    fit = line(0.0)
    assert fit.undetermined == ()
    (said,) = fit.judged(indistinguishable=0.5).undetermined
    assert "a and b are hard to tell apart" in said
    low, high = fit.confidence_intervals()["b"]
    (wide,) = fit.judged(wide_share=0.9 * (high - low) / 100.0).undetermined
    assert wide.startswith("b is not determined")


def test_wrong_thresholds_are_refused_by_name() -> None:
    with pytest.raises(ss.QuantityError, match=r"Judgement.false_alarm = 0 is out of range"):
        line(0.0).judged(false_alarm=0.0)
    with pytest.raises(ss.QuantityError, match="did you mean 'false_alarm'"):
        line(0.0).judged(alarm=0.1)


def test_a_file_names_thresholds_and_the_report_shows_them(tmp_path: Path) -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(amplitude=65.0, frequency=20.0)
    walk = ss.simulate(model, drive, duration=0.2, sample_rate=5e3)
    save_recording(walk, tmp_path / "walk.nc")
    file = {
        "kind": "walk",
        "title": "Judged",
        "model": "kang2007",
        "free": ["coulomb_force"],
        "recordings": [{"file": "walk.nc"}],
        "judgement": {"false_alarm": 0.02},
    }
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    write_report(run_file(tmp_path / "walk.yaml"), tmp_path / "out")
    written = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))["numbers"]["judgement"]
    assert written["false_alarm"] == {"value": 0.02, "unit": ""}
    assert written["lack_ratio"]["value"] == Judgement().lack_ratio
    assert "chance that a right model" in (tmp_path / "out" / "report.html").read_text("utf-8")
