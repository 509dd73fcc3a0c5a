"""Files of other formats: what they are is said, with what to do, and never what is in them at length."""

from __future__ import annotations

import bz2
import gc
import gzip
import json
import lzma
import pickle
import sqlite3
import struct
import tarfile
import warnings
import wave
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.io

from stickslip import inspect_file, read_recording
from stickslip.recording import RecordingError
from stickslip.recording.readers.signatures import BINARY, TEXTS, is_text

TABLE = "t,x\n" + "".join(f"{0.001 * i:.3f},{i}\n" for i in range(200))
FRAME = pd.DataFrame({"t": np.arange(50.0), "x": np.arange(50.0)})


def _zipped(names: list[str]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name in names:
                archive.writestr(name, "<x/>")

    return write


def _tar(path: Path) -> None:
    (path.parent / "in.csv").write_text(TABLE)
    with tarfile.open(path, "w") as archive:
        archive.add(path.parent / "in.csv", "in.csv")


def _sqlite(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("create table run (t, x)")
    connection.close()


def _wav(path: Path) -> None:
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 8000, 0, "NONE", ""))
        file.writeframes(np.arange(800, dtype="<i2").tobytes())


def _netcdf3(path: Path) -> None:
    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("time", 50)
        file.createVariable("x", "f8", ("time",))[:] = np.arange(50.0)


def _bytes(content: bytes) -> Callable[[Path], Any]:
    return lambda path: path.write_bytes(content)


NOISE = bytes(np.random.default_rng(1).integers(0, 256, 5000, dtype=np.uint8))
FILES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a.csv.gz": (_bytes(gzip.compress(TABLE.encode())), "packed by gzip.* gunzip"),
    "packed.csv": (_bytes(gzip.compress(TABLE.encode())), "packed by gzip.* gunzip"),
    "a.bz2": (_bytes(bz2.compress(TABLE.encode())), "packed by bzip2"),
    "a.xz": (_bytes(lzma.compress(TABLE.encode())), "packed by xz"),
    "a.tar": (_tar, "a tar archive.* tar xf"),
    "a.zip": (_zipped(["walk.csv"]), "a ZIP archive.* unpack"),
    "a.xlsx": (_zipped(["[Content_Types].xml", "xl/workbook.xml"]), "an Excel workbook.* as CSV"),
    "renamed.dat": (_zipped(["[Content_Types].xml", "xl/workbook.xml"]), "an Excel workbook.* as CSV"),
    "a.xls": (_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + NOISE), "an old Excel workbook.* as CSV"),
    "a.parquet": (FRAME.to_parquet, r"a Parquet table.*pandas\.read_parquet\(FILE\)\.to_csv"),
    "a.feather": (FRAME.to_feather, r"Feather.*read_feather"),
    "a.pkl": (FRAME.to_pickle, "a Python pickle.*numpy.savez"),
    "no-ending": (lambda path: path.write_bytes(pickle.dumps({"x": 1.0})), "a Python pickle"),
    "a.db": (_sqlite, "a database of SQLite.* sqlite3 -csv"),
    "a.wav": (_wav, "a sound file.*scipy.io.wavfile"),
    "old.cdf": (_netcdf3, "NetCDF 3 .*nccopy"),
    "old.nc": (_netcdf3, "NetCDF 3 .*nccopy"),
    "a.tdms_index": (_bytes(b"TDSh" + NOISE), r"index of a TDMS file.* \.tdms file beside it"),
    "a.opj": (_bytes(b"CPYA 4.3380 188 W64 #\n" + NOISE), "a project of Origin"),
    "a.psdata": (_bytes(NOISE), "a file of PicoScope.*CSV or MATLAB"),
    "a.png": (_bytes(b"\x89PNG\r\n\x1a\n" + NOISE), "a picture, .*numbers behind it"),
    "a.pdf": (_bytes(b"%PDF-1.7\n" + NOISE), "a PDF"),
    "page.csv": (
        _bytes(b"\n<!DOCTYPE html>\n<html><body>1,2,3</body></html>"),
        "a web page.*the file itself",
    ),
    "pointer.mat": (_bytes(b"version https://git-lfs.github.com/spec/v1\noid 1\n"), "Git LFS.* git lfs pull"),
    "a.json": (_bytes(json.dumps({"t": [0, 1], "x": [1, 2]}).encode()), r"in JSON.*read_json"),
    "a.xml": (_bytes(b"<?xml version='1.0'?><run><x>1</x></run>"), "in XML"),
    "famos.raw": (_bytes(b"|CF,2,1,1;|CK,1,3,1,1;" + NOISE), "imc FAMOS"),
    "unknown.bin": (_bytes(b"\xfe\xed\x00\x01" + NOISE), r"neither text nor .*first bytes are fe ed 00 01"),
    "no-zeros.bin": (_bytes(NOISE.replace(b"\0", b"\1")), "neither text nor .*first bytes are"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_format_is_named(tmp_path: Path, name: str) -> None:
    write, words = FILES[name]
    write(tmp_path / name)
    for look in (read_recording, inspect_file):
        with pytest.raises(RecordingError, match=words) as caught:
            look(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert len(str(caught.value)) < len(str(tmp_path)) + 400
        assert str(caught.value).isprintable()


def test_every_signature_says_what_and_what_to_do() -> None:
    for one in (*BINARY, *TEXTS):
        assert one.begins or one.endings, one
        assert len(one.advice) > 10, one


@pytest.mark.parametrize(
    "text",
    [
        TABLE.encode(),
        TABLE.encode("utf-16"),
        "t [s];x [µm]\n0;1\n1;2\n".encode("cp1252"),
        b"II*, t\n0,1\n",  # begins as a picture does
        b"ID3\tx\n0\t1\n1\t2\n",
        b"MZ,ORC,CDF\n0,1,2\n",
    ],
)
def test_text_stays_text(tmp_path: Path, text: bytes) -> None:
    assert is_text(text)
    (tmp_path / "a.dat").write_bytes(text)
    assert inspect_file(tmp_path / "a.dat").reader == "csv"
    assert is_text(text + b"\x1a\f\x1b[0m")  # ends of files and pages, colours


def test_a_table_called_as_a_workbook_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.xls").write_text(TABLE.replace(",", "\t"))  # as many instruments write it
    assert inspect_file(tmp_path / "a.xls").reader == "csv"


def test_an_error_quotes_no_more_than_eighty_characters(tmp_path: Path) -> None:
    long = "x" * 100_000
    for name, text in {
        "field": f"t,x\n0,1\n1,2\n2,3\n3,{long}\n4,5\n",
        "name": f"t,{long[:900]}\n0,1\n1,2\n",
        "last line": f"t,x\n0,1\n1,2\n2,3\n{long}",
        "quotes": f"t,x\n0,1\n1,2\n2,3\n3,it's \x07 {long}\n4,5\n",
    }.items():
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(RecordingError) as caught:
            read_recording(tmp_path / "a.csv", {"time": "t", "x": "y" if name == "name" else "x"})
        said = str(caught.value).removeprefix(f"{tmp_path / 'a.csv'}: ")
        assert said.isprintable()
        assert "x" * 70 in said or name == "last line"
        assert "x" * 81 not in said, said


def test_inspect_shows_long_names_and_control_characters_in_one_line(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "a.npz",
        **{"time": np.arange(9.0), "n" * 500: np.arange(9.0), "a\x07\x1b[31mb": np.arange(9.0)},
    )
    shown = str(inspect_file(tmp_path / "a.npz"))
    table = shown.partition("samples")[0]
    assert "n" * 81 not in table
    assert all(line.isprintable() for line in table.splitlines())


def test_a_file_that_lies_about_its_start_is_refused_in_a_sentence(tmp_path: Path) -> None:
    """First bytes of formats that a library reads, and nothing behind them."""
    for name, head in {
        "a.tdms": b"TDSm" + struct.pack("<IIQQ", 14, 4713, 2**62, 2**62),
        "a.trc": b"WAVEDESC" + NOISE,
        "a.wfm": b"\x0f\x0f:WFM#003" + NOISE,
        "a.isf": b":WFMP:NR_P 400;BYT_N 1;BN_F RI;:CURV #3400" + NOISE[:100],
        "keysight.bin": b"AG10" + NOISE,
        "rigol.wfm": b"\xa5\xa5\x38\x00DS4024" + NOISE,
        "a.uff": b"    -1\n    58\n" + NOISE,
        "a.h5": b"\x89HDF\r\n\x1a\n" + NOISE,
    }.items():
        (tmp_path / name).write_bytes(head)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # libraries leave a file open that they refuse
            with pytest.raises(RecordingError) as caught:
                read_recording(tmp_path / name, sample_rate=1.0)
            said = str(caught.value)
            del caught
            gc.collect()
        assert said.startswith(f"{tmp_path / name}: "), said
        assert "/dev/fd" not in said
        assert len(said) < len(str(tmp_path)) + 500
