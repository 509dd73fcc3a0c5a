"""Checked opening of HDF5 files: MAT 7.3, NetCDF 4 and others.

An HDF5 file may refer to other files: external storage, arrays assembled from other files (virtual), links
into other files, filters loaded from the disk. Such a file could read any file of the user who opens it, so
all of these are refused before a number is read. The tree of groups and arrays is built once, and counted
against `LIMITS`. Objects outside the tree cannot be reached, even by an object reference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5, h5a, h5d, h5f, h5g, h5l, h5o, h5p, h5r, h5s, h5t, h5z  # pyright: ignore[reportAttributeAccessIssue]

from .errors import GateError
from .files import name_of, opened
from .hdf5_chunks import check_chunks, filters_of, refuse_packed_names
from .hdf5_heap import check_heaps
from .limits import LIMITS, Visits, check_count, check_regular, check_size

_WHOLE = slice(None)
_INSIDE = ": a file is read only if all its data are inside it. Save a copy with the data in it"
_LAYOUTS = {h5d.COMPACT, h5d.CONTIGUOUS, h5d.CHUNKED}
_KINDS = {h5t.INTEGER: "iu", h5t.FLOAT: "f"}


class Hdf5Array:
    """An array of an HDF5 file, checked but not yet read.

    `kind` is NumPy's kind of the numbers ("i", "u", "f", "b", "c" for complex numbers), "r" for references to
    objects, and "" for all other types, which are never read. `nbytes` is the memory that reading may take,
    bytes. `identifier` is the array in h5py's low-level interface, None for the kind "". An array with data
    in another file, too many chunks, or filters that `hdf5_chunks.filters_of` refuses, raises GateError.
    """

    def __init__(self, tree: Hdf5Tree, name: str, identifier: Any) -> None:
        plist = identifier.get_create_plist()
        layout = plist.get_layout()
        if layout not in _LAYOUTS:
            raise GateError(f"{tree.path}: {name!r} is assembled from other files (virtual){_INSIDE}")
        if plist.get_external_count():
            raise GateError(f"{tree.path}: the numbers of {name!r} are in another file (external){_INSIDE}")
        self.name, self._tree = name, tree
        shape = identifier.shape
        self.shape: tuple[int, ...] = (0,) if shape is None else shape
        stored = identifier.get_type()
        tree.visits(1, _parts(stored))
        self.kind = _kind(stored)
        # An array that is never read is not kept open, because its data type may take much memory.
        self.identifier: Any = identifier if self.kind else None
        self.nbytes = math.prod(self.shape) * stored.get_size()
        self._packed = 0  # number of bytes to which a chunk compressed by gzip unpacks; 0 without gzip
        if layout == h5d.CHUNKED:
            part = plist.get_chunk()
            count = math.prod(-(-n // c) for n, c in zip(self.shape, part, strict=True))
            check_count(tree.path, count, LIMITS.chunks, f"chunks in {name!r}")
            chunk_bytes = math.prod(part) * stored.get_size()
            self.nbytes = max(self.nbytes, count * chunk_bytes)
            if h5z.FILTER_DEFLATE in filters_of(tree.path, name, plist):
                self._packed = chunk_bytes

    def has(self, attribute: str) -> bool:
        """Return True if the array has an attribute with this name; False for an array that is never read."""
        return bool(self.kind) and h5a.exists(self.identifier, attribute.encode())

    def attribute(self, name: str) -> Any:
        """Return an attribute that is a text, a number or an array of numbers; None if missing or
        otherwise."""
        with _damage(self._tree.path):
            return self._tree.attribute(self.identifier, name.encode()) if self.has(name) else None

    def read(self, axis: int = 0, part: slice = _WHOLE) -> np.ndarray:
        """Return the numbers of the array, or those in the slice `part` (with step 1) along one axis.

        Raises:
            GateError: the array has no numbers, its data are damaged, or its chunks share bytes or unpack to
                more than they declare.
        """
        if self.kind not in tuple("iufbc"):
            raise GateError(f"{self._tree.path}: {self.name!r} holds no numbers")
        with _damage(self._tree.path):
            found = self._read(axis, part)
            return found.view(f"c{found.itemsize}") if found.dtype.names else found

    def targets(self) -> list[Hdf5Array | Hdf5Group]:
        """Return the objects that the references of this array lead to, in MATLAB's order (column by column).

        Raises:
            GateError: a reference leads to no object in the file's tree, or there are too many of them.
        """
        check_count(self._tree.path, math.prod(self.shape), LIMITS.visits, f"references in {self.name!r}")
        with _damage(self._tree.path):
            return [self._tree.target(one, self.name) for one in self._read().T.flat]

    def _read(self, axis: int = 0, part: slice = _WHOLE) -> np.ndarray:
        shape, first = list(self.shape), [0] * len(self.shape)
        if shape:
            start, stop, _ = part.indices(shape[axis])
            shape[axis], first[axis] = max(stop - start, 0), start
        if self._packed:
            beyond = first[axis] + shape[axis]
            check_chunks(self._tree.path, self.name, self.identifier, self._packed, axis, beyond)
        found = np.empty(tuple(shape), self.identifier.dtype)
        if found.size:
            space = self.identifier.get_space()
            if shape:
                space.select_hyperslab(tuple(first), tuple(shape))
            self.identifier.read(h5s.create_simple(tuple(shape)) if shape else h5s.ALL, space, found)
        return found


class Hdf5Group:
    """A group of an HDF5 file, with its members by name, in the order of creation if the file stores it."""

    def __init__(self, name: str, identifier: Any) -> None:
        self.name, self.identifier = name, identifier
        self.members: dict[str, Hdf5Array | Hdf5Group] = {}


class Hdf5Tree:
    """The groups and arrays of an open HDF5 file `file` (an identifier of h5py's low-level interface).

    The group `root` contains all others, once `build` has checked and added them (see `hdf5_tree`).
    """

    def __init__(self, path: Path, file: Any) -> None:
        self.path = path
        self._file, self.visits = file, Visits(path)
        self._declared = self._attribute_bytes = 0
        self._by_address: dict[int, Hdf5Array | Hdf5Group] = {}
        self.root = Hdf5Group("/", h5g.open(file, b"/"))

    def build(self) -> None:
        """Visit all groups and arrays of the file, check them, and add them to the tree.

        Raises:
            GateError: an object refers to another file, or there is more than `LIMITS` allows.
        """
        self._fill(self.root, 1)
        check_size(self.path, self._declared)

    def array(self, name: str) -> Hdf5Array:
        """Return the array at a path such as "/group/array". Only this array and its path are checked.

        Raises:
            GateError: the path is no array any longer, or leads through a link into another place or file.
        """
        found = self.root.identifier
        for label in name.strip("/").encode().split(b"/"):
            if found.links.get_info(label).type != h5l.TYPE_HARD:
                raise GateError(f"{self.path}: {name!r} is a link, perhaps into another file{_INSIDE}")
            found = h5o.open(found, label)
        if not isinstance(found, h5d.DatasetID):
            raise GateError(f"{self.path}: {name!r} is no array any longer")
        return Hdf5Array(self, name, found)

    def target(self, reference: Any, name: str) -> Hdf5Array | Hdf5Group:
        """Return the object that an HDF5 reference leads to; `name` is the array with it, for errors.

        Raises:
            GateError: the object is not in the tree.
        """
        found = h5r.dereference(reference, self._file) if reference else None
        known = None if found is None else self._by_address.get(h5o.get_info(found).addr)
        if known is None:
            raise GateError(f"{self.path}: a reference in {name!r} names nothing in the file (damaged?)")
        return known

    def pairs(self, one: Hdf5Array, name: str) -> list[tuple[Hdf5Array | Hdf5Group, int]]:
        """Return an attribute that is a list of pairs (reference, number) as pairs (object, number).

        The list is empty if the array has no attribute `name` of this type.

        Raises:
            GateError: an object is not in the tree, or there are more pairs than `LIMITS` allows.
        """
        if not one.has(name):
            return []
        with _damage(self.path):
            opened = h5a.open(one.identifier, name.encode())
            kind, count = opened.get_type(), math.prod(opened.shape or (0,))
            check_count(self.path, count, LIMITS.visits, f"references in {one.name!r}")
            if kind.get_class() != h5t.COMPOUND or kind.get_nmembers() != 2:
                return []
            value: Any = np.empty(opened.shape, opened.dtype)
            opened.read(value)
            return [(self.target(pair[0], one.name), int(pair[1])) for pair in value.flat]

    def attributes(self, one: Hdf5Array | Hdf5Group, hidden: frozenset[str] = frozenset()) -> dict[str, Any]:
        """Return the attributes of an array or group (texts, numbers), by name, without those in `hidden`.

        Raises:
            GateError: the attributes take more bytes than `LIMITS` allows, or the file is damaged.
        """
        names: list[bytes] = []
        with _damage(self.path):
            order = one.identifier.get_create_plist().get_attr_creation_order()
            h5a.iterate(one.identifier, names.append, index_type=_index(order))
            shown = [name for name in names if name.decode() not in hidden]
            found = {name.decode(): self.attribute(one.identifier, name) for name in shown}
        return {name: value for name, value in found.items() if value is not None}

    def text_attribute(self, one: Hdf5Array | Hdf5Group, name: str) -> str:
        """Return an attribute of an array or group as text; "" if it is missing, neither text nor numbers, or
        of an array of the kind ""."""
        if isinstance(one, Hdf5Array) and not one.kind:
            return ""
        with _damage(self.path):
            if not h5a.exists(one.identifier, name.encode()):
                return ""
            value = self.attribute(one.identifier, name.encode())
        return value.decode("latin-1") if isinstance(value, bytes) else "" if value is None else str(value)

    def attribute(self, identifier: Any, name: bytes) -> Any:
        """Return an attribute of an object (h5py identifier): a text, "" if empty, or numbers; None for other
        types and several texts. GateError if all attributes read take more bytes than `LIMITS` allows."""
        opened = h5a.open(identifier, name)
        stored, shape = opened.get_type(), opened.shape
        kind = stored.get_class()
        # Each text of variable length may be as long as the file, so a list of several texts is not read.
        text = kind == h5t.STRING and shape in ((), (1,), None)
        if not (text or (kind in _KINDS and shape is not None)):
            return None
        if shape is None:
            return ""  # some programs store an empty text as an attribute without a value
        self._count_attribute(stored.get_size() * math.prod(shape))
        value = np.empty(shape, opened.dtype)
        opened.read(value)
        if not text:
            return value[()] if value.size != 1 else value.reshape(())[()]
        said = value.reshape(())[()]
        self._count_attribute(len(said))
        return said.decode("utf-8", "replace") if isinstance(said, bytes) else str(said)

    def _count_attribute(self, size: int) -> None:
        self._attribute_bytes += size
        check_count(self.path, self._attribute_bytes, LIMITS.attribute_bytes, "bytes of attributes")

    def _fill(self, group: Hdf5Group, depth: int) -> None:
        """Check the members of a group, at a nesting depth, and those of its groups; add them to the tree.
        GateError for a link into another place or file, or more members than `LIMITS` allows."""
        identifier = group.identifier
        refuse_packed_names(self.path, group.name, identifier)
        check_count(self.path, identifier.get_num_objs(), LIMITS.visits, f"members in {group.name!r}")
        self._add(group, identifier, depth - 1)
        links: list[tuple[bytes, int]] = []
        order = identifier.get_create_plist().get_link_creation_order()
        identifier.links.iterate(
            lambda name, info: links.append((name, info.type)), idx_type=_index(order), info=True
        )
        for label, link in links:
            name = f"{group.name.rstrip('/')}/{self._name(label)}"
            if link != h5l.TYPE_HARD:
                raise GateError(f"{self.path}: {name!r} is a link, perhaps into another file{_INSIDE}")
            found = h5o.open(identifier, label)
            if isinstance(found, h5d.DatasetID):
                member: Hdf5Array | Hdf5Group = Hdf5Array(self, name, found)
                self._declared += member.nbytes
                self._add(member, found, depth)
            elif isinstance(found, h5g.GroupID):
                member = Hdf5Group(name, found)
                self._fill(member, depth + 1)
            else:
                continue  # the member is a named data type, which contains no data
            group.members[self._name(label)] = member

    def _add(self, one: Hdf5Array | Hdf5Group, identifier: Any, depth: int) -> None:
        self.visits(depth)
        count = h5a.get_num_attrs(identifier)
        check_count(self.path, count, LIMITS.attributes, f"attributes of {one.name!r}")
        self._by_address[h5o.get_info(identifier).addr] = one

    def _name(self, label: bytes) -> str:
        if len(label) > LIMITS.name:
            raise GateError(f"{self.path}: a name in it has more than {LIMITS.name:,} characters: shorten it")
        return label.decode()


def _index(order: int) -> int:
    return h5.INDEX_CRT_ORDER if order & h5p.CRT_ORDER_TRACKED else h5.INDEX_NAME


def _parts(stored: Any) -> int:
    """Return the number of types in an HDF5 data type: fields, enum values or elements, and those in them."""
    kind = stored.get_class()
    if kind == h5t.ENUM:
        return int(stored.get_nmembers())
    if kind == h5t.COMPOUND:
        return sum(1 + _parts(stored.get_member_type(k)) for k in range(stored.get_nmembers()))
    return 1 + _parts(stored.get_super()) if kind in (h5t.ARRAY, h5t.VLEN) else 0


def _kind(stored: Any) -> str:
    """Return the kind of an array's elements from its HDF5 data type, as `Hdf5Array.kind` defines it."""
    known = stored.get_class()
    if known == h5t.REFERENCE:
        return "r" if stored.equal(h5t.STD_REF_OBJ) else ""
    if known == h5t.ENUM:
        return "b" if stored.get_nmembers() == 2 and stored.dtype == np.bool_ else ""
    if known == h5t.COMPOUND and _is_complex(stored):
        return "c"
    if known not in _KINDS:
        return ""
    try:
        return stored.dtype.kind
    except (TypeError, ValueError):
        return ""  # NumPy has no type for the number format of this array


def _is_complex(stored: Any) -> bool:
    """Return True if a compound type is a complex number: two adjacent equal floats, real/imag or r/i."""
    if stored.get_nmembers() != 2:
        return False
    parts = [stored.get_member_type(k) for k in range(2)]
    names = b"".join(stored.get_member_name(k) for k in range(2))
    whole = sum(part.get_size() for part in parts) == stored.get_size()
    reals = all(part.get_class() == h5t.FLOAT and part.get_size() in (4, 8) for part in parts)
    return names in (b"realimag", b"ri") and reals and whole and parts[0].equal(parts[1])


def is_hdf5(path: Path) -> bool:
    """Return True if a file is HDF5, perhaps with a leading block such as MATLAB's before the content."""
    with opened(path) as file:
        return h5f.is_hdf5(name_of(file).encode())


def has_attribute(path: Path, name: str, group: str = "/") -> bool:
    """Return True if a group of an HDF5 file has an attribute `name`; False if there is no such group.

    Raises:
        GateError: the file is damaged.
    """
    with _opened(path) as tree, _damage(path):
        found = tree.root.identifier
        for label in group.encode().split(b"/"):
            if not label:
                continue
            if not found.links.exists(label) or found.links.get_info(label).type != h5l.TYPE_HARD:
                return False
            found = h5o.open(found, label)
            if not isinstance(found, h5g.GroupID):
                return False
        return h5a.exists(found, name.encode())


@contextmanager
def hdf5_tree(path: Path) -> Iterator[Hdf5Tree]:
    """Open an HDF5 file and yield its checked tree, which can be used until the end of the context.

    Raises:
        GateError: the file is damaged, refers to other files, or has more structure than `LIMITS` allows.
    """
    with _opened(path) as tree:
        with _damage(path):
            tree.build()
        yield tree


def read_hdf5_array(path: Path, name: str, axis: int = 0, part: slice = _WHOLE) -> np.ndarray:
    """Return the numbers of the array `name` ("/group/array") of a file that was checked before by
    `hdf5_tree`, or those in the slice `part` (with step 1) along one axis.

    Raises:
        GateError: the array does not exist any longer, has no numbers, or `Hdf5Array` refuses it.
    """
    with _opened(path) as tree:
        with _damage(path):
            found = tree.array(name)
        return found.read(axis, part)


@contextmanager
def _opened(path: Path) -> Iterator[Hdf5Tree]:
    check_regular(path)
    with opened(path) as plain, _damage(path):
        file = h5py.File(name_of(plain), "r")
    with file:
        with _damage(path):
            check_heaps(path, file.id.get_create_plist().get_sizes())
            tree = Hdf5Tree(path, file.id)
        yield tree


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Context that converts the many types of errors that a damaged file causes to a GateError."""
    try:
        yield
    except GateError:
        raise
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError) as error:
        said = " ".join(str(error).split())
        kind = {".nc": "NetCDF 4", ".mat": "MAT"}.get(path.suffix.lower(), "HDF5")
        raise GateError(f"{path}: not a readable {kind} file (cut off or damaged?): {said}") from error
