"""Numbers of a file of a move that are none are refused by their field, before anything is put out."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stickslip.jobs.analysis.file import AnalysisError
from stickslip.jobs.analysis.moving import MoveFile, read_move, run_move
from stickslip.quantities.progress import unheard
from stickslip.quantities.units import QuantityError

ACTUATOR = {"set": "kang2007"}


@pytest.mark.parametrize("value", [math.nan, "-inf m"])
@pytest.mark.parametrize("field", ["target", "within", "hold_within"])
def test_an_aim_is_of_finite_numbers(field: str, value: float | str, tmp_path: Path) -> None:
    file = MoveFile.model_validate({"title": "a move", "actuator": ACTUATOR, field: value})
    with pytest.raises(AnalysisError, match=f"^{field} must be .*finite"):
        file.aim("m")
    with pytest.raises(AnalysisError, match=f"^{field} must be .*finite"):
        run_move(file, tmp_path, tmp_path / "out", unheard)
    assert not list(tmp_path.rglob("*.nc"))


@pytest.mark.parametrize("line", ["hold: .nan", "at_most: .inf", "interval: -1 ms"])
def test_times_of_a_move_are_finite(line: str, tmp_path: Path) -> None:
    path = tmp_path / "move.yaml"
    path.write_text(f"title: a move\nactuator: {{set: kang2007}}\n{line}\n", encoding="utf-8")
    with pytest.raises(Exception, match=f"{line.split(':')[0]}.* must be > 0 and finite"):
        read_move(path)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"walk": {"amplitude": math.nan}}, r"walk\.amplitude"),
        ({"slip": {"duration": math.nan}}, r"slip\.duration"),
        ({"spread": {"natural_frequency": math.nan}}, "natural_frequency = nan"),
        ({"actuator": ACTUATOR | {"change": {"gain": math.nan}}}, "gain"),
    ],
)
def test_parts_of_a_move_are_of_finite_numbers(part: dict, said: str, tmp_path: Path) -> None:
    content = {"title": "a move", "actuator": ACTUATOR, "target": "1 um"} | part
    with pytest.raises((AnalysisError, QuantityError, ValueError), match=said):
        run_move(MoveFile.model_validate(content), tmp_path, tmp_path / "out", unheard)
    assert not list(tmp_path.rglob("*.nc"))
