"""Channels made from named arrays in NPY, NPZ and MAT files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ...gate.errors import GateError
from ...gate.limits import LIMITS
from .. import RecordingError
from .source import FileChannel, FileContent, Rows


class Leaf(NamedTuple):
    """An array in a file, not necessarily loaded yet."""

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    of_complex: bool = False  # the numbers are complex
    unit: str = ""  # as in the file
    epoch: float = 0.0  # for dates: zero of the numbers, s since 1970
    # reads a part along an axis, if that is faster
    load_part: Callable[[int, slice], np.ndarray] | None = None


def total_bytes(leaves: Iterable[Leaf]) -> int:
    """Return the size of arrays as float64, bytes."""
    return sum(8 * math.prod(leaf.shape) for leaf in leaves)


class ArrayChannel(NamedTuple):
    """A channel that is a part of an array: all samples along `axis`, one index along each other axis."""

    array: str
    axis: int
    others: tuple[int, ...]
    alone: bool  # the array has only this channel

    @property
    def subscripts(self) -> list[str]:
        """Return the index along each axis, from 0; ":" for time."""
        texts = [str(i) for i in self.others]
        return [*texts[: self.axis], ":", *texts[self.axis :]]


def array_parts(leaves: Mapping[str, Leaf]) -> list[ArrayChannel]:
    """Return the channels of arrays by name, array by array. Time runs along the longest axis of an array,
    the first of equally long ones.

    Raises:
        RecordingError: there are more channels than `LIMITS` allows.
    """
    found: list[ArrayChannel] = []
    for name, leaf in leaves.items():
        axis = int(np.argmax(leaf.shape))
        others = leaf.shape[:axis] + leaf.shape[axis + 1 :]
        if len(found) + math.prod(others) > LIMITS.channels:
            raise RecordingError(
                f"with the array {name!r} of the shape {leaf.shape} it has more than {LIMITS.channels:,} "
                "channels; save only the signals that are needed"
            )
        alone = max(others, default=1) == 1
        found += [ArrayChannel(name, axis, index, alone) for index in np.ndindex(*others)]
    return found


def real_leaves(leaves: Mapping[str, Leaf]) -> dict[str, Leaf]:
    """Return the arrays with complex ones split into two: "real(G)" and "imag(G)"."""
    found: dict[str, Leaf] = {}
    for name, leaf in leaves.items():
        if not leaf.of_complex:
            found[name] = leaf
            continue
        for part in ("real", "imag"):
            load = partial(_part, leaf.load, part)
            found[f"{part}({name})"] = leaf._replace(load=load, of_complex=False, load_part=None)
    return found


def _part(load: Callable[[], np.ndarray], part: str) -> np.ndarray:
    return getattr(load(), part)


def subscripted(part: ArrayChannel) -> str:
    """Return the name of a channel as in Python: "table[:, 2]"; the only channel of an array has the array's
    name."""
    name = part.array
    return name if name and part.alone else f"{name}[{', '.join(part.subscripts)}]"


def array_source(
    reader: str, leaves: Mapping[str, Leaf], channels: Sequence[tuple[ArrayChannel, FileChannel]]
) -> FileContent:
    """Return a source whose channels are parts of arrays. Each array is loaded once per reading."""

    def read(indices: Sequence[int], rows: Rows) -> list[np.ndarray]:
        loaded: dict[str, np.ndarray] = {}
        result = []
        for i in indices:
            part, channel = channels[i]
            leaf, kept = leaves[part.array], slice(*rows)
            if part.array not in loaded:
                loaded[part.array] = _load(part.array, leaf, part.axis, kept)
            window = slice(None) if leaf.load_part else kept
            samples = loaded[part.array][(*part.others[: part.axis], window, *part.others[part.axis :])]
            if samples.dtype.kind not in "iufb":
                raise RecordingError(f"{channel.name!r} holds {samples.dtype}, not real numbers")
            result.append(np.array(samples, dtype=np.float64))
        return result

    return FileContent(reader, tuple(channel for _, channel in channels), read)


def _load(name: str, leaf: Leaf, axis: int, part: slice) -> np.ndarray:
    try:
        return leaf.load_part(axis, part) if leaf.load_part else leaf.load()
    except GateError:
        raise
    except (OSError, ValueError) as error:
        raise RecordingError(f"{name!r} cannot be read (damaged?): {error}") from error
