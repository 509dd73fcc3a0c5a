"""Conversion of named arrays in a file (NPY, NPZ, MAT, HDF5) to channels."""

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
    """An array in a file. Its function `load`, without arguments, reads the array when needed; `shape` is
    known before. `of_complex` is True for complex numbers. `clock` is the name of the array with the times of
    its samples; "" if it is unknown."""

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    of_complex: bool = False
    unit: str = ""  # unit as written in the file; "" if it is unknown
    # For dates: the time that the number 0 means, in s since 1970.
    epoch: float = 0.0
    # Function that reads only a slice along one axis, if the format allows this: it takes the axis and the
    # slice, and returns the array. None: only the whole array can be read.
    load_part: Callable[[int, slice], np.ndarray] | None = None
    clock: str = ""


def total_bytes(leaves: Iterable[Leaf]) -> int:
    """Return the size in bytes that arrays (`Leaf`) have in memory together as float64."""
    return sum(8 * math.prod(leaf.shape) for leaf in leaves)


class ArrayChannel(NamedTuple):
    """A channel that is a part of the array with the name `array`: all samples along `axis`, at the indices
    `others` along the other axes."""

    array: str
    axis: int
    others: tuple[int, ...]
    alone: bool  # True if the array has no other channel

    @property
    def subscripts(self) -> list[str]:
        """Return the index along each axis of the array as text, from 0, in the order of the axes, with ":"
        for the time axis."""
        texts = [str(i) for i in self.others]
        return [*texts[: self.axis], ":", *texts[self.axis :]]


def array_parts(leaves: Mapping[str, Leaf]) -> list[ArrayChannel]:
    """Return all channels of the named arrays, in their order. The longest axis of an array is taken as time,
    the first one if several are equally long.

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


def clock_places(leaves: Mapping[str, Leaf], parts: Sequence[ArrayChannel]) -> list[int | None]:
    """Return the index of the time channel of each channel in `parts`; None if its array in `leaves` has no
    `clock`."""
    first = {part.array: i for i, part in reversed(list(enumerate(parts)))}
    return [first.get(leaves[part.array].clock) for part in parts]


def real_leaves(leaves: Mapping[str, Leaf]) -> dict[str, Leaf]:
    """Return the arrays by name, with each complex array replaced by two real ones: "real(NAME)" and
    "imag(NAME)"."""
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
    """Return the name of a channel in Python's notation, such as "table[:, 2]". If an array with a name has
    no other channel, this is the name of the array."""
    name = part.array
    return name if name and part.alone else f"{name}[{', '.join(part.subscripts)}]"


def array_source(
    reader: str, leaves: Mapping[str, Leaf], channels: Sequence[tuple[ArrayChannel, FileChannel]]
) -> FileContent:
    """Return the content of a file whose channels are parts of arrays. One call of its `read` loads each
    array once.

    Args:
        reader: name of the reader.
        leaves: arrays by name.
        channels: for each channel, a tuple of its part of an array and its description.
    """

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
