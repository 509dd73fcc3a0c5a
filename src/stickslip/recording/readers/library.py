"""Tools for formats that an optional library reads: import of the library, its errors, and signals with their
clocks (times)."""

from __future__ import annotations

import gc
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...gate.errors import GateError
from ...gate.limits import LIMITS, check_count, check_regular, check_size
from .. import RecordingError
from .source import FileChannel, FileContent, Rows

# Pattern of the name by which a library gets an open file; it is removed from messages.
_OPEN = re.compile(r"'?/dev/fd/\d+'?")


def library(module: str, kind: str, package: str, extra: str) -> Any:
    """Return a module of an optional dependency.

    Args:
        module: name of the module.
        kind: the files that need the module, in words, for the message.
        package, extra: package of the module, and extra of stickslip that installs it.

    Raises:
        RecordingError: the module is not installed; the message contains the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        raise RecordingError(f"{kind} need {package}: pip install 'stickslip[{extra}]'") from None


@contextmanager
def read_by_library(kind: str) -> Iterator[None]:
    """Turn every error of a library in the block into a RecordingError, because libraries report damage by
    many types; `kind` names the file format in the message."""
    try:
        yield
    except (RecordingError, GateError, MemoryError):
        raise
    except Exception as error:
        said = _OPEN.sub("it", " ".join(str(error).split())) or type(error).__name__
        raise RecordingError(f"not a readable {kind} (cut off or damaged?): {said:.300}") from error


@contextmanager
def no_file_left_open() -> Iterator[None]:
    """At the end of the block, close files that a library has left open, by garbage collection."""
    try:
        yield
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()


class Signal(NamedTuple):
    """Samples of one signal that a library reads, in the file's unit.

    The function `load` takes a range of rows and returns their samples; `size` is the number of all samples.
    The other fields are those of `FileChannel`.
    """

    name: str
    unit: str
    size: int
    load: Callable[[Rows], np.ndarray]
    key: tuple[Any, ...] = ()
    numeric: bool = True
    # For dates: the time that the number 0 means, in s since 1970.
    epoch: float = 0.0


class SignalGroup(NamedTuple):
    """Signals with the same sample times. `time` is the signal of these times; None if the file has no
    times."""

    time: Signal | None
    signals: Sequence[Signal]


def clocked_source(path: Path, reader: str, clocks: Sequence[SignalGroup], what: str) -> FileContent:
    """Return the content of a file with its signals as channels, each time signal before the signals with
    these times.

    Args:
        path: path of the file.
        reader: name of the reader.
        clocks: groups of signals with the same times.
        what: the file format in words, for messages.

    Raises:
        RecordingError: there are no signals.
        GateError: there are more signals, or more samples, than `LIMITS` allows.
    """
    check_regular(path)
    signals: list[Signal] = []
    channels: list[FileChannel] = []
    for k, (time, of) in enumerate(clocks):
        clock = None if time is None else len(signals)
        own = [] if time is None else [time._replace(name=f"time ({k + 1})") if k else time]
        for one in [*own, *of]:
            signals.append(one)
            channels.append(FileChannel(one.name, one.unit, one.key, clock, one.numeric, epoch=one.epoch))
    if not signals:
        raise RecordingError(f"the {what} holds no signals")
    check_count(path, len(signals), LIMITS.channels, "channels")
    check_size(path, 8 * sum(one.size for one in signals), "channels")

    def read(indices: Sequence[int], rows: Rows) -> list[np.ndarray]:
        with read_by_library(what):
            return [np.array(signals[i].load(rows), np.float64) for i in indices]

    return FileContent(reader, tuple(channels), read)


def held(values: np.ndarray) -> Callable[[Rows], np.ndarray]:
    """Return the function `load` of a `Signal` whose samples `values` are in memory."""
    return lambda rows: values[rows.start : rows.stop]


def equally_spaced(start: float, step: float, size: int) -> Signal:
    """Return the time signal of `size` equally spaced samples: `start`, `start` + `step`, ..., in s."""
    return Signal("time", "s", size, lambda rows: start + step * np.arange(size)[rows.start : rows.stop])
