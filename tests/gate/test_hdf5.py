"""An HDF5 file that points outside itself, or packs more than it says, is refused before a number is read."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray as xr
from h5py import h5g, h5i, h5p  # pyright: ignore[reportAttributeAccessIssue]

from stickslip.gate.errors import GateError
from stickslip.gate.hdf5 import Hdf5Array, hdf5_tree
from stickslip.gate.limits import LIMITS
from stickslip.gate.netcdf import read_netcdf
from stickslip.jobs.analysis.design_given import draws_of_file
from stickslip.jobs.analysis.study import _table
from stickslip.recording import RecordingError, make_recording, open_recording, save_recording
from stickslip.recording.readers import inspect_file, read_recording

SECRET = bytes(range(256)) * 10  # a file that the recording must not read
N = 300
TIME = np.arange(N) / 1e3


def external(file: h5py.File, folder: Path) -> None:
    file.create_dataset("x", (N,), "f8", external=[(str(folder / "secret.bin"), 0, 8 * N)])


def virtual(file: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "y", (N,))
    file.create_virtual_dataset("x", layout)


def virtual_same(file: h5py.File, folder: Path) -> None:
    """A virtual data set whose source is the file itself, by another name."""
    file["y"] = TIME
    (folder / "again.h5").symlink_to(folder / "bad.mat")
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "again.h5"), "y", (N,))
    file.create_virtual_dataset("x", layout)


def link(file: h5py.File, folder: Path) -> None:
    file["x"] = h5py.ExternalLink(str(folder / "other.h5"), "/y")


def link_in_a_group(file: h5py.File, folder: Path) -> None:
    file.create_group("a/b")["x"] = h5py.ExternalLink(str(folder / "other.h5"), "/y")
    file["x"] = TIME


def soft_link_into_link(file: h5py.File, folder: Path) -> None:
    file["z"] = h5py.ExternalLink(str(folder / "other.h5"), "/")
    file["x"] = h5py.SoftLink("/z/y")


def unlinked(file: h5py.File, folder: Path) -> None:
    """A reference to an array that stands outside the tree, with its numbers in another file."""
    external(file, folder)
    file["cell"] = np.array([[file["x"].ref]], h5py.ref_dtype)
    file["cell"].attrs["MATLAB_class"] = np.bytes_(b"cell")
    file["keep"] = np.array([[file["x"].ref]], h5py.ref_dtype)
    del file["x"]


OUTSIDE = [external, virtual, virtual_same, link, link_in_a_group, soft_link_into_link, unlinked]


def made(folder: Path, fill: Callable, name: str = "bad.mat", **how: Any) -> Path:
    (folder / "secret.bin").write_bytes(SECRET)
    with h5py.File(folder / "other.h5", "w") as other:
        other["y"] = TIME + 7000.0
    path = folder / name
    with h5py.File(path, "w", **how) as file:
        file["time"] = TIME
        fill(file, folder)
    return path


@pytest.mark.parametrize("fill", OUTSIDE)
@pytest.mark.parametrize("block", [0, 512])
def test_a_mat_file_reads_no_other_file(tmp_path: Path, fill: Callable, block: int) -> None:
    path = made(tmp_path, fill, userblock_size=block)
    for read in (read_recording, inspect_file):
        with pytest.raises(RecordingError) as found:
            read(path)
        assert str(found.value).count(str(path)) == 1
        assert "inside" in str(found.value) or fill is unlinked


@pytest.mark.parametrize("fill", [one for one in OUTSIDE if one is not unlinked])
def test_a_netcdf_file_reads_no_other_file(tmp_path: Path, fill: Callable) -> None:
    path = made(tmp_path, fill, "bad.nc")
    for read in (open_recording, read_recording, inspect_file, draws_of_file, _table, read_netcdf):
        with pytest.raises(ValueError, match=r"bad\.nc: .* inside"):
            read(path)


@pytest.mark.parametrize("name", ["lzf", "scaleoffset", 32001, "twice"])
def test_other_packing_than_gzip_is_refused_by_name(tmp_path: Path, name: str | int) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        plist = h5p.create(h5p.DATASET_CREATE)
        plist.set_chunk((N,))
        if name == "lzf":
            plist.set_filter(32000, h5py.h5z.FLAG_OPTIONAL)
        elif name == "scaleoffset":
            plist.set_scaleoffset(2, 0)
        elif name == "twice":
            plist.set_deflate(4)
            plist.set_filter(1, h5py.h5z.FLAG_OPTIONAL, (9,))
        else:
            plist.set_filter(name, h5py.h5z.FLAG_OPTIONAL)
        kind = h5py.h5t.NATIVE_INT64
        h5py.h5d.create(file.id, b"x", kind, h5py.h5s.create_simple((N,)), plist)
        file["t"] = TIME
    with pytest.raises(RecordingError, match=r"a\.mat: '/x' is packed .* save it with gzip"):
        read_recording(path)


@pytest.mark.parametrize(("shuffle", "mask"), [(False, 0), (True, 0), (True, 1)])
def test_a_part_that_unpacks_to_more_than_it_declares_is_refused(
    tmp_path: Path, shuffle: bool, mask: int
) -> None:
    """Also where the part's mask says that another filter than gzip was not applied to it."""
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        file["t"] = TIME
        x = file.create_dataset("x", (N,), "f8", chunks=(N,), compression="gzip", shuffle=shuffle)
        x.id.write_direct_chunk((0,), zlib.compress(bytes(100_000_000), 9), filter_mask=mask)
    with pytest.raises(RecordingError, match=r"a\.mat: a part of '/x' unpacks to more than the 2,400 bytes"):
        read_recording(path)


def test_a_part_stored_without_gzip_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        file["t"] = TIME
        x = file.create_dataset("x", (N,), "f8", chunks=(N,), compression="gzip")
        x.id.write_direct_chunk((0,), (2.0 * TIME).tobytes(), filter_mask=1)
    found = read_recording(
        path, columns={"time": "t", "drive_voltage": "x"}, units={"time": "s", "drive_voltage": "V"}
    )
    np.testing.assert_array_equal(found["drive_voltage"].values, 2.0 * TIME)


def test_a_packed_table_of_names_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        plist = h5p.create(h5p.GROUP_CREATE)
        h5i.inc_ref(plist)
        h5p.PropDCID(plist.id).set_deflate(9)
        group = h5g.create(file.id, b"g", gcpl=plist)
        assert group.valid
        file["t"], file["x"] = TIME, TIME
    with pytest.raises(RecordingError, match=r"the table of names of '/g' is packed"):
        read_recording(path)


def test_a_good_file_is_read_with_all_packing_that_is_known(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        x = np.random.default_rng(1).standard_normal(N).astype(">f4")
        for number, (gzip, shuffle, sums) in enumerate(np.ndindex(2, 2, 2)):
            packing = {"compression": "gzip"} if gzip else {}
            file.create_dataset(
                f"force_{number}",
                data=x,
                chunks=(70,),
                shuffle=bool(shuffle),
                fletcher32=bool(sums),
                **packing,
            )
        file["again"] = file["force_0"]  # a hard link is inside
    read = read_recording(path, units={f"force_{k}": "N" for k in range(8)} | {"again": "N", "time": "s"})
    for number in range(8):
        np.testing.assert_array_equal(read[f"force_{number}"], x.astype(float))


def test_a_recording_is_what_xarray_reads(tmp_path: Path) -> None:
    channels = {"drive_voltage": np.sin(TIME), "end_effector_position": TIME * 1e-6}
    recording = make_recording(TIME, channels, title="Ångström", notes="")
    path = save_recording(recording, tmp_path / "a.nc")
    with xr.open_dataset(path, engine="h5netcdf") as wanted:
        xr.testing.assert_identical(open_recording(path), wanted.load())


def test_axes_and_attributes_of_netcdf(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"chain": 2, "draw": 5, "none": 3}
        file.create_variable("draw", ("draw",), "i4", data=np.arange(5))
        k = file.create_variable("k", ("chain", "draw"), "f8", data=np.arange(10.0).reshape(2, 5))
        k.attrs["units"], k.attrs["count"], k.attrs["range"] = "N/m", 3, np.array([1.0, 2.0])
        file.create_variable("chain", ("draw",), "f8", data=np.ones(5))
        file.create_variable("one", (), "f8", data=4.0)
        file.attrs["title"] = "a"
    found = read_netcdf(path)
    assert {name: one.axes for name, one in found.variables.items()} == {
        "draw": ("draw",), "k": ("chain", "draw"), "chain": ("draw",), "one": ()
    }  # fmt: skip
    assert found.attributes == {"title": "a"}
    said = found.variables["k"].attributes
    assert (said["units"], said["count"], said["range"].tolist()) == ("N/m", 3, [1.0, 2.0])
    assert draws_of_file(path)["k"].tolist() == list(range(10))
    assert "draw" not in draws_of_file(path)


def test_netcdf_3_and_other_content_say_what_they_are(tmp_path: Path) -> None:
    old = tmp_path / "a.nc"
    xr.Dataset({"x": ("time", TIME)}).to_netcdf(old, engine="scipy")
    with pytest.raises(RecordingError, match=r"a\.nc: NetCDF 3 .*nccopy -k nc4"):
        open_recording(old)
    (tmp_path / "b.nc").write_text("time,x\n0,1\n")
    with pytest.raises(RecordingError, match=r"b\.nc: not a readable NetCDF 4 file"):
        open_recording(tmp_path / "b.nc")


def test_only_what_is_in_the_tree_is_reached(tmp_path: Path) -> None:
    path = made(tmp_path, lambda file, folder: file.create_group("a/b").create_dataset("x", data=TIME))
    with hdf5_tree(path) as tree:
        (group,) = (one for name, one in tree.root.members.items() if name == "a")
        assert not isinstance(group, Hdf5Array)
        inner = group.members["b"]
        assert not isinstance(inner, Hdf5Array)
        x = inner.members["x"]
        assert isinstance(x, Hdf5Array)
        assert (x.name, x.shape, x.kind) == ("/a/b/x", (N,), "f")
        np.testing.assert_array_equal(x.read(), TIME)


def test_texts_of_attributes_are_counted(tmp_path: Path) -> None:
    """Many attributes that name the same long text in the file."""
    path = tmp_path / "a.nc"
    recording = make_recording(TIME, {"force": TIME})
    save_recording(recording, path)
    with h5py.File(path, "a") as file:
        for k in range(20):
            file.attrs[f"note_{k}"] = "x" * 1_000_000
    with pytest.raises(RecordingError, match=f"more than {LIMITS.attribute_bytes:,} bytes of attributes"):
        open_recording(path)


@pytest.mark.parametrize(
    ("number", "length"), [(0, 0), (0, 2**64 - 16), (0, 5_000), (1, 2**64 - 16), (1, 5_000)]
)
def test_a_table_of_texts_without_end_is_refused(tmp_path: Path, number: int, length: int) -> None:
    """The library would step from text to text for ever."""
    path = save_recording(make_recording(TIME, {"force": TIME}, title="a"), tmp_path / "a.nc")
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 16
    while int.from_bytes(content[at : at + 2], "little"):
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at : at + 2] = number.to_bytes(2, "little")
    content[at + 8 : at + 16] = length.to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"a\.nc: not a readable HDF5 file"):
        open_recording(path)


def test_the_error_is_of_the_gate(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(500))
    with pytest.raises(GateError, match=r"a\.mat: not a readable MAT file"), hdf5_tree(path):
        raise AssertionError("a damaged file must not open")
