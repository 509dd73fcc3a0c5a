"""A bench as a lab meets it: damaged files, full folders, restarts, many at once; real processes and
sockets."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

import gate.acts as acts
from stickslip import open_recording
from stickslip.panel import connections, create_app, server
from stickslip.panel import running as running_module
from stickslip.panel.connections import server_config
from stickslip.panel.folder import Folder
from stickslip.panel.starting import new_folder
from stickslip.recording.readers import process

from .conftest import CLIENT, PATIENCE, Panel, connected
from .serving import ME, client_of, emptied, heard, serving, streaming
from .test_bench_routes import FAST, change, ran


@pytest.fixture
def bench(shared_app: tuple[httpx.Client, Path]) -> httpx.Client:
    """A bench as it comes, but that it puts out as quickly as it can."""
    emptied(*shared_app)
    change(shared_app[0], *FAST.values()).raise_for_status()
    return shared_app[0]


def running(client: httpx.Client) -> None:
    """Start a walk of half a minute in real time, and wait until it is put out."""
    change(client, ["runs", 0, "capture", "length"], "30 s").raise_for_status()
    with streaming(client) as stream:
        heard(stream, "run")
        client.post("/bench/start", json={"runs": ["walk"]}).raise_for_status()
        while heard(stream, "run")["phase"] != "running":
            pass


def acknowledge(client: httpx.Client) -> None:
    """The fault of the last run."""
    client.post("/interlock/acknowledge", json={"why": "it was meant"}).raise_for_status()


def stop(client: httpx.Client) -> None:
    """An emergency stop by the stream, until the log says that the ramp began."""
    with streaming(client) as stream:
        stream.send(json.dumps({"kind": "emergency_stop"}))
        while not any(
            line["text"].startswith("emergency stop") and "ramp to 0 V began" in line["text"]
            for line in heard(stream, "log")["entries"]
        ):
            pass


class Watched(process.Reader):
    """Says when it comes to the damaged file, and computes on it for ever."""

    def __init__(self) -> None:
        super().__init__()
        self.damaged = threading.Event()

    def apply(self, act: Any, path: Any) -> Any:
        if Path(path).name != "damaged.nc":
            return super().apply(act, path)
        self.damaged.set()
        return super().apply(acts.compute, path)


def test_a_damaged_file_holds_up_neither_the_page_nor_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its reader computes for as long as the test likes, and is then ended as its own timer does it."""
    monkeypatch.setattr(process, "PATIENCE", 10.0 * PATIENCE)
    (tmp_path / "note.nc").write_bytes(b"no recording")
    monkeypatch.setenv("PYTHONPATH", str(Path(acts.__file__).parents[1]), prepend=os.pathsep)
    reader = Watched()
    monkeypatch.setattr(server, "Reader", lambda modules: reader)
    with client_of(create_app(tmp_path), **ME) as client:
        client.get("/api/identify/recordings").raise_for_status()  # its process is there
        (tmp_path / "damaged.nc").write_bytes(b"12345")
        running(client)
        found: list[list[dict]] = []
        watcher = threading.Thread(
            target=lambda: found.append(
                httpx.get(f"{client.base_url}/api/identify/recordings", timeout=PATIENCE).json()
            )
        )
        watcher.start()
        assert reader.damaged.wait(PATIENCE)
        time.sleep(1.5)
        assert watcher.is_alive(), "it is being read"
        assert client.get("/static/icon.svg").status_code == 200
        stop(client)
        assert watcher.is_alive(), "neither has waited for it"
        os.kill(reader._fence._process.pid, signal.SIGPROF)
        watcher.join(PATIENCE)
        problems = {one["name"]: one["problem"] for one in found[0]}
        assert "could not be read within" in problems["damaged.nc"]
        assert "note.nc" in problems
        again = client.post("/recordings/show", json={"name": "damaged.nc"})
        assert again.status_code == 400, "it is not tried again"


def test_pipes_and_large_files_are_refused_at_once(panel: Panel) -> None:
    os.mkfifo(panel.folder / "pipe.yaml")
    os.mkfifo(panel.folder / "pipe.csv")
    (panel.folder / "large.yaml").write_text("title: x\n" + "# 0123456789\n" * 3_000_000)
    bomb = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefghij", "bcdefghijk", strict=False)
    )
    (panel.folder / "bomb.yaml").write_text(bomb)
    (panel.folder / "deep.yaml").write_text("x: " + "[" * 50_000 + "]" * 50_000)
    for name in ("a.toml", "parameters/b.toml"):
        (panel.folder / name).parent.mkdir(exist_ok=True)
        (panel.folder / name).write_text("a." * 40_000 + "a = 1")
    with connected(panel, {"X-Client": CLIENT}) as client:
        expected = {
            "pipe": "no plain file",
            "large": "up to 1 MB",
            "bomb": "more than 100,000",
            "deep": "deep",
        }
        for name, said in expected.items():
            with ThreadPoolExecutor(45) as pool:
                ask = [
                    pool.submit(client.post, "/bench/load", json={"name": f"{name}.yaml"}) for _ in range(45)
                ]
                answers = [one.result() for one in ask]
            assert {one.status_code for one in answers} == {400}
            assert said in answers[0].json()["error"]
        answer = client.get("/recordings/export", params={"name": "pipe.csv"})
        assert answer.status_code == 400
        for path in ("/bench/rigs", "/api/explore/choices", "/history"):
            began = time.monotonic()
            assert client.get(path).status_code == 200
            assert time.monotonic() - began < 10.0


def test_end_stops_count_from_home_over_runs_and_restarts(tmp_path: Path) -> None:
    seen = []
    for _ in range(2):  # the second server is another one, on the same folder
        with client_of(create_app(tmp_path), **ME) as client:
            change(client, *FAST.values()).raise_for_status()
            change(client, ["limits", "max_position"], "30 um").raise_for_status()
            for last in (["done", "failed"], ["failed", "failed"])[len(seen) // 2]:
                seen.append(ran(client, "/bench/start", {"runs": ["forward"]}, last)["position"])
                if last == "failed":
                    refused = client.post("/bench/start", json={"runs": ["forward"]})
                    assert "not acknowledged: the end-effector is at" in refused.text
                    acknowledge(client)
            back = ran(client, "/bench/home", {})["position"] if len(seen) == 4 else None
    assert 15e-6 < seen[0] < 25e-6
    assert max(seen) < 34e-6, "a block beyond the stop, no more"
    assert back is not None
    assert abs(back) < 5e-6, "from beyond an end stop there is a way home"
    outcomes = [
        open_recording(path).attrs["outcome"] for path in tmp_path.glob("recordings/*/unfinished/*.nc")
    ]
    assert len(outcomes) == 3
    assert all("beyond the end stop at 30 µm" in one for one in outcomes)


def test_repeats_walk_on_and_are_stopped(bench: httpx.Client, folder: Path) -> None:
    change(bench, ["limits", "max_position"], "50 um").raise_for_status()
    change(bench, ["runs", 1, "repeats"], 4).raise_for_status()
    ran(bench, "/bench/start", {"runs": ["forward"]}, "failed")
    assert sorted(path.name for path in folder.glob("recordings/*/*.nc")) == [
        "forward_1.nc",
        "forward_2.nc",
    ]


def test_starts_within_a_second_have_a_folder_each(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        made = [*pool.map(lambda _: new_folder(Folder(tmp_path), "walk"), range(40))]
    assert len({*made}) == 40
    assert {*os.listdir(tmp_path / "recordings")} == {one.name for one in made}


def test_of_starts_at_once_one_begins(
    bench: httpx.Client, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []
    all_asked, record = threading.Event(), running_module.record_experiment

    def recorded(*given: Any, **options: Any) -> Any:
        assert all_asked.wait(PATIENCE)
        return record(*given, **options)

    monkeypatch.setattr(running_module, "record_experiment", recorded)
    with ThreadPoolExecutor(5) as pool:
        change(bench, ["runs", 1, "capture", "length"], "0.15 s").raise_for_status()

        def start(_: int) -> httpx.Response:
            return bench.post("/bench/start", json={"runs": ["forward"]})

        for _ in range(3):
            with streaming(bench) as stream:
                heard(stream, "run")
                all_asked.clear()
                answers = [*pool.map(start, range(5))]
                all_asked.set()
                begun += [one.json()["folder"] for one in answers if one.status_code == 200]
                refused = [one.json()["error"] for one in answers if one.status_code != 200]
                assert {*refused} == {"a run is going on: stop it first"}
                while heard(stream, "run", PATIENCE)["phase"] not in ("done", "stopped", "failed"):
                    pass
    assert len({*begun}) == len(begun) == 3
    assert sorted(os.listdir(folder / "recordings")) == sorted(name.split("/")[1] for name in begun)
    for name in begun:
        assert (folder / name / "forward.nc").is_file()
        assert "kept" not in (folder / name / "experiment.log").read_text()


def test_a_watcher_cannot_pass_for_the_holder(tmp_path: Path) -> None:
    with (
        client_of(create_app(tmp_path)) as client,
        streaming(client, client="a secret of one page") as holding,
    ):
        you = heard(holding, "hello")["you"]
        holding.send(json.dumps({"kind": "ask_control"}))
        while heard(holding, "control")["holder"] != you:
            pass
        with streaming(client, client="a watcher") as watching:
            told = [watching.recv(timeout=60.0) for _ in range(6)]
            assert not any("a secret" in one for one in told if isinstance(one, str))
            holder = next(
                json.loads(one)["holder"] for one in told if isinstance(one, str) and '"control"' in one
            )
            assert holder == you
            for said in (holder, "a watcher"):
                answer = client.post("/bench/home", headers={"X-Client": said})
                assert "another page controls" in answer.json()["error"]
            watching.send(json.dumps({"kind": "hand_over"}))
        answer = client.post(
            "/bench/set", json={"path": ["title"], "value": "Mine"}, headers={"X-Client": holder}
        )
        assert answer.status_code == 400
        own = {"X-Client": "a secret of one page"}
        assert (
            client.post("/bench/set", json={"path": ["title"], "value": "Mine"}, headers=own).status_code
            == 200
        )


def test_connections_that_say_nothing_are_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "PATIENCE", 1.0)
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 100)
    app = create_app(tmp_path)
    with serving(app, server_config(app)) as port, ExitStack() as at_last:
        half = [
            b"",
            b"GET / HTTP/1.1\r\nHost: 127.0",
            b"POST /bench/stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n{",
        ]
        links = [
            at_last.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60.0))
            for _ in range(200)
        ]
        for i, link in enumerate(links):
            link.sendall(half[i % 3])
        there = httpx.get(f"http://127.0.0.1:{port}/static/icon.svg", timeout=60.0)
        assert there.status_code == 200, "there is room"
        assert all(_last(link) == b"" for link in links)


def test_an_answer_that_takes_the_server_long_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine a list of recordings took more than the minute that clients have to take it in."""
    monkeypatch.setattr(connections, "PATIENCE", 0.05)
    app = FastAPI()

    @app.get("/slow")
    def slow() -> str:
        time.sleep(2.0)
        return "made"

    with serving(app, server_config(app)) as port:
        assert httpx.get(f"http://127.0.0.1:{port}/slow", timeout=60.0).json() == "made"


def _last(link: socket.socket) -> bytes:
    """What comes last, b"" where the other side has ended it."""
    try:
        while part := link.recv(4096):
            pass
    except ConnectionResetError:
        part = b""
    return part


def test_wrong_tokens_are_answered_slowly(tmp_path: Path) -> None:
    token = "a-token-of-some-length"
    with serving(create_app(tmp_path, token=token)) as port:
        begun = time.monotonic()
        tried: list[int] = []

        def guess(which: int) -> None:
            link = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
            while True:  # once at least
                link.request("GET", "/recordings", headers={"Authorization": f"Bearer {which}-{len(tried)}"})
                answer = link.getresponse()
                answer.read()
                tried.append(answer.status)
                if time.monotonic() > begun + 3.0:
                    break
            link.close()

        threads = [threading.Thread(target=guess, args=(i,)) for i in range(20)]
        for one in threads:
            one.start()
        for one in threads:
            one.join()
        taken = time.monotonic() - begun
        assert 5 <= tried.count(401) <= 5 * (taken + 1.0), "five a second are looked at"
        assert set(tried) <= {401, 429}
        time.sleep(1.1)
        headers = {"Authorization": f"Bearer {token}"}
        right = httpx.get(f"http://127.0.0.1:{port}/recordings", headers=headers, timeout=PATIENCE)
        assert right.status_code == 200


def test_a_panel_that_is_killed_or_frozen_leaves_no_voltage(tmp_path: Path) -> None:
    """The rig's process goes on without it, ramps to 0 V and says why; what was recorded is kept."""
    for sign in (signal.SIGKILL, signal.SIGSTOP):
        panel = Panel(tmp_path)
        try:
            with connected(panel, ME) as client:
                if sign == signal.SIGSTOP:
                    acknowledge(client)  # the panel was killed
                running(client)
                time.sleep(0.3)
                rig = json.loads((tmp_path / ".rig" / "rig.json").read_text())["pid"]
                home = tmp_path / ".rig" / "home.json"
                before = home.stat().st_mtime_ns if home.exists() else 0
                panel.process.send_signal(sign)
            end = time.monotonic() + PATIENCE
            while not home.exists() or home.stat().st_mtime_ns == before:  # written when a run has ended
                assert time.monotonic() < end
                time.sleep(0.01)
            os.kill(rig, 0)
        finally:
            panel.process.kill()
            panel.end()
    with client_of(create_app(tmp_path), **ME):
        names = {path.name for path in tmp_path.glob("recordings/*/unfinished/*.nc")}
    assert names == {"walk.nc"}
    assert len(list(tmp_path.glob("recordings/*/unfinished/*.nc"))) == 2


def test_the_history_of_the_folder(bench: httpx.Client) -> None:
    ran(bench, "/bench/start", {"runs": ["forward"]})
    change(bench, ["limits", "max_position"], "25 um").raise_for_status()
    ran(bench, "/bench/start", {"runs": ["forward"]}, "failed")
    listed = bench.get("/recordings").json()
    found = bench.get("/history", params={"search": "forward"}).json()["rows"]
    stopped = bench.get("/history", params={"outcome": "bad"}).json()["rows"]
    assert bench.get("/history", params={"search": "%00'"}).json()["rows"] == []
    assert [one["unfinished"] for one in listed] == [True, False]
    assert [one["outcome"].split(":")[0] for one in found] == ["stopped", "complete"]
    assert [one["name"] for one in stopped] == [listed[0]["name"]]
