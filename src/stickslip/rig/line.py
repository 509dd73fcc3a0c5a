"""Connection to a device over TCP or a serial port, with errors that name device, command and reply."""

from __future__ import annotations

import math
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from .protocols import RigError

LONGEST_REPLY = 1_000_000  # largest length of an answer, bytes; a longer one is an error
# Time for which `insist` repeats failed attempts, and pause between two attempts, s.
_INSISTENCE, _PAUSE = 1.0, 0.05


class Line:
    """A connection to a device.

    Args:
        device: name of the device in errors.
        host: name or address, or a serial port such as /dev/ttyUSB0.
        port: TCP port; None for a serial port, which needs pyserial.
        timeout: longest wait, s, for the connection and for each answer.
        baud: data rate of a serial port, bits/s.
        closing: True to close the connection if an answer is late or missing, because a later answer could be
            taken for the answer to another request. With False the caller must prevent that, and may still
            send.

    Raises:
        RigError: nobody answers there, or pyserial is missing.
    """

    def __init__(
        self,
        device: str,
        host: str,
        port: int | None,
        timeout: float,
        *,
        baud: int = 115200,
        closing: bool = False,
    ) -> None:
        where = host if port is None else f"{host}:{port}"
        self.device, self._host, self._port, self._baud = f"{device} at {where}", host, port, baud
        self._timeout, self._closing = timeout, closing
        self.open()

    def open(self) -> None:
        """Connect, or connect again after the connection was closed; data of the old connection are dropped.

        Raises:
            RigError: nobody answers there.
        """
        self._rest, self.closed = b"", False
        self._socket: Any
        try:
            if self._port is None:
                self._socket = _Serial(self._host, self._baud, self._timeout)
            else:
                self._socket = _Tcp(self._host, self._port, self._timeout)
        except (OSError, OverflowError, ValueError) as error:
            self.closed = True
            raise RigError(f"{self.device} cannot be reached: {error}") from None

    @contextmanager
    def closed_on_refusal(self) -> Iterator[None]:
        """Close the connection if an error leaves the context, so that others can use the device."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def insist(self, act: Callable[[], object], begin: Callable[[], object] = lambda: None) -> None:
        """Bring the output to its safe state; if the connection breaks, try again on a new one.

        Attempts are repeated for `_INSISTENCE` s, and at least once. An error that leaves the connection open
        is raised at once.

        Args:
            act: sends the commands for the safe state.
            begin: called on each new connection before `act`.

        Raises:
            RigError: the safe state was not reached; the output may keep its voltage.
        """
        end, again = time.monotonic() + _INSISTENCE, True
        while True:
            try:
                if self.closed:
                    self.open()
                    with self.closed_on_refusal():
                        begin()
                act()
                return
            except RigError as error:
                if not (self.closed and (again or time.monotonic() < end)):
                    raise RigError(
                        f"{error}; not known to have stopped, the output may keep its voltage"
                    ) from None
            again = False
            time.sleep(_PAUSE)

    def send(self, content: bytes) -> None:
        """Send bytes.

        Raises:
            RigError: the connection is closed, or the bytes cannot be sent within the timeout.
        """
        if self.closed:
            raise RigError(f"{self.device}: {_told(content)} was not sent: the connection is closed")
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(content)
        except OSError as error:
            self.fail(f"{_told(content)} could not be sent: {error}")

    def until(self, end: bytes, asked: bytes = b"", timeout: float | None = None) -> bytes:
        """Return the bytes that arrive before `end`, without `end`.

        Args:
            end: bytes that terminate the answer.
            asked: the request, for errors.
            timeout: longest wait, s; by default the timeout of the connection.

        Raises:
            RigError: the answer is late or too long, or the connection is closed.
        """
        last = time.monotonic() + (self._timeout if timeout is None else timeout)
        while end not in self._rest:
            self._receive(last, asked)
        found, _, self._rest = self._rest.partition(end)
        return found

    def exactly(self, count: int, asked: bytes = b"") -> bytes:
        """Return the next `count` bytes; `asked` is the request, for errors. Raises RigError as `until`."""
        last = time.monotonic() + self._timeout
        while len(self._rest) < count:
            self._receive(last, asked)
        found, self._rest = self._rest[:count], self._rest[count:]
        return found

    def more(self) -> bytes:
        """Return bytes that have arrived without a request, and keep them in the buffer; b"" if there are
        none.

        If there are any, answers can no longer be matched to requests.
        """
        if not self.closed and not self._rest and self._socket.waiting():
            with suppress(OSError):
                self._rest += self._socket.recv(65536)
        return self._rest

    def close(self) -> None:
        """Close the connection."""
        if not self.closed:
            self.closed = True
            self._socket.close()

    def _receive(self, last: float, asked: bytes) -> None:
        if self.closed:
            raise RigError(f"{self.device}: no answer to {_told(asked)}: the connection is closed")
        if len(self._rest) > LONGEST_REPLY:
            self.fail(f"the answer to {_told(asked)} does not end")
        try:
            self._socket.settimeout(max(last - time.monotonic(), 1e-3))
            came = self._socket.recv(65536)
        except TimeoutError:
            got = f"only {_told(self._rest)}" if self._rest else "nothing"
            self.fail(f"{got} came as the answer to {_told(asked)}")
        except OSError as error:
            self.fail(f"{_told(asked)}: {error}")
        if not came:
            self.fail(f"the connection ended after {_told(asked)}")
        self._rest += came

    def fail(self, why: str) -> NoReturn:
        """Raise RigError with the device and the reason `why`; with `closing` first close the connection."""
        if self._closing:
            self.close()
        raise RigError(f"{self.device}: {why}") from None


def finite(text: str) -> float:
    """Return the finite number that a text contains. ValueError if it contains something else."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


def need_silence(line: Any, name: str, query: str) -> None:
    """Raise RigError if an instrument has sent more than was requested.

    Args:
        line: connection with a method `more`, which returns bytes that nobody has read yet.
        name: name of the instrument in the error.
        query: the last query, for the error.
    """
    more = line.more()
    if more:
        raise RigError(f"{name}: {query}: {more[:20]!r} came beside its answer")


class _Tcp:
    """A TCP connection to a device with the methods of a socket and `waiting`; `timeout` is in s."""

    def __init__(self, host: str, port: int, timeout: float) -> None:
        self._link = socket.create_connection((host, port), timeout)
        self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.settimeout, self.sendall = self._link.settimeout, self._link.sendall
        self.recv, self.close = self._link.recv, self._link.close

    def waiting(self) -> bool:
        """Return True if data have arrived."""
        return bool(select.select([self._link], [], [], 0.0)[0])


class _Serial:
    """A serial port with the methods of a socket; its errors are OSErrors, too. `timeout` is in s, `baud` in
    bits/s. RigError without pyserial."""

    def __init__(self, port: str, baud: int, timeout: float) -> None:
        try:
            import serial  # type: ignore[import-not-found]
        except ModuleNotFoundError:
            raise RigError(f"{port}: a serial port needs pyserial: pip install pyserial") from None
        self._port = serial.Serial(port, baud, timeout=timeout, write_timeout=timeout, exclusive=True)

    def settimeout(self, timeout: float) -> None:
        """Set the timeout, s."""
        self._port.timeout = self._port.write_timeout = timeout

    def waiting(self) -> bool:
        """Return True if data have arrived."""
        return self._port.in_waiting > 0

    def sendall(self, content: bytes) -> None:
        """Send bytes."""
        self._port.write(content)

    def recv(self, most: int) -> bytes:
        """Wait for a byte; return it and up to `most` more that have arrived. TimeoutError if none
        arrives."""
        first = self._port.read(1)
        if not first:
            raise TimeoutError("nothing came")
        return first + self._port.read(min(self._port.in_waiting, most))

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def _told(content: bytes) -> str:
    return repr(content[:60].decode("latin-1").strip()) + ("..." if len(content) > 60 else "")
