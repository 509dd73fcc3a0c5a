"""What a reader hands over: the channels of a file, and a way to read some of them.

To add a format, write a function from a path to a `Source` and name it in `opening.py`.
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

    name: str  # in the file
    unit: str = ""  # as the file says it, if it does
    key: tuple[Any, ...] = ()  # what selects it beside name and index
    clock: int | None = None  # the channel that holds its time, where the file's layout says so
    numeric: bool = True
    header: str = ""  # name and unit, where the file writes them as one

    @property
    def shown(self) -> str:
        """As the user sees it in the file."""
        return self.header or self.name


class Source(NamedTuple):
    """A file's channels, and how to read some of them, float64 and in the file's units, in one pass."""

    reader: str
    channels: tuple[Channel, ...]
    read: Callable[[Sequence[int], Rows], list[np.ndarray]]
    place: Callable[[int], str] = "sample {}".format  # where a sample stands in the file, for errors


_TIME = re.compile(
    r"(.*\.)?(time|t|zeit|temps|times?tamps?|date ?time|elapsed( time)?|x_value|trace_x)"
    r"([ _.-]?\d|[ _.-][a-d]| \(\d\))?"
)


def is_clock(channel: Channel) -> bool:
    """Whether a channel is called like a time."""
    return _TIME.fullmatch(channel.name.strip().lower()) is not None


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
        matches = [i for i, channel in enumerate(channels) if column in (channel.name, channel.header)]
    if len(matches) == 1:
        return matches[0]
    problem = "more than one column" if matches else "no column"
    raise RecordingError(f"{problem} {column!r}; the file has {listing(channels)}")


def listing(channels: Sequence[Channel], most: int = 20) -> str:
    """The channels by index and name, for errors."""
    shown = ", ".join(f"{i}: {channel.shown!r}" for i, channel in enumerate(channels[:most]))
    return shown + (f", ... ({len(channels)} in all)" if len(channels) > most else "")
