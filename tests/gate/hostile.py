"""Makers of files with far more structure than a recording has; each is a few MB at most on the disk."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np

Maker = Callable[[Path], object]
MAKERS: dict[str, Maker] = {}
N = 300
TIME = np.arange(N) / 1e3
ROWS = "".join(f"{k / 1e3},{k},{k % 7}\n" for k in range(N))


def maker(ending: str) -> Callable[[Maker], Maker]:
    """A file of that ending, by the name of its maker."""

    def add(make: Maker) -> Maker:
        MAKERS[f"{make.__name__}.{ending}"] = make
        return make

    return add


def _texts() -> Iterator[tuple[str, str]]:
    long = 120_000
    yield "blanks_in_a_name", f"time [s],x{' ' * long}y,z\n{ROWS}"
    yield "blanks_before_a_bracket", f"time [s],x{' ' * long}[,z\n{ROWS}"
    yield "blank_line", f"{' ' * long}\ntime [s],x,y\n{ROWS}"
    yield "words_and_brackets", f"{'a[' * (long // 2)}\n" + ROWS.replace(",", " ")
    yield "brackets_in_a_name", f"time [s],{'(' * long},{'[' * long}\n{ROWS}"
    yield "slashes_in_a_name", f"time [s],{'a/ ' * (long // 3)},z\n{ROWS}"
    yield "digits_and_a_letter", f"time [s],{'1' * long}x,z\n{ROWS}"
    yield "digits_of_a_start", f"Time(s),x,t0 = {'1' * long}x\n{ROWS}"
    yield "digits_of_a_number", f"time [s],x,y\n0,1,{'1' * long}\n{ROWS}"
    yield "date_and_blanks", f"time,x,y\n2024-01-01 {' ' * long}x,1,2\n{ROWS}"
    yield "names", f"time [s],{','.join(f'{k} [q{k}x]' for k in range(9_000))}\n" + "0," * 9_000 + "0\n"
    yield "empty_lines", "\n" * 250_000 + f"time [s],x,y\n{ROWS}"
    yield "columns", "1," * 1_000_000 + "1\n"
    yield "columns_in_the_head", ("1," * 60_000 + "1\n") * 2
    yield "long_line_later", f"time [s],x,y\n{ROWS}{'1,' * 1_000_000}1\n"
    yield "long_field_later", f"time [s],x,y\n{ROWS}1,2,{'1' * 2_000_000}\n"
    yield "long_field_in_quotes", f'time [s],"{"x" * 200_000}",y\n{ROWS}'
    yield "quote_without_end", f'time [s],x,y\n{ROWS}1,2,"{ROWS * 500}'
    yield "many_rows_of_a_field", "0\n" * 1_000_000


for _name, _text in _texts():
    MAKERS[f"{_name}.csv"] = lambda path, _text=_text: path.write_text(_text)


@maker("npy")
def many_axes(path: Path) -> None:
    np.save(path, np.zeros((2,) * 20))


@maker("npy")
def no_bytes(path: Path) -> None:
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "|S0", "fortran_order": False, "shape": (2**40,)}
        )


@maker("npz")
def entries(path: Path) -> None:
    """100,000 names in the table of contents; the entries share one place."""
    one = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", 20, 20, 0, 0, 0, 33, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0)
    table = b"".join(one + b"%05x" % k for k in range(100_000))
    large = struct.pack("<4sQ2H2L4Q", b"PK\x06\x06", 44, 45, 45, 0, 0, 10**5, 10**5, len(table), 4)
    where = struct.pack("<4sLQL", b"PK\x06\x07", 0, 4 + len(table), 1)
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 65535, 65535, 2**32 - 1, 2**32 - 1, 0)
    path.write_bytes(b"PK\x03\x04" + table + large + where + end)


@maker("npz")
def other_packing(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        content = io.BytesIO()
        np.save(content, TIME)
        archive.writestr("t.npy", content.getvalue())


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _matrix(mx: int, dims: tuple[int, ...], rest: bytes, name: bytes = b"") -> bytes:
    head = _element(6, struct.pack("<II", mx, 0)) + _element(5, struct.pack(f"<{len(dims)}i", *dims))
    return _element(14, head + _element(1, name) + rest)


def _mat5(path: Path, *elements: bytes, packed: bool = True) -> None:
    parts = [zlib.compress(one) for one in elements] if packed else elements
    body = b"".join(struct.pack("<II", 15, len(one)) + one for one in parts) if packed else b"".join(parts)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM") + body)


@maker("mat")
def deep_cells(path: Path) -> None:
    head = b"".join(
        [_element(6, struct.pack("<II", 1, 0)), _element(5, struct.pack("<2i", 1, 1)), _element(1, b"")]
    )
    deep, size = 20_000, len(head) + 8
    tags = (struct.pack("<II", 14, len(head) + (deep - 1 - k) * size) + head for k in range(deep))
    _mat5(path, b"".join(tags))


@maker("mat")
def many_cells(path: Path) -> None:
    count = 2_000_000
    _mat5(path, _matrix(1, (1, count), struct.pack("<II", 14, 0) * count, b"c"))


@maker("mat")
def cells_that_are_not_there(path: Path) -> None:
    _mat5(path, _matrix(1, (2**15, 2**15), b"", b"c"))


@maker("mat")
def structures_without_fields(path: Path) -> None:
    names = struct.pack("<HHI", 5, 4, 32) + _element(1, b"")
    _mat5(path, _matrix(2, (2**15, 2**15), names, b"s"))


@maker("mat")
def letters_that_are_not_there(path: Path) -> None:
    _mat5(path, _matrix(4, (1, 2**31 - 1), _element(16, b""), b"s"))


@maker("mat")
def many_variables(path: Path) -> None:
    one = _matrix(6, (1, 2), _element(9, bytes(16)), b"x______")
    _mat5(path, *(one.replace(b"______", b"%06d" % k) for k in range(30_000)), packed=False)


@maker("mat")
def back_to_the_start(path: Path) -> None:
    """A variable of version 4 of -3 numbers, behind which the same variable stands again."""
    path.write_bytes(struct.pack("<5i", 0, -1, 5, 0, 20) + b"x".ljust(20, b"\0") + bytes(500))


@maker("mat")
def many_variables_of_version_4(path: Path) -> None:
    path.write_bytes(
        b"".join(struct.pack("<5i", 0, 2, 1, 0, 8) + b"x%06d\0" % k + bytes(16) for k in range(30_000))
    )


def _mat73(path: Path, fill: Callable[[h5py.File], object]) -> None:
    with h5py.File(path, "w", libver="latest") as file:
        file["time"], file["x"] = TIME[None], TIME[None]
        fill(file)


@maker("mat")
def references(path: Path) -> None:
    """12 levels of cells, each of 10 references to the same cell below."""

    def fill(file: h5py.File) -> None:
        below = file["x"]
        for level in range(12):
            cell = file.create_dataset(f"#refs#/c{level}", data=np.array([[below.ref] * 10], h5py.ref_dtype))
            cell.attrs["MATLAB_class"] = np.bytes_(b"cell")
            below = cell
        file["c"] = below

    _mat73(path, fill)


@maker("mat")
def reference_to_itself(path: Path) -> None:
    def fill(file: h5py.File) -> None:
        cell = file.create_dataset("c", (1, 2), h5py.ref_dtype)
        cell.attrs["MATLAB_class"] = np.bytes_(b"cell")
        cell[...] = np.array([[cell.ref] * 2], h5py.ref_dtype)

    _mat73(path, fill)


@maker("mat")
def groups_in_a_circle(path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.create_group("g")["g"] = file["/"]
        file["g/h"] = file["g"]

    _mat73(path, fill)


def _groups(file: h5py.File, count: int) -> None:
    group = file.create_group("g").id
    for k in range(count):
        h5py.h5g.create(group, b"%d" % k)


@maker("mat")
def groups(path: Path) -> None:
    _mat73(path, lambda file: _groups(file, 5_000))


@maker("nc")
def more_groups(path: Path) -> None:
    _mat73(path, lambda file: _groups(file, 21_000))


@maker("nc")
def deep_groups(path: Path) -> None:
    _mat73(path, lambda file: file.create_group("/".join("a" * 2_000)))


@maker("mat")
def parts(path: Path) -> None:
    _mat73(path, lambda file: file.create_dataset("y", (1, 3_000_000), "i1", chunks=(1, 1)))


@maker("mat")
def large_part(path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.create_dataset("y", (1, 2), "f8", chunks=(1, 2**28), maxshape=(1, None), compression="gzip")

    _mat73(path, fill)


@maker("mat")
def fields(path: Path) -> None:
    """Many arrays of one type of many fields."""

    def fill(file: h5py.File) -> None:
        file["type"] = np.dtype([(f"field_{k}", "f8") for k in range(800)])
        for k in range(100):
            h5py.h5d.create(file.id, b"d%d" % k, file["type"].id, h5py.h5s.create(h5py.h5s.NULL))

    _mat73(path, fill)


@maker("nc")
def attributes(path: Path) -> None:
    def fill(file: h5py.File) -> None:
        for k in range(1_100):
            file["x"].attrs[f"a{k}"] = k

    _mat73(path, fill)
