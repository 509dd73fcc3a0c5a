"""An interrupted campaign continues: finished stages are not computed again, and the result is the same."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.jobs.campaign import evaluation
from stickslip.report.circumstances import circumstances
from stickslip.report.results import results_json

MODEL = ss.load_actuator("kang2007").replace(stage_reaction=False)
# Computations, and the files in which their stages are kept.
STAGES = {
    "identify_step": "stage",
    "step_formula_errors": "formulas",
    "_friction": "friction",
    "_explained": "all-walks",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a campaign of a clamped step and two walks, few samples of each."""
    made, random = tmp_path_factory.mktemp("kept"), np.random.default_rng(46)
    runs = {
        "step": (MODEL.replace(clamped=True), ss.Step(50.0), 20e3, 0.05),
        "slow": (MODEL, ss.Sawtooth(65.0, 20.0, periods=3), 4e3, 0.2),
        "fast": (MODEL, ss.Sawtooth(75.0, 20.0, periods=3), 4e3, 0.2),
    }
    for name, (model, wave, rate, length) in runs.items():
        drive = ss.waveform.Sequence(ss.waveform.Rest(0.02), (wave, length - 0.02))
        times = np.arange(round(length * rate)) / rate
        moved = ss.simulate(model, drive, times=times)["end_effector_position"].values
        channels = {
            "end_effector_position": moved + 20e-9 * random.standard_normal(times.size),
            "drive_voltage": drive.value(times) + 0.01 * random.standard_normal(times.size),
        }
        ss.save_recording(ss.make_recording(times, channels), made / f"{name}.nc")
    uses = {"step": "step", "slow": "fit", "fast": "verify"}
    content = {
        "title": "Kept",
        "change": {"stage_reaction": False},
        "free": ["sigma_0", "coulomb_force"],
        "hops": 0,
        "profiles": True,
        "recordings": [{"file": f"{name}.nc", "use": use} for name, use in uses.items()],
    }
    (made / "campaign.yaml").write_text(yaml.safe_dump(content), "utf-8")
    return made


@pytest.fixture
def finished(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each computation came to its end."""
    counts: Counter[str] = Counter()

    def counted(name: str) -> None:
        compute: Callable[..., Any] = getattr(evaluation, name)

        def wrapper(*arguments: Any, **options: Any) -> Any:
            found = compute(*arguments, **options)
            counts[name] += 1
            return found

        monkeypatch.setattr(evaluation, name, wrapper)

    for name in STAGES:
        counted(name)
    return counts


def _interrupts(patch: pytest.MonkeyPatch, name: str, begins: Callable[[], object]) -> None:
    """The computation is interrupted before it begins, and when it has ended and is not kept yet."""
    compute: Callable[..., Any] = getattr(evaluation, name)
    calls: list[str] = []

    def wrapper(*arguments: Any, **options: Any) -> Any:
        begins()
        calls.append(name)
        found = compute(*arguments, **options) if len(calls) > 1 else None
        if len(calls) < 3:
            raise KeyboardInterrupt
        return found

    patch.setattr(evaluation, name, wrapper)


def _there(out: Path, stage: str) -> bool:
    return bool([*out.glob(f"stages/{stage}-????????????????.json.gz")])


def numbers(document: Any) -> Any:
    return json.loads(results_json(document, circumstances()))["numbers"]


def run(folder: Path, out: Path, file: str = "campaign.yaml") -> Any:
    """The document; None where it was interrupted, as by Ctrl-C."""
    try:
        return ss.jobs.run_campaign(folder / file, out, figures=False)
    except KeyboardInterrupt:
        return None


def test_a_campaign_that_is_interrupted_again_and_again(
    folder: Path, tmp_path: Path, finished: Counter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was finished is not repeated, and the result is that of one run."""
    expected = numbers(run(folder, tmp_path / "whole"))
    assert finished == dict.fromkeys(STAGES, 1)
    begun_with: list[bool] = []
    for name, stage in STAGES.items():
        _interrupts(monkeypatch, name, lambda stage=stage: begun_with.append(_there(tmp_path / "out", stage)))
    assert [run(folder, tmp_path / "out") for _ in range(2 * len(STAGES))] == [None] * 2 * len(STAGES)
    assert numbers(run(folder, tmp_path / "out")) == expected
    assert begun_with == [False] * 3 * len(STAGES)  # a stage that is there is never begun
    assert numbers(run(folder, tmp_path / "out")) == expected
    assert len(begun_with) == 3 * len(STAGES)
    assert not list((tmp_path / "out").rglob("*.part"))


def test_an_interrupted_command_says_what_it_keeps(folder: Path, tmp_path: Path) -> None:
    """Only what keeps something may say so."""
    walk = {"kind": "walk", "title": "Walk", "model": "kang2007", "free": ["sigma_0"]}
    (folder / "walk.yaml").write_text(yaml.safe_dump(walk | {"recordings": [{"file": "slow.nc"}]}), "utf-8")
    for command, file, said in (
        ("campaign", "campaign.yaml", "what was finished is kept, and the same command continues"),
        ("identify", "walk.yaml", "nothing is kept"),
    ):
        with pytest.MonkeyPatch.context() as patch:
            for name in ("campaign.evaluation", "analysis.walk"):
                patch.setattr(f"stickslip.jobs.{name}.identify_friction", _interrupted)
            done = CliRunner().invoke(app, [command, str(folder / file), "--out", str(tmp_path / command)])
        assert done.exit_code == 130
        assert done.stderr.splitlines()[-1] == f"Error: interrupted; {said}"
        assert bool([*tmp_path.glob(f"{command}/stages/stage-*")]) is (command == "campaign")


def _interrupted(*_: Any, **__: Any) -> None:
    raise KeyboardInterrupt


def test_what_changes_is_computed_again_and_nothing_else(
    folder: Path, tmp_path: Path, finished: Counter
) -> None:
    run(folder, tmp_path)
    content = yaml.safe_load((folder / "campaign.yaml").read_text("utf-8"))
    assert finished == dict.fromkeys(STAGES, 1)
    told = {**content, "title": "Another", "require": ["r_squared > 0.5"]}
    (folder / "told.yaml").write_text(yaml.safe_dump(told), "utf-8")
    assert run(folder, tmp_path, file="told.yaml").title == "Another"
    assert finished == dict.fromkeys(STAGES, 1)
    other = {**content, "change": {"stage_reaction": False, "stage_mass": "0.11 kg"}}
    (folder / "other.yaml").write_text(yaml.safe_dump(other), "utf-8")
    run(folder, tmp_path, file="other.yaml")
    assert finished == dict.fromkeys(STAGES, 2)
    next((tmp_path / "stages").glob("friction-*")).write_bytes(b"damaged")
    run(folder, tmp_path)
    run(folder, tmp_path, file="other.yaml")
    assert finished == dict.fromkeys(STAGES, 2) | {"_friction": 3}


def test_a_scale_that_is_less_certain_is_computed_again(
    folder: Path, tmp_path: Path, finished: Counter
) -> None:
    """Its uncertainty is an attribute of the channel; the samples are the same."""
    run(folder, tmp_path)
    before = ss.open_recording(folder / "slow.nc")
    changed = before.load()
    try:
        changed["end_effector_position"].attrs["scale_uncertainty"] = 0.01
        ss.save_recording(changed, folder / "slow.nc")
        run(folder, tmp_path)
    finally:
        del changed["end_effector_position"].attrs["scale_uncertainty"]
        ss.save_recording(changed, folder / "slow.nc")
    assert finished["_friction"] == 2
    run(folder, tmp_path)
    assert finished["_friction"] == 2
