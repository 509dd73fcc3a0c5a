"""Interface of readers: the channels of a file, and a function that reads some of them.

To add a format, write a function that takes a path and returns a `FileContent`, and register it with
`add_format`.
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

# Reference to a channel: its name in the file, its index (from 0), or a tuple of an array's name and indices
# (from 0).
Column = str | int | tuple[Any, ...]


class Rows(NamedTuple):
    """Range of samples to read: from `start` up to, but not including, `stop`; `stop` None: to the end."""

    start: int = 0
    stop: int | None = None


class FileChannel(NamedTuple):
    """One signal of a file, as a reader describes it. `numeric` is False if the signal contains no numbers;
    comments explain the other fields."""

    name: str  # name in the file
    unit: str = ""  # unit in the file; "" without a unit
    # Tuple by which a user can also refer to the channel, such as ("trace_y", 1).
    key: tuple[Any, ...] = ()
    # Index of the channel with the times of this one, if the file's layout determines it; None: unknown. A
    # time channel has its own index.
    clock: int | None = None
    numeric: bool = True
    header: str = ""  # name and unit in one text, if the file writes them so; otherwise ""
    # Time that the number 0 means, s: for dates since 1970, for times of day since midnight.
    epoch: float = 0.0
    stamp: bool = False  # True: the channel contains dates or times of day
    # Reason why apparent numbers are not read as numbers, in words; "" for words and for what is read.
    unread: str = ""

    @property
    def shown(self) -> str:
        """Return the name as the file writes it, with the unit if both are one text."""
        return self.header or self.name


class FileContent(NamedTuple):
    """Content of a file: its channels, and a function `read`.

    `read` takes indices of channels and a range of samples (`Rows`), and returns a list with the values of
    each channel as float64 in the file's units. `reader` is the name of the reader.
    """

    reader: str
    channels: tuple[FileChannel, ...]
    read: Callable[[Sequence[int], Rows], list[np.ndarray]]
    # function from the index of a sample to its place in the file as text, for messages
    place: Callable[[int], str] = "sample {}".format


class Format(NamedTuple):
    """A file format: `name`; `endings` of file names (".raw"); `recognises`, a function that takes the first
    bytes of a file and the ending of its name and returns True for this format; and `read`, a function that
    takes a path and returns a `FileContent`."""

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
    """Register a file format. Formats of users are tried before those of the package.

    Args:
        read: function that takes a path and returns a `FileContent`; the first line of its docstring
            describes the format in lists.
        name: name of the format.
        endings: endings of file names (".raw"); a file with one of them must have this format.
        recognises: function that takes the first bytes of a file and the ending of its name, and returns True
            if the file has this format; by default the ending decides.
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
    """Return True if a channel has the name of a time or contains dates or times of day. A name that is only
    a unit of time, such as "sec", counts if it means the same as the channel's unit."""
    name = channel.name.strip().lower()
    named = _TIME.fullmatch(name) is not None
    return channel.stamp or named or (time_unit(name) != "" and channel.unit == time_unit(name))


def time_unit(name: str) -> str:
    """Return the unit of time ("s", "ms", "us", "ns") that a column's whole name means, such as "seconds" or
    "millis()"; "" for other names."""
    return _TIME_UNITS.get(name.strip().lower().removesuffix("()"), "")


def find_channel(channels: Sequence[FileChannel], column: Column) -> int:
    """Return the index of the channel to which `column` refers: an index, a name in the file (with or without
    unit), or a key (a tuple).

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
    """Return a reference to channel `i`: its name in the file if that is unique, otherwise its index."""
    for name in (channels[i].shown, channels[i].name):
        if name and sum(name in (one.name, one.header) for one in channels) == 1:
            return name
    return i


def no_numbers(channel: FileChannel) -> str:
    """Return the message that a column has no numbers, with the reason, if it seems to have some."""
    why = f" that can be read: {channel.unread}" if channel.unread else ""
    return f"the column {channel.shown!r} holds no numbers{why}"


def listing(channels: Sequence[FileChannel], most: int = 20) -> str:
    """Return a text with index and name of the first `most` channels, and the number of all, for messages."""
    shown = ", ".join(f"{i}: {channel.shown!r}" for i, channel in enumerate(channels[:most]))
    return shown + (f", ... ({len(channels)} in all)" if len(channels) > most else "")
