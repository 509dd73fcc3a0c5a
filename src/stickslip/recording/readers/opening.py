"""Opening of a measurement file with the reader of its format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...gate.errors import GateError
from ...gate.limits import LIMITS
from ...quantities import registry
from .csv import read_csv
from .file_units import of_its_name
from .headers import named_unit
from .source import FileContent
from .time_columns import with_clocks


def source_of(path: Path, kind: str, **text: Any) -> FileContent:
    """Return the content of a file: its channels, with units and clocks that their names show, and the
    function that reads them.

    Args:
        path: path of the file.
        kind: name of the format, from `find_format`.
        text: arguments of `find_layout` for a text file.

    Raises:
        GateError: the file is damaged, or exceeds `LIMITS`, such as by a long name of a channel.
        RecordingError: the file is damaged, or has another format.
        RegistryError: there is no such format.
    """
    source = read_csv(path, **text) if kind == "text" else registry.readers.find(kind).read(path)
    if any(len(one.shown) > LIMITS.name for one in source.channels):
        raise GateError(f"{path}: a name in it has more than {LIMITS.name:,} characters: shorten it")
    source = source._replace(channels=tuple(of_its_name(named_unit(one)) for one in source.channels))
    return with_clocks(source) if kind == "text" else source
