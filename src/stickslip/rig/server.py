"""The TCP server of an instrument: one program at a time, messages of bounded size."""

from __future__ import annotations

import socket
import socketserver
from collections.abc import Callable
from contextlib import suppress

from .instrument import CommandError, Instrument
from .virtual import MAX_POINTS

LONGEST_LINE = 4096  # bytes
LARGEST_BLOCK = 8 * MAX_POINTS  # bytes
IDLE = 600.0  # s until a silent program loses the instrument to the next one


class InstrumentServer(socketserver.TCPServer):
    """Serves an instrument; ``serve_forever()`` and ``shutdown()`` as for any server of the library.

    Args:
        instrument: what is served.
        host: the address to bind to; only this machine can reach the loopback address.
        port: 0 takes a free one; `server_address` says which.
    """

    allow_reuse_address = True

    def __init__(self, instrument: Instrument, host: str = "127.0.0.1", port: int = 5025) -> None:
        self.instrument = instrument
        super().__init__((host, port), _Session)


class _Session(socketserver.StreamRequestHandler):
    """One program. When it goes, or is silent for too long while a run goes on, the output stops."""

    disable_nagle_algorithm = True

    def handle(self) -> None:
        instrument: Instrument = self.server.instrument  # type: ignore[attr-defined]
        try:
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
                    answer = instrument.execute(*message)
                    if answer is not None:
                        self.connection.settimeout(IDLE)
                        self.wfile.write(answer + b"\n")
        finally:
            instrument.stop()

    def _line(self, longest: int) -> bytes:
        return self.rfile.readline(longest)

    def finish(self) -> None:
        with suppress(OSError):
            super().finish()
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)


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
