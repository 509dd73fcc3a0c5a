"""Hostile files through the panel's routes: a sentence or a right answer, and what is there stays."""

from __future__ import annotations

import gzip
import io
import re
import struct
import zipfile
from pathlib import Path
from typing import Any

import h5py
import httpx
import numpy as np
import pytest

from stickslip.recording import make_recording, open_recording, save_recording

HEAD = b"time [s],x [um]\n"
ROWS = b"".join(b"%d.0,%d\n" % (i, i) for i in range(100))


def npy(kind: str, shape: str, data: bytes = bytes(8000), version: int = 1) -> bytes:
    """Return an NPY file whose header says anything."""
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return (
        b"\x93NUMPY"
        + bytes([version, 0])
        + struct.pack("<H" if version == 1 else "<I", len(head))
        + head
        + data
    )


RAMP = npy("'<f8'", "(1000,)", np.arange(1000.0).tobytes())


def npz(*parts: tuple[str, bytes], at: int = 0, change: bytes = b"") -> bytes:
    """Return an archive; some bytes of the entry of its first part in the table of contents are changed."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        for name, data in parts:
            archive.writestr(name, data)
    made = bytearray(whole.getvalue())
    entry = made.find(b"PK\x01\x02") + at
    made[entry : entry + len(change)] = change
    return bytes(made)


TWO = (("time.npy", RAMP), ("x.npy", RAMP))
REFUSED = {  # what is said when the file is looked at, or taken as time and x
    "a.csv": {
        "bytes after the head": (HEAD + ROWS * 700 + bytes(1000) + ROWS, "line 70002, column 'time"),
        "exponents": (
            HEAD + b"0,1e999999999\n1,2\n",
            "line 2: end_effector_position .* is empty, NaN or infinite",
        ),
        "backwards": (HEAD + b"".join(b"%d,1\n" % (100 - i) for i in range(100)), "does not increase"),
        "half a letter": (
            b"\xff\xfe" + (HEAD + ROWS).decode().encode("utf-16-le") + b"1",
            "line 102, column",
        ),
        "quotes": (HEAD + b'"' * 1_000_000, "no rows of numbers"),
        "lines in quotes": (HEAD + b'"' + b"a\n" * 500_000 + b'",1\n', "no rows of numbers"),
        "empty lines": (b"\n" * 1_000_000, "no rows of numbers"),
        "commas": (b"," * 200_000 + b"\n", "no rows of numbers"),
        "year 0": (b"time,x\n0000-00-00 00:00:00,1\n9999-12-31 23:59:60,2\n", "is not a date"),
        "two zones": (
            b"time,x\n2020-01-01T00:00:00+14:00,1\n2020-01-01T00:00:01-12:00,2\n2020-01-01T00:00:02Z,3\n",
            "does not increase",
        ),
        "picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 100, "a picture"),
        "packed": (gzip.compress(HEAD + ROWS), "packed by gzip"),
        "brackets": (
            b"time [s],x [" + b"(" * 5000 + b"m" + b")" * 5000 + b"]\n" + ROWS,
            "more than 1,000 char",
        ),
        "unit": (b"time [s],x [m^99999999999]\n" + ROWS, "the unit 'm.99999999999' is not known"),
        "program": (b"time [s],x [__import__('os')]\n" + ROWS, "is not known here"),
    },
    "a.npy": {
        "2**62 numbers": (npy("'<f8'", "(4611686018427387904,)"), "array is too big"),
        "less than none": (npy("'<f8'", "(-1,)"), "negative dimensions"),
        "letters": (npy("'<U1000000000'", "(1,)"), "not a valid dtype"),
        "nothing, often": (npy("'|S0'", "(1000000000000,)"), "its arrays would take 7,629,395 MiB"),
        "objects": (npy("[('a','<f8'),('b','<O')]", "(10,)"), "Python objects in dtype"),
        "sum": (npy("'<f8'", "(10**10**10,)"), "malformed node"),
        "digits": (npy("'<f8'", "(" + "9" * 6000 + ",)", version=2), "Cannot parse header"),
        "header of 2 GB": (b"\x93NUMPY\x02\x00\xff\xff\xff\x7f" + bytes(8000), "not a readable NPY file"),
        "dates": (npy("'<M8[ns]'", "(1000,)"), "not real numbers"),
    },
    "a.npz": {
        "locked": (npz(*TWO, at=8, change=b"\x01"), "is encrypted"),
        "place": (npz(*TWO, at=42, change=(2**31).to_bytes(4, "little")), "not a readable NPZ file"),
        "size": (npz(*TWO, at=24, change=(8).to_bytes(4, "little")), "not a readable NPZ file"),
        "nothing, often": (npz(("time.npy", npy("'|S0'", "(1000000000000,)"))), "would take 7,629,395 MiB"),
        "objects": (npz(("time.npy", npy("'|O'", "(10,)"))), "Object arrays cannot be loaded"),
        "table": (npz(("xl/workbook.xml", b"<x/>")), "a ZIP archive without NumPy arrays"),
    },
}
CASES = [(name, case) for name, group in REFUSED.items() for case in group]


@pytest.fixture(scope="module")
def folder(folder: Path) -> Path:
    """A lab with a recording."""
    time = np.arange(200) * 1e-3
    save_recording(make_recording(time, {"drive_voltage": (time, "V")}, title="good"), folder / "good.nc")
    return folder


def opened(client: httpx.Client, name: str, content: bytes) -> httpx.Response:
    """Upload a file, and take its first two columns."""
    answer = client.post("/history/upload", params={"name": name}, content=content)
    if answer.status_code != 200:
        return answer
    look = answer.json()
    columns = {"time": 0, "end_effector_position": 1} if len(look["columns"]) > 1 else {"time": 0}
    asked = {"token": look["token"], "name": "taken", "columns": columns}
    return client.post("/history/take", json=asked)


@pytest.mark.parametrize(("name", "case"), CASES)
def test_a_hostile_upload_is_refused(client: httpx.Client, folder: Path, name: str, case: str) -> None:
    content, words = REFUSED[name][case]
    answer = opened(client, name, content)
    assert answer.status_code == 400, answer.text
    said = answer.json()["error"]
    assert said.startswith(f"{name}: ")
    assert len(said) < 1600
    assert str(folder) not in said
    assert re.search(words, said), said
    assert client.get("/recordings").json()[0]["name"] == "good.nc"
    assert open_recording(folder / "good.nc").title == "good"


CHANNELS: dict[str, Any] = {  # of a recording in the folder, instead of its time or drive
    "time without numbers": ("time", np.full(200, np.nan)),
    "time back": ("time", np.arange(200.0)[::-1]),
    "time in a table": ("time", np.zeros((200, 2))),
    "time alone": ("time", 1.0),
    "no time": ("time", np.zeros(0)),
    "complex time": ("time", np.arange(200) + 1j),
    "time of texts": ("time", np.array([b"x"] * 200)),
    "shorter time": ("time", np.arange(100.0)),
    "endless drive": ("drive_voltage", np.full(200, np.inf)),
    "longer drive": ("drive_voltage", np.zeros(205)),
    "whole numbers": ("drive_voltage", np.full(200, -(2**63))),
    "nothing": ("drive_voltage", np.zeros(200, "V8")),
}


@pytest.mark.parametrize("case", CHANNELS)
def test_no_page_shows_a_hostile_recording(client: httpx.Client, folder: Path, case: str) -> None:
    name, values = CHANNELS[case]
    with h5py.File(folder / "good.nc") as good, h5py.File(folder / "bad.nc", "w") as bad:
        for key, value in good.attrs.items():
            bad.attrs[key] = value
        for channel in ("time", "drive_voltage"):
            of = good[channel]
            assert isinstance(of, h5py.Dataset)
            bad[channel] = values if channel == name else of[...]
            for key in ("units", "long_name"):
                bad[channel].attrs[key] = of.attrs[key]
        if case.startswith(("endless", "longer", "whole", "noth")):
            bad["time"].make_scale("time")  # type: ignore[union-attr]
            bad["drive_voltage"].dims[0].attach_scale(bad["time"])  # type: ignore[union-attr]
    for route, body in (
        ("/recordings/show", {"name": "bad.nc"}),
        ("/history/overlay", {"names": ["bad.nc", "good.nc"], "channel": "drive_voltage"}),
        ("/history/overlay", {"names": ["good.nc", "bad.nc"], "channel": "drive_voltage"}),
        ("/path/send", {"prediction": "bad.nc"}),
        ("/history/annotate", {"name": "bad.nc", "notes": "x"}),
    ):
        answer = client.post(route, json=body)
        assert answer.status_code == 400, (route, answer.text)
        assert "bad.nc" in answer.json()["error"]
    assert client.get("/recordings/export", params={"name": "bad.nc", "kind": "csv"}).status_code == 400
    rows = {row["name"]: row["problem"] for row in client.get("/history").json()["rows"]}
    assert rows["bad.nc"]
    assert not rows["good.nc"]
