"""How the panel ends, whatever it is doing: the real command, without a browser."""

from __future__ import annotations

import json
import select
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path

import httpx
import pytest
import uvicorn
from fastapi import FastAPI
from stickslip._jit import _package_cache

from stickslip.panel.connections import server_config

from .conftest import PATIENCE, Panel
from .serving import heard, streaming
from .test_first_start import kept

ELEMENT = {"stiffness": 1e5, "strength": 0.05}


def children(process: int) -> dict[int, str]:
    """Processes that a process started, and their commands."""
    found = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(status.read_text().rpartition(")")[2].split()[1]) == process:
                found[int(status.parent.name)] = (status.parent / "cmdline").read_text().replace("\0", " ")
    return found


@contextmanager
def ended(panel: Panel) -> Iterator[None]:
    """Whatever happens, it does not stay."""
    try:
        yield
    finally:
        panel.process.kill()
        panel.process.wait()


def test_ctrl_c_ends_it_while_a_request_is_compiling(tmp_path: Path) -> None:
    """Python would wait until that is done, for a minute on a busy machine, and keep what was compiled."""
    kernels = tmp_path / "kernels"
    if _package_cache().is_dir():
        shutil.copytree(_package_cache(), kernels / _package_cache().name)
    panel = Panel(tmp_path / "panel", kernels=kernels)
    asking = HTTPConnection("127.0.0.1", int(panel.port))
    base = panel.url.rstrip("/")
    with (
        closing(asking),
        ended(panel),
        httpx.Client(base_url=base, timeout=60) as client,
        streaming(client) as stream,
    ):
        while "fits with LuGre" not in heard(stream, "readiness")["preparing"]:
            pass
        while heard(stream, "readiness")["preparing"]:
            pass
        fits = [number for number, said in children(panel.process.pid).items() if "spawn_main" in said]
        assert fits
        before = kept(kernels)
        elements = {f"{name}_{i}": value for i in range(1, 10) for name, value in ELEMENT.items()}
        law = {"law": "MaxwellSlip", "friction": elements}  # of nine elements: a type of its own
        state = {"set": "kang2007", "duration": 0.1, "shape": "Sawtooth", **law}
        state |= {"waveform": {"amplitude": 65, "frequency": 20}}
        asking.request("POST", "/api/explore/steps", json.dumps(state), {"Content-Type": "application/json"})
        assert not select.select([asking.sock], [], [], 1.0)[0], asking.getresponse().read()
        assert panel.end() == 0
    assert kept(kernels) == before
    end = time.monotonic() + PATIENCE
    while any(Path(f"/proc/{number}").exists() for number in fits):
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
