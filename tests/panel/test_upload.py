"""Somebody's own file without a browser: what the look at it says, and how it is taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from stickslip.history import read_acts
from stickslip.panel.looking import for_the_page
from stickslip.recording import open_recording
from stickslip.waveform import Rest, Sawtooth, Sequence

ROWS = [f"{0.25 * i:.5f},{1e-3 * i:.5f},{0.1 * i:.5f}" for i in range(100)]
CUT = "\n".join(["t [ms],x [um],u [V]", *ROWS, "25.00000,"])
GERMAN = "\n".join(["Zeit in ms;Weg in µm;Spannung in V", *(one.replace(",", ";") for one in ROWS), ""])


def looked_at(client: httpx.Client, name: str, text: str) -> dict[str, Any]:
    answer = client.post("/history/upload", params={"name": name}, content=text.encode())
    answer.raise_for_status()
    return answer.json()


def taken(client: httpx.Client, look: dict[str, Any], **more: Any) -> httpx.Response:
    columns = {one["guess"]: one["index"] for one in look["columns"] if one["guess"]}
    asked = {"token": look["token"], "name": Path(look["name"]).stem, "columns": columns, **more}
    return client.post("/history/take", json=asked)


def test_a_file_that_is_cut_off_says_so_before_it_is_taken(client: httpx.Client, folder: Path) -> None:
    look = looked_at(client, "cut.csv", CUT)
    assert look["complete"] == 100
    assert look["cut"] == "the last line '25.00000,' has 2 of 3 fields: the file is cut off"
    refused = taken(client, look)
    assert refused.status_code == 400
    said = refused.json()["error"]
    assert said.endswith("the file is cut off. Tick “Take only the complete rows” to go on without it.")
    assert "rows=" not in said
    assert "YAML" not in said
    taken(client, look, rows=look["complete"]).raise_for_status()
    recording = open_recording(folder / "uploads" / "cut.nc")
    np.testing.assert_allclose(recording["time"], 0.25e-3 * np.arange(100), atol=1e-12)
    assert float(recording["drive_voltage"][-1]) == pytest.approx(9.9)


def test_what_the_drive_is_taken_for_is_said_and_noted(client: httpx.Client, folder: Path) -> None:
    time = np.arange(4000) * 2.5e-4
    volts = Sequence(Rest(0.1), Sawtooth(65.0, 5.0, periods=4)).value(time)
    volts += 0.02 * np.random.default_rng(46).standard_normal(time.size)
    rows = [f"{1e3 * t:.3f},{i % 7},{u:.5f}" for i, (t, u) in enumerate(zip(time, volts, strict=True))]
    answer = taken(client, looked_at(client, "mine.csv", "\n".join(["t [ms],x [um],u [V]", *rows])))
    answer.raise_for_status()
    said = "Sawtooth 65 V, 5 Hz, 4 periods, recognised in drive_voltage; residual 20 mV rms"
    assert answer.json()["drive"] == said
    assert read_acts(folder)[-1]["drive"] == said


def test_one_that_is_cut_off_beyond_what_is_looked_at(client: httpx.Client) -> None:
    many = "\n".join(["t [ms],x [um],u [V]", *(f"{0.25 * i},1,2" for i in range(25_000)), "6250,1"])
    look = looked_at(client, "long.csv", many)
    assert (look["samples"], look["first"], look["complete"]) == (20_000, True, 25_000)
    whole = looked_at(client, "whole.csv", many + ",2\n")
    assert not {"cut", "complete"} & whole.keys()


def test_the_time_is_what_the_reader_takes_as_the_time(client: httpx.Client, folder: Path) -> None:
    look = looked_at(client, "german.csv", GERMAN)
    assert [(one["guess"], one["unit"]) for one in look["columns"]] == [
        ("time", "ms"),
        ("end_effector_position", "µm"),
        ("drive_voltage", "V"),
    ]
    taken(client, look).raise_for_status()
    recording = open_recording(folder / "uploads" / "german.nc")
    np.testing.assert_allclose(recording["time"], 0.25e-3 * np.arange(100), atol=1e-12)


def test_where_two_columns_may_be_the_time_none_is_chosen(client: httpx.Client) -> None:
    text = "\n".join(["first in ms;second in ms;Weg in µm", *(one.replace(",", ";") for one in ROWS), ""])
    assert [one["guess"] for one in looked_at(client, "two.csv", text)["columns"]] == [
        "",
        "",
        "end_effector_position",
    ]


def test_what_readers_say_is_left_alone_where_it_advises_nothing() -> None:
    said = "line 500, column 'x [um]': 'abc' is not a number"
    assert for_the_page(said) == said


def test_an_upload_is_never_whole_in_the_server(client: httpx.Client, monkeypatch) -> None:
    async def whole(_: object) -> bytes:
        raise AssertionError("the body of an upload in memory")

    monkeypatch.setattr("starlette.requests.Request.body", whole)
    text = "time [s],x [um]\n" + "".join(f"{k / 1e3},{k}\n" for k in range(50))
    answer = client.post("/history/upload?name=a.csv", content=text.encode())
    assert (answer.status_code, answer.json()["samples"]) == (200, 50)


def test_an_upload_is_kept_if_what_was_made_of_it_cannot_be_read(client: httpx.Client, folder: Path) -> None:
    """A name of a channel that the reader refuses: the recording would be lost, and the upload with it."""
    look = looked_at(client, "long.csv", "\n".join(["t [ms],x [um],u [V]", *ROWS, ""]))
    long = {"token": look["token"], "name": "long", "columns": {"time": 0, "x" * 1001: 1}}
    refused = client.post("/history/take", json=long)
    assert refused.status_code == 400
    assert "as a recording it cannot be read" in refused.json()["error"]
    assert "a name in it has more than 1,000 characters" in refused.json()["error"]
    assert not (folder / "uploads" / "long.nc").exists()
    taken(client, look).raise_for_status()
    assert (folder / "uploads" / "long.nc").exists()
