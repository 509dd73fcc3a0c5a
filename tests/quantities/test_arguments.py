"""Parts of input files that give arguments of a function."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from pydantic import ValidationError

from stickslip.design import optimise_waveform
from stickslip.jobs.analysis.design_drives import OptimiseSpec
from stickslip.quantities.arguments import arguments_of


def search(
    model: object,
    *,
    budget: int = 7,
    force: float | str | None = None,
    low: float | str = 1.0,
    tied: Mapping[str, str] | None = None,
    points: object = (),
    name: str,
) -> None:
    """Look for something.

    Args:
        model: not of a file.
        budget: candidates, of which
            each is tried once.
        force, low: N, the ends.

    Returns:
        nothing.
    """


Part = arguments_of(search, "budget", "force", "low", "tied", "name", points=list[int])


def test_what_the_file_gives_is_passed_and_the_rest_is_the_function_s_own() -> None:
    part = Part(name="x", force="2 mN", points=[1, 2], budget=None)
    assert part.arguments == {"name": "x", "force": "2 mN", "points": [1, 2]}
    assert (part.budget, part.low, part.tied) == (7, 1.0, None)


def test_meanings_and_defaults_of_the_schema_are_those_of_the_function() -> None:
    shown = Part.model_json_schema()
    assert shown["properties"]["budget"]["description"] == "candidates, of which each is tried once."
    assert shown["properties"]["low"]["description"] == "N, the ends."
    assert shown["properties"]["budget"]["default"] == 7
    assert shown["required"] == ["name"]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"budget": "many"}, "budget"),
        ({"tied": [1]}, "tied"),
        ({"points": ["x"]}, "points"),
        ({"bugdet": 3}, "did you mean 'budget'"),
        ({"name": None}, "name"),
    ],
)
def test_another_type_or_name_is_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Part(**{"name": "x"} | wrong)


def test_an_argument_that_there_is_not() -> None:
    with pytest.raises(TypeError, match="search has no argument 'bugdet'"):
        arguments_of(search, "bugdet")


def test_parts_of_one_part_are_passed_together() -> None:
    asked = OptimiseSpec(goal="speed", seed=3, knots=6, frequency=["10 Hz", 500])
    assert asked.arguments == {"seed": 3, "knots": 6, "frequency": ("10 Hz", 500.0)}
    assert asked.budget == optimise_waveform.__kwdefaults__["budget"]
