"""Parts of a design file: each is the package's own call, a mistake is named, and what was done is kept."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip import design
from stickslip.cli import app
from stickslip.jobs.analysis.design import design_analysis
from stickslip.jobs.analysis.design_given import draws_of_file
from stickslip.jobs.analysis.file import AnalysisError
from stickslip.rig.experiment.running import read_experiment

KANG = ss.load_actuator("kang2007")
PULLED = {"name": "pulled", "change": {"external_force": "-0.1 N"}}
LIMITS = {"current": "0.3 A", "capacitance": "1.8 uF"}
OPTIMISE: dict[str, Any] = {
    "goal": "speed", "knots": 4, "max_voltage": "90 V", "frequency": ["50 Hz", "1 kHz"], "limits": LIMITS,
    "generator": {"update_rate": "20 kHz", "points": 400, "step": "0.1 V"}, "scenarios": [PULLED], "draws": 2,
    "budget": 100,
}  # fmt: skip
FRONT = {
    "goals": ["speed", {"current": "1.8 uF"}],
    "knots": 4,
    "points": 8,
    "generations": 2,
    "max_voltage": 90.0,
}
BUILT = {"goal": "speed", "free": {"load": [0.5, 2]}, "max_voltage": "90 V", "budget": 50, "draws": 2}
FREE = ["sigma_0", "coulomb_force"]
PLAN = {
    "free": FREE,
    "noise": "100 nm",
    "duration": "0.1 s",
    "recordings": 1,
    "limits": {"max_voltage": "80 V"},
}
PARTS: dict[str, Any] = {"optimise": OPTIMISE, "front": FRONT, "actuator": BUILT, "plan": PLAN}


def written(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "design.yaml"
    file.write_text(
        yaml.safe_dump({"kind": "design", "title": "All of it", **content}, sort_keys=False), "utf-8"
    )
    return file


def run(file: Path, command: str = "design") -> Any:
    out = file.parent / "out"
    return CliRunner().invoke(app, [command, str(file), "--out", str(out)], prog_name="stickslip")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a file with all parts, but the map, was run, with samples of a posterior as its uncertainty."""
    made = tmp_path_factory.mktemp("design")
    random = np.random.default_rng(3)
    samples = {"coulomb_force": 0.5401 * np.exp(0.1 * random.standard_normal((2, 20)))}
    columns = {name: (("chain", "draw"), values) for name, values in samples.items()}
    xr.Dataset(columns | {"log_posterior": (("chain", "draw"), np.zeros((2, 20)))}).to_netcdf(
        made / "known.nc"
    )
    done = run(written(made, {"model": "kang2007", "uncertainty": "known.nc", **PARTS}))
    assert done.exit_code == 0, done.output
    return made


@pytest.fixture(scope="module")
def numbers(folder: Path) -> Any:
    return json.loads((folder / "out" / "results.json").read_bytes())["numbers"]


def test_the_drive_is_that_of_the_call(folder: Path, numbers: Any) -> None:
    force = design.Scenario("pulled", external_force="-0.1 N")
    found = ss.optimise_waveform(
        KANG, goal="speed", knots=4, max_voltage="90 V", frequency=(50.0, 1000.0), scenarios=[force],
        output=ss.physics.electronics.OutputStage("20 kHz", 400, "0.1 V", **LIMITS),  # type: ignore[arg-type]
        uncertainty=draws_of_file(folder / "known.nc"), draws=2, budget=100,
    )  # fmt: skip
    told = numbers["optimise"]
    assert told["reached"] == {"value": found.value, "unit": "m/s"}
    assert told["values"]["value"] == found.values.tolist()
    assert told["conditions"] == ["nominal", "pulled", "draw 1", "pulled draw 1", "draw 2", "pulled draw 2"]
    assert told["condition_coulomb_force"]["unit"] == "N"
    assert told["waveform"]["values"]["value"] == list(found.waveform.values)
    run_of = yaml.safe_load((folder / "out" / "drive.yaml").read_text("utf-8"))["waveform"][0]
    assert ss.PeriodicKnots(**run_of["fields"]) == found.waveform
    played = np.loadtxt(folder / "out" / "drive.csv", delimiter=",", skiprows=1)
    assert found.played is not None
    assert played[:, 1] == pytest.approx(found.played.values, abs=1e-6)


def test_front_actuator_and_plan_are_those_of_the_calls(folder: Path, numbers: Any) -> None:
    goals = ("speed", design.Current("1.8 uF"))
    front = design.waveform_front(KANG, goals=goals, knots=4, points=8, generations=2, max_voltage=90.0)
    assert numbers["front"]["speed"]["value"] == front.table.speed.values.tolist()
    assert numbers["front"]["drives"]["drive_1"]["values"]["value"] == list(front.waveforms[0].values)
    known = draws_of_file(folder / "known.nc")
    found = design.optimise_actuator(
        KANG, goal="speed", free={"load": (0.5, 2)}, max_voltage="90 V", budget=50, draws=2, uncertainty=known
    )
    assert numbers["actuator"]["free"]["load"]["value"] == found.load
    assert numbers["actuator"]["reached"]["value"] == found.value
    limits = ss.rig.Limits(min_voltage=0.0, max_voltage=80.0)
    plan = ss.plan_experiment(
        KANG, free=FREE, noise="100 nm", duration="0.1 s", recordings=1, limits=limits, draws=known
    )
    assert list(numbers["plan"]["recordings"]) == list(plan.recordings)
    told = numbers["plan"]["parameters"]["sigma_0"]
    assert told["half_width"] == pytest.approx(float(plan.dataset.half_width.sel(parameter="sigma_0")))
    assert told["worst_half_width"] > told["half_width"]
    assert len(read_experiment(folder / "out" / "experiment.yaml").runs) == 1
    drawn = {p.stem for p in (folder / "out" / "figures").iterdir()}
    assert drawn == {"drive", "conditions", "front", "actuator", "plan"}


BENCH = {"bench": "kang2007-bench"}


def optimise(**change: Any) -> dict[str, Any]:
    return {"optimise": OPTIMISE | change}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, "a design asks for at least one"),
        ({"optimise": {"max_voltage": 90.0}}, "optimise: a goal is needed"),
        ({"optimise": {"goal": {"step": "2 V"}}}, "optimise: .*step"),
        ({"optimise": {"gaol": "speed"}}, "optimise: .*'goal'"),
        (optimise(max_voltage="0 V"), "optimise: .*exclude every drive"),
        (optimise(limits=BENCH | {"current": 1.0}), r"limits\.current"),
        (optimise(generator={"points": 30}), r"generator\.update_rate"),
        (optimise(generator={"points": 3}), r"generator\.points: points = 3 is out of range"),
        ({"plan": PLAN | {"free_drives": {"knots": 2}}}, r"plan\.free_drives\.knots: knots = 2 is out of"),
        ({"plan": PLAN | {"channel": {"offset": 1.0}}}, r"plan\.channel: there is no field 'offset'"),
        (optimise(scenarios=[{"change": {"mass": 1.0}}]), "optimise: Scenario .*mass"),
        ({"front": FRONT | {"goals": ["speed"]}}, "front: goals"),
        ({"actuator": BUILT | {"free": {"mass": [1, 2]}}}, "actuator: free.*mass"),
        ({"plan": PLAN | {"noise": None}}, "plan: noise"),
        ({"uncertainty": "none.nc", "plan": PLAN}, "none.nc: no samples"),
        ({"uncertainty": "other.nc", "plan": PLAN}, "plan: draws: .*another model"),
    ],
)  # fmt: skip
def test_a_mistake_is_named(tmp_path: Path, content: dict[str, Any], said: str) -> None:
    xr.Dataset({"k": ("draw", np.ones(3))}).to_netcdf(tmp_path / "other.nc")
    done = run(written(tmp_path, {"model": "kang2007", **content}))
    assert done.exit_code == 2, done.output
    assert re.search(said, " ".join(done.stderr.split())), done.stderr
    assert not (tmp_path / "out").exists()


def test_a_map_behind_an_output_is_that_of_the_call(tmp_path: Path) -> None:
    asked = {"voltage": [60.0], "frequency": [70.0, 1300.0], "limits": {"slew_rate": "300 kV/s"}}
    done = run(
        written(tmp_path, {"model": "kang2007", "map": {**asked, "generator": {"update_rate": "20 kHz"}}})
    )
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "out" / "results.json").read_bytes())["numbers"]["map"]["net_step"]["value"]
    output = ss.physics.electronics.OutputStage(20e3, slew_rate=300e3)
    of_call = ss.step_map(KANG, voltage=[60.0], frequency=[70.0, 1300.0], output=output).net_step.values
    np.testing.assert_array_equal(told, of_call)


def test_what_was_done_before_a_mistake_is_kept(tmp_path: Path) -> None:
    asked = {"map": {"voltage": [60.0], "frequency": 20.0}, "optimise": {}, "plan": PLAN}
    done = run(written(tmp_path, {"model": "kang2007", **asked}))
    assert done.exit_code == 1
    assert "optimise: a goal is needed" in done.stderr
    results = json.loads((tmp_path / "out" / "results.json").read_bytes())
    assert set(results["numbers"]) == {"map", "plan", "model"}
    assert results["failures"][0].startswith("optimise: a goal is needed")


def test_stopped_parts_are_kept_and_the_others_not_begun(tmp_path: Path) -> None:
    analysis, _ = design_analysis(written(tmp_path, {"model": "kang2007", "front": FRONT, "plan": PLAN}))

    def stop(doing: str, done: float) -> None:
        raise KeyboardInterrupt

    document = analysis.run(tmp_path, stop)
    assert set(document.numbers) == {"front", "model"}
    assert [one.partition(":")[0] for one in document.failures] == ["front", "not begun"]


@pytest.mark.parametrize("command", ["design", "run"])
def test_what_was_done_before_an_interruption_is_written(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it comes before the search has anything to show: the map is finished."""

    def early(*_: Any, **__: Any) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("stickslip.jobs.analysis.design_drives.optimise_waveform", early)
    asked = {"map": {"voltage": [60.0], "frequency": 20.0}, "optimise": {"goal": "speed"}, "plan": PLAN}
    done = run(written(tmp_path, {"model": "kang2007", **asked}), command)
    assert done.exit_code == 130
    assert done.stderr.splitlines()[-2:] == [
        "optimise: stopped before anything was found; not begun: plan",
        "Error: interrupted; what was finished is kept",
    ]
    results = json.loads((tmp_path / "out" / "results.json").read_bytes())
    assert set(results["numbers"]) == {"map", "model"}
    assert results["failures"] == ["optimise: stopped before anything was found", "not begun: plan"]


def test_draws_of_a_campaign_have_its_errors_and_correlations(tmp_path: Path) -> None:
    rng_free = {"sigma_0": (1.4e6, 2.8e4), "delay": (-1e-4, 2e-5), "lost": (1.0, None)}
    known = {
        name: {"value": value, "unit": "", "standard_error": error}
        for name, (value, error) in rng_free.items()
    }
    coefficients = [[1.0, 0.8, None], [0.8, 1.0, None], [None, None, None]]
    part = {
        "parameters": {},
        "parameters_with_all_errors": known,
        "correlation": {"parameters": [*known], "coefficients": {"value": coefficients}},
    }
    file = tmp_path / "results.json"
    file.write_text(json.dumps({"numbers": {"friction": part}}), "utf-8")
    drawn = draws_of_file(file)
    assert list(drawn) == ["sigma_0", "delay"]
    assert np.std(np.log(drawn["sigma_0"])) == pytest.approx(0.02, rel=0.1)
    assert np.mean(drawn["delay"]) == pytest.approx(-1e-4, rel=0.02)
    assert np.std(drawn["delay"]) == pytest.approx(2e-5, rel=0.1)
    assert np.corrcoef(np.log(drawn["sigma_0"]), drawn["delay"])[0, 1] == pytest.approx(0.8, abs=0.05)
    file.write_text(json.dumps({"numbers": {"r_squared": 1.0}}), "utf-8")
    with pytest.raises(
        AnalysisError, match=r"results\.json: no results of an identification that says how sure"
    ):
        draws_of_file(file)
