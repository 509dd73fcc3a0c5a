"""The Bench page's routes without a browser: what runs, what is kept, what is refused."""

from __future__ import annotations

import json
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest
import yaml
from scipy.io import loadmat

from stickslip import open_recording, read_recording
from stickslip.panel import create_app
from stickslip.recording.exports import EXPORTS

from .serving import ME, client_of, heard, streaming
from .test_stream import unpacked

FAST = {"path": ["rig", "real_time"], "value": False}


@pytest.fixture(scope="module")
def client(client: httpx.Client) -> httpx.Client:
    client.post("/bench/set", json=FAST).raise_for_status()
    return client


def ran(client: httpx.Client, path: str, body: dict, last: str = "done") -> dict:
    """Start something and wait until it has ended."""
    with streaming(client) as stream:
        heard(stream, "run")
        client.post(path, json=body).raise_for_status()
        while True:
            state = heard(stream, "run")
            if state["phase"] in ("done", "stopped", "failed"):
                assert state["phase"] == last, state
                return state


def change(client: httpx.Client, path: list, value: object) -> httpx.Response:
    return client.post("/bench/set", json={"path": path, "value": value})


def test_what_is_shown_at_the_end_of_a_run_is_what_its_recording_ends_with(
    client: httpx.Client, folder: Path
) -> None:
    ran(client, "/bench/start", {"runs": ["forward"]})
    name = client.get("/recordings").json()[0]["name"]
    recording = open_recording(folder / name)
    ends = [float(one[-1]) for one in recording.data_vars.values()]
    with streaming(client) as stream:
        while isinstance(message := stream.recv(timeout=60.0), str):
            pass
    assert unpacked(message)[0]["latest"] == ends
    shown = client.post("/recordings/show", json={"name": name, "end": 0.5, "points": 100})
    header, arrays = unpacked(shown.content)
    assert header["latest"] == ends, "also where less than all of it is drawn"
    whole = unpacked(client.post("/recordings/show", json={"name": name, "points": 100}).content)[1]
    assert arrays[0][-1] < whole[0][-1]
    np.testing.assert_array_equal([one[-1] for one in whole[1:]], np.array(ends, np.float32))


def test_a_run_is_seen_kept_and_exported(client: httpx.Client, folder: Path, tmp_path: Path) -> None:
    change(client, ["variables", "forward_voltage"], "0.07 kV").raise_for_status()
    ran(client, "/bench/start", {"runs": ["forward"]})
    name = client.get("/recordings").json()[0]["name"]
    recording = open_recording(folder / name)
    assert recording["drive_voltage"].max() == pytest.approx(70.0, abs=0.5)
    # The steps go forward, as far as the thesis's actuator walks at 70 V: some micrometres each.
    walked = float(recording["end_effector_position"][-100:].mean())
    assert 8 * 1e-6 < walked < 8 * 7.4e-6
    written = yaml.safe_load((folder / name).with_name("experiment.yaml").read_text())
    assert [run["name"] for run in written["runs"]] == ["forward"]
    assert written["variables"]["forward_voltage"] == "0.07 kV"

    formats = dict(client.get("/recordings/formats").json())
    assert list(formats) == ["nc", *EXPORTS]
    for kind, suffix in [("nc", ".nc"), ("mat", ".mat"), ("csv", ".csv"), ("nexus", ".nxs")]:
        answer = client.get("/recordings/export", params={"name": name, "kind": kind})
        assert f'forward{suffix}"' in answer.headers["content-disposition"]
        (tmp_path / f"x{suffix}").write_bytes(answer.content)
    expected = recording["end_effector_position"].values
    np.testing.assert_array_equal(open_recording(tmp_path / "x.nc")["end_effector_position"], expected)
    np.testing.assert_allclose(loadmat(tmp_path / "x.mat")["trace_y"][2], expected)
    np.testing.assert_allclose(
        read_recording(tmp_path / "x.csv")["end_effector_position"], expected, atol=1e-12
    )
    assert open_recording(tmp_path / "x.nxs").identical(recording)
    unknown = client.get("/recordings/export", params={"name": name, "kind": "xls"})
    assert unknown.status_code == 400
    assert "'xls' is no format of recordings: nc, mat" in unknown.text
    # A user's own CSV becomes a recording of ours too.
    (folder / "own.csv").write_bytes((tmp_path / "x.csv").read_bytes())
    answer = client.get("/recordings/export", params={"name": "own.csv", "kind": "nc"})
    (tmp_path / "own.nc").write_bytes(answer.content)
    np.testing.assert_allclose(
        open_recording(tmp_path / "own.nc")["end_effector_position"], expected, atol=1e-12
    )


def test_position_and_the_way_home(client: httpx.Client) -> None:
    client.post("/bench/home_here").raise_for_status()
    away = ran(client, "/bench/start", {"runs": ["forward"]})["position"]
    assert away > 5e-6
    home = ran(client, "/bench/home", {})["position"]
    assert abs(home) < away / 3
    assert client.post("/bench/home_here").json() == {"position": 0.0}
    assert not [one for one in client.get("/recordings").json() if "home" in one["name"]], (
        "no recording of that"
    )


def test_capture_settings_reach_the_recording(client: httpx.Client, folder: Path) -> None:
    at = ["runs", 2, "capture"]
    change(client, [*at, "length"], "0.3 s").raise_for_status()
    change(client, [*at, "interval"], "0.1 ms").raise_for_status()
    change(client, [*at, "pre_trigger"], 0.05).raise_for_status()
    change(client, ["runs", 2, "repeats"], 2).raise_for_status()
    ran(client, "/bench/start", {"runs": ["step"]})
    names = [one["name"] for one in client.get("/recordings").json()[:2]]
    assert sorted(name.rsplit("/")[-1] for name in names) == ["step_1.nc", "step_2.nc"]
    recording = open_recording(folder / names[0])
    assert recording.sizes["time"] == 3000
    drive = recording["drive_voltage"].values
    assert int(np.argmax(drive > 5.0)) == 500, "the trigger is 50 ms after the begin"


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (["variables", "forward_voltage"], "65 A", "'A'"),
        (["variables", "forward_voltage"], "165 V", "above the greatest voltage of 100 V"),
        (["runs", 0, "capture", "length"], "1 m", "no s"),
        (["runs", 0, "capture", "interval"], "33 us", "whole multiple"),
        (["runs", 0, "capture", "trigger", "signal"], "drive", "trigger"),
        (["runs", 7, "name"], "x", "7 is no part of a list"),
        (["runs", "a", "name"], "x", "'a' is no part of a list"),
        (["panel"], [{"kind": "gauge", "variables": ["a"]}], "kind"),
        (["panel", 0, "width"], 40, "12"),
        (["nonsense"], 1, "nonsense"),
        ([], 1, "place"),
        (["limits", "max_voltage"], "1e400 V", "max_voltage"),
    ],
)
def test_what_cannot_be_recorded_is_refused_and_nothing_changes(
    client: httpx.Client, path: list, value: object, said: str
) -> None:
    with streaming(client) as stream:
        before = heard(stream, "experiment")
    answer = change(client, path, value)
    assert answer.status_code == 400
    assert said in answer.json()["error"]
    with streaming(client) as stream:
        assert heard(stream, "experiment") == before


def test_changes_that_come_at_once_are_all_made(client: httpx.Client) -> None:
    values = {"forward_voltage": 51.0, "reverse_voltage": 52.0, "step_voltage": 53.0, "frequency": 54.0}
    units = {"frequency": "Hz"}
    with ThreadPoolExecutor(4) as pool:
        answers = pool.map(
            lambda one: change(client, ["variables", one[0]], f"{one[1]} {units.get(one[0], 'V')}"),
            values.items(),
        )
        assert all(answer.status_code == 200 for answer in answers)
    with streaming(client) as stream:
        found = {one["name"]: one["value"] for one in heard(stream, "experiment")["variables"]}
    assert {name: found[name] for name in values} == values
    change(client, ["variables", "frequency"], "5 Hz").raise_for_status()


def test_experiments_are_saved_and_loaded_with_their_instruments(client: httpx.Client, folder: Path) -> None:
    panel = [{"kind": "display", "variables": ["drive_voltage"], "title": "U", "width": 4, "height": 1}]
    with streaming(client) as stream:
        before = heard(stream, "experiment")["content"]["panel"]
    change(client, ["panel"], panel).raise_for_status()
    client.post("/bench/save", json={"name": "sub/mine.yaml"}).raise_for_status()
    change(client, ["panel"], before).raise_for_status()
    assert "sub/mine.yaml" in client.get("/bench/experiments").json()
    client.post("/bench/load", json={"name": "sub/mine.yaml"}).raise_for_status()
    with streaming(client) as stream:
        found = heard(stream, "experiment")
    assert (found["panel"], found["name"]) == (panel, "sub/mine.yaml")
    assert yaml.safe_load((folder / "sub" / "mine.yaml").read_text())["panel"] == panel
    change(client, ["panel"], before).raise_for_status()


def test_only_who_has_control_acts_but_anybody_stops(client: httpx.Client) -> None:
    with streaming(client) as stream:
        heard(stream, "control")
        client.post("/bench/home_here").raise_for_status()
        other = {"X-Client": "other"}
        for path, body in [
            ("/bench/start", {"runs": ["walk"]}),
            ("/bench/home", {}),
            ("/bench/set", {"path": ["title"], "value": "x"}),
            ("/bench/save", {"name": "x.yaml"}),
            ("/recordings/rename", {"name": "a.nc", "to": "b.nc"}),
        ]:
            answer = client.post(path, json=body, headers=other)
            assert answer.status_code == 400
            assert "another page controls" in answer.json()["error"]
        assert client.post("/bench/stop", headers=other).json() == {"stopped": False}


def test_rename_never_replaces(client: httpx.Client, folder: Path) -> None:
    for _ in range(2):
        ran(client, "/bench/start", {"runs": ["forward"]})
    names = [one["name"] for one in client.get("/recordings").json()]
    answer = client.post("/recordings/rename", json={"name": names[0], "to": names[1]})
    assert answer.status_code == 400
    assert "already" in answer.json()["error"]
    client.post("/recordings/rename", json={"name": names[0], "to": "kept/mine.nc"}).raise_for_status()
    assert (folder / "kept" / "mine.nc").is_file()
    assert not (folder / names[0]).exists()


def test_emergency_stop_ramps_at_the_next_block_and_says_when(client: httpx.Client) -> None:
    change(client, ["rig", "real_time"], True).raise_for_status()
    change(client, ["runs", 0, "capture", "length"], "30 s").raise_for_status()  # it does not end before
    with streaming(client) as stream:
        heard(stream, "run")
        client.post("/bench/start", json={"runs": ["walk"]}).raise_for_status()
        while heard(stream, "run")["phase"] != "running":
            pass
        time.sleep(0.5)
        stream.send(json.dumps({"kind": "emergency_stop"}))
        while heard(stream, "run")["phase"] != "stopping":
            pass
        blocks, phase = 0, "stopping"
        while phase == "stopping":
            message = stream.recv(timeout=300)
            said = {} if isinstance(message, bytes) else json.loads(message)
            blocks += isinstance(message, bytes)
            phase = said["phase"] if said.get("kind") == "run" else phase
        assert phase == "stopped"
        assert blocks <= 1, "what was under way, and no more"
    with streaming(client) as stream:
        lines = [line["text"] for line in heard(stream, "log")["entries"]]
    said = next(line for line in reversed(lines) if "ramp to 0 V" in line)
    assert "emergency stop" in said
    assert float(said.split("began ")[1].split(" ms")[0]) >= 0.0
    change(client, ["runs", 0, "capture", "length"], "4 s").raise_for_status()
    change(client, *FAST.values()).raise_for_status()


def test_a_page_that_comes_back_gets_the_lines_that_it_missed(client: httpx.Client) -> None:
    for _ in range(2):
        ran(client, "/bench/start", {"runs": ["forward"]})
    with streaming(client) as stream:
        entries = heard(stream, "log")["entries"]
    assert len(entries) > 3
    with streaming(client, log=entries[-3]["id"]) as stream:
        assert heard(stream, "log")["entries"] == entries[-2:]
    with streaming(client, log=10**6) as stream:  # numbers of a server that is gone
        assert heard(stream, "log")["entries"] == entries


def test_a_drive_that_fails_while_it_runs_says_why(client: httpx.Client) -> None:
    change(client, ["limits", "max_position"], "3 um").raise_for_status()
    ran(client, "/bench/start", {"runs": ["walk"]}, "failed")
    with streaming(client) as stream:
        assert "end stop at 3 µm" in heard(stream, "log")["entries"][-1]["text"]
    change(client, ["limits", "max_position"], None).raise_for_status()


def test_runs_differ_and_are_numbered_on_over_restarts_of_the_server(tmp_path: Path) -> None:
    """As those of a real rig, none is an earlier one again; also where recordings were thrown away."""
    told = []
    for _ in range(2):
        with client_of(create_app(tmp_path), **ME) as made:
            made.post("/bench/set", json=FAST).raise_for_status()
            change(made, ["variables", "frequency"], "50 Hz").raise_for_status()
            ran(made, "/bench/start", {"runs": ["forward", "step"]})
            ran(made, "/bench/start", {"runs": ["forward"]})
        for path in sorted(tmp_path.rglob("forward.nc")):
            told.append((path.stat().st_mtime_ns, json.loads(open_recording(path).attrs["contact"])))
            path.unlink()
            shutil.rmtree(path.parent)
    numbers = [one["number"] for _, one in sorted(told, key=lambda one: one[0])]
    assert numbers == [0, 2, 3, 5]
    assert len({one["sigma_0"] for _, one in told}) == 4


@pytest.mark.parametrize("held", [b"", b"12.5", b"-3", b"\xff\x00"])
def test_a_damaged_number_of_runs_is_named_and_nothing_is_run(held: bytes, tmp_path: Path) -> None:
    """Counted anew, runs could be those of before again."""
    kept = tmp_path / ".rig" / "runs"
    with client_of(create_app(tmp_path), **ME) as made:
        made.post("/bench/set", json=FAST).raise_for_status()
        kept.parent.mkdir(exist_ok=True)
        kept.write_bytes(held)
        refused = made.post("/bench/start", json={"runs": ["forward"]})
    assert refused.status_code == 400
    assert ".rig/runs does not hold how many runs" in refused.json()["error"]
    assert kept.read_bytes() == held
    assert not list(tmp_path.glob("recordings/*"))


def test_how_runs_differ_is_set_on_the_bench(client: httpx.Client) -> None:
    change(client, ["rig", "variation", "stiffness"], "4 %").raise_for_status()
    with streaming(client) as stream:
        variables = {one["name"]: one for one in heard(stream, "experiment")["variables"]}
    assert variables["variation.stiffness"] == {
        "name": "variation.stiffness",
        "value": 0.04,
        "unit": "",
        "label": "scatter of the bristle's stiffness",
        "path": ["rig", "variation", "stiffness"],
        "kind": "rig",
    }
    refused = change(client, ["rig", "variation", "stiffness"], "4 N")
    assert refused.status_code == 400
    assert "rig.variation.stiffness: stiffness = '4 N'" in refused.json()["error"]


def test_no_name_leads_to_a_file_outside(client: httpx.Client, tmp_path: Path) -> None:
    """Whatever its ending: each place of an experiment that may name a file."""
    outside = tmp_path / "secret"
    outside.write_text("[[secret")
    for place in (
        ["rig", "bench"],
        ["actuator", "set"],
        ["channels", "piezo_elongation", "calibration", 0],
    ):
        for name in (str(outside), f"../../{outside.name}", f"{outside}.toml", f"{outside}.json"):
            answer = change(client, place, name)
            assert answer.status_code == 400
            assert "is no name of a file in the panel's folder" in answer.text, (place, answer.text)
