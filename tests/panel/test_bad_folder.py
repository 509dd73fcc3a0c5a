"""A panel on a folder that came from anywhere: it starts, and no entry empties a list."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

import stickslip as ss
from stickslip.panel import create_app
from stickslip.panel.fits import REPORTS

from .serving import ME, client_of


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    clock = np.arange(50) / 1e3
    made = ss.make_recording(clock, {"drive_voltage": clock, "end_effector_position": 1e-6 * clock})
    ss.save_recording(made, tmp_path / "good.nc")
    (tmp_path / os.fsdecode(b"Pr\xfcfung.nc")).write_bytes((tmp_path / "good.nc").read_bytes())
    (tmp_path / "loop.nc").symlink_to("loop.nc")
    (tmp_path / os.fsdecode(b"\xfc.yaml")).write_text("kind: study\n")
    (tmp_path / os.fsdecode(b"\xfc.zarr")).mkdir()
    (tmp_path / os.fsdecode(b"\xfc.zarr") / "zarr.json").write_text("{}")
    asked = {"recordings": ["good.nc"], "set": "kang2007", "law": "LuGre", "free": []}
    saved = {
        "deep": "[" * 100_000,
        "list": "[]",
        "runs": json.dumps({"phase": "running", "request": asked}),
        "half": json.dumps({"phase": "done", "doing": "\ud800", "request": asked}),
    }
    for name, text in saved.items():
        (tmp_path / REPORTS / name).mkdir(parents=True)
        (tmp_path / REPORTS / name / "shown.json").write_text(text)
    (tmp_path / REPORTS / "loop").symlink_to("loop")
    (tmp_path / ".stickslip").mkdir()
    (tmp_path / ".stickslip" / "alarms.json").write_text("[" * 100_000)
    (tmp_path / "recordings" / "run").mkdir(parents=True)
    os.mkfifo(tmp_path / "recordings" / "run" / ".walk.999999999.samples")
    deep = tmp_path
    for _ in range(300):
        deep = deep / "d"
    deep.mkdir(parents=True)
    return tmp_path


@pytest.fixture
def client(folder: Path) -> Iterator[httpx.Client]:
    with client_of(create_app(folder), **ME) as made:
        yield made


def test_it_starts_and_lists_what_is_good(client: httpx.Client) -> None:
    rows = {row["name"]: row["problem"] for row in client.get("/history").json()["rows"]}
    assert rows["good.nc"] == ""
    assert "cannot be shown" in rows[r"Pr\xfcfung.nc"]
    assert "leads nowhere" in rows["loop.nc"]
    assert any("not searched" in problem for problem in rows.values())
    assert client.post("/history/detail", json={"name": r"Pr\xfcfung.nc"}).json()["samples"] == 50
    (one,) = client.get("/api/identify/recordings").json()
    assert (one["name"], one["samples"]) == ("good.nc", 50)
    assert [one["name"] for one in client.get("/recordings").json()] == ["good.nc"]
    assert client.get("/studies").json() == {"files": [], "stores": []}
    assert client.get("/api/identify/state").json()["phase"] == "none"
