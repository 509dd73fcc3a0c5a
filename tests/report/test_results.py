import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stickslip.report import Column, Document, DocumentError, Number, Section, Table
from stickslip.report.circumstances import circumstances
from stickslip.report.results import results_json

from .sample import sample


def strict(text: str) -> Any:
    """JSON as the standard has it: Python's reader would let NaN pass."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


def results_of(numbers: dict[str, Any]) -> Any:
    document = Document("t", "s", [], numbers=numbers)
    return strict(results_json(document, circumstances()))["numbers"]


def test_whole_document() -> None:
    found = strict(results_json(sample(), circumstances("stickslip demo", 12.5)))
    assert found["numbers"] == {
        "friction": {
            "sigma_0": {
                "value": 1.399e6,
                "unit": "N/m",
                "low": 1.380e6,
                "high": 1.418e6,
                "level": 0.95,
                "standard_error": 9.7e3,
            }
        },
        "law": "LuGre",
    }
    assert found["highlights"]["net displacement"] == {"value": 2.883e-5, "unit": "m"}
    (table,) = found["tables"]
    assert table["columns"][3] == {"name": "rms residual", "unit": "N"}
    assert table["rows"][0][:4] == ["LuGre", 5, 0.99652, 0.0251]
    assert table["rows"][1][2] is None
    assert table["rows"][1][4] == {
        "value": None,
        "unit": "N/m",
        "note": "not determined",
        "reason": "not determined",
    }
    assert found["elapsed"] == {"value": 12.5, "unit": "s"}
    assert found["command"] == "stickslip demo"
    assert found["assumptions"] == ["end_effector_mass = 0.1 kg: brass"]
    assert found["citations"].startswith("@misc{kang2007")
    assert found["versions"].keys() >= {"stickslip", "Python", "numpy", "scipy"}
    assert "elapsed" not in strict(results_json(sample(), circumstances()))


@pytest.mark.parametrize(
    ("value", "reason"),
    [(math.nan, "does not exist"), (math.inf, "infinite"), (-math.inf, "minus infinite")],
)
def test_what_json_does_not_know_is_null_with_a_reason(value: float, reason: str) -> None:
    expected = {"value": None, "unit": "m", "reason": reason}
    assert results_of({"step": Number(value, "m")}) == {"step": expected}
    assert results_of({"step": {"value": value, "unit": "m"}}) == {"step": expected}


def test_plain_mappings_and_arrays() -> None:
    found = results_of(
        {
            "gain": {
                "value": np.float64(1e-7),
                "unit": "m/V",
                "low": 0.9e-7,
                "high": math.inf,
                "samples": np.int64(3),
            },
            "fit": {"correlation": {"value": np.array([[1.0, math.nan], [0.5, 1.0]]), "unit": ""}},
            "converged": np.True_,
            "undetermined": ["sigma_1"],
            "nothing": None,
        }
    )
    assert found["gain"] == {"value": 1e-7, "unit": "m/V", "low": 0.9e-7, "high": None, "samples": 3}
    assert found["fit"]["correlation"]["value"] == [[1.0, None], [0.5, 1.0]]
    assert found["converged"] is True
    assert found["undetermined"] == ["sigma_1"]
    assert found["nothing"] is None


@pytest.mark.parametrize(
    ("numbers", "path"),
    [
        ({"fit": {"rmse": 0.1}}, r"numbers\.fit\.rmse = 0\.1 has no unit"),
        ({"fit": {"rmse": {"value": 0.1}}}, r"numbers\.fit\.rmse has no unit"),
        ({"fit": {"rmse": {"value": 0.1, "unit": None}}}, r"numbers\.fit\.rmse has no unit"),
        ({"gains": [1.0, 2.0]}, r"numbers\.gains = \[1\.0, 2\.0\] has no unit"),
        ({"law": {"value": object(), "unit": ""}}, "cannot be written"),
    ],
)
def test_numbers_without_a_unit_are_refused(numbers: dict[str, Any], path: str) -> None:
    with pytest.raises(DocumentError, match=path):
        results_of(numbers)


def test_counts_stay_whole() -> None:
    table = Table("t", [Column("data", "")], [[np.int64(8000)]])
    document = replace(sample(), sections=[Section("s", tables=[table])])
    assert "8000\n" in results_json(document, circumstances())
