"""Channels from named arrays, as NPY, NPZ and MAT files hold them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..gate.errors import GateError
from ..recording import RecordingError
from .source import FileChannel, FileContent, Rows


class Leaf(NamedTuple):
    """An array in a file, not necessarily loaded yet."""

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]


def total_bytes(leaves: Iterable[Leaf]) -> int:
    """What arrays take as float64, bytes."""
    return sum(8 * math.prod(leaf.shape) for leaf in leaves)


class Part(NamedTuple):
    """A channel as a part of an array: all samples along `axis`, one index along each other axis."""

    array: str
    axis: int
    others: tuple[int, ...]
    alone: bool  # the array has no other channel

    @property
    def subscripts(self) -> list[str]:
        """The index along each axis, from 0; ":" for time."""
        texts = [str(i) for i in self.others]
        return [*texts[: self.axis], ":", *texts[self.axis :]]


def array_parts(name: str, shape: tuple[int, ...]) -> list[Part]:
    """The channels of an array. Time runs along its longest axis, the first of them if two are as long."""
    axis = int(np.argmax(shape))
    others = shape[:axis] + shape[axis + 1 :]
    return [Part(name, axis, index, alone=max(others, default=1) == 1) for index in np.ndindex(*others)]


def array_source(
    reader: str, leaves: Mapping[str, Leaf], channels: Sequence[tuple[Part, FileChannel]]
) -> FileContent:
    """A source whose channels are parts of arrays. An array is loaded once per reading."""

    def read(indices: Sequence[int], rows: Rows) -> list[np.ndarray]:
        loaded: dict[str, np.ndarray] = {}
        result = []
        for i in indices:
            part, channel = channels[i]
            if part.array not in loaded:
                loaded[part.array] = _load(part.array, leaves[part.array])
            samples = loaded[part.array][(*part.others[: part.axis], slice(*rows), *part.others[part.axis :])]
            if samples.dtype.kind not in "iufb":
                raise RecordingError(f"{channel.name!r} holds {samples.dtype}, not real numbers")
            result.append(np.array(samples, dtype=np.float64))
        return result

    return FileContent(reader, tuple(channel for _, channel in channels), read)


def _load(name: str, leaf: Leaf) -> np.ndarray:
    try:
        return leaf.load()
    except GateError:
        raise
    except (OSError, ValueError) as error:
        raise RecordingError(f"{name!r} cannot be read (damaged?): {error}") from error
