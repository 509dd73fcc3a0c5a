"""Interface of a reader: the channels of a file, and a function that reads some of them.

To add a format, write a function from a path to a `Source`, and register it as a `Format` (`add_format`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...quantities import registry
from ...quantities.records import did_you_mean
from .. import RecordingError

# Reference to a channel: its name in the file, its index (from 0), or an array's name and indices
# (from 0).
Column = str | int | tuple[Any, ...]


class Rows(NamedTuple):
    """Samples to read: from `start` up to, but not including, `stop`."""

    start: int = 0
    stop: int | None = None


class FileChannel(NamedTuple):
    """One signal of a file, as a reader describes it."""

    name: str  # as in the file
    unit: str = ""  # as in the file, if any
    key: tuple[Any, ...] = ()  # reference to it besides name and index
    clock: int | None = None  # the channel with its time, if the file's layout determines it
    numeric: bool = True
    header: str = ""  # name and unit, if the file writes them as one
    epoch: float = 0.0  # for dates: zero of the numbers, s since 1970; for times of day, s of the day
    stamp: bool = False  # dates or times of day

    @property
    def shown(self) -> str:
        """Return the name as it is in the file."""
        return self.header or self.name


class FileContent(NamedTuple):
    """Channels of a file, and a function that reads some of them in one pass, as float64 in the file's
    units."""

    reader: str
    channels: tuple[FileChannel, ...]
    read: Callable[[Sequence[int], Rows], list[np.ndarray]]
    place: Callable[[int], str] = "sample {}".format  # place of a sample in the file, for errors


class Format(NamedTuple):
    """A file format: name, file endings (".raw"), a function that recognises a file by its first bytes and
    ending, and its reader."""

    name: str
    endings: tuple[str, ...]
    recognises: Callable[[bytes, str], bool]
    read: Callable[[Path], FileContent]


def add_format(
    read: Callable[[Path], FileContent],
    name: str,
    endings: Sequence[str],
    recognises: Callable[[bytes, str], bool] | None = None,
) -> None:
    """Register a format; a user's own is tried before those of the package.

    Args:
        read: function from a path to a `Source`; the first line of its docstring describes it in lists.
        name: name of the format.
        endings: endings of file names; a file with one of them must be of this format.
        recognises: function from the first bytes of a file, and the ending of its name, to whether it is of
            the format; by default the ending decides.
    """
    known = recognises or (lambda head, ending: ending in endings)
    registry.readers.add(Format(name, tuple(endings), known, read), name, read)


_TIME = re.compile(
    r"(.*\.)?(time|t|zeit|temps|times?tamps?|date ?time|elapsed( time)?|x_value|trace_x)"
    r"([ _.-]?\d|[ _.-][a-d]| \(\d\))?"
)


_TIME_UNITS = {
    name: unit
    for unit, names in (
        ("s", "sec secs second seconds sekunden"),
        ("ms", "ms msec msecs milli millis millisec millisecond milliseconds"),
        ("us", "us usec usecs µs micros microsec microsecond microseconds"),
        ("ns", "nsec nanos nanosecond nanoseconds"),
    )
    for name in names.split()
}


def is_clock(channel: FileChannel) -> bool:
    """Return True if a channel has the name of a time. "sec" alone is a unit if it is the unit of another
    name."""
    name = channel.name.strip().lower()
    named = _TIME.fullmatch(name) is not None
    return channel.stamp or named or (time_unit(name) != "" and channel.unit == time_unit(name))


def time_unit(name: str) -> str:
    """Return the unit of time in a column's name: "seconds", "millis()"; "" for other names."""
    return _TIME_UNITS.get(name.strip().lower().removesuffix("()"), "")


def find_channel(channels: Sequence[FileChannel], column: Column) -> int:
    """Return the index of the channel to which `column` refers.

    Raises:
        RecordingError: no channel, or more than one, matches; the message names the existing ones.
    """
    if isinstance(column, int) and not isinstance(column, bool):
        matches = [column] if 0 <= column < len(channels) else []
    elif isinstance(column, tuple | list):
        matches = [i for i, channel in enumerate(channels) if channel.key == tuple(column)]
    else:
        matches = [i for i, channel in enumerate(channels) if column in (channel.name, channel.header)]
    if len(matches) == 1:
        return matches[0]
    problem = "more than one column" if matches else "no column"
    hint = "" if matches else did_you_mean(str(column), [channel.name for channel in channels])
    raise RecordingError(f"{problem} {column!r}{hint}; the file has {listing(channels)}")


def pointer(channels: Sequence[FileChannel], i: int) -> str | int:
    """Return a reference to a channel: its name in the file if unique, else its index."""
    for name in (channels[i].shown, channels[i].name):
        if name and sum(name in (one.name, one.header) for one in channels) == 1:
            return name
    return i


def listing(channels: Sequence[FileChannel], most: int = 20) -> str:
    """Return a text with the channels by index and name, for errors."""
    shown = ", ".join(f"{i}: {channel.shown!r}" for i, channel in enumerate(channels[:most]))
    return shown + (f", ... ({len(channels)} in all)" if len(channels) > most else "")
