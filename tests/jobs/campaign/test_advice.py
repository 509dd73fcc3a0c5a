"""A campaign whose model lacks a term: all walks name the term, and the line to write explains them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import stickslip as ss
from stickslip.jobs.campaign import additional, evaluation
from stickslip.jobs.campaign.running import run_campaign
from stickslip.report.document import Document

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
FORCE, SIGMA_0, SIGMA_1 = 0.49, 1.3e6, 42.0
REST = 0.06  # s before the drive begins
# The walk at 5 Hz is fitted: alone it hardly shows viscous friction.
OF_ADVICE = [(65.0, 5.0, 3, "fit"), (80.0, 20.0, 6, "verify"), (50.0, 20.0, 6, "verify")]
# A hum of 50 Hz repeats in each period of these.
OF_HUM = [(65.0, 10.0, 8, "fit"), (80.0, 10.0, 8, "verify")]

Walks = list[tuple[float, float, int, str]]


def written(folder: Path, walks: Walks, noise: float, hum: float = 0.0, **law: float) -> Path:
    """A campaign file of walks whose truth has the values of the law; the model is without `sigma_2`."""
    random = np.random.default_rng(5)
    friction = KANG.friction._replace(sigma_0=SIGMA_0, sigma_1=SIGMA_1, coulomb_force=FORCE)
    truth = KANG.replace(friction=friction._replace(stiction_force=FORCE, **law))
    recordings = []
    for volts, frequency, periods, use in walks:
        drive = ss.Sawtooth(volts, frequency, periods=periods)
        lasts = drive.duration + 0.02
        moved = ss.waveform.Sequence(ss.waveform.Rest(REST), (drive, lasts))
        walk = ss.simulate(truth, moved, REST + lasts, sample_rate=2e3)
        time = walk["time"].values
        position = walk["end_effector_position"].values + noise * random.standard_normal(time.size)
        position += hum * np.sin(2.0 * np.pi * 50.0 * time)
        shown = np.column_stack([time, position, walk["drive_voltage"].values])
        name = f"{use}_{volts:.0f}V.csv"
        np.savetxt(folder / name, shown, delimiter=",", header="t,x,u", comments="")
        recordings.append(
            {
                "file": name,
                "use": use,
                "columns": {"time": "t", "end_effector_position": "x", "drive_voltage": "u"},
                "units": {"time": "s", "end_effector_position": "m", "drive_voltage": "V"},
                "waveform": [
                    {
                        "shape": "Sawtooth",
                        "fields": {"amplitude": volts, "frequency": frequency, "periods": periods},
                    }
                ],
            }
        )
    content = {
        "title": "Advice",
        "model": "kang2007",
        "change": {"stage_reaction": False},
        "friction": {"sigma_0": "1000 N/mm", "sigma_1": "0.03 N s/mm", "coulomb_force": "0.5 N"},
        "free": ["sigma_0", "sigma_1", "coulomb_force"],
        "recordings": recordings,
    }
    content["friction"] |= {"stiction_force": "0.5 N"}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content), "utf-8")
    return folder / "campaign.yaml"


def run(file: Path) -> Document:
    return run_campaign(file, file.parent / "out", figures=False)


def test_the_line_to_write_explains_the_walks(tmp_path: Path) -> None:
    file = written(tmp_path, OF_ADVICE, 50e-9, sigma_2=9.0)
    advice = run(file).numbers["friction"]["advice"]
    assert advice["cause"] == "viscous friction"
    assert advice["explains"]
    assert not advice["equal"]
    lines = [yaml.safe_load(line) for line in re.findall("`(.*?)`", advice["file"])]
    added = {key: value for line in lines for key, value in line.items()}
    assert set(added) == {"free", "bounds"}
    content: dict[str, Any] = yaml.safe_load(file.read_text("utf-8"))
    file.write_text(yaml.safe_dump(content | added), "utf-8")
    document = run(file)
    assert not document.failures
    assert document.numbers["friction"]["advice"] is None
    found = document.numbers["friction"]["parameters_with_all_errors"]
    truth = {"sigma_0": SIGMA_0, "sigma_1": SIGMA_1, "coulomb_force": FORCE, "sigma_2": 9.0}
    for name, value in truth.items():
        assert found[name].low < value < found[name].high, name


def test_a_hum_is_no_reason_to_compare_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any, **__: Any) -> Any:
        raise AssertionError("laws were compared")

    lacks: list[bool] = []
    of_file = evaluation.additional

    def seen(*arguments: Any) -> Any:
        lacks.append(arguments[4])
        return of_file(*arguments)

    monkeypatch.setattr(additional, "compare_walks", never)
    monkeypatch.setattr(evaluation, "additional", seen)
    document = run(written(tmp_path, OF_HUM, 8e-9, hum=20e-9))
    said = [*document.numbers["friction"]["remarks"], *document.failures]
    assert any("has a hum of" in text for text in said)
    assert any("does not explain" in text for text in document.failures)
    assert document.numbers["friction"]["advice"] is None
    assert lacks == [False]
    assert not any("laws were compared" in text for text in document.failures)
