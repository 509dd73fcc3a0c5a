"""Sentences of a report on the origin of the stage's parameters and on the errors that count."""

from __future__ import annotations

import html
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.jobs.campaign.file import CampaignFile
from stickslip.jobs.campaign.stage_source import (
    FITTED_TOO,
    FROM_STEPS,
    band_words,
    stage_heading,
    stage_words,
)

KANG = ss.load_actuator("kang2007")
DRIVE = {"shape": "Sawtooth", "fields": {"amplitude": 65.0, "frequency": 50.0, "periods": 3}}


def parameters(*names: str) -> Any:
    return SimpleNamespace(parameters=[SimpleNamespace(name=name) for name in names])


STEPS = SimpleNamespace(stage=np.eye(3), others=None)
NONE = SimpleNamespace(stage=None, others=None)
OF_PIEZO = SimpleNamespace(stage=None, others=np.eye(2))
FROM_RESPONSES = "The stage's parameters come from the step responses"
ALL = ("gain", "natural_frequency", "damping_ratio")


@pytest.mark.parametrize(
    ("own", "fitted", "stage", "hysteresis", "inherited", "said", "counts"),
    [
        ([], [], True, False, STEPS, f"{FROM_RESPONSES}, whose errors are part of", True),
        ([], [], True, False, None, f"{FROM_RESPONSES}, whose errors are not part of", False),
        ([], ALL, True, True, NONE, f"{FROM_RESPONSES}; the friction fit varies them", True),
        (
            [],
            [],
            False,
            False,
            None,
            "The stage's parameters are taken as known, because there are no recordings of steps: the "
            "uncertainty of damping_ratio, natural_frequency and gain is not part of the intervals.",
            False,
        ),
        (
            [],
            [],
            False,
            True,
            OF_PIEZO,
            "The stage's gain comes from the recordings of hysteresis and creep, whose errors are part of "
            "the intervals. The stage's other parameters are taken as known, because there are no recordings "
            "of steps: the uncertainty of damping_ratio and natural_frequency is not part of the intervals.",
            False,
        ),
        (
            ["gain"],
            ["gain"],
            False,
            False,
            None,
            "The friction fit also identifies the stage's gain. The stage's other parameters are taken as "
            "known, because there are no recordings of steps: the uncertainty of damping_ratio and "
            "natural_frequency is not",
            False,
        ),
        (
            ["gain"],
            ["gain"],
            True,
            False,
            NONE,
            "The friction fit also identifies the stage's gain. The stage's other parameters come from the "
            "step responses, whose errors are not",
            False,
        ),
        (
            ALL,
            ALL,
            False,
            False,
            None,
            "The friction fit also identifies the stage's damping_ratio, natural_frequency and gain.",
            True,
        ),
    ],
)  # fmt: skip
def test_what_is_said_of_the_stage(
    own: list[str],
    fitted: list[str],
    stage: bool,
    hysteresis: bool,
    inherited: Any,
    said: str,
    counts: bool,
) -> None:
    use = {"file": "a.csv", "use": "fit"}
    file = CampaignFile.model_validate({"title": "x", "recordings": [use], "free": ["sigma_0", *own]})
    found: Any = SimpleNamespace(
        friction=parameters("sigma_0", *fitted),
        stage=object() if stage else None,
        hysteresis=object() if hysteresis else None,
        inherited=inherited,
    )
    assert stage_words(file, found).startswith(said)
    assert ("including the stage's" in band_words(file, found, drawn=True)) == counts
    assert band_words(file, found, drawn=False).startswith("the noise of the fit alone")
    own_source = bool(fitted) and bool(own)
    assert stage_heading(file, found, FROM_STEPS) == (FITTED_TOO if own_source else FROM_STEPS)
    assert stage_heading(file, found, "drift of the sensor") == "drift of the sensor"


def test_a_campaign_without_steps_takes_the_stage_as_known(tmp_path: Path) -> None:
    noise = np.random.default_rng(0)
    drive = ss.waveform.Sequence(ss.waveform.Rest(0.05), (ss.Sawtooth(**DRIVE["fields"]), 0.06))
    shown = ss.simulate(KANG, drive, 0.12, sample_rate=5e3)[["end_effector_position", "drive_voltage"]]
    shown["end_effector_position"] += 2e-8 * noise.standard_normal(shown.sizes["time"])
    ss.save_recording(shown, tmp_path / "walk.nc")
    campaign = {
        "title": "No steps",
        "model": "kang2007",
        "free": ["sigma_0", "coulomb_force"],
        "hops": 0,
        "recordings": [{"file": "walk.nc", "use": "fit", "waveform": [DRIVE]}],
    }
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(campaign), "utf-8")
    done = CliRunner().invoke(
        app, ["campaign", str(tmp_path / "campaign.yaml"), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code in (0, 1), done.stderr
    page = html.unescape((tmp_path / "out" / "report.html").read_text("utf-8"))
    assert "The stage's parameters are taken as known, because there are no recordings of steps" in page
    assert "come from the step responses" not in page
    assert "including the stage's" not in page


def test_a_limit_without_its_unit_is_refused_before_anything_is_recorded(tmp_path: Path) -> None:
    campaign = {"title": "x", "recordings": [{"file": "gone.csv"}], "require": ["rmse < 100"]}
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(campaign), "utf-8")
    done = CliRunner().invoke(
        app, ["campaign", str(tmp_path / "campaign.yaml"), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 2
    assert f"Error: {tmp_path}/campaign.yaml: 'rmse < 100' has no unit" in done.stderr
