"""A connection to a device that answers in text over TCP, with errors that name device, command and reply."""

from __future__ import annotations

import socket
import time

from .protocols import RigError

LONGEST_REPLY = 1_000_000  # bytes


class Line:
    """A connection.

    Args:
        device: what it is called in errors.
        host: name or address; port.
        timeout: s, for connecting and for each answer.

    Raises:
        RigError: nobody answers there.
    """

    def __init__(self, device: str, host: str, port: int, timeout: float) -> None:
        self.device, self._timeout, self._rest = f"{device} at {host}:{port}", timeout, b""
        try:
            self._socket = socket.create_connection((host, port), timeout)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except (OSError, OverflowError, UnicodeError) as error:
            raise RigError(f"{self.device} cannot be reached: {error}") from None

    def send(self, content: bytes) -> None:
        """Send.

        Raises:
            RigError: the connection is gone.
        """
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(content)
        except OSError as error:
            raise RigError(f"{self.device}: {_told(content)} could not be sent: {error}") from None

    def until(self, end: bytes, asked: bytes = b"", timeout: float | None = None) -> bytes:
        """What comes up to and without `end`; `asked` is for the error.

        Raises:
            RigError: it does not come in time, is too long, or the connection is gone.
        """
        last = time.monotonic() + (self._timeout if timeout is None else timeout)
        while end not in self._rest:
            self._receive(last, asked)
        found, _, self._rest = self._rest.partition(end)
        return found

    def exactly(self, count: int, asked: bytes = b"") -> bytes:
        """So many bytes; errors as `until`."""
        last = time.monotonic() + self._timeout
        while len(self._rest) < count:
            self._receive(last, asked)
        found, self._rest = self._rest[:count], self._rest[count:]
        return found

    def close(self) -> None:
        """Let go."""
        self._socket.close()

    def _receive(self, last: float, asked: bytes) -> None:
        if len(self._rest) > LONGEST_REPLY:
            raise RigError(f"{self.device}: the answer to {_told(asked)} does not end")
        try:
            self._socket.settimeout(max(last - time.monotonic(), 1e-3))
            came = self._socket.recv(65536)
        except TimeoutError:
            got = f"only {_told(self._rest)}" if self._rest else "nothing"
            raise RigError(f"{self.device}: {got} came as the answer to {_told(asked)}") from None
        except OSError as error:
            raise RigError(f"{self.device}: {_told(asked)}: {error}") from None
        if not came:
            raise RigError(f"{self.device}: the connection ended after {_told(asked)}")
        self._rest += came


def _told(content: bytes) -> str:
    return repr(content[:60].decode("latin-1").strip()) + ("..." if len(content) > 60 else "")
