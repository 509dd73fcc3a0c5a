"""Verification files and `stickslip verify`, as a lab's own checks would use them."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from stickslip.cli import app
from stickslip.identify.results import chain_numbers, model_numbers
from stickslip.identify.saved import save_fit
from stickslip.identify.verification import net_step, verify
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import to_si
from stickslip.recording import RecordingWarning, open_recording, save_recording
from stickslip.recording.chain import Chain
from stickslip.recording.readers import inspect_file, read_recording
from stickslip.report import Document, Number, write_report
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest

DRIVE = {"shape": "Sawtooth", "fields": {"amplitude": 65.0, "frequency": 100.0, "periods": 2}}
MODEL = load_actuator("kang2007").replace(stage_reaction=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("verify")
    walk = simulate(MODEL, Sawtooth(**DRIVE["fields"]), 0.02, sample_rate=10e3, tolerance=1e-11)
    save_recording(walk, made / "walk.nc")
    file = {
        "kind": "verification",
        "title": "The actuator as it is",
        "model": "kang2007",
        "change": {"stage_reaction": False},
        "recordings": [{"file": "walk.nc", "drive": DRIVE}],
        "require": ["r_squared > 0.99", "net_step_error < 1 %"],
    }
    (made / "check.yaml").write_text(yaml.safe_dump(file), "utf-8")
    return made


def run(*arguments: str):
    return CliRunner().invoke(app, ["verify", *arguments], prog_name="stickslip")


def test_what_is_required_is_met(folder: Path) -> None:
    done = run(str(folder / "check.yaml"), "--out", str(folder / "out"))
    assert done.exit_code == 0, done.stderr
    assert "All of the 2 requirements met" in done.stdout
    results = json.loads((folder / "out" / "results.json").read_bytes())
    found = results["numbers"]["verification"]["walk"]
    assert found["r_squared"]["value"] > 0.999999
    assert found["rmse"]["unit"] == "m"
    assert found["net_step_error"]["value"] < 1e-3
    assert results["failures"] == []


def test_what_is_not_met_fails_with_a_sentence(folder: Path) -> None:
    content = yaml.safe_load((folder / "check.yaml").read_text("utf-8"))
    content["friction"] = {"coulomb_force": "0.3 N", "stiction_force": "0.3 N"}
    (folder / "wrong.yaml").write_text(yaml.safe_dump(content), "utf-8")
    done = run(str(folder / "wrong.yaml"), "--require", "rmse < 1 nm", "--out", str(folder / "wrong"))
    assert done.exit_code == 1
    said = [line for line in done.stderr.splitlines() if line.startswith("Error: not as required: walk: ")]
    assert [line.split()[5] for line in said] == ["r_squared", "net_step_error", "rmse"]
    assert said[0].endswith("which is not > 0.99")
    page = (folder / "wrong" / "report.html").read_text("utf-8")
    assert "Not as required" in page


def test_results_of_an_identification_are_verified(folder: Path) -> None:
    numbers = {"model": model_numbers(MODEL), "parameters": {}}
    write_report(Document("A fit", "Made.", [], numbers=numbers), folder / "fit")
    results = str(folder / "fit" / "results.json")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        done = run(results, str(folder / "walk.nc"), "--require", "rmse < 2 um", "--out", str(folder / "o2"))
    assert "Drive of walk: Sawtooth 65 V, 100 Hz, 2 periods, named by the recording" in done.stdout
    assert done.exit_code == 0, done.stderr
    assert run(results, "--out", str(folder / "o4")).exit_code == 2
    assert run(str(folder / "o2" / "report.html"), "--out", str(folder / "o5")).exit_code == 2
    both = run(str(folder / "check.yaml"), str(folder / "walk.nc"), "--out", str(folder / "o6"))
    assert both.exit_code == 2
    assert "is a verification file and names its recordings" in both.stderr


@pytest.mark.parametrize(("zeroed", "judged"), [(False, 501), (True, 211)])
def test_the_report_says_how_many_samples_are_judged(folder: Path, zeroed: bool, judged: int) -> None:
    """With the chain of a campaign, samples later than 5 % of the drive's duration after its end are cut."""
    walk = simulate(MODEL, Sawtooth(**DRIVE["fields"]), 0.05, sample_rate=10e3, tolerance=1e-11)
    save_recording(walk, folder / f"long-{judged}.nc")
    numbers = {"model": model_numbers(MODEL), "signal_chain": chain_numbers(Chain(zeroed=zeroed))}
    fit, out = folder / f"fit-{judged}", folder / f"out-{judged}"
    write_report(Document("A fit", "Made.", [], numbers=numbers), fit)
    done = run(str(fit / "results.json"), str(folder / f"long-{judged}.nc"), "--out", str(out))
    assert done.exit_code == 0, done.stderr
    results = json.loads((out / "results.json").read_bytes())
    assert results["numbers"]["verification"][f"long-{judged}"]["n_data"]["value"] == judged
    (table,) = results["tables"]
    assert (table["columns"][1]["name"], table["rows"][0][1]) == ("samples", judged)
    said = "long-211: 211 of 501 samples are judged, those up to shortly after the drive"
    assert (said in (out / "report.html").read_text("utf-8")) == zeroed


@pytest.mark.filterwarnings("default")
def test_a_table_of_one_s_own_is_verified_in_the_words_of_the_command(folder: Path) -> None:
    write_report(
        Document("A fit", "Made.", [], numbers={"model": model_numbers(MODEL)}), folder / "table-fit"
    )
    results = str(folder / "table-fit" / "results.json")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        direct = run(results, str(folder / "walk.nc"), "--out", str(folder / "t0"))
    assert direct.exit_code == 0, direct.stderr
    expected = json.loads((folder / "t0" / "results.json").read_bytes())["numbers"]["verification"]["walk"]

    def table(name: str, header: str) -> str:
        walk = open_recording(folder / "walk.nc")
        columns = (
            1e3 * walk["time"].values,
            1e6 * walk["end_effector_position"].values,
            walk["drive_voltage"].values,
        )
        np.savetxt(folder / name, np.column_stack(columns), "%.12g", ",", header=header, comments="")
        return str(folder / name)

    def verified(file: str, *options: str):
        done = run(results, file, *options, "--out", str(folder / "t1"))
        assert done.exit_code == 0, done.stderr
        said = json.loads((folder / "t1" / "results.json").read_bytes())["numbers"]["verification"]
        (found,) = said.values()
        assert found["rmse"]["value"] == pytest.approx(expected["rmse"]["value"], abs=1e-11)  # digits
        page = (folder / "t1" / "report.html").read_text("utf-8")
        assert ("without being told" in page) == ("without being told" in done.stderr)
        return page

    strange = table("scope.csv", "a [ms],b,c")
    done = run(results, strange, "--out", str(folder / "t2"))
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert "which column is end_effector_position? Say --column end_effector_position=..., of 'a" in line
    named = ["--column", "time=a", "--column", "end_effector_position=b", "--column", "drive_voltage=c"]
    page = verified(strange, *named, "--unit", "end_effector_position=um")
    assert "without being told" not in page
    page = verified(table("usual.csv", "time [ms],position [um],drive voltage [V]"))
    assert "end_effector_position from" in page
    page = verified(table("bare.csv", "time,position,drive voltage"))
    assert "time in ms, end_effector_position in um, drive_voltage in V" in page

    for options, words in (
        (["--column", "position"], "--column position: write NAME=..."),
        (["--unit", "=um"], "--unit =um: write NAME=..."),
        ([*named, "--unit", "drive_volts=V"], "did you mean 'drive_voltage'"),
        (["--column", "end_effector_positon=b"], "did you mean 'end_effector_position'"),
    ):
        done = run(results, strange, *options, "--out", str(folder / "t3"))
        assert done.exit_code == 2
        assert words in done.stderr.splitlines()[-1]
    done = run(str(folder / "check.yaml"), "--unit", "drive_voltage=V", "--out", str(folder / "t4"))
    assert "--unit: goes with a results.json" in done.stderr


def test_results_without_an_actuator_say_which_have_one(folder: Path) -> None:
    write_report(Document("A simulation", "Made.", [], numbers={"step": Number(1.0, "m")}), folder / "none")
    done = run(str(folder / "none" / "results.json"), str(folder / "walk.nc"), "--out", str(folder / "n1"))
    assert done.exit_code == 2
    assert "there is no 'model' in it; what stickslip identify, campaign or run has written" in done.stderr
    (folder / "loop.csv").write_text("t [s],pos [um],Friction [mN]\n0,1,2\n1,2,3\n2,3,4\n")
    table = run(str(folder / "none" / "results.json"), str(folder / "loop.csv"), "--out", str(folder / "n1"))
    assert table.stderr == done.stderr  # before any column is asked for


def test_wrong_files_are_refused(folder: Path) -> None:
    content = yaml.safe_load((folder / "check.yaml").read_text("utf-8"))
    for change, words in (
        ({"fit": "fit.json"}, "either 'model'"),
        ({"model": None, "fit": "none.json"}, "no results of an identification"),
        ({"require": ["r_squared >> 1"]}, "r_squared"),
        ({"recordings": []}, "recordings"),
    ):
        (folder / "bad.yaml").write_text(yaml.safe_dump({**content, **change}), "utf-8")
        done = run(str(folder / "bad.yaml"), "--out", str(folder / "bad"))
        assert done.exit_code == 2
        assert words in done.stderr


def test_a_saved_fit_predicts_like_the_fit_itself(folder: Path) -> None:
    drive = Sawtooth(**DRIVE["fields"])
    walk = open_recording(folder / "walk.nc")
    fit = identify_friction(
        walk, MODEL, ["coulomb_force"], drive=drive, channel=["offset"], hops=0, max_evaluations=3
    )
    save_fit(fit, folder / "fit.json")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = run(str(folder / "fit.json"), str(folder / "walk.nc"), "--out", str(folder / "saved"))
        expected = verify(fit, walk)
    assert done.exit_code == 0, done.stderr
    found = json.loads((folder / "saved" / "results.json").read_bytes())["numbers"]["verification"]["walk"]
    assert found["rmse"]["value"] == pytest.approx(expected.rmse)
    loose = replace(fit, predict=None)
    save_fit(loose, folder / "loose.json")
    done = run(str(folder / "loose.json"), str(folder / "walk.nc"))
    assert done.exit_code != 0
    assert "it is a saved fit, but of no walk" in done.stderr


def test_a_limit_without_its_unit_is_refused_before_anything_is_read(folder: Path) -> None:
    """In SI 100 would be 100 m, which every recording meets."""
    said = "'rmse < 100' has no unit: write one behind the number, as in rmse < 100 nm"
    done = run(str(folder / "check.yaml"), "--require", "rmse < 100", "--out", str(folder / "bare"))
    assert done.exit_code == 2
    assert f"Error: --require: {said}" in done.stderr
    content = yaml.safe_load((folder / "check.yaml").read_text("utf-8"))
    content |= {"require": ["rmse < 100"], "recordings": [{"file": "gone.nc"}]}
    (folder / "bare.yaml").write_text(yaml.safe_dump(content), "utf-8")
    done = run(str(folder / "bare.yaml"), "--out", str(folder / "bare"))
    assert done.exit_code == 2
    assert f"Error: {folder}/bare.yaml: require: {said}" in done.stderr
    assert not (folder / "bare").exists()


def test_the_net_step_of_a_drive_that_is_only_sampled(folder: Path) -> None:
    """Recordings made from tables name no waveform: the command of docs/verify.md could only fail."""
    random = np.random.default_rng([11, 0])
    drive = Sawtooth(round(random.uniform(50.0, 90.0)), round(random.uniform(10.0, 40.0)), periods=5)
    rest, trigger = random.uniform(0.02, 0.05), random.choice([0.0, 0.03])
    time = np.arange(0.0, rest + 5.2 / drive.frequency, 1e-4)
    whole = Sequence(Rest(rest), drive)
    noise = 1e-8 * random.standard_normal(time.size)
    table = {
        "time [ms]": 1e3 * (time - trigger),
        "position [um]": 1e6 * (simulate(MODEL, whole, times=time).end_effector_position.values + noise),
        "drive [V]": whole.value(time),
    }
    file = folder / "sampled.csv"
    np.savetxt(file, np.column_stack([*table.values()]), "%.7g", ",", header=",".join(table), comments="")
    found = inspect_file(file)
    save_recording(read_recording(file, found.named, found.units), folder / "new.nc")
    write_report(Document("A fit", "Made.", [], numbers={"model": model_numbers(MODEL)}), folder / "a-fit")
    steps = []
    for name in ("new.nc", file.name):
        wanted = ["--require", "r_squared > 0.99", "--require", "net_step_error < 2 %"]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            done = run(
                str(folder / "a-fit" / "results.json"),
                str(folder / name),
                *wanted,
                "--out",
                str(folder / "s"),
            )
        assert done.exit_code == 0, done.stderr
        assert "All of the 2 requirements met" in done.stdout
        said = f"Sawtooth {drive.amplitude:g} V, {drive.frequency:g} Hz, 5 periods, recognised in"
        page = (folder / "s" / "report.html").read_text("utf-8")
        assert said in page
        numbers = json.loads((folder / "s" / "results.json").read_bytes())["numbers"]
        (told,), (one,) = numbers["drives"], numbers["verification"].values()
        assert said in told
        steps.append(one["net_step"]["value"])
    expected = net_step(time, 1e-6 * table["position [um]"], whole)
    assert steps == pytest.approx([expected] * 2, rel=0.01)


def test_a_sampled_drive_without_a_waveform_says_what_to_do(folder: Path) -> None:
    time = np.arange(0.0, 0.2, 1e-4)
    volts = 75.0 + np.cumsum(np.random.default_rng(5).standard_normal(time.size)) * (time > 0.02)
    walk = simulate(MODEL, Sampled(time, volts), times=time)
    save_recording(walk.drop_attrs(deep=False), folder / "wild.nc")
    write_report(Document("A fit", "Made.", [], numbers={"model": model_numbers(MODEL)}), folder / "a-fit")
    results, wild = str(folder / "a-fit" / "results.json"), str(folder / "wild.nc")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = run(results, wild, "--require", "net_step_error < 2 %", "--out", str(folder / "w"))
    assert done.exit_code == 1
    assert "name it, as drive of the recording in a verification file" in done.stderr


@pytest.mark.parametrize(("force", "code"), [("0.5401 N", 0), ("0.45 N", 1)])
def test_a_noisy_monitor_is_no_other_drive_and_what_is_not_explained_fails(
    folder: Path, force: str, code: int
) -> None:
    """A campaign takes the sawtooth that the monitor shows; its samples would have been a wrong drive."""
    random = np.random.default_rng(46)
    drive = Sequence(Rest(0.1), (Sawtooth(65.0, 5.0, periods=4), 0.85))
    time = np.arange(0.0, 0.95, 2.5e-4)
    walk = simulate(MODEL, drive, times=time).end_effector_position.values
    table = {
        "t [ms]": 1e3 * time,
        "x [um]": 1e6 * (walk + 20e-9 * random.standard_normal(time.size)),
        "u [V]": drive.value(time) + 0.02 * random.standard_normal(time.size),
    }
    np.savetxt(
        folder / "noisy.csv",
        np.column_stack([*table.values()]),
        "%.6f",
        ",",
        header=",".join(table),
        comments="",
    )
    law = MODEL.friction._replace(coulomb_force=to_si(force, "N"), stiction_force=to_si(force, "N"))
    numbers = {"model": model_numbers(MODEL.replace(friction=law))}
    write_report(Document("A fit", "Made.", [], numbers=numbers), folder / "noisy-fit")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RecordingWarning)
        done = run(
            str(folder / "noisy-fit" / "results.json"), str(folder / "noisy.csv"), "--out", str(folder / "n")
        )
    assert done.exit_code == code, done.output
    assert "Drive of noisy: Sawtooth 65 V, 5 Hz, 4 periods, recognised in drive_voltage" in done.stdout
    assert "residual 20 mV rms" in done.stdout
    assert ("does not explain noisy" in done.stdout) == bool(code)
    assert ("does not explain noisy" in done.stderr) == bool(code)
