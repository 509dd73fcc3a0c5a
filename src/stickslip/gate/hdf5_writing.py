"""Write HDF5 files from a tree of groups and fields, for file formats that are based on HDF5."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, NamedTuple

import h5py


class Field(NamedTuple):
    """A field (HDF5 dataset) to write: its `value`, an array, a number or a text, and its `attributes` by
    name."""

    value: Any
    attributes: Mapping[str, Any] = {}


class Link(NamedTuple):
    """A second name (hard link) of a field that was written before; `target` is its path in the file."""

    target: str


class Group(NamedTuple):
    """A group to write: its `attributes` by name, and its `members` (groups, fields, links) by name, in the
    order of writing."""

    attributes: Mapping[str, Any]
    members: Mapping[str, Group | Field | Link]


def hdf5_version() -> str:
    """Return the version of the HDF5 library."""
    return h5py.version.hdf5_version


def hdf5_bytes(root: Group) -> memoryview:
    """Return the bytes of an HDF5 file whose root group is `root`, with everything in it.

    The file is made in memory, because the HDF5 library crashes the process when it closes a file on a full
    disk.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=True) as file:
        _fill(file, root)
    return content.getbuffer()


def _fill(made: Any, group: Group) -> None:
    made.attrs.update(group.attributes)
    for name, one in group.members.items():
        match one:
            case Group():
                _fill(made.create_group(name, track_order=True), one)
            case Field():
                made[name] = one.value
                made[name].attrs.update(one.attributes)
            case Link():
                made[name] = made.file[one.target]
