"""Actuators written as parameter sets: read back as they were, for every law, with source and error."""

from __future__ import annotations

from pathlib import Path

import pytest

import stickslip as ss
from stickslip.identify.comparison.laws import example_laws
from stickslip.parameters.load import ParameterSetError, load_set
from stickslip.parameters.writing import parameter_text, write_parameters

BASE = ss.load_actuator("kang2007")
LAWS = example_laws(BASE.friction)


@pytest.mark.parametrize("law", LAWS)
def test_an_actuator_is_read_back_as_it_was(law: str, tmp_path: Path) -> None:
    actuator = BASE.replace(friction=LAWS[law], stage_reaction=False, incline=0.1, gain=1.0 / 3e6)
    path = write_parameters(
        tmp_path / "a.toml", parameter_text(actuator, 'of "1"', "fit fits/x", {"gain": 2e-9})
    )
    read = ss.load_actuator(path)
    assert read.replace(name="kang2007") == actuator
    entries = load_set(path).entries()
    assert {one.source for one in entries.values()} == {"fit fits/x"}
    assert entries["gain"].note == "standard error 2e-09 m/V"
    assert entries["incline"].note == ""


def test_no_set_is_replaced(tmp_path: Path) -> None:
    text = parameter_text(BASE, "t", "s")
    write_parameters(tmp_path / "a.toml", text)
    with pytest.raises(FileExistsError):
        write_parameters(tmp_path / "a.toml", text)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"a\.toml"):
        write_parameters(tmp_path / "a.toml", parameter_text(BASE, "t", "s"))
    assert not list(tmp_path.iterdir())


def test_a_text_that_is_no_set_leaves_nothing(tmp_path: Path) -> None:
    """So that a second attempt with a good text finds no file."""
    text = parameter_text(BASE, "t", "s")
    with pytest.raises(ParameterSetError, match=r"a\.toml"):
        write_parameters(tmp_path / "a.toml", text + "value = \n")
    assert not list(tmp_path.iterdir())
    assert write_parameters(tmp_path / "a.toml", text).is_file()
