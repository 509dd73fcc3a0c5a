"""``--set FIELD=VALUE`` gives any field of a file on the command line; it is checked as in the file."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.quantities.input_file import InputFileError, load_yaml

FILE = {
    "kind": "walk",
    "title": "A walk",
    "model": "kang2007",
    "free": ["coulomb_force"],
    "recordings": [{"file": "one.nc"}, {"file": "two.nc", "use": "verify"}],
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(amplitude=65.0, frequency=20.0)
    for i, name in enumerate(("one", "two")):
        walk = ss.simulate(model, drive, duration=0.15, sample_rate=5e3)
        noise = 1e-9 * np.random.default_rng(i).standard_normal(walk.sizes["time"])
        position = walk["end_effector_position"]
        walk["end_effector_position"] = (position + noise).assign_attrs(position.attrs)
        ss.save_recording(walk, tmp_path / f"{name}.nc")
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(FILE), "utf-8")
    return tmp_path


def run(*words: str | os.PathLike[str]):
    return CliRunner().invoke(app, list(map(str, words)))


def test_a_fit_is_changed_on_the_command_line_and_the_file_stays(folder: Path) -> None:
    before = (folder / "walk.yaml").read_bytes()
    changes = ("free=[coulomb_force, sigma_0]", "bounds.sigma_0=[100 kN/m, 10 MN/m]", "recordings.1.use=fit")
    asked = [word for change in changes for word in ("--set", change)]
    done = run("identify", folder / "walk.yaml", *asked, "--out", folder / "out")
    assert done.exit_code == 0, done.output
    numbers = json.loads((folder / "out" / "results.json").read_text("utf-8"))["numbers"]
    assert set(numbers["parameters"]) == {"coulomb_force", "sigma_0"}
    assert len(numbers["recordings"]) == 2
    assert (folder / "walk.yaml").read_bytes() == before


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("title", "--set title: write FIELD=VALUE"),
        ("=3", "--set =3: write FIELD=VALUE"),
        ("titel=x", "there is no field 'titel' (did you mean 'title'?)"),
        ("recordings.2.use=fit", "'2' is no part of a list of 2, whose parts are 0 to 1"),
        ("recordings.first.use=fit", "'first' is no part of a list of 2"),
        ("title.short=x", "'short' is a field of something that has none: 'A walk'"),
        ("free=[coulomb_force", "--set free=[coulomb_force"),
        ("bounds.coulomb_force=[5 m, 6 m]", "lower bound of coulomb_force"),
        ("tolerance=-1 nm", "tolerance"),
    ],
)
def test_wrong_changes_are_refused_before_anything_is_done(folder: Path, change: str, said: str) -> None:
    done = run("identify", folder / "walk.yaml", "--set", change, "--out", folder / "out")
    assert done.exit_code != 0
    assert said in " ".join(done.output.split())
    assert not (folder / "out" / "results.json").exists()


@pytest.mark.parametrize(
    "command", ["run", "identify", "campaign", "verify", "design", "record", "move", "hold", "study run"]
)
def test_every_command_with_a_file_takes_changes(folder: Path, command: str) -> None:
    said = run(*command.split(), folder / "walk.yaml", "--set", "no equals", *store(command, folder))
    assert said.exit_code != 0
    assert "--set no equals: write FIELD=VALUE" in " ".join(said.output.split())


def store(command: str, folder: Path) -> list[str]:
    return ["--store", str(folder / "store")] if command == "study run" else ["--out", str(folder / "out")]


def test_changes_make_the_mappings_that_are_missing(tmp_path: Path) -> None:
    (tmp_path / "file.yaml").write_text("title: A\nlist: [{a: 1}]\nnone: null\n", "utf-8")
    found = load_yaml(tmp_path / "file.yaml", ["b.c.d=2.5", "list.0.a=[1, 2]", "none.x=yes", "title='1'"])
    assert found == {
        "title": "1",
        "list": [{"a": [1, 2]}],
        "none": {"x": True},
        "b": {"c": {"d": 2.5}},
    }
    with pytest.raises(InputFileError, match="--set a="):
        load_yaml(tmp_path / "file.yaml", ["a={x: 1, x: 2}"])
