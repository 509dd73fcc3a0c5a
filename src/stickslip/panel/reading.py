"""Modules that the process that reads files needs for the first question of a page."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

# Modules with the functions that pages have applied to files. To import them takes 1.5 s of computing, for
# which the first question of a page would wait.
_MODULES = (
    "readers.reading",
    "history.describing",
    "parameters.load",
    "study.picture",
    "analysis.fit_parameters",
)


def ready(_: Path) -> None:
    """Import what reads the files of a folder."""
    for name in _MODULES:
        import_module(f"..{name}", __package__)
