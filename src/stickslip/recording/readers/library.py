"""Files that an optional library reads: the library, its errors, and signals with their clocks."""

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

_OPEN = re.compile(r"'?/dev/fd/\d+'?")  # name of an open file for a library


def library(module: str, kind: str, package: str, extra: str) -> Any:
    """Return a module of an optional dependency; raise RecordingError that says how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise RecordingError(f"{kind} need {package}: pip install 'stickslip[{extra}]'") from None


@contextmanager
def read_by_library(kind: str) -> Iterator[None]:
    """Turn every error of a library into one RecordingError, because libraries report damage in many ways."""
    try:
        yield
    except (RecordingError, GateError, MemoryError):
        raise
    except Exception as error:
        said = _OPEN.sub("it", " ".join(str(error).split())) or type(error).__name__
        raise RecordingError(f"not a readable {kind} (cut off or damaged?): {said:.300}") from error


@contextmanager
def no_file_left_open() -> Iterator[None]:
    """Close files that a library leaves open."""
    try:
        yield
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()


class Signal(NamedTuple):
    """Samples of a file that a library reads, in the file's unit; `load` returns some of them."""

    name: str
    unit: str
    size: int
    load: Callable[[Rows], np.ndarray]
    key: tuple[Any, ...] = ()
    numeric: bool = True
    epoch: float = 0.0  # for dates: zero of the numbers, s since 1970


class SignalGroup(NamedTuple):
    """Signals that share a time; the time is None if the file has none."""

    time: Signal | None
    signals: Sequence[Signal]


def clocked_source(path: Path, reader: str, clocks: Sequence[SignalGroup], what: str) -> FileContent:
    """Return a source of signals with their clocks, each clock before its signals.

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
    """Return a function that returns some of the samples of an array."""
    return lambda rows: values[rows.start : rows.stop]


def equally_spaced(start: float, step: float, size: int) -> Signal:
    """Return the time of samples that are equally spaced, s."""
    return Signal("time", "s", size, lambda rows: start + step * np.arange(size)[rows.start : rows.stop])
