"""SCPI interface of a simulated instrument: messages with binary blocks, headers in long or short form, an
error queue."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable

from .server import HangUp

LONGEST = 4_000_000  # largest number of bytes of a message, or of a block in it; more end the connection
_VOWELS = "AEIOU"

Command = Callable[[list[str], bytes], str | bytes | None]


class ScpiError(Exception):
    """Error of a command: the number and text that SCPI defines for it."""

    def __init__(self, number: int, words: str) -> None:
        super().__init__(words)
        self.number = number


class ScpiDevice:
    """A simulated instrument, which executes SCPI messages by its table `commands`.

    The table has a function for each header in short form, such as "CHAN:RANG?". The function gets a list of
    texts (suffix of the header, then the arguments) and the binary block. It returns the answer as text or
    bytes, or None for no answer, and raises ScpiError if it refuses. `queue` contains number and text of the
    last 20 errors.

    Args:
        identity: the answer to ``*IDN?``.
        errors: the query that returns the oldest error and removes it from the queue.
    """

    end = b"\n"  # bytes that end each answer

    def __init__(self, identity: str, errors: str = "SYST:ERR?") -> None:
        self.identity, self.lock = identity, threading.RLock()
        self.queue: deque[tuple[int, str]] = deque(maxlen=20)
        self.commands: dict[str, Command] = {
            "*IDN?": lambda given, block: self.identity,
            "*CLS": lambda given, block: self.queue.clear(),
            "*OPC?": lambda given, block: "1",
            "*WAI": lambda given, block: None,
            "*ESR?": lambda given, block: "32" if self.queue else "0",
            errors: lambda given, block: self._oldest(),
        }

    def session(self) -> ScpiSession:
        """Return a new session, for one connection."""
        return ScpiSession(self)

    def execute(self, text: str, block: bytes = b"") -> bytes:
        """Execute the commands of a message; return their answers, joined by ";", with the line end.

        The result is b"" without an answer. Errors are added to the error queue, not raised.

        Args:
            text: commands, separated by ";".
            block: binary block at the end of the message, if any; the text is then one command.
        """
        with self.lock:
            return self._execute(text, block)

    def _execute(self, text: str, block: bytes) -> bytes:
        answers = []
        for command in text.split(";") if not block else [text]:
            header, _, rest = command.strip().partition(" ")
            if not header:
                continue
            try:
                name, suffix = shortened(header)
                found = self.commands.get(name)
                if found is None:
                    raise ScpiError(-113, "Undefined header")
                given = [str(suffix), *(part.strip() for part in rest.split(","))]
                said = found(given, block)
            except ScpiError as error:
                self.queue.append((error.number, str(error)))
                continue
            if said is not None:
                answers.append(said if isinstance(said, bytes) else said.encode("latin-1"))
        return b";".join(answers) + self.end if answers else b""

    def _oldest(self) -> str:
        number, words = self.queue.popleft() if self.queue else (0, "No error")
        return f'{number:+d},"{words}"'


class ScpiSession:
    """One connection to `device`, which splits the received bytes into SCPI messages."""

    greeting = b""

    def __init__(self, device: ScpiDevice) -> None:
        self._device, self._rest = device, b""

    def feed(self, data: bytes) -> bytes:
        """Return the answers to all messages that are complete after these received bytes.

        Raises:
            HangUp: a message or block is too long.
        """
        self._rest += data
        made = b""
        while (cut := self._message()) is not None:
            text, block = cut
            made += self._device.execute(text.decode("latin-1"), block)
        if len(self._rest) > LONGEST:
            raise HangUp("a message does not end")
        return made

    def _message(self) -> tuple[bytes, bytes] | None:
        """Remove the next complete message from the received bytes; return its text and its block (b"" if it
        has none), or None if no message is complete. HangUp if the block is too long."""
        end = self._rest.find(b"\n")
        mark = self._rest.find(b"#", 0, end if end >= 0 else None)
        if mark >= 0 and self._rest[mark + 1 : mark + 2].isdigit():
            digits = int(self._rest[mark + 1 : mark + 2])
            size = self._rest[mark + 2 : mark + 2 + digits]
            if len(size) == digits and size.isdigit():
                first = mark + 2 + digits
                last = first + int(size)
                if int(size) > LONGEST:
                    raise HangUp("a block is too long")
                if len(self._rest) <= last:
                    return None
                text, block = self._rest[:mark], self._rest[first:last]
                self._rest = self._rest[last:].removeprefix(b"\r").removeprefix(b"\n")
                return text, block
            if len(size) < digits:
                return None
        if end < 0:
            return None
        text, self._rest = self._rest[:end], self._rest[end + 1 :]
        return text.strip(b"\r"), b""


def shortened(header: str) -> tuple[str, int]:
    """Return a header in SCPI's short form without numeric suffixes, and its suffix.

    For example, ":CHANnel2:RANGe?" gives "CHAN:RANG?" and 2. Without a suffix, 1 is returned; of several
    suffixes, the last one.
    """
    query = "?" if header.endswith("?") else ""
    words, suffix = [], 1
    for word in header.upper().strip(":?").split(":"):
        letters = word.rstrip("0123456789")
        if letters == "DAC":  # the number in the keyword DAC16 is no suffix
            letters = word
        elif word != letters:
            suffix = int(word[len(letters) :][:6])
        if len(letters) > 4 and letters.isalpha():
            letters = letters[: 3 if letters[3] in _VOWELS else 4]
        words.append(letters)
    return ":".join(words) + query, suffix


def number(text: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Return the number in a text.

    Raises:
        ScpiError: the text is no number, or the number is not finite or not within `low` to `high`.
    """
    try:
        value = float(text)
    except ValueError:
        raise ScpiError(-104, "Data type error") from None
    if not (math.isfinite(value) and low <= value <= high):
        raise ScpiError(-222, "Data out of range")
    return value


def switch(text: str) -> bool:
    """Return True for the texts ON, 1 and RUN, and False for OFF, 0 and STOP. Raises ScpiError for others."""
    if text.upper() not in ("ON", "OFF", "1", "0", "RUN", "STOP"):
        raise ScpiError(-104, "Data type error")
    return text.upper() in ("ON", "1", "RUN")
