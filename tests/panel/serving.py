"""A real server in a thread of this process, and clients of it, for tests that need no browser."""

from __future__ import annotations

import json
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI
from websockets.sync.client import ClientConnection, connect

from stickslip.panel.document import DEFAULT

ME = {"X-Client": "test"}


@contextmanager
def serving(app: FastAPI, config: uvicorn.Config | None = None) -> Iterator[int]:
    """Serve an application on a free port of the loopback address, as configured; gives the port."""
    listening = socket.create_server(("127.0.0.1", 0))
    # A connection that says nothing is kept: ended after some seconds, it may be just when a request comes.
    plain = uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=2, timeout_keep_alive=3600)
    server = uvicorn.Server(config or plain)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield listening.getsockname()[1]
    finally:
        server.should_exit = True
        thread.join(300)
        listening.close()
        assert not thread.is_alive()


@contextmanager
def client_of(app: FastAPI, host: str = "", **headers: str) -> Iterator[httpx.Client]:
    """A client of an application that is served for it; `host` is what it calls the server."""
    with serving(app) as port:
        shown = {"Host": f"{host}:{port}"} if host else {}
        with httpx.Client(
            base_url=f"http://127.0.0.1:{port}", headers=shown | headers, timeout=300
        ) as client:
            yield client


def emptied(client: httpx.Client, folder: Path) -> None:
    """Leave what a newcomer finds: an empty folder, the experiment as it comes, home here, no alarm. But the
    rig waits longer for a panel that a busy machine gives no time."""
    limits = "limits: {"
    text = DEFAULT.read_text(encoding="utf-8")
    assert limits in text
    (folder / DEFAULT.name).write_text(text.replace(limits, f"{limits}watchdog: 300 s, "), encoding="utf-8")
    client.post("/bench/stop").raise_for_status()
    end = time.monotonic() + 300.0
    # A run ends meanwhile, or a page that is gone loses control.
    while not (loaded := client.post("/bench/load", json={"name": DEFAULT.name})).is_success:
        assert time.monotonic() < end, loaded.text
        time.sleep(0.2)
    client.post("/bench/home_here").raise_for_status()
    client.post("/interlock/acknowledge", json={"why": "the next test"})  # refused where there is no fault
    permit = {"name": "operators", "given": True, "why": "the next test"}
    client.post("/interlock/permit", json=permit).raise_for_status()
    client.post("/statistics/alarms", json={"alarms": []}).raise_for_status()
    swept(folder)


def swept(folder: Path) -> None:
    """Remove everything from a panel's folder but what its rig, which goes on, keeps there."""
    for one in folder.iterdir():
        if one.name != ".rig":
            shutil.rmtree(one) if one.is_dir() and not one.is_symlink() else one.unlink()


@contextmanager
def streaming(
    client: httpx.Client, headers: dict[str, str] | None = None, /, **said: Any
) -> Iterator[ClientConnection]:
    """The stream of a server, after the page said who it is."""
    address = str(client.base_url).replace("http", "ws") + "/stream"
    with connect(address, additional_headers=headers, proxy=None, max_size=2**26) as stream:
        stream.send(json.dumps({"client": "test", **said}))
        yield stream


def heard(stream: ClientConnection, kind: str, timeout: float = 300.0) -> dict[str, Any]:
    """The next JSON message of a kind; others are passed over."""
    end = time.monotonic() + timeout
    while True:
        message = stream.recv(timeout=max(end - time.monotonic(), 0.01))
        if isinstance(message, str) and (found := json.loads(message))["kind"] == kind:
            return found


class Link:
    """A network between pages and a server, that can be cut and mended; `port` is its near end."""

    def __init__(self, server: int) -> None:
        self._server, self.port = server, 0
        self._open: list[socket.socket] = []
        self.mend()

    def mend(self) -> None:
        """Let connections through, from now on."""
        self._listening = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listening.getsockname()[1]
        threading.Thread(target=self._accept, args=(self._listening,), daemon=True).start()

    def cut(self) -> None:
        """End all connections, and refuse new ones."""
        for one in (self._listening, *self._open):
            with suppress(OSError):  # it has ended already
                one.shutdown(socket.SHUT_RDWR)
            one.close()
        self._open = []

    def _accept(self, listening: socket.socket) -> None:
        while True:
            try:
                near, _ = listening.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self._server))
            self._open += [near, far]
            for ends in ((near, far), (far, near)):
                threading.Thread(target=_pump, args=ends, daemon=True).start()


def _pump(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            target.sendall(data)
    with suppress(OSError):
        target.shutdown(socket.SHUT_WR)
