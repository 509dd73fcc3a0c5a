"""Function of the study whose stores `folder_damage` damages; in a file of its own, which workers import."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import NDArray


def value(columns: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Return a number of each member that says which one it is."""
    return {"value": columns["x"] + 10.0 * columns["y"]}
