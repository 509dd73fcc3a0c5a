"""The interlock on the command line: a rig of volts is armed on purpose, and a fault is acknowledged."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from cli.test_laboratory import RIG, run, small
from stickslip.recording import open_recording


@pytest.fixture
def experiment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One on a rig of volts, which has an end stop that the walk passes at 65 V only."""
    monkeypatch.setenv("STICKSLIP_RIGS", str(tmp_path / "rigs"))
    rig = RIG.replace("class Mine(VirtualRig):", "class Mine(VirtualRig):\n    simulated = False\n")
    (tmp_path / "my_rig.py").write_text(rig.replace("real_time=True", "real_time=False"))
    options = {"log": str(tmp_path / "stopped")}
    runs = yaml.safe_load(small(tmp_path).read_text())["runs"]
    runs[0]["matrix"] = {"voltage": ["35 V"]}
    return small(tmp_path, runs=runs, rig={"kind": "my_rig.py:Mine", "options": options})


def test_a_rig_of_volts_is_armed_on_purpose(experiment: Path) -> None:
    out = experiment.parent / "out"
    command = ["record", str(experiment), "--out", str(out)]
    done = run(*command)
    assert done.exit_code == 1
    assert "Error: the output is not armed. Arm it on purpose: --arm WHY on the command line" in done.stderr
    assert not list(out.glob("*.nc"))
    done = run(*command, "--arm", "a walk")
    assert done.exit_code == 0, done.stderr
    assert open_recording(out / "walk_35V.nc").attrs["outcome"] == "complete"


def test_a_fault_is_shown_and_acknowledged(experiment: Path) -> None:
    content = yaml.safe_load(experiment.read_text())
    experiment.write_text(yaml.safe_dump({**content, "limits": {"max_position": "0.1 um"}}))
    command = ["record", str(experiment), "--out", str(experiment.parent / "out"), "--arm", "a walk"]
    assert "beyond the end stop" in run(*command).stderr
    experiment.write_text(yaml.safe_dump(content))
    refused = run(*command)
    assert refused.exit_code == 1
    assert "is not acknowledged: the end-effector is at" in refused.stderr
    state = run("interlock", str(experiment))
    assert state.exit_code == 0, state.stderr
    assert state.stdout.startswith("a fault is not acknowledged\n    fault, 20")
    assert "    permit operators: given" in state.stdout
    done = run("interlock", str(experiment), "--acknowledge", "it was meant")
    assert done.stdout.startswith("not armed\n")
    assert run(*command).exit_code == 0


def test_a_permit_is_withdrawn_and_given(experiment: Path) -> None:
    asked = ["interlock", str(experiment)]
    assert "--why: say why" in run(*asked, "--withdraw", "operators").stderr
    done = run(*asked, "--withdraw", "operators", "--why", "lunch")
    assert done.stdout.startswith("a permit is missing\n    permit operators: missing: ")
    assert done.stdout.rstrip().endswith(", lunch")
    refused = run("record", str(experiment), "--out", str(experiment.parent / "out"), "--arm", "a walk")
    assert "the permit 'operators' is missing" in refused.stderr
    assert run(*asked, "--give", "operators", "--why", "back").stdout.startswith("not armed\n")


def test_the_log_says_who_did_what_and_why(experiment: Path) -> None:
    out = str(experiment.parent / "out")
    run("record", str(experiment), "--out", out)
    run("record", str(experiment), "--out", out, "--arm", "a walk")
    run("interlock", str(experiment), "--withdraw", "operators", "--why", "lunch")
    done = run("log", str(experiment))
    assert done.exit_code == 0, done.stderr
    lines = done.stdout.splitlines()
    said = [
        "limits: ",
        "refused: start",
        "armed: the output",
        "run started",
        "disarmed: ",
        "permit withdrawn: ",
    ]
    at = [next(i for i, line in enumerate(lines) if f"  rig    {one}" in line) for one in said]
    assert at == sorted(at)
    assert "(a walk)" in lines[at[3]]
    assert "(lunch)" in lines[at[5]]
    assert "stickslip interlock (process " in lines[at[5]]
    assert run("log", str(experiment), "--search", "LUNCH").stdout.splitlines()[1:] == ["1 lines"]
    (line,) = json.loads(run("log", str(experiment), "--last", "1", "--json").stdout)
    assert line["why"] == "lunch"


def test_a_virtual_rig_of_a_file_has_no_interlock_that_stays(tmp_path: Path) -> None:
    refused = run("interlock", str(small(tmp_path)))
    assert refused.exit_code == 2
    assert "name a panel's folder" in refused.stderr
