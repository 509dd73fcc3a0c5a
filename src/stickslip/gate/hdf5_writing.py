"""Write HDF5 files of groups and fields, as formats on top of HDF5 describe them."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, NamedTuple

import h5py


class Field(NamedTuple):
    """An array, a number or a text, and its attributes."""

    value: Any
    attributes: Mapping[str, Any] = {}


class Link(NamedTuple):
    """A second name of a field that was written before."""

    target: str


class Group(NamedTuple):
    """A group: its attributes, and its members in the order in which they are written."""

    attributes: Mapping[str, Any]
    members: Mapping[str, Group | Field | Link]


def hdf5_version() -> str:
    """Return the version of the HDF5 library."""
    return h5py.version.hdf5_version


def hdf5_bytes(root: Group) -> memoryview:
    """Return the content of a file.

    It is made in memory: where a disk is full, HDF5 brings the whole process down when it closes a file.
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
