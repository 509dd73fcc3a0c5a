"""The library of the engine and the files that are made for it."""

from __future__ import annotations

import pytest
from tools import generate_engine

from friction.samples import ALL
from stickslip.engine import library
from stickslip.engine.law_of import law_of
from stickslip.engine.laws import packaged, row
from stickslip.friction import element


def test_the_generated_files_are_those_of_the_sources() -> None:
    for file, text in generate_engine.generated().items():
        assert file.read_text("ascii") == text, f"{file.name} is out of date: run make laws"


def test_the_library_holds_every_law_of_the_package() -> None:
    assert set(library.packaged_laws()) == {law.__name__ for law in packaged()}


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
