"""Reader of MDF 4 files (.mf4) of automotive measurement systems, by asammdf, extra stickslip[mdf]."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...gate.files import name_of, opened
from ...gate.limits import LIMITS, check_count, check_size
from ...gate.mdf import check_mdf
from .. import RecordingError
from .source import FileChannel, FileContent, Rows, add_format

# Codes of the standard for data types that are numbers: integers and reals of both byte orders.
_NUMBERS = range(6)
_FORMULA = 3  # type of a conversion by a formula, which is a text in the file
_TEXTS = range(7, 12)  # types of conversions whose result is text


class _Place(NamedTuple):
    """Place of a channel in its file: index of the group, index of the channel in this group, and `master`,
    True if the channel contains the group's times."""

    group: int
    channel: int
    master: bool


def read_mdf(path: Path) -> FileContent:
    """Return the content of an MDF 4 file: its channels, with the time channel of each group as their clock.

    Groups without samples or without a time channel are left out.

    Raises:
        RecordingError: asammdf is not installed, the file is damaged, or has no such channels.
        GateError: `check_mdf` refuses the file.
    """
    file = _opened(path)
    try:
        places, channels, declared = _listed(file)
    except Exception as error:
        raise RecordingError(f"not a readable MDF file (cut off or damaged?): {error}") from error
    finally:
        file.close()
    if not channels:
        raise RecordingError("the MDF file has no channel with samples")
    check_count(path, len(channels), LIMITS.channels, "channels")
    check_size(path, declared, "channels")
    return FileContent(
        "MDF 4", tuple(channels), lambda wanted, rows: _read(path, places, channels, wanted, rows)
    )


def _opened(path: Path) -> Any:
    check_mdf(path)
    try:
        from asammdf import MDF
    except ImportError:
        raise RecordingError("MDF files need asammdf: pip install 'stickslip[mdf]'") from None
    try:
        with opened(path) as plain:
            file = MDF(name_of(plain))
    # asammdf raises its own exceptions and those of other libraries.
    except Exception as error:
        raise RecordingError(f"not a readable MDF file (cut off or damaged?): {error}") from error
    return file


def _listed(file: Any) -> tuple[list[_Place], list[FileChannel], int]:
    places: list[_Place] = []
    channels: list[FileChannel] = []
    declared = 0
    for number, group in enumerate(file.groups):
        cycles = int(group.channel_group.cycles_nr)
        master = file.masters_db.get(number)
        if not cycles or master is None:
            continue
        order = [master, *(i for i in range(len(group.channels)) if i != master)]
        clock = len(channels)
        for i in order:
            one = group.channels[i]
            changed = one.conversion.conversion_type if one.conversion is not None else 0
            numeric = one.data_type in _NUMBERS and changed not in _TEXTS
            unit = str(one.unit or (one.conversion.unit if one.conversion is not None else "") or "")
            places.append(_Place(number, i, i == master))
            channels.append(FileChannel(str(one.name), unit, (number, i), clock, numeric))
        declared += 8 * cycles * len(order)
    return places, channels, declared


def _read(
    path: Path, places: Sequence[_Place], channels: Sequence[FileChannel], wanted: Sequence[int], rows: Rows
) -> list[np.ndarray]:
    file = _opened(path)
    try:
        found = []
        for i in wanted:
            place = places[i]
            _refuse_formula(file.groups[place.group].channels[place.channel].conversion, channels[i].name)
            if place.master:
                values = file.get_master(place.group)
            else:
                values = file.get(group=place.group, index=place.channel).samples
            if values.ndim != 1 or values.dtype.kind not in "iufb":
                raise RecordingError(f"the channel {channels[i].name!r} holds no plain numbers")
            found.append(np.array(values[rows.start : rows.stop], np.float64))
        return found
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(f"not a readable MDF file (cut off or damaged?): {error}") from error
    finally:
        file.close()


def _refuse_formula(conversion: Any, name: str) -> None:
    """Raise RecordingError for a channel with the name `name` that the library would compute by a formula in
    the file, because the library would execute this text as a program."""
    if conversion is None:
        return
    if conversion.conversion_type == _FORMULA:
        raise RecordingError(f"the channel {name!r} is computed by a formula in the file: save its numbers")
    for inner in conversion.referenced_blocks.values():
        if hasattr(inner, "conversion_type"):
            _refuse_formula(inner, name)


add_format(read_mdf, "mdf", (".mf4",), lambda head, ending: head.startswith((b"MDF     ", b"UnFinMF ")))
