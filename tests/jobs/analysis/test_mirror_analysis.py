"""Identification files of mirrors: the measured one, and one that SciPy simulates."""

from __future__ import annotations

import importlib.resources
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.identify.frequency import modal_system

from stickslip.jobs.analysis import run_file
from stickslip.jobs.analysis.file import AnalysisError
from stickslip.report import write_report

EXAMPLES = Path(str(importlib.resources.files("stickslip") / "examples"))


def test_piezo_mirror_softens_with_the_amplitude() -> None:
    document = run_file(EXAMPLES / "piezo_mirror.yaml")
    levels = [document.numbers[f"{v} mV"] for v in (100, 200, 300)]
    gains = [abs(level["static_gain"].value) for level in levels]
    assert gains == sorted(gains)
    assert gains[0] == pytest.approx(2.7e-6, rel=0.02)
    first = [level["parameters"]["natural_frequency_1"].value / (2 * np.pi) for level in levels]
    assert first == sorted(first, reverse=True)
    assert first[0] == pytest.approx(640.9, abs=1.0)
    assert all(level["r_squared_held_out"]["14_modes"].value > 0.996 for level in levels)
    assert all(level["r_squared_held_out"]["1_modes"].value < 0.6 for level in levels)
    together = document.numbers["all_levels"]
    assert 0.3 < together["exponent"].value < 0.8
    assert all(level["r_squared_held_out"].value > 0.996 for level in together["levels"].values())
    # um, of a neural model for all three levels
    for level, aim in zip(together["levels"].values(), (0.0866, 0.1309, 0.1686), strict=True):
        assert level["rms_error_held_out"].value < 1e-6 * aim
    assert together["levels_not_seen"]["200 mV"]["rms_error_held_out"].value < 0.16e-6
    assert together["parameters"]["natural_frequency_slope_1"].high < 0.0
    assert "One model for all levels" in [s.title for s in document.sections]


def test_modes_of_a_mirror_from_arrays(tmp_path: Path) -> None:
    """A mirror that SciPy simulates: three modes predict the drives held out, one does not."""
    rng = np.random.default_rng(0)
    levels = []
    for name, amplitude in (("low", 0.1), ("high", 0.2)):
        drive = amplitude * np.repeat(modal_system.multisines(rng, 1000, 4)[..., None], 2, axis=3)
        response = np.stack([modal_system.steady(drive[..., p]) for p in range(2)], axis=3)
        response += 1e-9 * rng.standard_normal(response.shape)
        for what, array in (("u", drive), ("y", response)):
            np.save(tmp_path / f"{what}_{name}.npy", array)
        sources = {"drive": {"file": f"u_{name}.npy"}, "response": {"file": f"y_{name}.npy"}}
        levels.append({"name": name, "amplitude": amplitude, **sources})
    file = {
        "kind": "frequency_response",
        "title": "A mirror",
        "sample_rate": "4 kHz",
        "band": ["20 Hz", "1.5 kHz"],
        "modes": [[[150.0, 0.02]], [[152.0, 0.03], [415.0, 0.04], [705.0, 0.02]]],
        "follow": [1],
        "time_domain": ["low"],
        "levels": levels,
    }
    (tmp_path / "mirror.yaml").write_text(yaml.safe_dump(file), "utf-8")
    document = run_file(tmp_path / "mirror.yaml")
    for level in ("low", "high"):
        found = document.numbers[level]
        assert (
            found["r_squared_held_out"]["3_modes"].value
            > 0.999
            > found["r_squared_held_out"]["1_modes"].value
        )
        omega = found["parameters"]["natural_frequency_2"]
        assert omega.low < modal_system.OMEGA[1] < omega.high
    (in_time,) = [s for s in document.sections if "fitted in time" in s.title]
    _, by_response, _, by_time, _ = in_time.tables[0].rows[0]
    assert by_time.value == pytest.approx(by_response.value, rel=1e-3)
    assert by_time.unit == "Hz"
    file |= {"tied": {"damping_ratio_2": "2.5 * damping_ratio_1"}, "levels": levels[:1]}
    (tmp_path / "mirror.yaml").write_text(yaml.safe_dump(file), "utf-8")
    ends = run_file(tmp_path / "mirror.yaml").numbers["low"]["parameters"]
    assert ends["damping_ratio_2"].value == pytest.approx(2.5 * ends["damping_ratio_1"].value)
    assert ends["damping_ratio_2"].low < modal_system.ZETA[1] < ends["damping_ratio_2"].high
    file["levels"][0]["drive"]["file"] = "mirror.yaml"
    (tmp_path / "mirror.yaml").write_text(yaml.safe_dump(file), "utf-8")
    with pytest.raises(AnalysisError, match=r"mirror\.yaml"):
        run_file(tmp_path / "mirror.yaml")


@cache
def arrays() -> dict[str, np.ndarray]:
    """Drives and responses of a mirror simulated by SciPy: its levels differ in gain alone."""
    rng, found = np.random.default_rng(1), {}
    for name, amplitude in (("low", 0.1), ("mid", 0.2), ("high", 0.4)):
        for part, realisations in (("", 4), ("test_", 2)):
            drive = amplitude * np.repeat(
                modal_system.multisines(rng, 1000, realisations)[..., None], 2, axis=3
            )
            response = np.stack([modal_system.steady(drive[..., p]) for p in range(2)], axis=3)
            response *= 1.0 + 0.1 * amplitude
            response += 1e-9 * rng.standard_normal(response.shape)
            found |= {f"{part}u_{name}.npy": drive, f"{part}y_{name}.npy": response}
    return found


def mirror_file(folder: Path, **changes) -> Path:
    """A study of that mirror."""
    for name, array in arrays().items():
        np.save(folder / name, array)
    levels = []
    for name, amplitude in (("low", 0.1), ("mid", 0.2), ("high", 0.4)):
        own, test = (
            {"drive": {"file": f"{part}u_{name}.npy"}, "response": {"file": f"{part}y_{name}.npy"}}
            for part in ("", "test_")
        )
        levels.append({"name": name, "amplitude": amplitude, **own, "test": test})
    file = {
        "kind": "frequency_response",
        "title": "A mirror",
        "sample_rate": "4 kHz",
        "band": ["20 Hz", "1.5 kHz"],
        "output": [1, 2],
        "modes": [1, 3],
        "one_model": True,
        "levels": levels,
    } | changes
    (folder / "mirror.yaml").write_text(yaml.safe_dump(file), "utf-8")
    return folder / "mirror.yaml"


def test_orders_outputs_and_files_to_test(tmp_path: Path) -> None:
    document = run_file(mirror_file(tmp_path))
    for level in ("low", "mid", "high"):
        found = document.numbers[level]
        scores = found["r_squared_held_out"]
        assert scores["3_modes"].value > 0.9999 > 0.95 > scores["1_modes"].value
        assert {"gain_1[1,2]", "gain_1[2,2]"} < set(found["parameters"])
    together = document.numbers["all_levels"]
    assert all(level["r_squared_held_out"].value > 0.9999 for level in together["levels"].values())
    assert list(together["levels_not_seen"]) == ["mid"]
    # um, of a neural model for all three levels
    for level, aim in zip(together["levels"].values(), (0.0866, 0.1309, 0.1686), strict=True):
        assert level["rms_error_held_out"].value < 1e-6 * aim
    assert together["levels_not_seen"]["mid"]["r_squared_held_out"].value > 0.999
    write_report(document, tmp_path / "out")
    # One output alone, with its own number, and the realisation held out instead of the files.
    levels = yaml.safe_load((tmp_path / "mirror.yaml").read_text("utf-8"))["levels"]
    levels = [{k: v for k, v in level.items() if k != "test"} for level in levels]
    document = run_file(mirror_file(tmp_path, output=2, levels=levels, one_model=False, held_out=1))
    assert "gain_1[2,1]" in document.numbers["low"]["parameters"]
    expected = modal_system.GAIN[:, 1, 0].sum() + modal_system.REMAINDER[1, 0]
    assert document.numbers["low"]["static_gain"].value == pytest.approx(1.01 * expected, rel=0.02)


def test_a_response_of_an_angle_to_a_current_is_reported_in_its_units(tmp_path: Path) -> None:
    poles = list(zip((modal_system.OMEGA / (2 * np.pi)).tolist(), modal_system.ZETA.tolist(), strict=True))
    asked = {"output": 1, "modes": [list(map(list, poles))], "time_domain": ["low"]}
    document = run_file(mirror_file(tmp_path, units=["mA", "urad"], **asked))
    for numbers in (document.numbers["low"], document.numbers["all_levels"]):
        assert numbers["rmse"].unit == numbers["parameters"]["gain_1[1,1]"].unit == "rad/A"
        # The arrays are in V and m for the truth, and here in mA and urad.
        gain = numbers["parameters"]["gain_1[1,1]"].value
        assert gain == pytest.approx(1e-3 * modal_system.GAIN[0, 0, 0], rel=0.06)
    together = document.numbers["all_levels"]
    for level in (together["levels"]["low"], together["levels_not_seen"]["mid"]):
        assert level["rms_error_held_out"].unit == "rad"
    (section,) = (s for s in document.sections if s.title == "One model for all levels")
    errors, modes = section.tables
    assert {cell.unit for row in errors.rows for cell in row[1:] if cell} == {"rad"}
    assert modes.caption.startswith("Modes at 0.00019 A rms")
    with pytest.raises(AnalysisError, match="'units' has 'gizmos', which is not known"):
        run_file(mirror_file(tmp_path, units=["gizmos", "m"]))


def test_files_to_test_of_another_mirror_are_refused(tmp_path: Path) -> None:
    file = mirror_file(tmp_path)
    np.save(tmp_path / "test_y_mid.npy", np.ones((1000, 3, 2, 2)))
    with pytest.raises(
        AnalysisError, match=r"test of mid: drive \(1000, 2, 2, 2\) and response \(1000, 3, 2, 2\)"
    ):
        run_file(file)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modes": ["many"]}, "modes"),
        ({"modes": [True]}, "True"),
        ({"modes": 14}, "modes"),
        ({"modes": [[["150 N", 0.02]]]}, "frequency"),
        ({"modes": [[[150.0, -0.02]]]}, "damping ratio"),
        ({"output": [1, 1]}, "different"),
        ({"output": [1, 3]}, "y_low.npy: output 3"),
        ({"follow": [4]}, "follow"),
        ({"held_out": 1}, "held_out"),
        ({"tied": {"damping_ratio_2": "damping_ratio_1"}}, "one_model"),
    ],
)
def test_wrong_values_of_a_mirror_are_refused(tmp_path: Path, changes: dict, words: str) -> None:
    with pytest.raises(AnalysisError, match=words):
        run_file(mirror_file(tmp_path, **changes))
