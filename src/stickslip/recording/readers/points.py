"""Reader of tables with points of velocity and friction force, as a tribometer or a servo drive measures
them."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .. import RecordingError
from .formats import find_format
from .opening import source_of
from .reading import named_file
from .selection import select
from .source import Column, FileChannel, Rows, listing

_NAMES = (
    ("velocity", r"veloc|speed|geschw|vitesse|^v$|\bv\b"),
    ("force", r"force|friction|kraft|^f$|\bf\b|load cell"),
)


def read_points(
    path: str | os.PathLike[str],
    columns: Mapping[str, Column] | None = None,
    units: Mapping[str, str] | None = None,
) -> dict[str, np.ndarray]:
    """Return velocities and forces from a table without a clock, in SI, for `identify_stribeck`.

    Args:
        path: any file of columns that `read_recording` reads.
        columns: column of "velocity" and of "force", as for `read_recording`; by default found by their
            names.
        units: units of "velocity" and "force", which override those of the file; numbers without a unit are
            taken to be in SI.

    Returns:
        Dictionary of the arrays "velocity" [m/s] and "force" [N], one value for each point.

    Raises:
        RecordingError: a column is missing or ambiguous, has a wrong unit, or a value that is missing or not
            finite; the message names file and column.
    """
    path = Path(path)
    with named_file(path):
        source = source_of(path, find_format(path))
        chosen = {**_found(source.channels), **(columns or {})}
        missing = [name for name, _ in _NAMES if name not in chosen]
        if missing or set(chosen) - dict(_NAMES).keys():
            raise RecordingError(
                f"say columns={{'velocity': ..., 'force': ...}}. The file has {listing(source.channels)}"
            )
        selected = select(source.channels, chosen, units or {}, {}, equally_spaced=True)
        arrays = source.read([one.channel for one in selected.variables], Rows())
        found = {}
        for one, values in zip(selected.variables, arrays, strict=True):
            if not np.all(np.isfinite(values)):
                bad = int(np.flatnonzero(~np.isfinite(values))[0])
                raise RecordingError(f"{source.place(bad)}: {one.label} is empty, NaN or infinite")
            found[one.name] = values * one.conversion.factor
        if found["velocity"].size != found["force"].size:
            raise RecordingError(f"{found['velocity'].size} velocities, but {found['force'].size} forces")
        return found


def _found(channels: tuple[FileChannel, ...]) -> dict[str, Column]:
    """Return the indices of the columns whose names mean velocity and force, by the keys "velocity" and
    "force". A key is missing if no column or several columns have such a name."""
    result: dict[str, Column] = {}
    for name, pattern in _NAMES:
        text = [re.sub(r"[_.]+", " ", one.name).lower() for one in channels]
        at = [i for i, one in enumerate(channels) if one.numeric and re.search(pattern, text[i])]
        if len(at) == 1:
            result[name] = at[0]
    return result
