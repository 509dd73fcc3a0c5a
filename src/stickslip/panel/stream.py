"""The page's only WebSocket: JSON in both directions, and blocks of float32 to the page.

A binary message is the length of its header (4 bytes, little endian), the header (JSON, padded with spaces to
a multiple of 4), and the numbers. A message to all pages is encoded once.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterable
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from ..gate.errors import GateError
from ..gate.text import load_json
from .asking import asked_by, asking, shown
from .packing import packed as packed
from .roles import SAID_BY_ALL, enough

Message = str | bytes
# Most messages that wait for a page. A page that is further behind is disconnected; it connects again and
# catches up.
MOST_WAITING = 400
MOST_CLIENTS = 200  # most pages that are connected at a time
LONGEST_MESSAGE = 65536  # characters of a message from a page


class Client:
    """One connected page with its queue of messages.

    `identity` is the page's secret, `name` its name for people; `waiting` ends with None if the page is too
    slow (`lagging`).
    """

    def __init__(self, identity: str, name: str) -> None:
        self.identity, self.name = identity, name
        self.waiting: asyncio.Queue[Message | None] = asyncio.Queue()
        self.lagging = False

    def put(self, message: Message) -> None:
        """Queue a message for the page; to be called in the event loop only."""
        if self.waiting.qsize() >= MOST_WAITING:
            self.lagging = True
            while not self.waiting.empty():
                self.waiting.get_nowait()
            self.waiting.put_nowait(None)
        elif not self.lagging:
            self.waiting.put_nowait(message)


class Hub:
    """All connected pages, to which messages are sent.

    Attributes:
        clients: the connected pages.
        greetings: functions that return the first messages for a page, also when it asks for them again. They
            get the page and its first message ({} if it asks again).
        hears: handler of each kind of message from a page; it gets the page and the message.
        changed: functions that are called when a page connects or leaves.

    All these functions run in the event loop and must be fast.
    """

    def __init__(self) -> None:
        self.clients: set[Client] = set()
        self.greetings: list[Callable[[Client, dict[str, Any]], Iterable[Message]]] = []
        self.hears: dict[str, Callable[[Client, dict[str, Any]], None]] = {}
        self.changed: list[Callable[[], None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._counting = threading.Lock()
        self._under_way = 0  # messages that the event loop has not sent yet

    @property
    def behind(self) -> bool:
        """Return True if the event loop has not sent the last message yet.

        Messages that can be combined with the next one should wait then; otherwise a stop waits until all of
        them are written to every page.
        """
        return self._under_way > 0

    def tell(self, kind: str, **fields: Any) -> None:
        """Send a JSON message with its kind and fields to every page, from any thread."""
        self.send(json.dumps({"kind": kind, **fields}))

    def send(self, message: Message) -> None:
        """Send a message, text or binary, to every page, from any thread; nothing before the first page."""
        if self._loop is not None and not self._loop.is_closed():
            with self._counting:
                self._under_way += 1
            self._loop.call_soon_threadsafe(self._put, message)

    def _put(self, message: Message) -> None:
        with self._counting:
            self._under_way -= 1
        for client in self.clients:
            client.put(message)

    async def serve(self, socket: WebSocket) -> None:
        """Exchange messages with one page through its WebSocket until it leaves."""
        self._loop = asyncio.get_running_loop()
        await socket.accept()
        if len(self.clients) >= MOST_CLIENTS:
            await socket.close(1013, f"{MOST_CLIENTS} pages are connected already")
            return
        try:
            said = _said(await asyncio.wait_for(socket.receive_text(), 10.0))
        except (TimeoutError, WebSocketDisconnect, KeyError):
            return
        client = Client(str(said.get("client", ""))[:64], str(said.get("name", ""))[:40])
        # No await in between: a message is sent either in the greeting or after it, never twice.
        self._greet(client, said)
        self.clients.add(client)
        self._changed()
        writing = asyncio.create_task(_write(socket, client))
        try:
            while True:
                message = _said(await socket.receive_text())
                if message.get("kind") == "greet":
                    self._greet(client, {})
                act = self.hears.get(str(message.get("kind")))
                if act is not None and (message["kind"] in SAID_BY_ALL or enough(asking().role, "operate")):
                    with asked_by(asking()._replace(page=shown(client.identity))):
                        act(client, message)
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            self.clients.discard(client)
            writing.cancel()
            self._changed()

    def _greet(self, client: Client, said: dict[str, Any]) -> None:
        for greet in self.greetings:
            for message in greet(client, said):
                client.put(message)

    def _changed(self) -> None:
        for call in self.changed:
            call()


def _said(text: str) -> dict[str, Any]:
    """Return the message of a page; empty if it is not a JSON object or is too long."""
    if len(text) > LONGEST_MESSAGE:
        return {}
    try:
        found = load_json(text, "message")
    except GateError:
        return {}
    return found if isinstance(found, dict) else {}


async def _write(socket: WebSocket, client: Client) -> None:
    try:
        while True:
            message = await client.waiting.get()
            if message is None:
                await socket.close(1013, "too slow: connect again and catch up")
                return
            if isinstance(message, str):
                await socket.send_text(message)
            else:
                await socket.send_bytes(message)
    except (WebSocketDisconnect, RuntimeError):
        return  # the page left; its reader ends too
