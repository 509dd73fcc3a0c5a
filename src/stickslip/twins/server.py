"""The TCP server of a twin: one program at a time, as the controllers have it; lines and frames of bounded
length."""

from __future__ import annotations

import socketserver
import threading
from contextlib import suppress
from typing import Any, Protocol

from ..rig.protocols import RigError

IDLE = 600.0  # s until a silent program is let go


class HangUp(Exception):
    """The twin ends the connection: what came cannot be understood, or no more is wanted."""


class Session(Protocol):
    """One connection; `greeting` is what the device says first."""

    greeting: bytes

    def feed(self, data: bytes) -> bytes:
        """Take what came, in pieces of any length; the answers to what is complete.

        Raises:
            HangUp: the connection is to end.
        """
        ...


class Twin(Protocol):
    """A controller: `port` is where its maker has it."""

    port: int

    def session(self) -> Session:
        """A new connection."""
        ...

    def leave(self) -> None:
        """The program has gone: motions without an end of their own stop."""
        ...


class TwinServer(socketserver.ThreadingTCPServer):
    """Serves a twin.

    Args:
        twin: what is served.
        host: the address to bind to; only this machine can reach the loopback address.
        port: 0 takes a free one; `server_address` says which.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, twin: Twin, host: str = "127.0.0.1", port: int = 0) -> None:
        self.twin, self.held = twin, threading.Lock()
        super().__init__((host, port), _Connection)


class _Connection(socketserver.BaseRequestHandler):
    server: TwinServer  # type: ignore[assignment]
    request: Any

    def handle(self) -> None:
        """Answer until the program leaves; a second one finds the connection closed."""
        if not self.server.held.acquire(timeout=1.0):  # the one before may be about to leave
            return
        try:
            with suppress(OSError, HangUp, RigError):
                self.request.settimeout(IDLE)
                session = self.server.twin.session()
                self.request.sendall(session.greeting)
                while data := self.request.recv(65536):
                    answer = session.feed(data)
                    if answer:
                        self.request.sendall(answer)
        finally:
            self.server.twin.leave()
            self.server.held.release()


class Lines:
    """Cuts what comes into lines, at CR, LF or both (and the NUL that telnet puts after CR)."""

    def __init__(self, longest: int = 65536) -> None:
        self._rest, self._longest, self._after_cr = b"", longest, False

    def feed(self, data: bytes) -> list[str]:
        """The complete lines.

        Raises:
            HangUp: a line is too long.
        """
        data = data.replace(b"\x00", b"")
        if not data:
            return []
        if self._after_cr:
            data = data.removeprefix(b"\n")
        self._after_cr = data.endswith(b"\r")
        *lines, self._rest = (self._rest + data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")).split(b"\n")
        if max(len(self._rest), *map(len, lines), 0) > self._longest:
            raise HangUp(f"a line is longer than {self._longest} bytes")
        return [line.decode("latin-1") for line in lines]
