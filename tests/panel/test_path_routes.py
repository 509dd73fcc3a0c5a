"""Next steps after a fit without a browser: what is refused, and files that never answer."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

import stickslip as ss
from stickslip.identify.results import model_numbers
from stickslip.recording import save_recording

from .test_bench_routes import change
from .test_saved_sets import BRASS, save_set

SHAPE = {"shape": "Sawtooth", "amplitude": "65 V", "frequency": "5 Hz", "periods": 2}


@pytest.fixture(scope="module")
def client(client: httpx.Client, folder: Path) -> Iterator[httpx.Client]:
    """A panel on a folder with pipes in it, which nobody writes to."""
    (folder / "fits" / "piped").mkdir(parents=True)
    (folder / "fits" / "piped" / "report.html").touch()
    (folder / "parameters").mkdir()
    for name in ("f.nc", "f.csv", "f.toml", "f.json", "f.yaml", "parameters/f.toml"):
        os.mkfifo(folder / name)
    os.mkfifo(folder / "fits" / "piped" / "results.json")
    (folder / "on_a_pipe.toml").write_text('kind = "bench"\nbase = "f.toml"\n')
    client.post("/bench/save", json={"name": "ready.yaml"}).raise_for_status()
    client.post("/bench/load", json={"name": "ready.yaml"}).raise_for_status()
    usual = client.timeout
    client.timeout = 10.0  # s: what reads files is there now, and waits for nothing but a pipe
    yield client
    client.timeout = usual


@pytest.fixture
def piped_acts(folder: Path) -> Iterator[None]:
    os.mkfifo(folder / "acts.jsonl")
    yield
    (folder / "acts.jsonl").unlink()


@pytest.mark.usefixtures("piped_acts")
def test_no_route_opens_a_pipe(client: httpx.Client) -> None:
    for path, body in (
        *(("/path/predict", {**SHAPE, "parameters": n}) for n in ("f.nc", "f.toml", "parameters/f.toml")),
        ("/path/save", {"fit": "fits/piped", "name": "brass"}),
        ("/path/save", {"fit": "f.nc", "name": "brass"}),
        ("/path/verify", {"fit": "fits/piped", "recordings": ["f.nc"]}),
        ("/path/send", {"prediction": "f.nc"}),
        ("/history/annotate", {"name": "f.nc", "notes": "x"}),
        ("/history/annotate", {"name": "fits/piped", "notes": "x"}),
        ("/history/detail", {"name": "fits/piped"}),
        ("/history/overlay", {"names": ["f.nc", "f.csv"], "channel": "drive_voltage"}),
        ("/recordings/show", {"name": "f.csv"}),
        ("/recordings/rename", {"name": "f.nc", "to": "g.nc"}),
        ("/bench/load", {"name": "f.yaml"}),
        ("/bench/save", {"name": "f.yaml"}),
        ("/studies/begin", {"file": "f.yaml"}),
        ("/studies/state", {"name": "f.nc"}),
        ("/api/identify/start", {"recordings": ["f.nc"], "set": "kang2007", "law": "LuGre", "free": []}),
    ):
        answer = client.post(path, json=body)
        said = answer.json()
        assert 400 <= answer.status_code < 500 or said.get("wrong") or said.get("problem"), (
            path,
            answer.text,
        )
    assert client.post("/history/differences", json={"names": ["f.nc", "fits/piped"]}).status_code == 200
    for path in ("/history", "/history/bin", "/recordings", "/studies", "/api/identify/recordings"):
        assert client.get(path).status_code == 200
    assert client.get("/recordings/export", params={"name": "f.nc"}).status_code == 400
    assert client.get("/api/identify/report/fits/piped").status_code == 200
    for place, value in (
        (["rig", "bench"], "f.toml"),
        (["rig", "bench"], "on_a_pipe.toml"),
        (["actuator", "set"], "f.toml"),
        (["runs", 0, "waveform"], [{"file": "f.csv"}]),
        (
            ["channels", "end_effector_position"],
            {"input": "end_effector_position", "calibration": ["f.json"]},
        ),
    ):
        answer = change(client, place, value)
        assert answer.status_code == 400, (place, answer.text)
        assert "plain file" in answer.text, (place, answer.text)


def test_a_file_that_was_not_used_is_not_run_for_a_bench(client: httpx.Client, folder: Path) -> None:
    (folder / "mine.py").write_text(f"open({str(folder / 'ran')!r}, 'w')")
    (folder / "base.toml").write_text('base = "kang2007-bench"\n[sensor.mine]\ntype = "mine.py:Mine"\n')
    (folder / "bench.toml").write_text('kind = "bench"\nbase = "base.toml"\n')
    client.get("/bench/rigs").raise_for_status()
    assert "mine.py is of a file that is not run" in change(client, ["rig", "bench"], "bench.toml").text
    assert not (folder / "ran").exists()


def test_only_parameter_sets_are_predicted_with_and_only_predictions_sent(
    client: httpx.Client, folder: Path
) -> None:
    save_set(folder, BRASS, sigma_0=2e6)
    save_set(folder, "elsewhere.toml")
    assert (
        "none of those" in client.post("/path/predict", json={**SHAPE, "parameters": "elsewhere.toml"}).text
    )
    made = client.post("/path/predict", json={**SHAPE, "parameters": BRASS}, timeout=300.0)
    assert made.status_code == 200, made.text
    assert client.post("/path/send", json={"prediction": made.json()["name"]}).status_code == 200
    walk = ss.open_recording(folder / made.json()["name"])
    for variables in (
        {"voltage": 65.0},
        {"shape": "Sawtooth", "amplitude": 65.0},
        [1],
        {**SHAPE, "periods": 0},
    ):
        walk.attrs["variables"] = json.dumps(variables)
        save_recording(walk, folder / "walk.nc")
        answer = client.post("/path/send", json={"prediction": "walk.nc"})
        assert answer.status_code == 400
        assert "walk.nc is no prediction" in answer.text


def test_a_fit_with_wrong_units_is_not_saved(client: httpx.Client, folder: Path) -> None:
    numbers = model_numbers(ss.load_actuator("kang2007"))
    numbers["actuator"]["end_effector_mass"]["unit"] = "V"
    (folder / "fits" / "wrong").mkdir()
    for results, words in (({"numbers": {"model": numbers}}, "end_effector_mass"), ({}, "no 'numbers'")):
        (folder / "fits" / "wrong" / "results.json").write_text(json.dumps(results))
        answer = client.post("/path/save", json={"fit": "fits/wrong", "name": "wrong"})
        assert answer.status_code == 400
        assert answer.json()["error"].startswith("fits/wrong/results.json: ")
        assert words in answer.text


def test_what_cannot_be_predicted_is_said(client: httpx.Client, folder: Path) -> None:
    """A stage of 1e-300 rad/s, of which no periodic motion is found: no fault of the server."""
    file = folder / "parameters" / "slow.toml"
    save_set(folder, "parameters/slow.toml")
    file.write_text(re.sub(r"(\[natural_frequency\]\nvalue = )[0-9.]+", r"\g<1>1e-300", file.read_text()))
    asked = {**SHAPE, "parameters": "parameters/slow.toml"}
    answer = client.post("/path/predict", json=asked, timeout=300.0)
    assert (answer.status_code, answer.json()["error"][:34]) == (400, "no motion with the period of the d")
