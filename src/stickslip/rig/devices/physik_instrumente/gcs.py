"""GCS 2.0, the General Command Set of Physik Instrumente (PI), over TCP: commands, queries, error numbers.

A command has no answer; ``ERR?`` returns its error number. In an answer of several lines, all lines but the
last end with a space.
"""

from __future__ import annotations

import re

from ...line import Line, finite, need_silence
from ...protocols import RigError

PORT = 50000
_LONGEST = 1_000_000  # lines of an answer
_ERRORS = {
    1: "parameter syntax error",
    2: "unknown command",
    5: "axis is not referenced, or its servo is off",
    7: "position out of limits",
    10: "stopped by command",
    15: "invalid axis identifier",
    17: "parameter out of range",
    23: "illegal axis",
    24: "wrong number of parameters",
    25: "invalid floating point number",
    26: "missing parameter",
}


class GcsLine:
    """Connection to a controller; `identity` is its answer to ``*IDN?``.

    Raises:
        RigError: nobody answers there, or the device is not from PI.
    """

    def __init__(self, host: str, port: int, timeout: float) -> None:
        self._line = Line("PI controller", host, port, timeout)
        self._lost = False
        try:
            self.identity = self.ask("*IDN?")[0]
            if "physik instrumente" not in self.identity.lower():
                raise RigError(f"{self.name} says it is {self.identity[:80]!r}, not a controller of PI")
            self.ask("ERR?")  # clears an earlier error
        except RigError:
            self._line.close()
            raise

    @property
    def model(self) -> str:
        """Model name in the controller's identity."""
        return [*self.identity.split(","), "controller"][1].strip()

    @property
    def name(self) -> str:
        """Device and address, for errors."""
        return self._line.device

    def tell(self, command: str) -> None:
        """Send a command without asking for its error."""
        self._line.send(command.encode("latin-1") + b"\n")

    def do(self, command: str, allowed: tuple[int, ...] = ()) -> None:
        """Send a command. Raises RigError if its error is not one of those allowed."""
        self.tell(command)
        said = self.ask("ERR?")[0]
        if not re.fullmatch(r"-?\d{1,6}", said):
            self._lost = True
            raise RigError(f"{self.name}: {command}, then ERR?: {said[:60]!r} came, late or garbage")
        if int(said) not in (0, *allowed):
            words = _ERRORS.get(int(said), "see the manual's list of errors")
            raise RigError(f"{self.name}: {command}: error {said}, {words}")

    def ask(self, query: str) -> list[str]:
        """Return the lines of the answer to a query, which may be a control character such as chr(5)."""
        if self._lost:
            raise RigError(f"{self.name}: {query!r}: not asked, an answer was late or garbage before")
        asked, lines = query.encode("latin-1"), list[str]()
        try:
            need_silence(self._line, self.name, query)
            self._line.send(asked if len(asked) == 1 else asked + b"\n")
            while not lines or lines[-1].endswith(" "):
                if len(lines) > _LONGEST:
                    raise RigError(f"{self.name}: the answer to {query} does not end")
                lines.append(self._line.until(b"\n", asked).decode("latin-1").strip("\r"))
            need_silence(self._line, self.name, query)
        except RigError:
            self._lost = True
            raise
        return [line.rstrip() for line in lines]

    def number(self, query: str) -> float:
        """Return the number after the last "=" of the answer."""
        said = self.ask(query)[0]
        found = re.fullmatch(r"(?:.*=)?\s*([-+.\deE]+)\s*", said)
        try:
            return finite(found[1] if found else "")
        except ValueError:
            self._lost = True
            raise RigError(f"{self.name}: {query} is answered by {said[:60]!r}, no number") from None

    def table(self, query: str) -> list[list[float]]:
        """Return the rows of a GCS array, checked against its header."""
        said = self.ask(query)
        lines = [line for line in said if not line.startswith("#")]
        for name, count in (("NDATA", len([one for one in lines if one])), ("DIM", len(lines[0].split()))):
            told = re.search(rf"^#\s*{name}\s*=\s*(\d+)", "\n".join(said), re.MULTILINE)
            if told is not None and int(told[1]) != count:
                raise RigError(f"{self.name}: {query}: {name} = {told[1]} was announced, and {count} came")
        try:
            return [[finite(one) for one in line.split()] for line in lines if line]
        except ValueError:
            raise RigError(f"{self.name}: {query} is answered by no table: {lines[0][:60]!r}") from None

    def close(self) -> None:
        """Close the connection."""
        self._line.close()
