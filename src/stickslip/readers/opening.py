"""The source of a file, by its format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from .csv import read_csv
from .formats import Format
from .headers import named_unit
from .matlab import read_matlab
from .mdf import read_mdf
from .npy import read_npy, read_npz
from .source import Source

_BINARY: Mapping[Format, Callable[[Path], Source]] = {
    "npy": read_npy,
    "npz": read_npz,
    "mat": read_matlab,
    "mdf": read_mdf,
}


def source_of(
    path: Path, kind: Format, delimiter: str | None = None, decimal: str | None = None, skip: int = 0
) -> Source:
    """The channels of a file of that format, with the units that their names say; see `find_layout` for the
    arguments of text.

    Raises:
        RecordingError: the file is damaged, or not as its format is.
    """
    source = read_csv(path, delimiter, decimal, skip) if kind == "text" else _BINARY[kind](path)
    return source._replace(channels=tuple(map(named_unit, source.channels)))
