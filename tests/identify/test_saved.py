"""A fit is one thing: it is pickled, saved, loaded, and predicts as before."""

from __future__ import annotations

import copy
import json
import pickle
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from damaged_json import mutated
from stickslip.estimate.result import Fit
from stickslip.estimate.saved import packed, unpacked

from .stops import made_loops

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
SAW = ss.waveform.Sequence(ss.waveform.Rest(0.1), ss.Sawtooth(65.0, 5.0, periods=3))


@cache
def walk():
    shown = ss.simulate(KANG, SAW, 0.7, sample_rate=1e3)
    shown["end_effector_position"] += 5e-8 * np.random.default_rng(0).standard_normal(shown["time"].size)
    return shown.assign_attrs(title="walk")


@cache
def walked():
    recording = walk()
    fit = ss.identify_friction(recording, KANG, ["sigma_0", "coulomb_force"], drive=SAW, bounds=None)
    return fit, lambda found: found.predict(recording, SAW)


@cache
def looped():
    recording = made_loops((4e4, 1.5e4), (1.2, 0.9), noise=0.01)
    law = ss.MaxwellSlip((3e4, 2e4), (1.0, 1.1))
    fit = ss.identify_loops(recording, law, ["strength_1", "strength_2", "drift"], reference_normal_force=5.0)
    return fit, lambda found: found.predict(recording)


@cache
def stepped():
    drive = ss.Step(60.0, delay=0.02)
    recording = ss.simulate(KANG.replace(clamped=True), drive, 0.05, sample_rate=2e4)
    x = recording["end_effector_position"]
    recording["end_effector_position"] = x + 1e-8 * np.random.default_rng(0).standard_normal(x.size)
    fit = ss.identify_step([recording], KANG)
    return fit, lambda found: found.predict(recording)


@pytest.mark.parametrize("made", [walked, looped, stepped], ids=lambda made: made.__name__)
@pytest.mark.parametrize("way", ["pickle", "file"])
def test_it_comes_back_as_it_was(made, way: str, tmp_path: Path) -> None:
    fit, predicted = made()
    if way == "pickle":
        back = pickle.loads(pickle.dumps(fit))
    else:
        ss.save_fit(fit, tmp_path / "fit.json")
        back = ss.load_fit(tmp_path / "fit.json")
    assert isinstance(back, Fit)
    assert back == fit == copy.deepcopy(fit)
    assert back.values == fit.values
    assert back.model == fit.model
    assert back.confidence_intervals() == fit.confidence_intervals()
    assert back.report() == fit.report()
    assert back.failures == fit.failures
    assert back.lack == fit.lack
    np.testing.assert_array_equal(predicted(back), predicted(fit))


def test_what_differs_is_not_equal() -> None:
    fit, _ = walked()
    assert fit != replace(fit, jacobian=None)
    assert fit != replace(fit, values={**fit.values, "sigma_0": 1.0})
    assert fit != replace(fit, residuals=tuple(-r for r in fit.residuals))
    seen = ss.verify(fit, walk(), drive=SAW)
    assert seen == pickle.loads(pickle.dumps(seen))
    assert seen != replace(seen, unit="rad")
    assert seen != ss.verify(fit, 1.1 * walk(), drive=SAW)


def test_what_it_says_in_short() -> None:
    fit, _ = walked()
    assert "sigma_0 = " in fit.summary
    assert repr(fit) == f"<Fit, {fit.summary}>"
    assert "sigma_0" in fit._repr_html_()


def test_files_without_a_fit_are_refused(tmp_path: Path) -> None:
    for text in ("", "{}", '{"format": "stickslip fit", "fit": {"type": "Popen"}}', "[1]"):
        (tmp_path / "no.json").write_text(text, "utf-8")
        with pytest.raises(ss.estimate.FitError, match=r"no\.json: there is no fit in it"):
            ss.load_fit(tmp_path / "no.json")
    with pytest.raises(ss.estimate.FitError, match="there is no fit"):
        ss.load_fit(tmp_path / "nowhere.json")


def test_damaged_files_are_refused_or_are_fits_that_say_themselves(tmp_path: Path) -> None:
    """150 random changes of types, keys and depth: FitError, or a fit with which all works."""
    fit, _ = looped()
    path, draw, refused = tmp_path / "fit.json", random.Random(11), 0
    ss.save_fit(fit, path)
    content = json.loads(path.read_text())
    for _ in range(150):
        path.write_text(json.dumps(mutated(content, draw)))
        try:
            found = ss.load_fit(path)
        except ss.estimate.FitError as error:
            refused += 1
            said = str(error)
        else:
            with np.errstate(all="ignore"):
                said = f"{found.report()} {found.to_dict()} {found.confidence_intervals()} fit.json"
        assert "fit.json" in said
    assert 75 < refused < 150


DEEP = "[" * 500 + "]" * 500


@pytest.mark.parametrize(
    "text", ["[" * 100_000, f'{{"format": "stickslip fit", "fit": {DEEP}}}', "5", '"x"', "[1]"]
)
def test_files_that_are_too_deep_or_no_mapping_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "no.json").write_text(text, "utf-8")
    with pytest.raises(ss.estimate.FitError, match=r"no\.json"):
        ss.load_fit(tmp_path / "no.json")


@pytest.mark.parametrize("values", [np.array([1.0 + 2.0j]), np.array([None]), np.array(["2026"], "M8[Y]")])
def test_an_array_that_cannot_be_read_back_is_not_written(values: np.ndarray) -> None:
    with pytest.raises(TypeError, match=f"array of {values.dtype}".replace("[", r"\[")):
        packed(values)
    with pytest.raises(TypeError, match="real numbers or texts"):
        unpacked({"type": "array", "dtype": str(values.dtype), "rows": [1.0]}, {})
