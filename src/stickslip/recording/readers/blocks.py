"""Reader of logs with blocks of "key: value", as programs print them after each move.

The line "Trial 1 - Forward: Error: 37.48 nm, Time: 0.63 sec" is one record. Several lines, such as "Target:
10 um" and "Reached: 9.98 um", are also one record, which ends at a line without a pair (blank, or a rule such
as "-----") or at a repeated key.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...gate.files import opened
from ...gate.limits import LIMITS
from ...quantities.units import QuantityError
from .. import RecordingError
from .file_units import to_si_unit

if TYPE_CHECKING:
    import xarray as xr

# Fewest records of a file that is taken for a log.
FEWEST = 2
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(
    rf"(?P<key>[^\W\d_][^:=,;|\t\n]{{0,60}}?)\s*[:=]\s*(?P<number>{_NUMBER})\s*(?P<unit>[^\s\d,;|:=]*)\s*(?=[,;|\t]|$)"
)
_COUNTED = re.compile(r"(?P<key>[^\W\d_]+)[ _#.]*(?P<number>\d+)")
_RULE = re.compile(r"\s*[-=*_#~]*\s*")


class _Record(NamedTuple):
    label: str
    values: dict[str, tuple[float, str]]  # numbers with their units as in the file, by key


def read_log(path: str | os.PathLike[str]) -> xr.Dataset:
    """Return the table in a log of "key: value" blocks: a dataset over "record" with a variable for each key,
    in SI; values with an unknown unit keep this unit.

    A missing value is NaN. The text before the keys of a record is in the variable `label`; a number in this
    text ("Trial 1") is also a value, with the word as key. Only the first 4 MiB of the file are read. The
    variables are named by the keys in lower case, with "_" for other signs.

    Raises:
        RecordingError: there are no two such blocks, or a key has units of different dimensions.
        GateError: the path is no regular file.
        OSError: the file cannot be opened.
    """
    import xarray as xr

    path = Path(path)
    records = _records(path)
    if len(records) < FEWEST:
        raise RecordingError(f"{path}: there are no {FEWEST} blocks of 'key: value' lines with numbers")
    keys = list(dict.fromkeys(key for record in records for key in record.values))
    table: dict[str, tuple[str, np.ndarray, dict[str, str]]] = {}
    for key in keys:
        column, units = np.full(len(records), np.nan), set()
        for i, record in enumerate(records):
            if key in record.values:
                number, unit = record.values[key]
                column[i], si = _in_si(number, unit)
                units.add(si)
        if len(units) > 1:
            raise RecordingError(f"{path}: {key!r} is in {' and in '.join(sorted(map(repr, units)))}")
        name = re.sub(r"\W+", "_", key.lower()).strip("_")
        table[name] = ("record", column, {"units": units.pop(), "long_name": key})
    labels = [record.label for record in records]
    shown = {"label": ("record", labels, {"long_name": "label"})} if any(labels) else {}
    return xr.Dataset({**shown, **table}, attrs={"source": path.name})


def _in_si(number: float, unit: str) -> tuple[float, str]:
    """Return a number and its unit, both converted to SI; both unchanged if the unit is unknown or ""."""
    try:
        conversion = to_si_unit(unit) if unit else None
    except QuantityError:
        return number, unit
    return (conversion.factor * number + conversion.offset, conversion.unit) if conversion else (number, "")


def _records(path: Path) -> list[_Record]:
    with opened(path) as file:
        text = file.read(LIMITS.line * 16).decode("utf-8", errors="replace")
    found: list[_Record] = []
    heading, open_block = "", False
    for line in text.splitlines():
        pairs = list(_PAIR.finditer(line))
        before = line[: pairs[0].start()] if pairs else line
        if not pairs:
            open_block = False
            heading = "" if _RULE.fullmatch(line) else before.strip(" \t:-=*#[]")
            continue
        label = before.strip(" \t:-,") or ("" if open_block else heading)
        values = {one["key"].strip(): (float(one["number"]), one["unit"]) for one in pairs}
        if not open_block or before.strip(" \t:-,") or values.keys() & found[-1].values.keys():
            counts = {one["key"]: (float(one["number"]), "") for one in _COUNTED.finditer(label)}
            found.append(_Record(label, {**counts, **values}))
        else:
            found[-1].values.update(values)
        open_block = True
    return found
