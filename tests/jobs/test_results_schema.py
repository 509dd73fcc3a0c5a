"""results.json against its JSON Schema, by an independent validator."""

from __future__ import annotations

import copy
import importlib.resources
import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from stickslip.cli import app
from stickslip.report.circumstances import circumstances
from stickslip.report.results import results_json

EXAMPLES = Path(str(importlib.resources.files("stickslip") / "examples"))
QUANTITY = {"value": 1.0, "unit": "m"}


@pytest.fixture(scope="module")
def schema() -> Draft202012Validator:
    printed = CliRunner().invoke(app, ["schema", "results"], catch_exceptions=False)
    found = json.loads(printed.stdout)
    Draft202012Validator.check_schema(found)
    return Draft202012Validator(found)


@pytest.mark.parametrize(
    "command",
    [
        ["simulate", "--amplitude", "65 V", "--frequency", "5 Hz", "--periods", "2"],
        ["run", str(EXAMPLES / "kang2007_map.yaml")],
        ["identify", str(EXAMPLES / "pulled_slider.yaml")],
    ],
)
def test_the_results_of_examples_follow_the_schema(
    command: list[str], schema: Draft202012Validator, tmp_path: Path
) -> None:
    done = CliRunner().invoke(app, [*command, "--out", str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    written = json.loads((tmp_path / "results.json").read_bytes())
    assert not [f"{one.json_path}: {one.message:.200}" for one in schema.iter_errors(written)]
    assert written["numbers"]


def without(content: dict[str, Any], name: str) -> None:
    del content[name]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content.update(kind="stickslip results, version 2"),
        lambda content: without(content, "machine"),
        lambda content: content.update(colour="red"),
        lambda content: content["numbers"].update(bare=3.0),
        lambda content: content["numbers"].update(deep={"er": {"value": 3.0}}),
        lambda content: content["numbers"].update(deep={"er": {"value": None, "unit": "m"}}),
        lambda content: content["highlights"].update(text="3 m"),
        lambda content: content["tables"][0]["columns"][0].update(unit=3),
    ],
)
def test_what_breaks_the_schema_is_noticed(damage: Any, schema: Draft202012Validator) -> None:
    from stickslip.report import Column, Document, Number, Section, Table

    table = Table(
        "Steps", [Column("step", "m"), Column("law")], [[1.0, "LuGre"], [Number(float("nan"), "m"), None]]
    )
    numbers = {"step": QUANTITY, "deep": {"er": Number(2.0, "m", 1.0, float("inf")), "law": "LuGre"}}
    whole = Document("t", "s", [Section("a", tables=[table])], [("step", Number(1.0, "m"))], numbers)
    content = json.loads(results_json(whole, circumstances("stickslip demo", 2.0)))
    assert schema.is_valid(content)
    assert content["numbers"]["deep"]["er"]["high"] is None
    damaged = copy.deepcopy(content)
    damage(damaged)
    assert not schema.is_valid(damaged)
