"""The programs of docs/laboratory.md and docs/frequency-response.md run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from stickslip.rig.experiment.file import ExperimentFile

ROOT = Path(__file__).resolve().parents[1]
PAGE = "".join(
    (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("laboratory.md", "frequency-response.md")
)


def program(word: str) -> str:
    """The only program of the pages that contains this word."""
    (found,) = (one for one in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if word in one)
    return found


def test_the_rig_in_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(program("virtual_device"), names)
    try:
        assert names["rig"].capabilities.inputs
    finally:
        names["link"].close()


def test_the_program_on_the_page() -> None:
    names: dict = {}
    exec(program("pre_trigger="), names)
    recording = names["recording"]
    assert recording["time"].size == 10_000
    drive = recording["drive_voltage"].values
    assert abs(drive[:4000]).max() < 0.1
    assert abs(drive[4000:] - 60.0).max() < 0.1


def test_the_frequency_response_on_the_page() -> None:
    names: dict = {}
    exec(program("ss.identify_frequency("), names)
    assert names["fit"].values["natural_frequency_1"] == pytest.approx(3303.1, rel=1e-4)
    assert names["fit"].values["damping_ratio_1"] == pytest.approx(0.524, rel=1e-4)
    assert names["fit"].values["gain_1"] == pytest.approx(0.1057e-6, rel=1e-4)


def test_one_model_for_all_amplitudes_on_the_page() -> None:
    names: dict = {}
    exec(program("identify_levels("), names)
    assert 1e9 * np.sqrt(np.mean(names["error"] ** 2)) == pytest.approx(167.2, abs=0.5)  # as the table says


def test_the_amplifier_on_the_page() -> None:
    names: dict = {}
    exec(program("load_amplifier("), names)
    assert names["voltage"].range()[1] <= 65.1
    assert float(names["account"]["peak_current"]) > 0.1


def test_files_on_the_page_exist_and_its_rig_is_one() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (ROOT / "docs" / target).is_file(), target
    (rig,) = re.findall(r"`(rig: \{kind: scpi.*?\})`", PAGE)
    example = yaml.safe_load((ROOT / "src/stickslip/examples/kang2007_experiment.yaml").read_text("utf-8"))
    made = ExperimentFile.model_validate({**example, **yaml.safe_load(rig)})
    assert made.rig.kind == "scpi"
