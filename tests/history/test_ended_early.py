"""Experiments that ended before their first sample are listed with their outcome, too."""

from __future__ import annotations

from pathlib import Path

import pytest

import stickslip as ss
from stickslip.history import Index
from stickslip.rig.experiment import run_experiment

from rig.experiment.files import SMALL, written  # isort: skip


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Runs that were killed before their folder held a log, before their first sample, and one that a limit
    refused; beside them one with a recording."""
    experiment = written(tmp_path, SMALL)
    run_experiment(experiment, tmp_path / "whole")
    (tmp_path / "at once").mkdir()
    (tmp_path / "at once" / "experiment.yaml").write_text(experiment.read_text())
    killed = tmp_path / "killed"
    killed.mkdir()
    (killed / "experiment.yaml").write_text(experiment.read_text())
    line = "2026-11-30T01:02:03.004+00:00 experiment.yaml: 2 recordings\n"
    (killed / "experiment.log").write_text(line)
    stopped = tmp_path / "stopped"
    stopped.mkdir()
    (stopped / "experiment.log").write_text(
        line + "2026-11-30T01:02:04.005+00:00 stopped: RigError the rig is held by another\n"
    )
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "experiment.log").write_bytes(b"\xff\xfe\x00")
    return tmp_path


def test_runs_without_a_recording_are_listed_with_their_outcome(lab: Path) -> None:
    with Index(lab) as index:
        found = {one["name"]: one for one in index.rows(kind="run")}
    assert found.keys() == {"at once", "killed", "stopped", "damaged"}
    assert found["at once"]["outcome"].startswith("nothing was recorded: it was ended before it started")
    assert found["at once"]["title"] == SMALL["title"]
    assert found["killed"]["outcome"].startswith(
        "nothing was recorded: it was ended before its first samples"
    )
    assert found["killed"]["begun"].startswith("2026-11-30T01:02:03")
    said = "nothing was recorded: stopped: RigError the rig is held by another"
    assert found["stopped"]["outcome"] == said
    assert found["damaged"]["problem"]
    assert all(one["outcome"] for name, one in found.items() if name != "damaged")


def test_such_a_run_is_listed_no_more_when_it_has_a_recording(lab: Path) -> None:
    with Index(lab) as index:
        index.rows()
        run_experiment(lab / "experiment.yaml", lab / "killed")
        kinds = {one["name"]: one["kind"] for one in index.rows()}
    assert "killed" not in kinds
    assert sum(name.startswith("killed/") for name in kinds) == len(list((lab / "killed").glob("*.nc")))


def test_such_a_run_can_be_put_into_the_bin(lab: Path) -> None:
    with Index(lab) as index:
        index.to_bin("killed")
        assert "killed" not in {one["name"] for one in index.rows()}
    assert not (lab / "killed").exists()


def test_an_experiment_that_a_limit_refuses_is_listed(tmp_path: Path) -> None:
    refused = {**SMALL, "limits": {"max_position": "1 nm"}}
    with pytest.raises(ss.rig.LimitError):
        run_experiment(written(tmp_path, refused), tmp_path / "refused")
    with Index(tmp_path) as index:
        outcomes = [one["outcome"] for one in index.rows() if one["name"].startswith("refused")]
    assert outcomes
    assert all("stopped" in one for one in outcomes)
