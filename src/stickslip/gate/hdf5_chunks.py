"""Check the compression of HDF5 arrays, which are stored in parts (chunks), and of tables of names: filters
and unpacked sizes.

The HDF5 library unpacks a chunk of any size, whatever the array declares. Each gzip chunk is therefore
unpacked here first, and refused if it exceeds its declared size.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

from h5py import h5i, h5p, h5z  # pyright: ignore[reportAttributeAccessIssue]

from .errors import GateError

_READ = {h5z.FILTER_DEFLATE: "gzip", h5z.FILTER_SHUFFLE: "shuffle", h5z.FILTER_FLETCHER32: "fletcher32"}


def filters_of(path: Path, name: str, plist: Any) -> list[int]:
    """Return the codes of an array's compression filters, in the order in which they were applied on writing.

    Args:
        path: path for error messages.
        name: name of the array for error messages.
        plist: creation property list of the array, from h5py's low-level interface.

    Raises:
        GateError: a filter is not gzip, shuffle or fletcher32 (the library loads others from the disk, or
            they reserve as much memory as the file declares), or gzip is followed by gzip or shuffle.
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
    """Raise GateError if a group's table of member names is compressed, because the HDF5 library would unpack
    the table to any size. `name` is that of the group for the message, `group` its h5py identifier."""
    plist = group.get_create_plist()
    # Two Python objects own this property list, and each of them releases the list once.
    h5i.inc_ref(plist)
    if h5p.PropDCID(plist.id).get_nfilters():
        raise GateError(f"{path}: the table of names of {name!r} is packed; save it unpacked")


def check_chunks(path: Path, name: str, array: Any, chunk_bytes: int, axis: int, beyond: int) -> None:
    """Check the chunks of an array compressed by gzip before the HDF5 library unpacks them.

    Args:
        path: path of the file.
        name: name of the array for error messages.
        array: identifier of the array, from h5py's low-level interface.
        chunk_bytes: number of bytes to which one chunk may unpack.
        axis: axis along which a part of the array is to be read.
        beyond: end of this part: chunks that start at this index or later are not unpacked here.

    Raises:
        GateError: a chunk is damaged or unpacks to more bytes; or the chunks together are larger than the
            file, so some share bytes.
    """
    plist = array.get_create_plist()
    codes = [plist.get_filter(i)[0] for i in range(plist.get_nfilters())]
    # A chunk has a mask with a bit for each filter that was not applied to it. This is the bit of gzip.
    gzip = 1 << codes.index(h5z.FILTER_DEFLATE)
    stored: list[Any] = []
    array.chunk_iter(stored.append)
    if sum(one.size for one in stored) > path.stat().st_size:
        raise GateError(f"{path}: parts of {name!r} share bytes of the file (damaged?)")
    for one in (one for one in stored if one.chunk_offset[axis] < beyond):
        mask, packed = array.read_direct_chunk(one.chunk_offset)
        if mask & gzip:
            # This chunk is stored without gzip, so it cannot unpack to more than its bytes in the file.
            continue
        try:
            unpacked = zlib.decompressobj().decompress(packed, chunk_bytes + 1)
        except zlib.error as error:
            raise GateError(f"{path}: {name!r} cannot be unpacked (damaged?): {error}") from None
        if len(unpacked) > chunk_bytes:
            raise GateError(
                f"{path}: a part of {name!r} unpacks to more than the {chunk_bytes:,} bytes it declares"
            )
