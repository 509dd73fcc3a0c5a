"""The page's only WebSocket: messages in JSON in both directions, and blocks of float32 to the page.

A binary message is the length of its header (4 bytes, little endian), the header (JSON, padded with spaces to
a multiple of 4 bytes), and the numbers. A message to all pages is encoded once.
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
# Largest number of messages that wait for a page. A page that is further behind is disconnected; it connects
# again and receives the present state.
MOST_WAITING = 400
MOST_CLIENTS = 200  # largest number of pages connected at the same time
LONGEST_MESSAGE = 65536  # largest length of a message from a page, characters


class Client:
    """One connected page with its queue of messages.

    `identity` is the page's secret, and `name` a name that the page gave itself. If too many messages wait,
    `lagging` becomes True and `waiting` contains None alone, at which the page is disconnected.
    """

    def __init__(self, identity: str, name: str) -> None:
        self.identity, self.name = identity, name
        self.waiting: asyncio.Queue[Message | None] = asyncio.Queue()
        self.lagging = False

    def put(self, message: Message) -> None:
        """Queue a message for the page; may be called in the event loop only.

        If `MOST_WAITING` messages wait already, the page is disconnected instead.
        """
        if self.waiting.qsize() >= MOST_WAITING:
            self.lagging = True
            while not self.waiting.empty():
                self.waiting.get_nowait()
            self.waiting.put_nowait(None)
        elif not self.lagging:
            self.waiting.put_nowait(message)


class Hub:
    """Stream of messages to and from all connected pages.

    Attributes:
        clients: the connected pages.
        greetings: functions that return the first messages for a page. They take the page and its first
            message; {} if the page asks for a new greeting.
        hears: function for each kind of message from pages; it takes the page and the message. A page with
            the role "watch" can send only the kinds in `roles.SAID_BY_ALL`.
        changed: functions without arguments that are called when a page connects or leaves.

    All these functions run in the event loop, so they must return fast.
    """

    def __init__(self) -> None:
        self.clients: set[Client] = set()
        self.greetings: list[Callable[[Client, dict[str, Any]], Iterable[Message]]] = []
        self.hears: dict[str, Callable[[Client, dict[str, Any]], None]] = {}
        self.changed: list[Callable[[], None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._counting = threading.Lock()
        self._under_way = 0  # number of messages not yet in the queues of the pages

    @property
    def behind(self) -> bool:
        """Return True if the event loop has not yet passed on a message to the queues of the pages.

        A message that can be combined with the next one should then wait, so that an urgent one, such as a
        stop, is not delayed.
        """
        return self._under_way > 0

    def tell(self, kind: str, **fields: Any) -> None:
        """Send a message to every page, from any thread, as a JSON object with "kind" and the `fields`."""
        self.send(json.dumps({"kind": kind, **fields}))

    def send(self, message: Message) -> None:
        """Send a text or binary message to every page, from any thread. Without any page yet it is
        discarded."""
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
        # There is no await between the greeting and the registration, so every message reaches the page
        # exactly once: in the greeting or after it.
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
    """Return the message in a text from a page; {} if it is not a JSON object, or longer than
    `LONGEST_MESSAGE`."""
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
        return  # the page has left; the reading loop ends, too
