"""The TCP server of an instrument: one program at a time, messages and connections of bounded number and
size."""

from __future__ import annotations

import socket
import socketserver
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .instrument import CommandError, Instrument
from .virtual import MAX_POINTS

LONGEST_LINE = 4096  # bytes
LARGEST_BLOCK = 8 * MAX_POINTS  # bytes
IDLE = 600.0  # s until a silent program loses the instrument, if nobody else wants it
TAKEN = 10.0  # s of silence after which one who wants it gets it, unless a run is going on
MOST_PROGRAMS = 16  # connections at a time
_LEAVING = 0.5  # s in which the one who has it may be about to leave
_REFUSED = 5.0  # s that a program which was told that it cannot have it may stay


class InstrumentServer(socketserver.ThreadingTCPServer):
    """Serves an instrument to one program at a time; others are told who holds it.

    Args:
        instrument: what is served.
        host: the address to bind to; only this machine can reach the loopback address.
        port: 0 takes a free one; `server_address` says which.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, instrument: Instrument, host: str = "127.0.0.1", port: int = 5025) -> None:
        self.instrument = instrument
        self.programs = threading.BoundedSemaphore(MOST_PROGRAMS)
        self._lock = threading.Lock()
        self._holder: _Session | None = None
        super().__init__((host, port), _Session)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether there is room for another connection."""
        return self.programs.acquire(blocking=False)

    def hold(self, session: _Session) -> str:
        """Give the instrument to a session; or say who has it."""
        with self._lock:
            holder = self._holder
            if holder is None:
                self._holder = session
                return ""
        if holder.ended.wait(_LEAVING):
            return self.hold(session)
        silent = time.monotonic() - holder.heard
        if silent < TAKEN or self.instrument.running:
            return f"the instrument is held by {holder.name}, heard {silent:.0f} s ago"
        holder.hang_up()
        holder.ended.wait(_REFUSED)
        return self.hold(session)

    def release(self, session: _Session) -> None:
        """A session has ended: the output stops."""
        with self._lock:
            if self._holder is session:
                self.instrument.stop()
                self._holder = None


class _Session(socketserver.StreamRequestHandler):
    """One program. When it goes, or is silent for too long while a run goes on, the output stops."""

    disable_nagle_algorithm = True
    server: InstrumentServer  # type: ignore[assignment]

    def setup(self) -> None:
        super().setup()
        self.heard = time.monotonic()
        self.ended = threading.Event()
        address = self.client_address
        self.name = f"{address[0]}:{address[1]}"

    def handle(self) -> None:
        instrument = self.server.instrument
        refused = self.server.hold(self)
        if refused:
            self._refuse(refused)
            return
        with suppress(OSError):
            while True:
                silence = instrument.watchdog if instrument.running else IDLE
                self.connection.settimeout(silence)
                try:
                    message = read_message(self.rfile.read, self._line)
                except CommandError as error:  # where the next message begins is not known
                    instrument.fail(error.number, str(error))
                    return
                if message is None:
                    return
                self.heard = time.monotonic()
                answer = instrument.execute(*message)
                if answer is not None:
                    self.connection.settimeout(instrument.watchdog)
                    self.wfile.write(answer + b"\n")

    def _refuse(self, why: str) -> None:
        """Answer every query with the reason, for a moment."""
        self.connection.settimeout(_REFUSED)
        with suppress(OSError, CommandError):
            while (message := read_message(self.rfile.read, self._line)) is not None:
                if message[0].split(" ")[0].strip().endswith("?"):
                    self.wfile.write(f'-221,"Settings conflict; {why}"\n'.encode())

    def hang_up(self) -> None:
        """End the connection, from another thread."""
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def _line(self, longest: int) -> bytes:
        return self.rfile.readline(longest)

    def finish(self) -> None:
        self.server.release(self)  # before the other side sees the end: it may come again at once
        self.server.programs.release()
        self.ended.set()
        with suppress(OSError):
            super().finish()
        self.hang_up()


def read_message(
    read: Callable[[int], bytes], readline: Callable[[int], bytes]
) -> tuple[str, bytes | None] | None:
    """One message: the command, and its block of data, if it has one; None at the end.

    Args:
        read: so many bytes, fewer at the end.
        readline: up to and with the next line feed, so many bytes at most.

    Raises:
        CommandError: the message is too long or its block is broken.
    """
    line = readline(LONGEST_LINE)
    if not line:
        return None
    start = line.find(b" #")
    if start < 0:
        if len(line) == LONGEST_LINE and not line.endswith(b"\n"):
            raise CommandError(-363, "Input buffer overrun; the line is too long")
        return line.decode("latin-1"), None
    command, rest = line[:start].decode("latin-1"), line[start + 2 :]

    def more(count: int) -> bytes:
        """The next bytes of the message: of the line that was read, then of the connection."""
        nonlocal rest
        taken, rest = rest[:count], rest[count:]
        if len(taken) < count:
            taken += read(count - len(taken))
        if len(taken) < count:
            raise CommandError(-161, "Invalid block data; the connection ended within a block")
        return taken

    digits = more(1)
    if digits not in (b"1", b"2", b"3", b"4", b"5", b"6", b"7", b"8", b"9"):
        raise CommandError(-161, "Invalid block data; a block of definite length is needed")
    length = more(int(digits))
    if not length.isdigit():
        raise CommandError(-161, "Invalid block data; its length is no number")
    if int(length) > LARGEST_BLOCK:
        raise CommandError(-363, f"Input buffer overrun; a block has up to {LARGEST_BLOCK} bytes")
    data = more(int(length))
    if not rest.endswith(b"\n"):
        rest += readline(LONGEST_LINE)
    if rest.strip():
        raise CommandError(-161, "Invalid block data; something follows the block")
    return command, data
