"""The library of the engine and the files that are made for it."""

from __future__ import annotations

from tools import generate_engine


def test_the_generated_files_are_those_of_the_sources() -> None:
    for file, text in generate_engine.generated().items():
        assert file.read_text("ascii") == text, f"{file.name} is out of date: run make laws"
