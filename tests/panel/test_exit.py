"""How the panel ends, whatever it is doing: the real command, without a browser."""

from __future__ import annotations

import json
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path

import httpx
import psutil
import pytest
import uvicorn
from fastapi import FastAPI

from stickslip.panel.connections import server_config

from .conftest import PATIENCE, Panel
from .serving import streaming

# Maxwell slip of 40 elements that slip one by one: a map of its steps takes half an hour of a processor.
SLOW_LAW = {f"stiffness_{i}": 1.75e3 * 1.12**i for i in range(1, 41)}  # N/m
SLOW_LAW |= {f"strength_{i}": 0.0135 for i in range(1, 41)}  # N


def children(process: int) -> dict[int, str]:
    """Processes that a process started, and their commands."""
    found = {}
    for child in psutil.Process(process).children():
        with suppress(psutil.NoSuchProcess):
            found[child.pid] = " ".join(child.cmdline())
    return found


@contextmanager
def ended(panel: Panel) -> Iterator[None]:
    """Whatever happens, it does not stay."""
    try:
        yield
    finally:
        panel.process.kill()
        panel.process.wait()


def process_of_fits(panel: Panel) -> int:
    """Number of the process in which fits run, once it is there."""
    end = time.monotonic() + PATIENCE
    while True:
        for number, said in children(panel.process.pid).items():
            if "spawn_main" in said:
                return number
        assert time.monotonic() < end, "no process of fits starts with the Identify page"
        time.sleep(0.01)


def test_ctrl_c_ends_it_while_a_request_is_computed(tmp_path: Path) -> None:
    """Python would wait for the thread that computes, here for longer than `Panel.end` does."""
    panel = Panel(tmp_path / "panel")
    asking = HTTPConnection("127.0.0.1", int(panel.port))
    base = panel.url.rstrip("/")
    with (
        closing(asking),
        ended(panel),
        httpx.Client(base_url=base, timeout=60) as client,
        streaming(client),
    ):
        client.get("/api/identify/state").raise_for_status()
        fits = process_of_fits(panel)
        asked = {"set": "kang2007", "law": "MaxwellSlip", "friction": SLOW_LAW, "voltage": 100.0}
        asking.request("POST", "/api/design/map", json.dumps(asked), {"Content-Type": "application/json"})
        assert not select.select([asking.sock], [], [], 1.0)[0], asking.getresponse().read()
        assert panel.end() == 0
    end = time.monotonic() + PATIENCE
    while Path(f"/proc/{fits}").exists():
        assert time.monotonic() < end, "the fits' process goes on"
        time.sleep(0.01)


def test_a_request_that_is_given_up_at_the_end_shows_no_trace(capsys: pytest.CaptureFixture[str]) -> None:
    app, begun, done = FastAPI(), threading.Event(), threading.Event()

    @app.get("/")
    def waits() -> None:
        begun.set()
        done.wait(60.0)

    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(server_config(app))
    serving = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    serving.start()
    with closing(HTTPConnection(*listening.getsockname())) as asking:
        asking.request("GET", "/")
        assert begun.wait(60.0)
        server.should_exit = True
        serving.join(60.0)
    done.set()
    assert not serving.is_alive()
    said = capsys.readouterr().err
    assert "Cancel 1 running task" in said
    assert "Traceback" not in said
