"""Servers that connect a twin (simulated device) to a program, by TCP or by a pseudo terminal.

On TCP a twin serves one program at a time, as the controllers do.
"""

from __future__ import annotations

import os
import select
import socketserver
import threading
from contextlib import suppress
from typing import Any, Protocol, Self

from ...quantities.units import QuantityError
from ..protocols import RigError

IDLE = 600.0  # time without data after which a twin disconnects the program, s
_POLL = 0.05  # pause between two queries of a twin for unsolicited messages, s


class HangUp(Exception):
    """Exception by which a twin requests the end of the connection, because received data are not valid."""


class Session(Protocol):
    """One connection to a twin; `greeting` is the first message of the device, b"" without one.

    If the device sends unsolicited messages, its session also has a method `unasked()`, which returns the
    bytes of the messages that are due.
    """

    greeting: bytes

    def feed(self, data: bytes) -> bytes:
        """Take received bytes, in pieces of any length; return the answers to all messages that are complete.

        The result is b"" without an answer.

        Raises:
            HangUp: the server must end the connection.
        """
        ...


class Twin(Protocol):
    """A simulated controller with the methods that a server needs."""

    def session(self) -> Session:
        """Return a new session, for one connection."""
        ...

    def leave(self) -> None:
        """React to the end of the program's connection, such as by stopping motions that have no end."""
        ...


class TwinServer(socketserver.ThreadingTCPServer):
    """TCP server of a twin; `where` is its address, "HOST:PORT".

    Args:
        twin: the simulated device.
        host: address at which the server listens; by default only programs of this machine can reach it.
        port: TCP port; 0 takes a free one.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, twin: Twin, host: str = "127.0.0.1", port: int = 0) -> None:
        self.twin, self.held = twin, threading.Lock()
        super().__init__((host, port), _Connection)
        self.where = "{}:{}".format(*self.server_address[:2])


class _Connection(socketserver.BaseRequestHandler):
    server: TwinServer  # type: ignore[assignment]
    request: Any

    def handle(self) -> None:
        """Answer the program until it disconnects, or until the twin ends the connection.

        If another program is still connected after 1 s, this connection is closed without an answer.
        """
        if not self.server.held.acquire(timeout=1.0):  # wait for the previous program to disconnect
            return
        try:
            with suppress(OSError, HangUp, RigError):
                session = self.server.twin.session()
                self.request.settimeout(IDLE)
                self.request.sendall(session.greeting)
                while (answer := self._answer(session)) is not None:
                    self.request.sendall(answer)
        finally:
            self.server.twin.leave()
            self.server.held.release()

    def _answer(self, session: Session) -> bytes | None:
        """Wait for data or an unsolicited message of the twin, and return the bytes to send.

        The result is None if the program has disconnected, or nothing has happened for `IDLE` s.
        """
        unasked = getattr(session, "unasked", None)
        pause = IDLE if unasked is None else _POLL
        for _ in range(round(IDLE / pause)):
            if select.select([self.request], [], [], pause)[0]:
                data = self.request.recv(65536)
                return session.feed(data) if data else None
            if unasked is not None and (said := unasked()):
                return said
        return None


class TwinTerminal:
    """Server of a twin on a pseudo terminal, which a program opens as a serial port; `where` is its path.

    As on a serial line, the device does not notice who opens and closes the port, so closing the port stops
    no motion. Invalid data are discarded. POSIX only. QuantityError if `twin` has no serial port (no method
    `serial_session`).
    """

    def __init__(self, twin: Twin) -> None:
        session = getattr(twin, "serial_session", None)
        if session is None:
            raise QuantityError(f"a twin of {type(twin).__name__} has no serial port")
        import tty  # imported here, because the module is missing on Windows

        self._session, self._ended = session, threading.Event()
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.where = os.ttyname(self._theirs)

    def serve_forever(self, poll_interval: float = 0.1) -> None:
        """Answer the data on the port until `shutdown` is called, which is noticed after `poll_interval`
        s."""
        session = self._session()
        while not self._ended.is_set():
            try:
                if select.select([self._ours], [], [], min(poll_interval, _POLL))[0]:
                    answer = session.feed(os.read(self._ours, 65536))
                else:
                    answer = session.unasked() if hasattr(session, "unasked") else b""
            except (HangUp, RigError):
                answer, session = b"", self._session()
            while answer:
                answer = answer[os.write(self._ours, answer) :]

    def shutdown(self) -> None:
        """Make `serve_forever` return, from another thread."""
        self._ended.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._ours)
        os.close(self._theirs)


class Lines:
    """Splitter of received bytes into lines, which end with CR, LF, CR LF or telnet's CR NUL.

    `longest` is the largest number of bytes of a line.
    """

    def __init__(self, longest: int = 65536) -> None:
        self._rest, self._longest, self._after_cr = b"", longest, False

    def feed(self, data: bytes) -> list[str]:
        """Return the lines that these received bytes complete, as texts without their line ends.

        Raises:
            HangUp: a line is longer than `longest`.
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
