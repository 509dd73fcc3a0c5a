"""A record as a part of a file: the file takes and refuses what Python does, and names place and field."""

from __future__ import annotations

import importlib
import json
import math
import pkgutil
from typing import Annotated, Any, Literal, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError, create_model

from stickslip.jobs.analysis.design import json_schema as design_schema
from stickslip.jobs.analysis.running import json_schema as analysis_schema
from stickslip.jobs.file import json_schema as job_schema
from stickslip.quantities.input_file import (
    InputFileError,
    Part,
    RecordFields,
    RecordPart,
    Strict,
    explain,
    fields_of,
)
from stickslip.quantities.records import Quantity, fields_with_quantity, quantities, record
from stickslip.quantities.units import QuantityError
from stickslip.rig import Limits

FOLDERS = ("jobs", "jobs.analysis", "jobs.campaign", "panel", "rig.experiment")
STACK = {
    "capacitance": 1e-6,
    "loss_tangent": 0.02,
    "loss_factor": 8.0,
    "full_voltage": 150.0,
    "thermal_resistance": 30.0,
    "heat_capacity": 2.0,
}
# Values of the fields that have no default.
NEEDED: dict[str, dict[str, Any]] = {
    "Capture": {"length": 1.0, "interval": 1e-3},
    "Filter": {"order": 2, "corner": 1e3},
    "PulledRig": {"mass": 0.3, "stiffness": 100.0, "speed": 1e-3},
    "Range": {"low": "1 N", "high": 2.0},
    "Stack": STACK,
    "Trigger": {"signal": "drive_voltage", "level": 1.0},
}


def parts() -> list[tuple[Any, tuple[str, ...]]]:
    """The records that are parts of files and requests, with the fields that are given there."""
    for folder in FOLDERS:
        path = importlib.import_module(f"stickslip.{folder}").__path__
        for module in pkgutil.iter_modules(path, f"stickslip.{folder}."):
            importlib.import_module(module.name)
    ours = [one for one in RecordFields.__subclasses__() if one.__module__.startswith("stickslip.")]
    named = [(getattr(importlib.import_module(one.__module__), one.__name__), one.of_record) for one in ours]
    return [(kind, names) for kind, names in named if hasattr(kind, "_fields")]


PARTS = parts()
KINDS = list(dict.fromkeys(kind for kind, _ in PARTS))
CASES = [(kind, names, name) for kind, names in PARTS for name in names if name in quantities(kind)]


def shown(one: Any) -> str:
    """A record's type or names of fields as a test's name has them."""
    return one.__name__ if isinstance(one, type) else "-".join([one] if isinstance(one, str) else one)


def read(part: Any, content: Any) -> Any:
    """What a file makes of the content of a part."""
    file: Any = create_model("File", __base__=Strict, part=(part, ...))
    whole = {"part": content}
    try:
        return file.model_validate(whole).part
    except ValidationError as error:
        raise explain("file.yaml", error, content=whole) from error


def near_bounds(quantity: Quantity) -> list[float]:
    """The bounds themselves, the next floats on both sides, and what is no finite number."""
    bounds = (quantity.minimum, quantity.above, quantity.maximum, quantity.below)
    ends = [one for one in bounds if one is not None and math.isfinite(one)]
    beside = [math.nextafter(end, way) for end in ends for way in (-math.inf, math.inf)]
    return [*ends, *beside, math.nan, math.inf, -math.inf]


def test_the_parts_are_found() -> None:
    known = {
        "Stepping",
        "Slip",
        "MarginRequirement",
        "Limits",
        "Variation",
        "Capture",
        "Filter",
        "Stack",
        "Chain",
    }
    assert {kind.__name__ for kind in KINDS} >= known
    assert len(CASES) > 40


@pytest.mark.parametrize(("kind", "names", "name"), CASES, ids=shown)
def test_the_bounds_of_a_field_are_those_of_the_record(kind: Any, names: tuple[str, ...], name: str) -> None:
    quantity, model = quantities(kind)[name], fields_of(kind, *names)
    needed = {field: value for field, value in NEEDED.get(kind.__name__, {}).items() if field in names}
    for value in near_bounds(quantity):
        for said in (value, f"{value!r} {quantity.unit}".strip()):
            if quantity.allows(value):
                assert read(model, {**needed, name: said}).given[name] in (value, said)
                continue
            with pytest.raises(InputFileError) as caught:
                read(model, {**needed, name: said})
            assert str(caught.value).startswith(f"file.yaml: part.{name}: {name} = ")
            assert str(caught.value).endswith(f"{quantity.meaning} must be {quantity.range_text()}")


@st.composite
def contents(draw: st.DrawFn) -> tuple[Any, dict[str, Any]]:
    """A record's type, and values for some fields of it, most of them allowed."""
    kind = draw(st.sampled_from(KINDS))
    content = dict(NEEDED.get(kind.__name__, {}))
    for name, field in fields_with_quantity(kind).items():
        if draw(st.booleans()):
            value = draw(st.sampled_from(near_bounds(field.quantity)) | st.floats() | st.floats(0.5, 20.0))
            content[name] = draw(st.sampled_from([value, f"{value!r} {field.quantity.unit}".strip()]))
    return kind, content


@given(contents())
def test_a_part_is_the_record_that_python_makes(asked: tuple[Any, dict[str, Any]]) -> None:
    kind, content = asked
    made, refused = None, ""
    try:
        made = kind(**content)
    except QuantityError as error:
        refused = str(error)
    if made is not None:
        assert read(Part[kind], content) == made
        assert read(Part[kind], made) is made
        assert read(Part[kind], {**dict.fromkeys(kind._field_defaults), **content}) == made
        return
    with pytest.raises(InputFileError) as caught:
        read(Part[kind], content)
    said, (name, _, of_field) = str(caught.value), refused.removeprefix(f"{kind.__name__}.").partition(" ")
    # A value alone is refused at its field; values that do not go together are refused at the part.
    assert said.partition(" (and ")[0] in (
        f"file.yaml: part.{name}: {name} {of_field}",
        f"file.yaml: part: {refused}",
    )


@pytest.mark.parametrize(("kind", "names"), PARTS, ids=shown)
def test_the_schema_says_what_the_record_declares(kind: Any, names: tuple[str, ...]) -> None:
    schema = fields_of(kind, *names).model_json_schema()
    assert list(schema["properties"]) == list(names)
    assert set(schema.get("required", ())) == {name for name in names if name not in kind._field_defaults}
    for name in names:
        if (quantity := quantities(kind).get(name)) is None:
            continue
        field = schema["properties"][name]
        number, text = field["anyOf"]
        assert (field["unit"], field["description"]) == (quantity.unit, quantity.meaning)
        assert (number["type"], text["type"]) == ("number", "string")
        for key, bound in (("minimum", quantity.minimum), ("exclusiveMaximum", quantity.below)):
            assert number.get(key) == (None if bound is None or math.isinf(bound) else bound)
        for key, bound in (("maximum", quantity.maximum), ("exclusiveMinimum", quantity.above)):
            assert number.get(key) == (None if bound is None or math.isinf(bound) else bound)


def test_schemas_of_files_are_json() -> None:
    """JSON has no infinity."""
    for schema in (job_schema(), analysis_schema(), design_schema()):
        json.dumps(schema, allow_nan=False)


@record
class Edge(NamedTuple):
    """An edge of a pulse."""

    time: Annotated[float, Quantity("s", "t", "time of the edge", above=0)]
    levels: Annotated[tuple[float, ...], Quantity("V", "u", "levels on the way", maximum=100)] = ()


@record
class Pulse(NamedTuple):
    """A pulse of a drive."""

    rise: Edge
    fall: Edge | None = None
    way: Literal["up", "down"] = "up"
    length: Annotated[float, Quantity("m", "l", "length that it moves", above=0)] = 1e-6


def test_records_in_records_and_what_is_no_number() -> None:
    content = {"rise": {"time": "1 ms", "levels": ["10 V", 20]}, "fall": {"time": 2.0}, "way": "down"}
    made = Pulse(Edge(1e-3, (10.0, 20.0)), Edge(2.0), "down")  # type: ignore[arg-type]
    assert read(Part[Pulse], content) == made
    file: Any = create_model("File", __base__=Strict, part=(Part[Pulse], ...))
    whole = json.loads(file(part=made).model_dump_json())
    assert file.model_validate(whole).part == made, "a file that is written is read as it was"
    schema = file.model_json_schema()
    assert schema["$defs"]["Edge"]["properties"]["levels"]["items"]["anyOf"][0] == {
        "type": "number", "maximum": 100
    }  # fmt: skip


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            {"rise": {"time": "0 s"}},
            "part.rise.time: time = '0 s' is out of range: time of the edge must be > 0",
        ),
        (
            {"rise": {"time": 1, "levels": [1, "1 kV"]}},
            "part.rise.levels: levels[1] = '1 kV' is out of range",
        ),
        (
            {"rise": {"time": 1}, "fall": {"tmie": 1}},
            "part.fall: there is no field 'tmie' (did you mean 'time'?)",
        ),
        (
            {"rise": {"time": 1, "level": None}},
            "part.rise: there is no field 'level' (did you mean 'levels'?)",
        ),
        ({"rise": {}}, "part.rise.time: Field required"),
        (
            {"rise": {"time": None}},
            "part.rise.time: time = None is not a number (expected s): time of the edge",
        ),
        ({"rise": {"time": 1}, "way": "dwn"}, "part.way: 'dwn' (did you mean 'down'?): it is 'up' or 'down'"),
        ({"rise": {"time": 1}, "length": "1 s"}, "part.length: length = '1 s' has the unit 's'"),
        ({"rise": {"time": 1}, "length": "1 mrad"}, "part: Pulse.length = '1 mrad' has the unit 'mrad'"),
        ({"rise": 3}, "part.rise: Input should be a valid dictionary or instance of Edge"),
    ],
)
def test_a_mistake_is_named_by_place_and_field(content: dict[str, Any], said: str) -> None:
    with pytest.raises(InputFileError) as caught:
        read(Part[Pulse], content)
    assert str(caught.value).startswith(f"file.yaml: {said}")


def test_a_field_that_is_said_elsewhere_is_unknown_in_the_part() -> None:
    without = Annotated[Edge, RecordPart(without=("levels",))]
    assert read(without, {"time": 1}) == Edge(1.0)
    with pytest.raises(InputFileError, match=r"part: there is no field 'levels'; there are time$"):
        read(without, {"time": 1, "levels": [1]})


def test_lengths_of_what_may_turn_are_read_when_it_is_known() -> None:
    """A file does not say by itself whether its actuator turns; what is wrong of both is told at once."""
    limits = fields_of(Limits)
    assert read(limits, {"max_position": "2 mrad"}).given == {"max_position": "2 mrad"}
    assert read(limits, {"max_position": "2 um", "max_slew": None}).given == {"max_position": "2 um"}
    for wrong in ("-2 mrad", "2 V", -1.0):
        with pytest.raises(InputFileError, match=r"file\.yaml: part\.max_position: max_position = "):
            read(limits, {"max_position": wrong})
