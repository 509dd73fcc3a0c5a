"""What a reader hands over: the channels of a file, and a way to read some of them.

To add a format, write a function from a path to a `Source` and name it in `reading.py`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..recording import RecordingError

# How a user points at a channel: its name in the file, its index (from 0), or an array's name and indices
# (from 0).
Column = str | int | tuple[Any, ...]


class Rows(NamedTuple):
    """The samples to read, from `start` up to, not including, `stop`."""

    start: int = 0
    stop: int | None = None


class Channel(NamedTuple):
    """One signal of a file."""

    name: str  # as the file writes it
    unit: str = ""  # as the file says it, if it does
    key: tuple[Any, ...] = ()  # what selects it beside name and index
    clock: int | None = None  # the channel that holds its time, where the file's layout says so
    numeric: bool = True


class Source(NamedTuple):
    """A file's channels, and how to read some of them, float64 and in the file's units, in one pass."""

    reader: str
    channels: tuple[Channel, ...]
    read: Callable[[Sequence[int], Rows], list[np.ndarray]]
    place: Callable[[int], str] = "sample {}".format  # where a sample stands in the file, for errors


_UNIT = re.compile(
    r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\)|\s/\s(?P<slash>\S+))\s*$"
)
_TIME = re.compile(
    r"(.*\.)?(time|t|zeit|temps|times?tamps?|date ?time|elapsed( time)?|x_value|trace_x)"
    r"([ _.-]?\d|[ _.-][a-d]| \(\d\))?"
)


def split_unit(header: str) -> tuple[str, str, bool]:
    """Name, unit, and whether it is certainly a unit: ("Position", "mm", True) for "Position [mm]".

    Round brackets and a slash may hold something else: "Force (left)".
    """
    found = _UNIT.match(header)
    if not found or not found["name"]:
        return header.strip(), "", False
    square = found["square"]
    return found["name"], (square or found["round"] or found["slash"] or "").strip(), square is not None


def is_time_name(name: str) -> bool:
    """Whether a channel of this name (with or without unit) is a clock."""
    return _TIME.fullmatch(split_unit(name)[0].strip().lower()) is not None


def find_channel(channels: Sequence[Channel], column: Column) -> int:
    """The index of the channel that `column` points at.

    Raises:
        RecordingError: there is none, or more than one; names those that are there.
    """
    if isinstance(column, int) and not isinstance(column, bool):
        matches = [column] if 0 <= column < len(channels) else []
    elif isinstance(column, tuple | list):
        matches = [i for i, channel in enumerate(channels) if channel.key == tuple(column)]
    else:
        matches = [i for i, channel in enumerate(channels) if channel.name == column]
        matches = matches or [
            i for i, channel in enumerate(channels) if split_unit(channel.name)[0] == column
        ]
    if len(matches) == 1:
        return matches[0]
    problem = "more than one column" if matches else "no column"
    raise RecordingError(f"{problem} {column!r}; the file has {_listing(channels)}")


def _listing(channels: Sequence[Channel], most: int = 20) -> str:
    shown = ", ".join(f"{i}: {channel.name!r}" for i, channel in enumerate(channels[:most]))
    return shown + (f", ... ({len(channels)} in all)" if len(channels) > most else "")
