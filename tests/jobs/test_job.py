"""Job files: steps that use what those before them made; and mistakes, named before anything is done."""

from __future__ import annotations

import copy
import functools
import json
import re
import signal
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from rig.experiment.files import SMALL
from stickslip.cli import app
from stickslip.jobs.analysis.results import model_and_chain
from stickslip.jobs.file import json_schema, read_job
from stickslip.quantities import registry
from stickslip.quantities.input_file import InputFileError
from stickslip.recording import RecordingWarning
from stickslip.recording.exports import EXPORTS

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
TRUTH = {"sigma_0": 1.399e6, "coulomb_force": 0.5401}


@functools.cache
def walked(volts: float) -> Any:
    friction = KANG.friction._replace(**TRUTH, stiction_force=TRUTH["coulomb_force"])
    drive = ss.Sawtooth(volts, 50.0, periods=3)
    shown = ss.simulate(KANG.replace(friction=friction), drive, 0.07, sample_rate=5e3)
    return shown[["end_effector_position", "drive_voltage"]]


def walk(folder: Path, name: str, volts: float, use: str) -> dict[str, Any]:
    """A walk of three periods in a file, and how files name it."""
    ss.save_recording(walked(volts), folder / f"{name}.nc")
    fields = {"amplitude": volts, "frequency": 50.0, "periods": 3}
    return {"file": f"{name}.nc", "use": use, "drive": {"shape": "Sawtooth", "fields": fields}}


def steps(folder: Path) -> list[dict[str, Any]]:
    fitted, unseen = walk(folder, "fitted", 65.0, "fit"), walk(folder, "unseen", 45.0, "verify")
    model = {"model": "kang2007", "change": {"stage_reaction": False}}
    free = {"kind": "walk", "free": list(TRUTH), "hops": 0}
    return [
        {"identify": {**model, **free, "title": "Friction", "recordings": [fitted]}},
        {"verify": {"recordings": [unseen], "require": ["r_squared > 0.999"]}},
        {"compare": {**model, "laws": ["LuGre", "Dahl"], "recordings": [fitted, unseen]}},
        {"export": {"format": "c"}},
    ]


def command(name: str, path: Path, out: Path) -> Any:
    return CliRunner().invoke(app, [name, str(path), "--out", str(out)], prog_name="stickslip")


def written(folder: Path, content: Any, name: str = "job.yaml") -> Path:
    (folder / name).write_text(yaml.safe_dump(content, sort_keys=False), "utf-8")
    return folder / name


def test_what_is_tied_stays_so_to_the_export(tmp_path: Path) -> None:
    walked, verified, _, exported = steps(tmp_path)
    walked["identify"] |= {"free": ["sigma_0"], "tied": {"coulomb_force": "'0.386 um' * sigma_0"}}
    path = written(tmp_path, {"title": "Tied", "steps": [walked, verified, exported]})
    done = command("run", path, tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    numbers = json.loads((tmp_path / "out" / "results.json").read_bytes())["numbers"]
    friction = numbers["verify"]["model"]["friction"]
    assert friction["coulomb_force"]["value"] == pytest.approx(0.386e-6 * friction["sigma_0"]["value"])
    assert numbers["friction"]["tied"] == walked["identify"]["tied"]
    walked["identify"]["tied"] = {"coulomb_farce": "'0.386 um' * sigma_0"}
    path = written(tmp_path, {"title": "Tied", "steps": [walked]})
    done = command("run", path, tmp_path / "no")
    assert done.exit_code == 2
    assert "'coulomb_farce' cannot be tied (did you mean 'coulomb_force'?)" in done.stderr


def test_from_a_recording_to_code(tmp_path: Path) -> None:
    """What is verified and exported is what was identified."""
    path = written(tmp_path, {"title": "To code", "steps": steps(tmp_path)})
    done = command("run", path, tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    results = json.loads((tmp_path / "out" / "results.json").read_bytes())
    numbers = results["numbers"]
    assert list(numbers) == ["friction", "verify", "compare", "export_c"]
    for name, true in TRUTH.items():
        assert numbers["friction"]["parameters"][name]["value"] == pytest.approx(true, rel=0.01)
        assert numbers["verify"]["model"]["friction"][name] == pytest.approx(
            {"value": numbers["friction"]["parameters"][name]["value"], "unit": results_unit(name)}
        )
    assert numbers["compare"]["best"] == "LuGre"
    assert "coulomb_force" in "".join(p.read_text("utf-8") for p in (tmp_path / "out" / "c").rglob("*.h"))
    assert (tmp_path / "out" / "report.html").read_text("utf-8").count("<svg") >= 3
    model, _ = model_and_chain(tmp_path / "out" / "results.json")  # of the step that identified
    assert model.friction.sigma_0 == numbers["friction"]["parameters"]["sigma_0"]["value"]
    results["numbers"]["again"] = numbers["friction"]
    (tmp_path / "two.json").write_text(json.dumps(results))
    with pytest.raises(ValueError, match="the steps friction, again have fitted a model each"):
        model_and_chain(tmp_path / "two.json")


def results_unit(name: str) -> str:
    return {"sigma_0": "N/m", "coulomb_force": "N"}[name]


def test_a_requirement_that_is_not_met_fails_the_job(tmp_path: Path) -> None:
    some = steps(tmp_path)[:2]
    some[1]["verify"]["require"] = ["rmse < 1 pm"]
    path = written(tmp_path, {"title": "Strict", "steps": some})
    document = ss.run_job(path, tmp_path / "out")
    assert len(document.failures) == 1
    assert "rmse" in document.failures[0]


def test_a_campaign_takes_what_the_job_recorded(tmp_path: Path) -> None:
    content = copy.deepcopy(SMALL)
    content["runs"][0]["matrix"] = {"voltage": ["55 V", "65 V"], "frequency": ["50 Hz"]}
    content["runs"][0]["repeats"] = 1
    campaign = {
        "model": "kang2007",
        "hops": 0,
        "recordings": [
            {"cells": "walk_65V_50Hz", "use": "fit"},
            {"cells": "walk_*", "use": "verify"},
        ],
    }
    # One step in a file of its own, the other's content here.
    written(tmp_path, content, "experiment.yaml")
    job = {"title": "Both", "steps": [{"record": "experiment.yaml"}, {"identify": campaign}]}
    document = ss.run_job(written(tmp_path, job), tmp_path / "out", figures=False)
    assert {p.stem for p in (tmp_path / "out" / "recordings").glob("*.nc")} == {
        "walk_55V_50Hz",
        "walk_65V_50Hz",
    }
    assert document.numbers["identify"]["verification"]["walk_55V_50Hz"]["r_squared"].value > 0.9
    assert (tmp_path / "out" / "steps" / "2_identify.json").is_file()


def test_recordings_of_the_job_are_found_by_their_names(tmp_path: Path) -> None:
    content = copy.deepcopy(SMALL)
    content["runs"][0]["matrix"] = {"voltage": ["65 V"], "frequency": ["50 Hz"]}
    content["runs"][0]["repeats"] = 1
    drive = {"shape": "Sawtooth", "fields": {"amplitude": "65 V", "frequency": "50 Hz"}}
    recording = {"file": "recordings/walk_65V_50Hz.nc", "drive": drive}
    check = {"model": "kang2007", "recordings": [recording]}
    job = {"title": "Both", "steps": [{"record": content}, {"verify": check}]}
    document = ss.run_job(written(tmp_path, job), tmp_path / "out")
    assert document.numbers["verify"]["verification"]["walk_65V_50Hz"]["rmse"].value > 0.0


def test_a_map_of_what_was_identified(tmp_path: Path) -> None:
    walked = steps(tmp_path)[0]
    volts = {"start": "40 V", "stop": "80 V", "points": 3}
    design = {
        "map": {"voltage": volts, "frequency": "50 Hz", "load": ["0 N", "-50 mN"], "direction": [1, -1]}
    }
    job = {"title": "A map", "steps": [walked, {"design": design}]}
    document = ss.run_job(written(tmp_path, job), tmp_path / "out")
    found = document.numbers["design"]["map"]
    friction = document.numbers["design"]["model"]["friction"]
    law = KANG.friction._replace(**{name: friction[name]["value"] for name in TRUTH})
    law = law._replace(stiction_force=friction["stiction_force"]["value"])
    expected = ss.steady_step(KANG.replace(friction=law, external_force=-0.05), ss.Sawtooth(60.0, 50.0))
    assert found["dimensions"] == ["voltage", "load", "direction"]
    assert found["net_step"]["unit"] == "m"
    assert found["net_step"]["value"][1, 1, 0] == pytest.approx(expected, abs=3e-10)
    assert [one.name for one in document.pictures()][-2:] == ["step2-map-net-step", "step2-map-speed"]


LOG = {"start": 0, "stop": 3, "points": 2, "spacing": "log"}
DESIGNS = (
    ({"map": {}}, "either 'model', a parameter set, or 'fit'"),
    ({"model": "kang2007"}, "a design asks for at least one of map, optimise"),
    ({"model": "kang2007", "map": {"voltage": "65 N", "frequency": 5.0}}, "voltage = '65 N'"),
    ({"model": "kang2007", "map": {"voltage": LOG | {"stop": "3 N"}}}, r"map\.voltage\.stop = '3 N'"),
    ({"model": "kang2007", "map": {"frequency": LOG}}, "frequency: spacing: log needs values above 0 Hz"),
    ({"model": "kang2007", "map": {"volts": 1.0}}, "map: there is no field 'volts'"),
    ({"model": "kang2007", "map": {"frequency": 5.0}}, r"without a waveform, voltage \[V\] must be given"),
)


def test_mistakes_in_a_design_file(tmp_path: Path) -> None:
    for content, message in DESIGNS:
        path = written(tmp_path, {"kind": "design", "title": "x", **content})
        done = command("design", path, tmp_path / "out")
        assert done.exit_code == 2
        assert re.search(message, done.stderr), done.stderr
        assert not (tmp_path / "out").exists()


def test_a_map_from_the_command_line(tmp_path: Path) -> None:
    content = {"kind": "design", "title": "x", "model": "kang2007"}
    path = written(tmp_path, content | {"map": {"voltage": [60.0, "90 V", 160.0], "frequency": 20.0}})
    done = command("design", path, tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    results = json.loads((tmp_path / "out" / "results.json").read_bytes())
    steps_found = results["numbers"]["map"]["net_step"]
    assert steps_found["unit"] == "m"
    assert steps_found["value"][1] == pytest.approx(
        ss.steady_step(ss.load_actuator("kang2007"), ss.Sawtooth(90.0, 20.0)), abs=3e-10
    )
    assert steps_found["value"][2] is None
    assert any("takes 0 V to 150 V" in str(row) for row in results["tables"][0]["rows"])
    assert "map-net-step" in {p.stem for p in (tmp_path / "out" / "figures").iterdir()}


def test_a_kind_that_files_do_not_say(tmp_path: Path) -> None:
    for kind in ("campaign", "experiment"):
        path = written(tmp_path, {"kind": kind, "title": "one", "recordings": []}, "own.yaml")
        with pytest.raises(InputFileError, match=rf"own\.yaml: kind: the file of a {kind} has none"):
            read_job(path)


def test_other_kinds_of_files_are_jobs_of_one_step(tmp_path: Path) -> None:
    examples = Path(ss.__file__).parent / "examples"
    files = [path for path in examples.glob("*.yaml") if path.name != "kang2007_study.yaml"]
    kinds = {path.name: [step.kind for step in read_job(path).steps] for path in files}
    assert kinds == {
        "kang2007_experiment.yaml": ["record"],
        "kang2007_campaign.yaml": ["identify"],
        "friction_loops.yaml": ["identify"],
        "piezo_mirror.yaml": ["identify"],
        "pulled_slider.yaml": ["identify"],
        "kang2007_map.yaml": ["design"],
        "kang2007_design.yaml": ["design"],
        "kang2007_move.yaml": ["move"],
        "motor_steps.yaml": ["steps"],
        "kang2007_piezo.yaml": ["record", "identify"],
        "contact_study.yaml": ["record"],
        "kang2007_hysteresis_experiment.yaml": ["record"],
        "kang2007_hysteresis_campaign.yaml": ["identify"],
        "kang2007_job.yaml": ["record", "identify", "export"],
    }
    with pytest.raises(InputFileError, match=r"stickslip study kang2007_study\.yaml --store DIR"):
        read_job(examples / "kang2007_study.yaml")
    check = {"kind": "verification", "title": "One", "model": "kang2007", "change": {"stage_reaction": False}}
    check["recordings"] = [walk(tmp_path, "one", 65.0, "verify")]
    document = ss.run_job(written(tmp_path, check), tmp_path / "out")
    assert document.title == "One"
    assert document.numbers["verification"]["one"]["r_squared"].value > 0.9


def test_the_steps_of_a_motor_are_calibrated_by_a_job(tmp_path: Path) -> None:
    example = Path(ss.__file__).parent / "examples" / "motor_steps.yaml"
    document = ss.run_job(example, tmp_path)
    law = ss.control.StepLaw.load(tmp_path / "step_law" / "steps.json")
    assert law.forward == pytest.approx([0.2e-6, 0.6e-6, 1e-6], rel=0.03)
    assert law.backward == pytest.approx([0.176e-6, 0.528e-6, 0.88e-6], rel=0.03)
    assert (tmp_path / "step_law" / "steps.csv").is_file()
    assert (tmp_path / "step_law" / "bursts.csv").is_file()
    assert "threshold" in str(document.numbers)
    alone = written(tmp_path, {"measured": "none.csv", "frequency": "100 Hz"}, "alone.yaml")
    assert [one.kind for one in read_job(alone).steps] == ["steps"]
    with pytest.raises(InputFileError, match=r"measured: none\.csv: there is no such file"):
        ss.run_job(alone, tmp_path / "none")


CELLS = {"identify": {"recordings": [{"cells": "a", "use": "fit"}]}}
NO_FIT = {"identify": {"recordings": [{"file": "a.nc", "use": "step"}]}}
MISTAKES = (
    (lambda job: job["steps"][3]["export"].update(format="c++"), "steps.3.export.format"),
    (lambda job: job["steps"].append({}), "steps.4: a step is exactly one of verify, "),
    (lambda job: job.update(steps=[]), "steps: a list of at least one step"),
    (lambda job: job["steps"].pop(0), "steps.0.verify: no model is named, and nothing is identified before"),
    (lambda job: job.update(steps=job["steps"][3:]), "steps.0.export: no model is named, and nothing is "),
    (
        lambda job: job["steps"][0].update(CELLS),
        "steps.0.identify: recordings: 'cells', and nothing is recor",
    ),
    (lambda job: job["steps"][0].update(NO_FIT), "steps.0.identify.recordings: there is none to fit the fri"),
    (
        lambda job: job["steps"][2]["compare"].update(laws=["Lugre"]),
        "steps.2.compare.laws: there is no 'Lugre' (did you mean 'LuGre'?)",
    ),
    (lambda job: job["steps"][0].update(identify="other.yaml"), "other.yaml: there is no field 'steps'"),
)


def test_a_mistake_is_named_with_its_file(tmp_path: Path) -> None:
    """Beside keys, which have a test of their own."""
    written(tmp_path, {"kind": "walk", "steps": 1, "title": "x"}, "other.yaml")
    right = {"title": "To code", "steps": steps(tmp_path)}
    for change, message in MISTAKES:
        job = copy.deepcopy(right)
        change(job)
        with pytest.raises(InputFileError) as caught:
            ss.run_job(written(tmp_path, job), tmp_path / "out")
        assert message in str(caught.value)
        assert str(caught.value).startswith(f"{tmp_path}/{'other' if 'other' in message else 'job'}.yaml: ")
        assert not (tmp_path / "out").exists()


def test_the_schema_knows_all_steps() -> None:
    schema = json_schema()
    steps = {"record", "identify", "verify", "compare", "move", "design", "export", "steps"}
    assert set(registry.steps.packaged()) == steps
    assert set(schema["$defs"]["StepSpec"]["properties"]) == set(registry.steps.names())


def test_ctrl_c_ends_a_step_without_a_rig_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An identification may send no progress for minutes."""
    reached = []

    def fitting(*_: Any, **__: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        reached.append("the fit went on")

    monkeypatch.setattr("stickslip.jobs.steps.identify.run_analysis", fitting)
    path = written(
        tmp_path, {"title": "Both", "steps": [{"record": copy.deepcopy(SMALL)}, steps(tmp_path)[0]]}
    )
    done = command("run", path, tmp_path / "out")
    assert done.exit_code == 130
    assert not reached
    assert done.stderr.splitlines()[-1] == "Error: interrupted; what was finished is kept"
    assert "ramp" not in done.stderr
    assert len(list((tmp_path / "out" / "recordings").glob("*.nc"))) == 8


def test_ctrl_c_in_a_recording_is_heard_before_the_next_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also after the last recording has said how far it is: what is recorded is kept whole."""
    csv = EXPORTS["csv"]

    def last(recording: Any, target: Path) -> Path:
        if len(list(target.parent.glob("*.nc"))) == 8:
            signal.raise_signal(signal.SIGINT)
        return csv.write(recording, target)

    monkeypatch.setitem(EXPORTS, "csv", csv._replace(write=last))
    content = {**copy.deepcopy(SMALL), "save_as": ["csv"]}
    path = written(tmp_path, {"title": "Both", "steps": [{"record": content}, steps(tmp_path)[0]]})
    done = command("run", path, tmp_path / "out")
    assert done.exit_code == 130
    assert "ending, with a ramp to 0 V" in done.stderr
    assert not (tmp_path / "out" / "steps").exists()
    for kind in ("nc", "csv"):
        assert len(list((tmp_path / "out" / "recordings").glob(f"*.{kind}"))) == 8


def recorded(folder: Path, *more: dict[str, Any]) -> Path:
    """A job that records walk_55V_50Hz and walk_65V_50Hz, and goes on."""
    content = copy.deepcopy(SMALL)
    content["runs"][0] |= {"matrix": {"voltage": ["55 V", "65 V"], "frequency": ["50 Hz"]}, "repeats": 1}
    return written(folder, {"title": "Recorded", "steps": [{"record": content}, *more]})


def verified(file: str = "recordings/walk_65V_50Hz.nc", **how: Any) -> dict[str, Any]:
    recording = {"file": file, **how.pop("recording", {})}
    return {"verify": {**({} if "fit" in how else {"model": "kang2007"}), "recordings": [recording], **how}}


def identified(*cells: tuple[str, str], **how: Any) -> dict[str, Any]:
    return {"identify": {"recordings": [{"cells": one, "use": use} for one, use in cells], **how}}


LACKING = (
    (
        verified("recordings/walk_66V_50Hz.nc"),
        "verify.recordings.0: recordings/walk_66V_50Hz.nc: there is no such file, and no step before makes it"
        " (did you mean 'recordings/walk_65V_50Hz.nc'?)",
    ),
    (verified("gone.csv"), "verify.recordings.0: gone.csv: there is no such file"),
    (verified(fit="gone.json"), "verify.fit: gone.json: there is no such file"),
    (
        verified(model="kang207"),
        "verify.model: there is no parameter set 'kang207' (did you mean 'kang2007'?)",
    ),
    (verified(require=["r_squared > 0.9", "rmse < 100"]), "verify.require.1: 'rmse < 100' has no unit"),
    (
        identified(("walk_55V*", "fit"), ("walk_5*", "verify")),
        "identify.recordings.1: no cell that is left fits 'walk_5*'; left are walk_65V_50Hz",
    ),
    ({"export": {"model": "kang207"}}, "export.model: there is no parameter set 'kang207'"),
    (identified(("walk*", "fit"), free=["sigma_O"]), "identify.free: 'sigma_O' cannot be free"),
    (
        identified(("walk*", "fit"), bounds={"sigma_2": [0, 1]}),
        "identify.free: there are bounds for 'sigma_2', which is not free",
    ),
    (verified("mine.csv", recording={"columns": {"x": "pos"}}), "verify.recordings.0: "),
)


def test_what_a_later_step_lacks_is_said_before_the_first(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("t [s],x [um]\n0,1\n1,2\n2,3\n", "utf-8")
    for step, words in LACKING:
        path = recorded(tmp_path, step)
        done = command("run", path, tmp_path / "out")
        assert done.exit_code == 2
        assert f"Error: {path}: steps.1.{words}" in done.stderr
        assert not (tmp_path / "out").exists()


def test_the_steps_before_one_that_fails_have_their_report(tmp_path: Path) -> None:
    late = {"file": "recordings/walk_55V_50Hz.nc", "start": "50 s"}
    check = {"model": "kang2007", "recordings": [late]}
    path = recorded(tmp_path, {"verify": check}, {"export": {"model": "kang2007"}})
    done = command("run", path, tmp_path / "out")
    assert done.exit_code != 0
    last = done.stderr.splitlines()[-1]
    assert last.startswith("Error: ")
    assert "walk_55V_50Hz.nc: from 50.0 s" in last
    assert "that was in step 2 of 3, verify; the report is of those before it" in last
    results = json.loads((tmp_path / "out" / "results.json").read_bytes())
    assert [one.startswith("step 2 of 3, verify, failed: ") for one in results["failures"]] == [True]
    assert "walk_55V_50Hz.nc: from 50.0 s" in results["failures"][0]
    (kept,) = results["numbers"].values()
    assert set(kept) >= {"walk_55V_50Hz", "walk_65V_50Hz"}
    assert "Step 2 of 3, verify, failed" in (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "Not begun: export" in results["summary"]


@pytest.mark.filterwarnings("default")
def test_a_job_that_runs_again_puts_its_code_under_the_same_names(tmp_path: Path) -> None:
    """Two exports of one job have two names; what an earlier run wrote goes to the bin."""
    exports = [{"export": {"model": name}} for name in ("kang2007", "pohl1987")]
    path, out = written(tmp_path, {"title": "Code", "steps": exports}), tmp_path / "out"
    ss.run_job(path, out)
    before = {name: (out / name / "stickslip_parameters.c").read_text("utf-8") for name in ("c", "c_2")}
    assert before["c"] != before["c_2"]
    (out / "c" / "mine.txt").write_text("a note", "utf-8")
    with pytest.warns(RecordingWarning, match=r"an earlier run had put there is in .*\.bin"):
        ss.run_job(path, out)
    assert {p.name for p in out.iterdir()} == {"c", "c_2", ".bin"}
    assert {name: (out / name / "stickslip_parameters.c").read_text("utf-8") for name in before} == before
    assert (out / ".bin" / "c" / "mine.txt").is_file()
    assert not (out / "c" / "mine.txt").exists()
