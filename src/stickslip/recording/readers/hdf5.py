"""Reader of HDF5 files of other programs, including NetCDF 4: every array of real numbers is a signal, and
every complex one is two.

Names are the groups and the array, joined by dots: "run_1.position"; columns of a table are counted from 0:
"run_1.table[:, 2]". Units come from an attribute "units" or "unit"; scale, offset and missing values of
NetCDF are applied.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...gate.limits import check_size
from .. import RecordingError
from .arrays import Leaf, array_parts, array_source, clock_places, real_leaves, subscripted, total_bytes
from .signatures import HDF5_SIGNATURE
from .source import FileChannel, FileContent, add_format, is_clock

if TYPE_CHECKING:
    from ...gate.hdf5 import Hdf5Array, Hdf5Group, Hdf5Tree

_UNITS = ("units", "unit", "Units", "Unit", "UNITS")
# Text between unit and date in NetCDF's "seconds since 2020-02-20".
_SECONDS_SINCE = " since "
# Offsets [bytes] at which HDF5 content may start, after a block of another program.
_PLACES = (0, 512, 1024, 2048)


class _Signal(NamedTuple):
    """An array of numbers: its `group`, the `array` in the file, its `unit`, and the conversion value =
    number * `scale` + `offset`. Numbers in `missing` are read as NaN."""

    group: str
    array: Hdf5Array
    unit: str
    scale: float
    offset: float
    missing: tuple[float, ...]


def read_hdf5(path: Path) -> FileContent:
    """Return the content of an HDF5 file: its arrays of real or complex numbers, as channels.

    Arrays with a single element are left out.

    Raises:
        RecordingError: the file contains no arrays of numbers, or too many channels.
        GateError: the file is damaged, refers to other files, or exceeds `LIMITS`.
    """
    from ...gate.hdf5 import hdf5_tree

    found: dict[str, _Signal] = {}
    others: list[str] = []
    with hdf5_tree(path) as tree:
        _collect(tree, tree.root, "", found, others)
    if not found:
        records = f" ({others[0]!r} holds texts or records of several values)" if others else ""
        raise RecordingError(
            f"the HDF5 file holds no arrays of real numbers{records}: in Python, read it by h5py, and save "
            "the columns by numpy.savez"
        )
    leaves = real_leaves({name: _leaf(path, one, _clock(one, found)) for name, one in found.items()})
    check_size(path, total_bytes(leaves.values()))
    parts = array_parts(leaves)
    channels = [
        (part, FileChannel(subscripted(part), leaves[part.array].unit, (part.array, *part.others), clock))
        for part, clock in zip(parts, clock_places(leaves, parts), strict=True)
    ]
    return array_source("hdf5", leaves, channels)


def _collect(
    tree: Hdf5Tree, group: Hdf5Group, prefix: str, found: dict[str, _Signal], others: list[str]
) -> None:
    from ...gate.hdf5 import Hdf5Group

    for label, one in group.members.items():
        name = f"{prefix}.{label}" if prefix else label
        if isinstance(one, Hdf5Group):
            _collect(tree, one, name, found, others)
        elif not one.kind or one.kind == "r":
            others.append(name)
        # A single number is a setting, not a signal.
        elif np.prod(one.shape) > 1:
            found[name] = _signal(prefix, one)


def _signal(group: str, array: Hdf5Array) -> _Signal:
    unit = next((text for name in _UNITS if isinstance(text := array.attribute(name), str) and text), "")
    scale, offset = _number(array.attribute("scale_factor"), 1.0), _number(array.attribute("add_offset"), 0.0)
    said = [array.attribute(name) for name in ("_FillValue", "missing_value")]
    missing = tuple(_number(one, np.nan) for one in said if one is not None)
    return _Signal(group, array, unit.partition(_SECONDS_SINCE)[0], scale, offset, missing)


def _number(value: Any, default: float) -> float:
    real = isinstance(value, int | float | np.integer | np.floating)
    return float(value) if real else default


def _leaf(path: Path, signal: _Signal, clock: str) -> Leaf:
    from ...gate.hdf5 import read_hdf5_array

    def load(axis: int = 0, part: slice = slice(None)) -> np.ndarray:
        values = read_hdf5_array(path, signal.array.name, axis, part)
        if (signal.scale, signal.offset) == (1.0, 0.0) and not signal.missing:
            return values
        absent = np.isin(values, signal.missing)
        return np.where(absent, np.nan, values * signal.scale + signal.offset)

    array = signal.array
    return Leaf(array.shape, load, array.kind == "c", signal.unit, load_part=load, clock=clock)


def _clock(signal: _Signal, found: dict[str, _Signal]) -> str:
    """Return the name of the array with the times of a signal; "" if there are several or none.

    It is a one-dimensional array of real numbers in the same group that has the name of a time (see
    `is_clock`) and the same length. `found` are all arrays by name.
    """
    times = [
        name
        for name, one in found.items()
        if one.group == signal.group
        and one.array.kind != "c"
        and is_clock(FileChannel(name, one.unit))
        and one.array.shape == (max(signal.array.shape),)
    ]
    return times[0] if len(times) == 1 else ""


def _is_hdf5(head: bytes, ending: str) -> bool:
    matlab = ending == ".mat" or head.startswith(b"MATLAB")
    return not matlab and any(head.startswith(HDF5_SIGNATURE, place) for place in _PLACES)


add_format(read_hdf5, "hdf5", (".h5", ".hdf5", ".he5", ".nc", ".nc4", ".nxs"), _is_hdf5)
