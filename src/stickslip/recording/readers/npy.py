"""Reader of NumPy files: one array (.npy) or several arrays by name (.npz)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...gate import archives as gate
from ...gate.limits import check_size
from .. import RecordingError
from .arrays import Leaf, array_parts, array_source, real_leaves, subscripted, total_bytes
from .source import FileChannel, FileContent, add_format

# Byte offsets, in a ZIP archive, of the length of the first entry's name, and of this name.
_NAME_LENGTH, _NAME = 26, 30


def read_npy(path: Path) -> FileContent:
    """Return the channels of a .npy file (a single array), along its longest axis, which is time.

    There is a channel for each combination of indices along the other axes. In a two-dimensional array the
    index of the channel is the index of its column. In an array with more axes, a channel is named by a tuple
    of indices in the order of the axes: (0, 2, 1) is the channel ``array[:, 0, 2, 1]``.

    Raises:
        RecordingError: the array is a single number or empty, or has too many channels.
        GateError: the file is damaged, contains objects, or is too large.
    """
    array = gate.read_npy(path, mapped=True)
    return _source(path, "npy", {"": _leaf(array)})


def read_npz(path: Path) -> FileContent:
    """Return the channels of a .npz file (several arrays by name).

    The key ("name", 3) is the fourth column of a two-dimensional array. Single numbers are left out.

    Raises:
        RecordingError: the file contains an empty array, no arrays, or too many channels.
        GateError: the file is damaged, contains objects, or is too large.
    """
    arrays = gate.read_npz(path)
    if not arrays:
        raise RecordingError("a ZIP archive without NumPy arrays")
    leaves = {name: _leaf(array) for name, array in arrays.items() if array.ndim}
    return _source(path, "npz", leaves)


def _leaf(array: np.ndarray) -> Leaf:
    return Leaf(array.shape, lambda: array, np.iscomplexobj(array))


def _source(path: Path, reader: str, leaves: dict[str, Leaf]) -> FileContent:
    leaves = real_leaves(leaves)
    check_size(path, total_bytes(leaves.values()))
    for name, leaf in leaves.items():
        if not leaf.shape or 0 in leaf.shape:
            raise RecordingError(f"the array {name!r} of the shape {leaf.shape} holds no samples")
    channels = []
    for part in array_parts(leaves):
        key = (part.array, *part.others) if part.array else part.others
        channels.append((part, FileChannel(subscripted(part), key=key)))
    return array_source(reader, leaves, channels)


def _is_npz(head: bytes, ending: str) -> bool:
    """Return True if a ZIP archive is an NPZ file, judged by its extension `ending` or by the name of its
    first entry. `head` are its first bytes."""
    name = int.from_bytes(head[_NAME_LENGTH : _NAME_LENGTH + 2], "little")
    first = head[_NAME : _NAME + name]
    return head.startswith(b"PK\x03\x04") and (ending == ".npz" or first.endswith(b".npy"))


add_format(read_npy, "npy", (".npy",), lambda head, ending: head.startswith(b"\x93NUMPY"))
add_format(read_npz, "npz", (".npz",), _is_npz)
