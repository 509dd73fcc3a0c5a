"""Reader of MAT files: versions 4 to 7 by SciPy, version 7.3 (HDF5) by h5py.

Both become the same tree: structures are dictionaries, arrays of structures and cells are lists, text is str,
objects (tables, strings) are converted by `matlab_objects`, and every dense array of real or complex numbers
is a `Leaf`. The names of channels are written as in MATLAB, with rows counted from 1: "t", "trace_y(2,:)",
"measurement.force". As a tuple, with indices from 0, the same second row is ("trace_y", 1).
"""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from ...gate.errors import GateError
from ...gate.files import opened
from ...gate.limits import Visits, check_size
from ...gate.matlab5 import check_matlab5, check_subsystem
from .. import RecordingError
from . import dspace
from .arrays import ArrayChannel, Leaf, array_parts, array_source, clock_places, real_leaves, total_bytes
from .matlab_objects import FUNCTION, MatlabTable, Opaque, holds_objects, not_read, read_objects, shown
from .signatures import HDF5_SIGNATURE
from .source import FileChannel, FileContent, add_format

if TYPE_CHECKING:
    from ...gate.hdf5 import Hdf5Array, Hdf5Group, Hdf5Tree

_OPAQUE = "3"  # value of the attribute MATLAB_object_decode that marks an object in version 7.3
_SUBSYSTEM = "__function_workspace__"  # SciPy's name for the hidden variable in which MATLAB stores objects
_V73_BLOCK = 512  # size in bytes of MATLAB's own header before the HDF5 content


def read_matlab(path: Path) -> FileContent:
    """Return the content of a MAT file: its arrays of numbers or the signals of a dSPACE capture.

    The numbers are real or complex; arrays with a single element are left out. Without a capture, objects
    that cannot be read are listed as channels without numbers.

    Raises:
        RecordingError: the file is damaged or has an unknown version, or contains no numbers.
        GateError: the file is damaged, or exceeds `LIMITS`.
    """
    from ...gate.hdf5 import is_hdf5

    try:
        hdf5 = is_hdf5(path)
        tree = _tree_of_hdf5(path) if hdf5 else _tree_of_v5(path)
    except (RecordingError, GateError):
        raise
    # Both libraries report damage by many types of exceptions, down to zlib.error.
    except Exception as error:
        raise RecordingError(f"not a readable MAT file (cut off or damaged?): {error}") from error
    objects = [name for name, node in tree.items() if holds_objects(node)]
    tree |= read_objects(path, objects)
    version = "matlab v7.3" if hdf5 else "matlab v5"
    capture = dspace.find_capture(tree)
    if capture is not None:
        leaves, channels = capture
    else:
        leaves, channels = _plain(tree)
    check_size(path, total_bytes(leaves.values()))
    return array_source(version if capture is None else f"dspace, {version}", leaves, channels)


def _plain(tree: dict[str, Any]) -> tuple[dict[str, Leaf], list[tuple[ArrayChannel, FileChannel]]]:
    leaves: dict[str, Leaf] = {}
    objects: dict[str, str] = {}
    _collect("", tree, leaves, objects)
    leaves = real_leaves(leaves)
    parts = array_parts(leaves)
    if not parts:
        unread = next((f": {not_read(name, of)}" for name, of in objects.items()), "")
        raise RecordingError(f"the MAT file holds no arrays of real numbers{unread}")
    channels = [
        (
            part,
            FileChannel(
                matlab_name(part),
                leaves[part.array].unit,
                (part.array, *part.others),
                clock,
                epoch=leaves[part.array].epoch,
            ),
        )
        for part, clock in zip(parts, clock_places(leaves, parts), strict=True)
    ]
    for name, of in objects.items():
        channels.append((parts[0], FileChannel(name, numeric=False, header=shown(name, of))))
    return leaves, channels


def _collect(prefix: str, node: Any, leaves: dict[str, Leaf], objects: dict[str, str]) -> None:
    """Collect the arrays in a part `node` of the tree into the two dictionaries.

    Args:
        prefix: name of the part; "" for the whole tree.
        node: part of the tree.
        leaves: gets the arrays by name; columns of a timetable get its times as their `clock`.
        objects: gets the MATLAB class of each object that cannot be read, by name.
    """
    if isinstance(node, MatlabTable):
        time = f"{prefix}.{node.time}"
        columns = node.columns.items()
        node = {name: one._replace(clock=time) if isinstance(one, Leaf) else one for name, one in columns}
    if isinstance(node, dict):
        for name, value in node.items():
            _collect(f"{prefix}.{name}" if prefix else name, value, leaves, objects)
    elif isinstance(node, list):
        for i, value in enumerate(node):
            _collect(f"{prefix}({i + 1})", value, leaves, objects)
    elif isinstance(node, Opaque):
        objects[prefix] = node.of
    # A single number is a setting, not a signal.
    elif isinstance(node, Leaf) and np.prod(node.shape) > 1:
        leaves[prefix] = node


def matlab_name(part: ArrayChannel) -> str:
    """Return the name of a channel in MATLAB's notation, such as "trace_y(2,:)". If the array has no other
    channel, this is the name of the array."""
    if part.alone:
        return part.array
    subscripts = (text if text == ":" else str(int(text) + 1) for text in part.subscripts)
    return f"{part.array}({','.join(subscripts)})"


def _tree_of_v5(path: Path) -> dict[str, Any]:
    found = check_matlab5(path)
    objects = {name: of for name, of in found.items() if of}
    plain = [name for name in found if name and name not in objects]
    with opened(path) as file:
        variables = scipy.io.loadmat(file, variable_names=[*plain, _SUBSYSTEM] if objects else None)
    if objects and _SUBSYSTEM in variables:
        check_subsystem(path, variables[_SUBSYSTEM].tobytes())
    tree: dict[str, Any] = {name: Opaque(of) for name, of in objects.items() if name}
    return tree | {name: _v5_node(value) for name, value in variables.items() if not name.startswith("__")}


def _v5_node(value: Any) -> Any:
    if isinstance(value, scipy.io.matlab.MatlabOpaque):
        return Opaque(str(value["s2"].flat[0], "utf-8", "replace"))
    if not isinstance(value, np.ndarray) or isinstance(value, scipy.io.matlab.MatlabFunction):
        # Sparse matrices and functions are not read.
        return None
    if value.dtype.names:
        names = value.dtype.names
        elements = [{name: _v5_node(element[name]) for name in names} for element in value.flat]
        return elements[0] if len(elements) == 1 else elements
    if value.dtype.kind == "O":
        return [_v5_node(element) for element in value.flat]
    if value.dtype.kind == "U":
        return "".join(value.flat)
    return Leaf(value.shape, lambda: value, value.dtype.kind == "c") if value.dtype.kind in "iufbc" else None


def _tree_of_hdf5(path: Path) -> dict[str, Any]:
    from ...gate.hdf5 import hdf5_tree

    with hdf5_tree(path) as tree:
        visits, root = Visits(path), tree.root.members
        return {n: _hdf5_node(tree, visits, one, 1) for n, one in root.items() if not n.startswith("#")}


def _hdf5_node(tree: Hdf5Tree, visits: Visits, item: Hdf5Group | Hdf5Array, depth: int) -> Any:
    from ...gate.hdf5 import Hdf5Array, Hdf5Group, read_hdf5_array

    visits(depth)
    of = tree.text_attribute(item, "MATLAB_class")
    if of == FUNCTION:
        return None
    if tree.text_attribute(item, "MATLAB_object_decode") == _OPAQUE:
        return Opaque(of)
    if isinstance(item, Hdf5Group):
        fields = {name: _hdf5_node(tree, visits, one, depth + 1) for name, one in item.members.items()}
        # MATLAB writes an array of structures field by field. Each field is a list of references, without the
        # attribute that marks a cell.
        lists = [
            name
            for name, one in item.members.items()
            if isinstance(one, Hdf5Array) and one.kind == "r" and not one.has("MATLAB_class")
        ]
        if not lists:
            return fields
        count = min(len(fields[name]) for name in lists)
        return [{name: fields[name][i] for name in lists} for i in range(count)]
    if item.kind == "r":
        return [_hdf5_node(tree, visits, one, depth + 1) for one in item.targets()]
    if not item.kind or item.has("MATLAB_empty"):
        return None
    if of == "char":
        return "".join(map(chr, item.read().T.flat))
    last, name = len(item.shape) - 1, item.name

    def load(axis: int = 0, part: slice = slice(None)) -> np.ndarray:
        # MATLAB stores arrays column by column, so the axes in the HDF5 file are reversed.
        return read_hdf5_array(tree.path, name, last - axis, part).T

    return Leaf(item.shape[::-1], load, item.kind == "c", load_part=load)


def _is_matlab(head: bytes, ending: str) -> bool:
    if head.startswith(b"MATLAB 5.0 MAT-file") or head[_V73_BLOCK:].startswith(HDF5_SIGNATURE):
        return True
    if ending != ".mat":
        return False
    # Other programs write MAT 7.3 without MATLAB's block, and version 4 has no signature, so the extension
    # decides.
    text = b"\0" not in head or head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    others = (b"\x93NUMPY", b"PK\x03\x04", b"MDF     ", b"UnFinMF ")
    return head.startswith(HDF5_SIGNATURE) or not (text or head.startswith(others))


add_format(read_matlab, "mat", (".mat",), _is_matlab)
