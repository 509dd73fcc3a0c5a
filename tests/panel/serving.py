"""A real server in a thread of this process, and clients of it, for tests that need no browser."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI
from websockets.sync.client import ClientConnection, connect


@contextmanager
def serving(app: FastAPI) -> Iterator[int]:
    """Serve an application on a free port of the loopback address; gives the port."""
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=2))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield listening.getsockname()[1]
    finally:
        server.should_exit = True
        thread.join(30)
        listening.close()
        assert not thread.is_alive()


@contextmanager
def client_of(app: FastAPI, host: str = "", **headers: str) -> Iterator[httpx.Client]:
    """A client of an application that is served for it; `host` is what it calls the server."""
    with serving(app) as port:
        shown = {"Host": f"{host}:{port}"} if host else {}
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", headers=shown | headers, timeout=60) as client:
            yield client


@contextmanager
def streaming(
    client: httpx.Client, headers: dict[str, str] | None = None, **said: Any
) -> Iterator[ClientConnection]:
    """The stream of a server, after the page said who it is."""
    address = str(client.base_url).replace("http", "ws") + "/stream"
    with connect(address, additional_headers=headers, proxy=None, max_size=2**26) as stream:
        stream.send(json.dumps({"client": "test", **said}))
        yield stream


def heard(stream: ClientConnection, kind: str, timeout: float = 60.0) -> dict[str, Any]:
    """The next JSON message of a kind; others are passed over."""
    end = time.monotonic() + timeout
    while True:
        message = stream.recv(timeout=max(end - time.monotonic(), 0.01))
        if isinstance(message, str) and (found := json.loads(message))["kind"] == kind:
            return found
