"""A mistyped key of an input file is named with the right one, on each level of each kind of file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import stickslip
from stickslip.jobs.analysis import run_file
from stickslip.jobs.analysis.study import study_of_file
from stickslip.jobs.file import read_job
from stickslip.quantities.input_file import InputFileError, load_yaml

PACKAGE = Path(stickslip.__file__).parent
WALK = {"file": "walk.csv", "columns": {"time": "t"}, "units": {"time": "ms"}, "start": 0.1, "use": "fit"}
DRIVE = {"shape": "Sawtooth", "fields": {"amplitude": 65.0, "frequency": 5.0}, "duration": 1.0}
FIT = {"title": "A walk", "model": "kang2007", "change": {"incline": 0.1}, "friction": {"sigma_0": 1e6}}
LAW = {"law": "Dahl", "fields": {"sigma_0": 1e6, "coulomb_force": 0.5}, "free": ["sigma_0"], "label": "own"}
TRIGGER = {"signal": "drive_voltage", "level": "1 V", "edge": "rising"}
CAPTURE = {"length": 1.0, "interval": 1e-3, "trigger": TRIGGER}
FILTER = {"order": 2, "corner": "1 kHz"}
FILES: dict[str, Any] = {
    "walk": {"kind": "walk", **FIT, "free": ["sigma_0"], "recordings": [{**WALK, "drive": DRIVE}]},
    "verification": {"kind": "verification", **FIT, "recordings": [WALK], "require": ["rmse < 1 um"]},
    "comparison": {"kind": "comparison", **FIT, "laws": ["LuGre", LAW], "recordings": [WALK]},
    "campaign": {
        **FIT, "model_choice": [LAW], "recordings": [{**WALK, "waveform": [DRIVE]}], "filter": FILTER
    },
    "experiment": {
        "title": "All that there is",
        "rig": {"kind": "virtual", "seed": 1, "variation": {"friction": "1 %", "drift_runs": 3}},
        "channels": {"x": {"input": "inductive", "calibration": ["c"], "filter": FILTER}},
        "runs": [{"name": "a", "waveform": [DRIVE], "capture": CAPTURE}],
        "panel": [{"kind": "plotter", "variables": ["x"], "width": 3}],
    },
    "device": {
        "title": "A rig on the network",
        "rig": {"kind": "nv200", "options": {"host": "192.168.0.20"}},
        "channels": {"x": {"input": "a"}},
        "runs": [{"name": "a", "waveform": [DRIVE], "capture": {"length": 1.0, "down_sampling": 2}}],
    },
}  # fmt: skip
FILES["job"] = {
    "title": "One after the other",
    "steps": [
        {"record": FILES["experiment"]},
        {"identify": FILES["walk"]},
        {"verify": {"recordings": [WALK], "require": ["rmse < 1 um"]}},
        {"compare": FILES["comparison"]},
        {"export": {"format": "fmu", "mode": "plant"}},
        {"design": {"map": {"drive": DRIVE, "load": {"start": "0 N", "stop": "1 N", "points": 3}}}},
    ],
}
EXAMPLES = [*PACKAGE.glob("examples/*.yaml"), PACKAGE / "panel/experiment.yaml"]
FILES |= {file.stem: yaml.safe_load(file.read_text("utf-8")) for file in EXAMPLES if "job" not in file.stem}
# Their keys are names that the user gives, or fields of the model, which is asked when it is made (below).
FREE = {
    "columns", "units", "calibration", "rename", "change", "friction", "fields", "bounds", "priors", "tied",
    "matrix", "published", "marks", "variables", "channels", "grid", "ranges", "spread", "factors", "free",
    "models", "options",
}  # fmt: skip


def places(node: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where the keys of a schema stand; of several items of a list, in the first of a kind."""
    if isinstance(node, dict):
        for key, value in node.items():
            if not at or at[-1] not in FREE or at[0] == "panel":
                yield (*at, key)
            yield from places(value, (*at, key))
    elif isinstance(node, list):
        seen: set[Any] = set()
        for i, one in enumerate(node):
            keys = tuple(one) if isinstance(one, dict) else ()
            if keys not in seen:
                seen.add(keys)
                yield from places(one, (*at, i))


def mistyped(content: Any, place: tuple[Any, ...]) -> tuple[Any, str]:
    """The content with one letter less or another in a key, at its old place among the others."""
    made = json.loads(json.dumps(content))  # a copy in which no part is in two places
    node = made
    for part in place[:-1]:
        node = node[part]
    key = place[-1]
    wrong = f"{key[:-1]}q" if len(key) > 2 else f"{key}q"
    items = list(node.items())
    node.clear()
    node.update({wrong if name == key else name: value for name, value in items})
    return made, wrong


@pytest.mark.parametrize("name", FILES)
def test_a_mistyped_key_is_named_with_the_right_one(name: str, tmp_path: Path) -> None:
    file = tmp_path / "file.yaml"
    read = study_of_file if name == "kang2007_study" else read_job
    found = list(places(FILES[name]))
    assert len(found) > 5
    for place in found:
        content, wrong = mistyped(FILES[name], place)
        file.write_text(yaml.safe_dump(content, sort_keys=False), "utf-8")
        with pytest.raises(InputFileError) as caught:
            read(file)
        inside = ".".join(map(str, place[:-1]))
        if place[0] == "steps" and len(place) == 3:
            words = f"{inside}: there is no step {wrong!r}"
        else:
            words = f"{inside}: there is no field {wrong!r}".removeprefix(": ")
        assert str(caught.value).startswith(f"{file}: {words} (did you mean {place[-1]!r}?)")


def test_a_mistyped_kind_and_a_file_that_says_none(tmp_path: Path) -> None:
    for content, words in (
        ({**FILES["walk"], "kind": "wlk"}, "there is no kind 'wlk' (did you mean 'walk'?); there are "),
        ({"knid": "walk", **FIT}, "there is no field 'knid' (did you mean 'kind'?)"),
        (FIT, "kind is missing"),
    ):
        (file := tmp_path / "walk.yaml").write_text(yaml.safe_dump(content), "utf-8")
        with pytest.raises(InputFileError) as caught:
            run_file(file)
        assert str(caught.value).startswith(f"{file}: {words}")


def test_a_key_that_is_given_twice_is_refused(tmp_path: Path) -> None:
    """YAML takes the last, unsaid."""
    file = tmp_path / "twice.yaml"
    file.write_text("kind: walk\ntitle: a\nchange:\n  end_effector_mass: 100 g\n  end_effector_mass: 250 g\n")
    with pytest.raises(InputFileError, match=r"line 5: the key 'end_effector_mass' is given twice"):
        load_yaml(file)
