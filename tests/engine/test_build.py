"""The library of the engine and the files that are made for it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tools import generate_engine

from friction.samples import ALL
from stickslip.engine import library
from stickslip.engine.law_of import law_of
from stickslip.engine.laws import packaged, row
from stickslip.friction import element

ROOT = Path(__file__).resolve().parents[2]


def test_the_generated_files_are_those_of_the_sources() -> None:
    for file, text in generate_engine.generated().items():
        assert file.read_text("ascii") == text, f"{file.name} is out of date: run make laws"


def test_the_library_holds_every_law_of_the_package() -> None:
    assert set(library.packaged("law")) == {law.__name__ for law in packaged()}


@pytest.mark.parametrize("law", ALL, ids=lambda law: type(law).__name__)
def test_laws_of_the_package_come_from_the_library(law) -> None:
    one = element(law, 0)
    made = law_of(one)
    assert made.how == "package"
    assert made.pointer.parameters == len(row(one))


def test_a_library_of_other_sources_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Other:
        STICKSLIP_ABI = 1

        def stickslip_abi(self) -> int:
            return 2

    class Opener:
        def dlopen(self, name: str) -> Other:
            return Other()

    monkeypatch.setattr(library, "ffi", Opener())
    with pytest.raises(library.EngineMissingError, match=r"was built from other sources.*make engine"):
        library.library.__wrapped__()


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(library, "FILE", tmp_path / "_engine.so")
    with pytest.raises(library.EngineMissingError, match=r"_engine\.so cannot be opened.*make engine"):
        library.library.__wrapped__()


def test_set_up_without_a_compiler_says_what_to_install(tmp_path: Path) -> None:
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, program in {"python3": sys.executable, "sh": "/bin/sh", "make": shutil.which("make")}.items():
        (programs / name).symlink_to(str(program))
    for name in ("Makefile", "requirements.lock", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path / name)
    environment = {"PATH": str(programs), "HOME": str(tmp_path)}
    command = [str(programs / "make"), "setup"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "stickslip needs a C compiler (Debian: apt install gcc libc6-dev" in done.stderr
    assert not (tmp_path / ".venv").exists()
