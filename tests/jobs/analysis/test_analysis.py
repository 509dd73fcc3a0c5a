"""Identification files: what they may say, and the examples run as a user would run them."""

from __future__ import annotations

import importlib.resources
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.identify.stops import made_loops

from stickslip.friction import Dahl
from stickslip.jobs import demo
from stickslip.jobs.analysis import run_file
from stickslip.jobs.analysis.file import AnalysisError, RecordingFile, read_parts
from stickslip.jobs.analysis.loops import _spans
from stickslip.physics.actuator import load_actuator
from stickslip.recording import RecordingError, make_recording, save_recording
from stickslip.report import write_report
from stickslip.simulation import friction_response, simulate
from stickslip.waveform.periodic import Sawtooth

EXAMPLES = Path(str(importlib.resources.files("stickslip") / "examples"))


def edited(example: str, folder: Path, change) -> Path:
    content = yaml.safe_load((EXAMPLES / example).read_text("utf-8"))
    change(content)
    path = folder / example
    path.write_text(yaml.safe_dump(content), "utf-8")
    return path


def test_friction_loops_are_predicted_better_than_the_known_marks(tmp_path: Path) -> None:
    looked_at = ("Dahl", "Maxwell slip, 2 elements", "the same, alike both ways", "Elastoplastic, drifting")

    def fewer_laws(content) -> None:
        content["laws"] = [one for one in content["laws"] if one.get("label", one["law"]) in looked_at]

    document = run_file(edited("friction_loops.yaml", tmp_path, fewer_laws))
    found = {name: n["verification_r_squared"].value for name, n in document.numbers["models"].items()}
    assert tuple(found) == looked_at
    assert max(found.values()) >= 0.998
    assert found["Maxwell slip, 2 elements"] > 0.9963 > found["Dahl"] > 0.9864
    assert found["the same, alike both ways"] > 0.9963
    assert found["Elastoplastic, drifting"] >= 0.998
    write_report(document, tmp_path)
    results = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert "Elastoplastic" in json.dumps(results)


def test_pulled_slider_is_predicted_at_other_speeds(tmp_path: Path) -> None:
    def two_predictions(content) -> None:
        del content["recordings"][1], content["recordings"][2:4]

    document = run_file(edited("pulled_slider.yaml", tmp_path, two_predictions))
    found = document.numbers["predictions"]["168 N/m, 4_3 mm/s"]
    assert found["predicted_period"].value == pytest.approx(found["measured_period"].value, rel=0.15)
    assert "static 0.36" in document.summary


def test_a_walk_is_identified_from_the_users_own_csv(tmp_path: Path) -> None:
    true = load_actuator("kang2007").replace(stage_reaction=False)
    drives = {"fit": 65.0, "check": 75.0}
    rng = np.random.default_rng(1)
    for name, amplitude in drives.items():
        d = simulate(true, Sawtooth(amplitude=amplitude, frequency=5.0), 0.6, tolerance=1e-10)
        micrometres = 1e6 * d["end_effector_position"].values + 0.02 * rng.standard_normal(d.sizes["time"])
        volts = d["drive_voltage"].values
        rows = [
            f"{t:.6f};{x:.6f};{u:.6f}" for t, x, u in zip(d["time"].values, micrometres, volts, strict=True)
        ]
        (tmp_path / f"{name}.csv").write_text("\n".join(["t [s];x [um];u [V]", *rows]), "utf-8")
    recordings = [
        {
            "file": f"{name}.csv",
            "columns": {"time": "t", "end_effector_position": "x", "drive_voltage": "u"},
            "drive": {"shape": "Sawtooth", "fields": {"amplitude": f"{volts} V", "frequency": "5 Hz"}},
            "use": "fit" if name == "fit" else "verify",
        }
        for name, volts in drives.items()
    ]
    file = {
        "kind": "walk",
        "title": "A walk",
        "model": "kang2007",
        "change": {"stage_reaction": False},
        "friction": {"sigma_0": "1.2 N/um", "coulomb_force": "0.5 N", "stiction_force": "0.5 N"},
        "free": ["sigma_0", "coulomb_force"],
        "starts": 1,
        "recordings": recordings,
    }
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    document = run_file(tmp_path / "walk.yaml")
    found = document.numbers["parameters"]
    assert found["coulomb_force"].low < 0.5401 < found["coulomb_force"].high
    assert found["sigma_0"].low < 1.399e6 < found["sigma_0"].high
    assert document.numbers["recordings"]["recording_2"]["r_squared"].value > 0.9999
    assert len(document.pictures()) == 2
    assert not any("drive_voltage" in words for words in document.assumptions)
    for recording in recordings:
        del recording["drive"]
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    shown = run_file(tmp_path / "walk.yaml")  # the channels show the same drives
    assert shown.numbers["parameters"]["sigma_0"].value == pytest.approx(found["sigma_0"].value, rel=1e-3)
    assert [text.partition(";")[0] for text in shown.numbers["drives"]] == [
        f"drive of {name}: Sawtooth {volts:g} V, 5 Hz, 3 periods, recognised in drive_voltage"
        for name, volts in drives.items()
    ]


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ([(1.2, 2.2), (2.2005669, 2.9)], "1.2 to 2.2 s, 2.201 to 2.9 s"),
        ([(-1e-9, 0.012), (0.012, 0.0315)], "0 to 0.012 s, 0.012 to 0.0315 s"),
        ([(0.0, 7200.0)], "0 to 7200 s"),
    ],
)
def test_parts_are_said_as_long_as_they_are(ends: list[tuple[float, float]], said: str) -> None:
    assert _spans([make_recording(one, {"position": ([0.0, 1.0], "m")}) for one in ends]) == said


def test_laws_are_ranked_on_loops_of_a_file(tmp_path: Path) -> None:
    """Stop operators in NumPy made them; that law wins, and gives its values back."""
    for seed, name in enumerate(("fit", "check")):
        loops = made_loops((4e4, 1.5e4), (1.2, 0.9), seed=seed, noise=0.005)
        save_recording(
            loops.assign(friction_force=-loops["friction_force"].assign_attrs(units="N")),
            tmp_path / f"{name}.nc",
        )
    file = {
        "kind": "friction_loops",
        "title": "Loops",
        "reference_normal_force": "5 N",
        "flip": True,
        "marks": {"somebody": 0.9},
        "laws": [
            {"law": "Coulomb", "fields": {"coulomb_force": "2 N"}, "free": ["coulomb_force"]},
            {
                "law": "MaxwellSlip",
                "label": "two elements",
                "fields": {"stiffness": ["35 N/mm", "20 N/mm"], "strength": [1.1, 1.0]},
                "free": ["stiffness_1", "stiffness_2", "strength_1", "strength_2"],
            },
        ],
        "recordings": [{"file": "fit.nc"}, {"file": "check.nc", "use": "verify"}],
    }
    (tmp_path / "loops.yaml").write_text(yaml.safe_dump(file), "utf-8")
    said: list[str] = []
    document = run_file(tmp_path / "loops.yaml", lambda doing, done: said.append(f"{doing} {done:g}"))
    assert said == ["fitting Coulomb 0", "fitting two elements 0.5"]
    assert document.summary.startswith("two elements predicts recordings that no fit has seen best: r² ")
    found = document.numbers["models"]["two elements"]
    assert found["parameters"]["stiffness_1"].low < 4e4 < found["parameters"]["stiffness_1"].high
    assert found["verification_r_squared"].value > 0.999
    assert document.numbers["models"]["Coulomb"]["r_squared"].value < 0.999
    assert [p.name for p in document.pictures()] == ["models", "friction_loop", "friction_over_time"]

    file["laws"][1]["free"] = ["stiffness_1", "stiffness_2", "strength_1"]
    file["laws"][1]["tied"] = {"strength_2": "0.75 * strength_1"}
    (tmp_path / "loops.yaml").write_text(yaml.safe_dump(file), "utf-8")
    tied = run_file(tmp_path / "loops.yaml")
    found = tied.numbers["models"]["two elements"]
    assert found["tied"] == {"strength_2": "0.75 * strength_1"}
    ends = found["parameters"]
    assert ends["strength_2"].low < 0.9 < ends["strength_2"].high
    assert ends["strength_2"].standard_error == pytest.approx(0.75 * ends["strength_1"].standard_error)
    page = write_report(tied, tmp_path / "out").read_text("utf-8")
    assert "strength_2 (tied: 0.75 * strength_1)" in page
    file["laws"][1]["tied"] = {"strength_2": "0.75 * strength_l"}
    (tmp_path / "loops.yaml").write_text(yaml.safe_dump(file), "utf-8")
    with pytest.raises(ValueError, match=r"there is no 'strength_l' \(did you mean 'strength_1'\?\)"):
        run_file(tmp_path / "loops.yaml")


def test_loops_with_a_prior_say_what_it_did(tmp_path: Path) -> None:
    time = np.arange(0.0, 2.0, 1e-3)
    position = 1e-4 * np.sin(2.0 * np.pi * time)
    noise = np.random.default_rng(8).normal(0.0, 5e-3, (2, time.size))
    force = friction_response(Dahl(5e4, 2.0), time, position)["friction_force"].values
    for name, added in zip(("fit", "check"), noise, strict=True):
        channels = {"position": (position, "m"), "friction_force": (force + added, "N")}
        save_recording(make_recording(time, channels), tmp_path / f"{name}.nc")
    law = {
        "law": "Dahl",
        "fields": {"sigma_0": "30 N/mm", "coulomb_force": "1.5 N"},
        "free": ["sigma_0", "coulomb_force"],
        "priors": {"coulomb_force": ["1.5 N", "50 mN"], "sigma_0": ["60 N/mm", "30 N/mm"]},
    }
    file = {"kind": "friction_loops", "title": "Loops", "noise": "5 mN", "laws": [law]}
    file["recordings"] = [{"file": "fit.nc"}, {"file": "check.nc", "use": "verify"}]
    (tmp_path / "loops.yaml").write_text(yaml.safe_dump(file), "utf-8")
    document = run_file(tmp_path / "loops.yaml")
    told = document.numbers["priors"]
    assert told["coulomb_force"]["disagrees"]
    assert "coulomb_force: recordings and prior disagree: 2 N without it" in document.summary
    assert told["coulomb_force"]["without"].value == pytest.approx(2.0, rel=1e-3)
    assert told["coulomb_force"]["with"].value < told["coulomb_force"]["without"].value
    assert not told["sigma_0"]["disagrees"]
    del file["noise"]
    (tmp_path / "loops.yaml").write_text(yaml.safe_dump(file), "utf-8")
    with pytest.raises(ValueError, match="noise"):
        run_file(tmp_path / "loops.yaml")


def test_a_walk_in_short(tmp_path: Path) -> None:
    model = load_actuator("kang2007").replace(stage_reaction=False)
    walk = simulate(model, Sawtooth(65.0, 100.0, periods=1), 0.012, tolerance=1e-11)
    save_recording(walk, tmp_path / "walk.nc")
    file = {
        "kind": "walk",
        "title": "A walk",
        "model": "kang2007",
        "change": {"stage_reaction": False},
        "friction": {"coulomb_force": "0.52 N", "stiction_force": "0.52 N"},
        "free": ["coulomb_force"],
        "hops": 0,
        "tolerance": "0.1 nm",
        "recordings": [
            {
                "file": "walk.nc",
                "drive": {
                    "shape": "Sawtooth",
                    "fields": {"amplitude": "65 V", "frequency": 100, "periods": 1},
                },
            }
        ],
    }
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    document = run_file(tmp_path / "walk.yaml")
    assert document.numbers["parameters"]["coulomb_force"].value == pytest.approx(0.5401, rel=1e-4)
    assert document.numbers["recordings"]["recording_1"]["r_squared"].value > 0.999999
    assert not document.numbers["undetermined"]
    file |= {"priors": {"coulomb_force": ["0.5 N", "10 pN"]}, "noise": "1 mm"}
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    document = run_file(tmp_path / "walk.yaml")
    told = document.numbers["parameters"]["coulomb_force"]
    assert told.value == pytest.approx(0.5, rel=1e-4)  # a prior that knows it, of a recording that does not
    assert document.numbers["priors"]["coulomb_force"]["open"]
    assert "coulomb_force: the recordings say less than the prior, 0.5 N, which moved it" in document.summary
    file |= {"priors": {"coulomb_force": ["0.4 N", "10 mN"]}, "noise": "10 nm"}
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    document = run_file(tmp_path / "walk.yaml")
    assert "coulomb_force: recordings and prior disagree: 0.54 N without it" in document.summary
    assert document.sections[-1].title == "Priors"
    assert document.numbers["priors"]["coulomb_force"]["disagrees"]
    del file["noise"]
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    with pytest.raises(ValueError, match=r"priors weigh against the noise: give noise \[m\]"):
        run_file(tmp_path / "walk.yaml")
    for wrong, words in (
        ({"priors": {"sigma0": [1, 1]}}, "a prior for 'sigma0', which is not free"),
        ({"priors": {"coulomb_force": 0.4}}, "priors.coulomb_force"),
        ({"priors": {"coulomb_force": ["0.4 m", "1 mN"]}}, "prior of coulomb_force.*0.4 m"),
        ({"priors": {}, "prior": {}}, "there is no field 'prior' .did you mean 'priors'"),
    ):
        (tmp_path / "walk.yaml").write_text(yaml.safe_dump({**file, "noise": "10 nm", **wrong}), "utf-8")
        with pytest.raises(ValueError, match=words):
            run_file(tmp_path / "walk.yaml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.update(masss="1 kg"), "masss"),
        (lambda c: c.update(mass="30.7 N"), "mass = '30.7 N'.*kg"),
        (lambda c: c["recordings"][0].update(speed="fast"), "speed"),
        (lambda c: c["recordings"][0].update(use="verify"), "not 0"),
        (lambda c: c["recordings"][0].update(start="9 s", end="9.0001 s"), "0 samples|1 samples"),
    ],
)
def test_wrong_files_are_refused_by_field(tmp_path: Path, change, words: str) -> None:
    with pytest.raises(AnalysisError, match=words):
        run_file(edited("pulled_slider.yaml", tmp_path, change))


def test_what_is_no_number_of_the_model_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "walk.yaml").write_text(
        "kind: walk\ntitle: t\nmodel: kang2007\nchange: {gian: 1 um/V}\nfree: [sigma_0]\n"
        "recordings: [{file: walk.nc}]\n"
    )
    with pytest.raises(AnalysisError, match=r"walk\.yaml: Actuator has no field 'gian'"):
        run_file(tmp_path / "walk.yaml")


def test_a_label_is_used_once_and_a_file_read_once(tmp_path: Path) -> None:
    time = np.arange(0.0, 2.0, 5e-4)
    save_recording(make_recording(time, {"force_ratio": (time, "")}), tmp_path / "r.nc")
    one = RecordingFile(file="r.nc", start=0.5, end=1.0)
    with pytest.raises(AnalysisError, match="two are called 'r'; give each a 'name'"):
        read_parts([one, one], tmp_path)
    parts = read_parts([one, RecordingFile(file="r.nc", end=0.3, name="early")], tmp_path)
    assert {label: part.attrs["title"] for label, part in parts.items()} == {"r": "r", "early": "early"}
    assert [part.sizes["time"] for part in parts.values()] == [1001, 601]
    assert np.shares_memory(*(part["force_ratio"].values.base for part in parts.values()))


def test_what_a_damaged_file_needs_is_said_in_yaml_too(tmp_path: Path) -> None:
    rows = [f"{0.001 * i:.3f},{i}" for i in range(20)]
    rows[7] = "0.007,"
    (tmp_path / "a.csv").write_text("time [s],position [um]\n" + "\n".join(rows) + "\n0.02")
    given: dict[str, Any] = {"file": "a.csv"}
    with pytest.raises(RecordingError, match=r"is cut off.* in a YAML file rows: \[0, number of rows\]"):
        RecordingFile.model_validate(given).read(tmp_path)
    given["rows"] = [0, 20]
    with pytest.raises(RecordingError, match="in a YAML file missing: drop, leaves such samples out"):
        RecordingFile.model_validate(given).read(tmp_path)
    found = read_parts([RecordingFile.model_validate({**given, "missing": "drop"})], tmp_path)["a"]
    assert found.sizes["time"] == 19


def test_no_yaml_and_no_mapping_are_refused(tmp_path: Path) -> None:
    for text in ("kind: [", "- a\n- b\n"):
        (tmp_path / "a.yaml").write_text(text, "utf-8")
        with pytest.raises(AnalysisError, match=r"a\.yaml"):
            run_file(tmp_path / "a.yaml")
    with pytest.raises(AnalysisError, match=r"nothing\.yaml"):
        run_file(tmp_path / "nothing.yaml")


def short_experiment(content) -> None:
    """A step and a walk."""
    step, _, walk = content["runs"]
    step["matrix"], walk["matrix"] = {"voltage": ["70 V"]}, {"voltage": ["75 V"]}
    content["runs"] = [step, walk]


def short_campaign(content) -> None:
    """Of these."""
    content.update(title="A short campaign", published={}, require=[], hops=0)
    content["recordings"] = [{"cells": "step_*", "use": "step"}, {"cells": "*", "use": "fit"}]


def test_the_demonstration_says_which_data_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The campaign needs no data; a part without its data is named, the rest stays."""
    example = tmp_path / "examples"
    example.mkdir()

    def elsewhere(content) -> None:
        for recording in content["recordings"]:
            recording.update(dataset=None, file="not_here.mat")

    edited("pulled_slider.yaml", example, elsewhere)
    edited("kang2007_experiment.yaml", example, short_experiment)
    edited("kang2007_campaign.yaml", example, short_campaign)
    monkeypatch.setattr(demo, "EXAMPLES", ("pulled_slider.yaml",))
    monkeypatch.setattr(demo.importlib.resources, "files", lambda package: tmp_path)
    said = []
    document = demo.run(tmp_path / "out", lambda doing, done: said.append(done))
    assert document.summary.endswith("neither here nor to be fetched: pulled_slider.yaml.")
    missing = document.sections[-1]
    assert missing.title == "Parts that are missing"
    assert "not_here.mat" in missing.points[0]
    assert document.numbers["a_short_campaign"]["verification"]["sawtooth_20Hz_75V"]["r_squared"].value > 0.99
    assert said == sorted(said)
