"""A campaign on the virtual rig, whose truth is known, and what a campaign file may say."""

from __future__ import annotations

import importlib.resources
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from stickslip.cli import app
from stickslip.jobs.analysis.alignment import Aligned
from stickslip.jobs.campaign import run_campaign
from stickslip.jobs.campaign.file import read_campaign
from stickslip.jobs.campaign.gathering import scale_of, scaled
from stickslip.quantities.input_file import InputFileError
from stickslip.quantities.units import QuantityError
from stickslip.recording import (
    RecordingError,
    make_recording,
    open_recording,
    save_recording,
)
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.signal import value_at

EXAMPLES = Path(str(importlib.resources.files("stickslip") / "examples"))
CAMPAIGN = yaml.safe_load((EXAMPLES / "kang2007_campaign.yaml").read_text("utf-8"))
TRUE = {"sigma_0": 1.399e6, "sigma_1": 34.9, "coulomb_force": 0.5401}


def run(*arguments: str):
    return CliRunner().invoke(app, ["campaign", *arguments], prog_name="stickslip")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of three recordings, 20 Hz only: short, and all that a campaign is."""
    made = tmp_path_factory.mktemp("campaign")
    experiment = yaml.safe_load((EXAMPLES / "kang2007_experiment.yaml").read_text("utf-8"))
    step, _, walk = experiment["runs"]
    step["matrix"] = {"voltage": ["60 V", "80 V"]}
    walk["matrix"] = {"voltage": ["65 V", "75 V"]}
    experiment["runs"] = [step, walk]
    (made / "experiment.yaml").write_text(yaml.safe_dump(experiment), "utf-8")
    return made


def written(folder: Path, name: str = "campaign.yaml", **changes) -> str:
    file = {
        **CAMPAIGN,
        "experiment": "experiment.yaml",
        "published": {"step": 0.9708, "sawtooth_20Hz_75V": 0.99},
        "recordings": [
            {"cells": "step_*", "use": "step"},
            {"cells": "*65V", "use": "fit"},
            {"cells": "*", "use": "verify"},
        ],
        **changes,
    }
    (folder / name).write_text(yaml.safe_dump(file), "utf-8")
    return str(folder / name)


def test_the_truth_is_near_and_the_other_walk_is_predicted(folder: Path) -> None:
    out = folder / "out"
    done = run(written(folder), "--out", str(out))
    assert done.exit_code == 0, done.stderr
    results = json.loads((out / "results.json").read_bytes())
    numbers = results["numbers"]
    for name, true in TRUE.items():
        found = numbers["friction"]["parameters_with_all_errors"][name]
        away = np.log(found["value"] / true) / (found["standard_error"] / found["value"])
        assert abs(away) < 3.0, name
        assert found["low"] < found["value"] < found["high"]
        own = numbers["friction"]["parameters"][name]
        assert found["standard_error"] >= own["standard_error"]
    stage = numbers["stage"]["parameters"]
    for name, true in (("gain", 0.1057e-6), ("natural_frequency", 3303.1), ("damping_ratio", 0.524)):
        assert abs(stage[name]["value"] - true) < 3.0 * stage[name]["standard_error"], name
    # The maker's polynomial and the recalibration are 3 % off in their slope; the strain gauge is not.
    assert numbers["sensor_scale"]["value"] == pytest.approx(0.967, abs=0.003)
    other = numbers["verification"]["sawtooth_20Hz_75V"]
    assert other["r_squared"]["value"] > 0.9995
    assert other["net_step_error"]["value"] < 0.01
    assert results["failures"] == []
    # Without a model: what the slips of 75 V carry, which the verification finds in the mean positions.
    walk = numbers["features"]["sawtooth_20Hz_75V"]
    assert walk["forward"]["step_of_peaks"]["value"] == pytest.approx(other["net_step"]["value"], rel=0.03)
    assert walk["back"]["slips"]["value"] == 8
    assert walk["vibration_frequency"]["value"] == pytest.approx(
        595.0, abs=30.0
    )  # contact on the slider's mass
    page = (out / "report.html").read_text("utf-8")
    assert "figs. 5.1, 5.2 and 5.4" in page  # as the file of this campaign says
    assert "of the thesis)" not in page
    assert {p.name for p in (out / "figures").iterdir()} == {
        "campaign-steps.svg", "campaign-fit.svg", "campaign-predicted-1.svg",
    }  # fmt: skip
    again = run(written(folder, require=["rmse < 10 nm"]), "--no-figures", "--out", str(out))
    assert again.exit_code == 1
    assert "sawtooth_20Hz_65V: rmse is" in again.stderr
    assert "<svg" not in (out / "report.html").read_text("utf-8")


def test_verify_predicts_as_the_campaign_did(folder: Path) -> None:
    """From results.json: bias, scale, delay, slew rate; the waveform from the recording's attributes."""
    out = folder / "out"
    results = out / "results.json"
    done = run(written(folder), "--no-figures", "--out", str(out))
    assert done.exit_code == 0, done.stderr
    walks = ["sawtooth_20Hz_65V", "sawtooth_20Hz_75V"]
    files = [str(out / "recordings" / f"{name}.nc") for name in walks]

    def verified(files: list[str], name: str, exit_code: int = 0) -> dict:
        command = ["verify", str(results), *files, "--out", str(folder / name)]
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            seen = CliRunner().invoke(app, command, prog_name="stickslip")
        assert ("If the waveform is known" in seen.stderr) == (name == "near")
        assert seen.exit_code == exit_code, seen.stderr
        return json.loads((folder / name / "results.json").read_bytes())["numbers"]["verification"]

    expected = json.loads(results.read_bytes())["numbers"]["verification"]
    found = verified(files, "again")
    for walk in walks:
        for key, number in expected[walk].items():
            assert found[walk][key]["value"] == pytest.approx(number["value"], rel=1e-9, abs=1e-15), key
    # Without the name of its waveform the channel is the drive: near, and not the same.
    unnamed = open_recording(files[1])
    del unnamed.attrs["drive"]
    save_recording(unnamed, folder / "unnamed.nc")
    near = verified([str(folder / "unnamed.nc")], "near")["unnamed"]
    assert near["rmse"]["value"] < 3 * expected[walks[1]]["rmse"]["value"]
    assert near["rmse"]["value"] != pytest.approx(expected[walks[1]]["rmse"]["value"], rel=1e-6)
    # A model and a delay alone predict far worse, which fails the command.
    numbers = json.loads(results.read_bytes())
    del numbers["numbers"]["signal_chain"]
    results.write_text(json.dumps(numbers), "utf-8")
    bare = verified(files, "bare", exit_code=1)
    assert bare[walks[1]]["rmse"]["value"] > 3 * expected[walks[1]]["rmse"]["value"]


def test_on_request_it_samples_follows_profiles_and_compares_models(folder: Path) -> None:
    file = written(
        folder,
        "deeper.yaml",
        posterior=True,
        posterior_simulations=1000,
        profiles=True,
        model_choice=["Pohl: static", "LuGre"],
    )
    out = folder / "out"  # the recordings are there
    done = run(file, "--out", str(out))
    assert done.exit_code == 0, done.stderr
    numbers = json.loads((out / "results.json").read_bytes())["numbers"]
    for name, true in TRUE.items():
        of = numbers["posterior"][name]
        known = numbers["friction"]["parameters_with_all_errors"][name]["standard_error"]
        assert abs(of["value"] - true) < 3.0 * max(known, of["standard_error"]), name
        assert of["low"] < of["value"] < of["high"]
    # F_C follows the gain of the stage, which is sampled too.
    assert numbers["posterior"]["gain"]["value"] == pytest.approx(0.1057e-6, rel=0.01)
    for name in TRUE:
        interval = numbers["profiles"][name]
        assert interval["low"] < numbers["friction"]["parameters"][name]["value"] < interval["high"]
    models = numbers["model_choice"]
    rmse = {law: models[law]["verification_rmse"]["value"] for law in models}
    assert rmse["LuGre"] < 0.2 * rmse["Pohl: static"]
    assert models["LuGre"]["bic"]["value"] < models["Pohl: static"]["bic"]["value"] - 1000.0
    page = (out / "report.html").read_text("utf-8")
    for words in ("Intervals without linearisation", "Choice of model", "the usual choice", "R-hat"):
        assert words in page, words
    assert {p.name for p in (out / "figures").iterdir()} >= {"campaign-posterior.svg", "models.svg"}
    wrong = run(written(folder, "wrong.yaml", model_choice=["Lugre"]), "--no-figures", "--out", str(out))
    assert wrong.exit_code == 2
    assert "there is no 'Lugre'" in wrong.stderr
    assert "did you mean" in wrong.stderr


def test_a_damping_ratio_that_is_known_is_sayable(folder: Path) -> None:
    """sigma_1 tied: half its relative error comes from sigma_0, whatever that has it from."""
    file = written(
        folder,
        "tied.yaml",
        free=["sigma_0", "coulomb_force"],
        tied={"sigma_1": "0.0933 * sqrt(sigma_0 * end_effector_mass)"},
        hops=0,
    )
    out = folder / "out"  # the recordings are there
    done = run(file, "--no-figures", "--out", str(out))
    assert done.exit_code == 0, done.stderr
    numbers = json.loads((out / "results.json").read_bytes())["numbers"]
    found = numbers["friction"]["parameters_with_all_errors"]
    assert set(found) == {"sigma_0", "sigma_1", "coulomb_force"}
    relative = {name: of["standard_error"] / of["value"] for name, of in found.items()}
    assert relative["sigma_1"] == pytest.approx(0.5 * relative["sigma_0"], rel=1e-6)
    assert found["sigma_1"]["value"] == pytest.approx(34.9, rel=0.02)
    assert "sigma_1 (tied: 0.0933 * sqrt(" in (out / "report.html").read_text("utf-8")


def test_own_recordings_and_what_is_wrong_with_them(folder: Path) -> None:
    """The walk as a CSV of one's own; then cut short, constant, empty: each is refused by its name."""
    time = np.arange(4000) * 0.25e-3
    rng = np.random.default_rng(0)
    from stickslip.physics.actuator import load_actuator
    from stickslip.simulation import simulate
    from stickslip.waveform.sequence import Sequence
    from stickslip.waveform.shapes import Rest

    drive = Sequence(Rest(0.1), Sawtooth(65.0, 20.0, periods=8))
    true = load_actuator("kang2007").replace(stage_reaction=False)
    d = simulate(true, drive, times=time, tolerance=1e-10)
    micrometres = 1e6 * d["end_effector_position"].values + 0.02 * rng.standard_normal(time.size)
    own = {
        "file": "walk.csv",
        "columns": {"time": "t", "end_effector_position": "x", "drive_voltage": "u"},
        "waveform": [
            {"shape": "Sawtooth", "fields": {"amplitude": "65 V", "frequency": "20 Hz", "periods": 8}}
        ],
    }
    plain = {
        "experiment": None,
        "reference": None,
        "slew_rate": "inf V/s",
        "published": {},
        "recordings": [own],
    }

    def saved(x, n: int = time.size) -> None:
        rows = (
            f"{t:.5f},{a:.5f},{b:.5f}" for t, a, b in zip(time[:n], x, drive.value(time[:n]), strict=False)
        )
        (folder / "walk.csv").write_text("\n".join(["t [s],x [um],u [V]", *rows]), "utf-8")

    saved(micrometres)
    file = written(folder, "own.yaml", **plain)
    done = run(file, "--no-figures", "--out", str(folder / "own"))
    assert done.exit_code == 0, done.stderr
    found = json.loads((folder / "own" / "results.json").read_bytes())["numbers"]
    interval = found["friction"]["parameters"]["coulomb_force"]
    assert interval["low"] < 0.5401 < interval["high"]
    assert found["recordings"]["walk"]["start"]["value"] == pytest.approx(0.1, abs=1e-5)
    for x, words in ((0 * micrometres, "is 0 throughout"), (micrometres[:5], "5 samples")):
        saved(x, x.size)
        refused = run(file, "--no-figures", "--out", str(folder / "own"))
        assert refused.exit_code == 2
        assert "walk" in refused.stderr.splitlines()[-1]
        assert words in refused.stderr


def clamped(ratio: float, name: str, unit: str = "m") -> Aligned:
    t = np.arange(0.0, 0.3, 1e-3)
    x = np.where(t > 0.1, 6e-6, 0.0)
    data = {"end_effector_position": ratio * x, "other": (x, unit)}
    return Aligned(name, make_recording(t, data), 0.1, 1e-9, None, None, use="step")


def test_the_scale_is_the_mean_ratio_of_the_steps() -> None:
    steps = [clamped(0.95, "a"), clamped(0.97, "b")]
    scale = scale_of(steps, "other", 0.01)
    assert scale.value == pytest.approx(0.96)
    assert scale.standard_error == pytest.approx(0.01)
    assert scaled(steps[0], 0.95).recording["end_effector_position"].values[-1] == pytest.approx(6e-6)
    with pytest.raises(RecordingError, match="there is none"):
        scale_of([], "other", 0.01)
    with pytest.raises(RecordingError, match="less than 10 samples at rest"):
        scale_of([clamped(1.0, "c")._replace(begin=0.002)], "other", 0.01)
    with pytest.raises(RecordingError, match="c has no gauge"):
        scale_of([clamped(1.0, "c")], "gauge", 0.01)
    with pytest.raises(QuantityError, match="other of c is in V"):
        scale_of([clamped(1.0, "c", "V")], "other", 0.01)


def test_a_pdf_without_a_browser_is_refused_before_the_work(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(folder))
    done = run(written(folder, "paper.yaml"), "--pdf", "--out", str(folder / "paper"))
    assert done.exit_code == 2
    assert "a PDF needs a Chromium browser" in done.stderr
    assert not (folder / "paper").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"recordings": [{"cells": "step_*", "use": "step"}]}, "none to fit the friction to"),
        ({"experiment": None}, "no 'experiment' is named"),
        ({"slew_rate": "3 V"}, "slew_rate"),
        (
            {"recordings": [{"cells": "*", "use": "stpe"}]},
            r"recordings\.0\.use: 'stpe' .*'step'",
        ),
        (
            {"recordings": [{"file": "a.csv", "waveform": [{"shape": "Sawtoth"}]}]},
            r"recordings\.0\.waveform\.0\.shape: .*did you mean 'Sawtooth'",
        ),
    ],
)
def test_wrong_files_are_refused_by_field(tmp_path: Path, changes, words: str) -> None:
    with pytest.raises(InputFileError, match=words):
        read_campaign(Path(written(tmp_path, **changes)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"change": {"gian": "1 um/V"}}, ".*'gian'"),
        ({"published": {"wakl": 0.9}}, "published: .*'wakl'"),
        ({"model": "kang2008"}, ".*'kang2008'"),
        ({"require": ["rsquared > 0.9"]}, "'rsquared'"),
        ({"free": ["sigma_0", "sigma_O"]}, "free: 'sigma_O'"),
        ({"bounds": {"sigma_2": [0, 1]}}, "free: .*'sigma_2'"),
        ({"priors": {"sigma_0": ["1 N/um", "0.1 N/um"]}}, "free: priors weigh against the noise"),
        ({"tied": {"sigma_1": "sigma_9"}, "free": ["sigma_0"]}, "free: .*'sigma_9'"),
        ({"model_choice": ["LuGer"]}, "model_choice: there is no 'LuGer'"),
        (
            {"waveform": {"amplitude": "65 A", "frequency": "20 Hz"}},
            r"recordings: walk: waveform\[0\]: .*'65 A'",
        ),
    ],
)
def test_what_no_field_alone_shows_is_refused_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes, words: str
) -> None:
    time = np.arange(800) * 0.25e-3
    drive = Sawtooth(65.0, 20.0, periods=3)
    channels = {"end_effector_position": 1e-9 * np.sin(1e5 * time), "drive_voltage": value_at(drive, time)}
    save_recording(make_recording(time, channels), tmp_path / "walk.nc")
    fields = changes.pop("waveform", {"amplitude": "65 V", "frequency": "20 Hz", "periods": 3})
    own = {"file": "walk.nc", "waveform": [{"shape": "Sawtooth", "fields": fields}]}
    plain = {"experiment": None, "reference": None, "recordings": [own], "published": {}}
    file = written(tmp_path, "own.yaml", **{**plain, **changes})
    monkeypatch.setattr("stickslip.jobs.campaign.running.evaluate", lambda *_: pytest.fail("computed before"))
    with pytest.raises(InputFileError, match=rf"own\.yaml: {words}"):
        run_campaign(file, tmp_path)


def test_the_example_is_one() -> None:
    file = read_campaign(EXAMPLES / "kang2007_campaign.yaml")
    assert file.slew_rate == pytest.approx(0.4 / 1.4e-6, rel=2e-3)
