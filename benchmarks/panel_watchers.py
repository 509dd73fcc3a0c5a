"""Clients of the panel's benchmark that cost next to nothing: many pages that watch the stream, and others
that keep a connection and ask for a file now and then, in a process of their own."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import struct
import time
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

SLOW = 3.0  # s between the requests of a client that only keeps its connection; the server waits for 5
_FILES = ("/", "/static/style.css", "/bench/experiments", "/recordings")


class Watcher(asyncio.Protocol):
    """A page that takes everything. `arrived` are the times of the blocks of each run, `fell` counts how
    often it was let go."""

    def __init__(self, number: int) -> None:
        self.number, self.fell, self.octets = number, 0, 0
        self.arrived: dict[int, list[float]] = {}
        self._data = bytearray()
        self._open = False
        self.lost = asyncio.Event()

    def connection_made(self, transport: Any) -> None:
        self._transport, self._open = transport, False
        self._data.clear()
        self.lost.clear()
        key = base64.b64encode(os.urandom(16)).decode()
        host = "{}:{}".format(*transport.get_extra_info("peername"))
        transport.write(
            f"GET /stream HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.set()

    def data_received(self, data: bytes) -> None:
        now = time.monotonic()
        self.octets += len(data)
        self._data += data
        if not self._open:
            end = self._data.find(b"\r\n\r\n")
            if end < 0:
                return
            assert self._data.startswith(b"HTTP/1.1 101"), bytes(self._data[:60])
            del self._data[: end + 4]
            self._open = True
            self._say(1, json.dumps({"client": f"watcher {self.number}"}).encode())
        while (frame := self._frame()) is not None:
            kind, content = frame
            if kind == 9:
                self._say(10, content)
            elif kind == 8:
                self._transport.close()
            elif kind == 2:
                header = json.loads(content[4 : 4 + int.from_bytes(content[:4], "little")])
                if header["kind"] == "block":
                    self.arrived.setdefault(header["trace"], []).append(now)

    def _frame(self) -> tuple[int, bytes] | None:
        """The next whole frame: its kind and content; servers do not mask them."""
        if len(self._data) < 2:
            return None
        length, begin = self._data[1], 2
        if length >= 126:
            begin = 4 if length == 126 else 10
            if len(self._data) < begin:
                return None
            length = int.from_bytes(self._data[2:begin], "big")
        if len(self._data) < begin + length:
            return None
        kind, content = self._data[0] & 15, bytes(self._data[begin : begin + length])
        del self._data[: begin + length]
        return kind, content

    def _say(self, kind: int, content: bytes) -> None:
        mask = os.urandom(4)
        masked = bytes(one ^ mask[i % 4] for i, one in enumerate(content))
        self._transport.write(struct.pack("!BB", 128 | kind, 128 | len(content)) + mask + masked)


async def _watching(port: int, one: Watcher) -> None:
    while True:
        try:
            await asyncio.get_running_loop().create_connection(lambda: one, "127.0.0.1", port)
            await one.lost.wait()
        except OSError:
            await asyncio.sleep(1.0)
        one.fell += 1


async def _keeping(port: int, number: int, answers: list[int]) -> None:
    """An HTTP connection that is kept, and used every few seconds; `answers`: right, and lost ones."""
    await asyncio.sleep(SLOW * number / 100)
    while True:
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            for name in _FILES * 10_000:
                request = f"GET {name} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n"
                writer.write(request.encode())
                head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 30.0)
                length = next(
                    int(line.split(b":")[1])
                    for line in head.lower().split(b"\r\n")
                    if line.startswith(b"content-length")
                )
                await reader.readexactly(length)
                answers[0 if b" 200 " in head[:20] else 1] += 1
                await asyncio.sleep(SLOW)
        except (OSError, EOFError, TimeoutError, asyncio.IncompleteReadError):
            answers[1] += 1
            await asyncio.sleep(0.2)


def watch(port: int, watchers: int, keepers: int, ask: Connection) -> None:
    """All of them, until something comes through the connection; then their figures go back."""

    async def everything() -> dict[str, Any]:
        pages = [Watcher(i) for i in range(watchers)]
        answers = [0, 0]
        tasks = [asyncio.create_task(_watching(port, one)) for one in pages]
        tasks += [asyncio.create_task(_keeping(port, i, answers)) for i in range(keepers)]
        while not ask.poll():
            await asyncio.sleep(0.2)
        for task in tasks:
            task.cancel()
        return {
            "blocks": [frames(one) for one in pages],
            "fell": sum(one.fell for one in pages),
            "octets": sum(one.octets for one in pages),
            "answers": answers,
        }

    ask.send(asyncio.run(everything()))


def frames(one: Watcher) -> list[tuple[float, float, int, float]]:
    """Of each run that it saw 2 s of: when it began and ended, s of the machine's clock, frames, and the
    longest gap, s."""
    found = []
    for arrived in one.arrived.values():
        if arrived[-1] - arrived[0] > 2.0:
            gap = float(np.diff(arrived).max())
            found.append((arrived[0], arrived[-1], len(arrived) - 1, gap))
    return found
