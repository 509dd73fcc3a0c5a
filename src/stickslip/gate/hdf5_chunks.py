"""Packed parts (chunks) of HDF5 arrays: which packing is read, and what a part unpacks to.

The library unpacks a part of any size, whatever the array declares. Each part is therefore unpacked here
first, up to its declared size.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

from h5py import h5i, h5p, h5z  # pyright: ignore[reportAttributeAccessIssue]

from .errors import GateError

_READ = {h5z.FILTER_DEFLATE: "gzip", h5z.FILTER_SHUFFLE: "shuffle", h5z.FILTER_FLETCHER32: "fletcher32"}


def filters_of(path: Path, name: str, plist: Any) -> list[int]:
    """Return the filters through which an array was packed, in the order of packing.

    Raises:
        GateError: a filter is not one of gzip, shuffle and fletcher32: others are loaded from the disk, or
            reserve as much memory as the file says; or gzip is followed by another packing.
    """
    found = [plist.get_filter(i) for i in range(plist.get_nfilters())]
    codes = [one[0] for one in found]
    for code, _, _, label in found:
        if code not in _READ:
            said = label.decode("ascii", "replace") or f"number {code}"
            raise GateError(
                f"{path}: {name!r} is packed by the filter {said!r}; save it with gzip, or unpacked"
            )
    if h5z.FILTER_DEFLATE in codes:
        after = codes[codes.index(h5z.FILTER_DEFLATE) + 1 :]
        if set(after) - {h5z.FILTER_FLETCHER32}:
            raise GateError(f"{path}: {name!r} is packed more than once; save it with gzip or as it is")
    return codes


def refuse_packed_names(path: Path, name: str, group: Any) -> None:
    """Raise GateError if the table of names of a group is packed."""
    plist = group.get_create_plist()
    h5i.inc_ref(plist)  # two Python objects share the property list, and each gives it back
    if h5p.PropDCID(plist.id).get_nfilters():
        raise GateError(f"{path}: the table of names of {name!r} is packed; save it unpacked")


def check_chunks(path: Path, name: str, array: Any, chunk_bytes: int, axis: int, beyond: int) -> None:
    """Raise GateError if parts of an array packed by gzip unpack to too much, or share bytes of the file.

    Each part that starts before the index `beyond` of an axis may unpack to `chunk_bytes` at most.
    """
    stored: list[Any] = []
    array.chunk_iter(stored.append)
    if sum(one.size for one in stored) > path.stat().st_size:
        raise GateError(f"{path}: parts of {name!r} share bytes of the file (damaged?)")
    for one in (one for one in stored if one.chunk_offset[axis] < beyond):
        mask, packed = array.read_direct_chunk(one.chunk_offset)
        if mask:
            continue  # the library leaves out a filter for this part: it is as it is in the file
        try:
            unpacked = zlib.decompressobj().decompress(packed, chunk_bytes + 1)
        except zlib.error as error:
            raise GateError(f"{path}: {name!r} cannot be unpacked (damaged?): {error}") from None
        if len(unpacked) > chunk_bytes:
            raise GateError(
                f"{path}: a part of {name!r} unpacks to more than the {chunk_bytes:,} bytes it declares"
            )
