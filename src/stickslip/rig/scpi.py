"""Connections to SCPI instruments over TCP or VISA: queries, commands, blocks, errors.

After each command (`do`) the error queue is read, so that an error names the refused command. After a late or
garbled answer, answers can no longer be matched to queries. From then on `do` and all queries raise RigError;
only `tell` still sends, for a last command that brings an output to its safe state.
"""

from __future__ import annotations

import contextlib
import re
from typing import Any

from .line import Line, need_silence
from .protocols import RigError

LARGEST_BLOCK = 100_000_000  # largest length of a block in an answer, bytes; a longer one is an error
_MOST_ERRORS = 32  # largest number of errors that are read from the queue after a command
_PIECE = 65536  # number of bytes of a block that are read at once


class ScpiInstrument:
    """Connection to an SCPI instrument; `identity` is its answer to ``*IDN?``.

    Args:
        role: name of the instrument in errors, such as "generator".
        where: "HOST", "HOST:PORT", or a VISA resource, "USB0::0x0957::0x2807::MY1::INSTR" (needs pyvisa).
        port: TCP port that is used if `where` gives none.
        timeout: longest wait for each answer, s.
        end: bytes that terminate each message to the instrument.

    Raises:
        RigError: no instrument answers at this address, `where` is no address, or pyvisa is missing.
    """

    def __init__(
        self, role: str, where: str, port: int = 5025, timeout: float = 5.0, end: bytes = b"\n"
    ) -> None:
        self._end = end
        self.errors = "SYST:ERR?"  # query that returns and removes the oldest error; others may be set
        self._lost = False
        if "::" in where:
            self._line: Any = _VisaLine(role, where, timeout)
        else:
            host, _, given = where.partition(":")
            if given and not given.isdecimal():
                raise RigError(f"{role}: {where!r} is no HOST:PORT")
            self._line = Line(role, host, int(given or port), timeout)
        try:
            self.identity = self.ask("*IDN?")
        except RigError:
            self.close()
            raise

    @property
    def name(self) -> str:
        """Return role and address of the instrument, for errors."""
        return self._line.device

    def tell(self, command: str) -> None:
        """Send a command without reading the error queue. RigError if it cannot be sent."""
        self._line.send(command.encode("latin-1") + self._end)

    def ask(self, query: str) -> str:
        """Send a query and return the answer, without white space at its ends.

        Raises:
            RigError: the answer is late or invalid, other data came too, or this was so before.
        """
        return self._heard(query, lambda asked: self._line.until(b"\n", asked)).decode("latin-1").strip()

    def do(self, command: str, content: bytes | None = None) -> None:
        """Send a command, and read the error queue.

        Args:
            command: the command.
            content: data sent after the command as a definite-length block; None for no block.

        Raises:
            RigError: the instrument reported an error (the message contains the first one), or answers as for
                `ask`.
        """
        if self._lost:
            raise RigError(f"{self.name}: {command}: not sent, an answer was late or garbage before")
        count = b"" if content is None else str(len(content)).encode()
        block = b"" if content is None else b"#" + str(len(count)).encode() + count + content
        self._line.send(command.encode("latin-1") + block + self._end)
        self.check(command)

    def check(self, command: str) -> None:
        """Read the error queue until it is empty, 32 errors at most; raise RigError with the oldest, if any.

        `command` is the last command, for the error. After an answer without an error number, RigError is
        raised too, and all later queries are refused.
        """
        first = ""
        for _ in range(_MOST_ERRORS):
            said = self.ask(self.errors)
            if self.errors.startswith("*ESR?;"):
                said = said.partition(";")[2]
            number = re.match(r"[+-]?\d{1,6},", said)
            if number is None:
                self._lost = True
                raise RigError(
                    f"{self.name}: {command}, then {self.errors}: {said[:60]!r} came, late or garbage"
                )
            if int(number[0][:-1]) == 0:
                break
            first = first or said
        if first:
            raise RigError(f"{self.name}: {command}: {first[:200]}")

    def number(self, query: str) -> float:
        """Return the number that answers a query. RigError if the answer is no number, after which all
        queries are refused, or as for `ask`."""
        said = self.ask(query)
        try:
            return float(said)
        except ValueError:
            self._lost = True
            raise RigError(f"{self.name}: {query} is answered by {said[:60]!r}, no number") from None

    def block(self, query: str) -> bytes:
        """Return the content of the definite-length block that answers a query. RigError as for `ask`."""
        return self._heard(query, self._read_block)

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _read_block(self, asked: bytes) -> bytes:
        head = self._line.exactly(2, asked)
        digits = self._line.exactly(int(head[1:]), asked) if head[:1] == b"#" and head[1:].isdigit() else b""
        if not digits.isdigit() or int(digits) > LARGEST_BLOCK:
            raise RigError(f"{self.name}: {asked.decode()} is answered by {(head + digits)!r}..., no block")
        pieces, left = [], int(digits)
        while left:
            pieces.append(self._line.exactly(min(left, _PIECE), asked))
            left -= len(pieces[-1])
        after = self._line.until(b"\n", asked).strip(b"\r")
        if after:
            raise RigError(
                f"{self.name}: {asked.decode()}: {after[:20]!r} came after its {digits.decode()} bytes"
            )
        return b"".join(pieces)

    def _heard(self, query: str, read: Any) -> bytes:
        if self._lost:
            raise RigError(f"{self.name}: {query}: not asked, an answer was late or garbage before")
        asked = query.encode("latin-1")
        try:
            need_silence(self._line, self.name, query)
            self._line.send(asked + self._end)
            found = read(asked)
            need_silence(self._line, self.name, query)
            return found
        except RigError:
            self._lost = True
            raise


class _VisaLine:
    """Connection to a VISA resource (GPIB, USB, ...), with the methods of `line.Line` that SCPI needs.

    The methods that send or read raise RigError if the connection fails or data are late; `timeout` is the
    longest wait, s. `role` names the instrument in errors.
    """

    def __init__(self, role: str, resource: str, timeout: float) -> None:
        self.device = f"{role} at {resource}"
        try:
            import pyvisa
        except ModuleNotFoundError:
            raise RigError('an instrument behind VISA needs pyvisa: pip install "stickslip[scpi]"') from None
        self._failures, self._rest = (pyvisa.Error, OSError, ValueError), b""
        try:
            self._manager = pyvisa.ResourceManager("@py")
            self._link: Any = self._manager.open_resource(resource, timeout=1000.0 * timeout)
            if resource.upper().endswith("SOCKET"):  # a raw socket marks ends of messages only so
                self._link.read_termination = "\n"
        except self._failures as error:
            raise RigError(f"{self.device} cannot be opened: {error}") from None

    def send(self, content: bytes) -> None:
        """Send bytes."""
        self._tried(lambda: self._link.write_raw(content), content)

    def until(self, end: bytes, asked: bytes = b"") -> bytes:
        """Return the bytes that arrive before `end`; `asked` is the request, for errors."""
        while end not in self._rest:
            self._rest += self._tried(self._link.read_raw, asked)
        found, _, self._rest = self._rest.partition(end)
        return found

    def exactly(self, count: int, asked: bytes = b"") -> bytes:
        """Return the next `count` bytes; `asked` is the request, for errors."""
        while len(self._rest) < count:
            self._rest += self._tried(self._link.read_raw, asked)
        found, self._rest = self._rest[:count], self._rest[count:]
        return found

    def more(self) -> bytes:
        """Return bytes that were received beyond the last answer; b"" if there are no such bytes."""
        return self._rest

    def close(self) -> None:
        """Close the resource."""
        with contextlib.suppress(*self._failures):
            self._link.close()
            self._manager.close()

    def _tried(self, talk: Any, asked: bytes) -> Any:
        try:
            return talk()
        except self._failures as error:
            said = asked[:60].decode("latin-1").strip()
            raise RigError(f"{self.device}: {said!r}: {error}") from None
