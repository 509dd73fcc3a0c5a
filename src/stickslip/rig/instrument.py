"""A rig as an instrument that understands SCPI: commands in, answers out, errors in a queue.

| command | does |
|---|---|
| ``*IDN?`` ``*RST`` ``*CLS`` ``*OPC?`` | as IEEE 488.2 has them; ``*RST`` stops the output |
| ``SYSTem:ERRor?`` | the oldest error, and takes it from the queue |
| ``SYSTem:CAPabilities?`` | what the rig can do: a block of JSON; see `protocols.Capabilities` |
| ``SOURce:DATA <block>`` | the drive at the piezo, V, float64, lowest byte first |
| ``SENSe:CONFigure <points>,<input>,...`` | what to record |
| ``INITiate`` | arm |
| ``*TRG`` | start |
| ``FETCh?`` | the next samples: a block of float64, input after input |
| ``OUTPut:STOP <slew>`` | ramp to 0 V at this slew, V/s, in 10 s at most |

Capitals are the short form; case does not matter. Blocks are those of definite length of IEEE 488.2. Every
output passes the gate of `stickslip.rig.limits`.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable

import numpy as np

from .._version import __version__
from ..units import QuantityError
from .gate import Gate
from .limits import LONGEST_STOP, LimitError, Limits
from .protocols import Rig, RigError

QUEUE = 20  # errors that are remembered


class CommandError(Exception):
    """A command that cannot be done: SCPI's number and words."""

    def __init__(self, number: int, words: str) -> None:
        super().__init__(words)
        self.number = number


def block(content: bytes) -> bytes:
    """The content as a block of definite length."""
    length = str(len(content)).encode()
    return b"#" + str(len(length)).encode() + length + content


class Instrument:
    """See the module. Args: the rig, and what its output may not pass."""

    def __init__(self, rig: Rig, limits: Limits) -> None:
        self._rig, self._limits = rig, limits
        self._gate = Gate(rig, limits, rig.capabilities)
        self._errors: deque[tuple[int, str]] = deque(maxlen=QUEUE)
        self._configured: tuple[int, tuple[str, ...]] | None = None
        self.running = False
        self._commands: dict[str, Callable[[str, bytes | None], bytes | None]] = {
            "*IDN?": lambda text, data: f"stickslip,{rig.capabilities.name},0,{__version__}".encode(),
            "*RST": self._reset,
            "*CLS": lambda text, data: self._errors.clear(),
            "*OPC?": lambda text, data: b"1",
            "*TRG": self._start,
            "SYST:ERR?": self._error,
            "SYST:CAP?": self._capabilities,
            "SOUR:DATA": self._load,
            "SENS:CONF": self._configure,
            "INIT": self._arm,
            "FETC?": self._fetch,
            "OUTP:STOP": self._stop,
        }

    @property
    def watchdog(self) -> float:
        """How long a run goes on without a word from the program, s."""
        return self._limits.watchdog

    def execute(self, text: str, data: bytes | None = None) -> bytes | None:
        """Do one command, with its block of data, if any; the answer to a query, without line feed."""
        header, _, rest = text.strip().partition(" ")
        if not header:
            return None
        try:
            command = self._commands.get(_short(header))
            if command is None:
                raise CommandError(-113, "Undefined header")
            return command(rest.strip(), data)
        except CommandError as error:
            self.fail(error.number, str(error))
        except LimitError as error:
            self.fail(-222, f"Data out of range; {error}")
        except (RigError, QuantityError) as error:
            self.fail(-200, f"Execution error; {error}")
        return block(b"") if _short(header) == "FETC?" else None

    def fail(self, number: int, words: str) -> None:
        """Put an error into the queue."""
        self._errors.append((number, " ".join(words.split()).replace('"', "'")[:400]))

    def stop(self) -> None:
        """Ramp to 0 V, if a run is going on."""
        if self.running:
            self.running = False
            self._gate.stop()

    def _reset(self, text: str, data: bytes | None) -> None:
        self.stop()
        self._configured = None

    def _error(self, text: str, data: bytes | None) -> bytes:
        number, words = self._errors.popleft() if self._errors else (0, "No error")
        return f'{number},"{words}"'.encode()

    def _capabilities(self, text: str, data: bytes | None) -> bytes:
        found = self._rig.capabilities._asdict() | {"origin": getattr(self._rig, "origin", 0.0)}
        return block(json.dumps(found).encode())

    def _load(self, text: str, data: bytes | None) -> None:
        if data is None or len(data) % 8:
            raise CommandError(-161, "Invalid block data; a block of float64 is needed")
        self._gate.load(np.frombuffer(data, dtype="<f8"))

    def _configure(self, text: str, data: bytes | None) -> None:
        points, *inputs = (part.strip() for part in text.split(","))
        if not (points.isascii() and points.isdecimal()) or len(points) > 9 or not inputs:
            raise CommandError(-104, "Data type error; points and inputs are needed")
        self._configured = int(points), tuple(inputs)

    def _arm(self, text: str, data: bytes | None) -> None:
        if self._configured is None:
            raise CommandError(-221, "Settings conflict; SENSe:CONFigure first")
        points, inputs = self._configured
        self._rig.arm(inputs, points)

    def _start(self, text: str, data: bytes | None) -> None:
        self._gate.start()
        self.running = True

    def _fetch(self, text: str, data: bytes | None) -> bytes:
        return block(np.ascontiguousarray(self._rig.fetch(), dtype="<f8").tobytes())

    def _stop(self, text: str, data: bytes | None) -> None:
        try:
            slew = float(text)
        except ValueError:
            raise CommandError(-104, "Data type error; a slew in V/s is needed") from None
        least = max(-self._limits.min_voltage, self._limits.max_voltage) / LONGEST_STOP
        if not least <= slew <= self._limits.max_slew:
            raise CommandError(
                -222, f"Data out of range; a slew from {least:g} to {self._limits.max_slew:g} V/s"
            )
        self._rig.stop(slew)
        self.running = False


def _short(header: str) -> str:
    """The header in short form: "SYSTem:ERRor?" is "SYST:ERR?"; a long form must be the whole word."""
    words = []
    for word in header.upper().removeprefix(":").split(":"):
        query = "?" if word.endswith("?") else ""
        words.append(_SHORT.get(word.removesuffix("?"), word.removesuffix("?")) + query)
    return ":".join(words)


_WORDS = ("SYSTem", "ERRor", "CAPabilities", "SOURce", "SENSe", "CONFigure", "INITiate", "FETCh", "OUTPut")
_SHORT = {word.upper(): "".join(sign for sign in word if sign.isupper()) for word in _WORDS}
