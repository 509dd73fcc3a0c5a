"""Connection that uses GCS 2.0, the General Command Set of Physik Instrumente (PI), over TCP.

A GCS command has no answer; the query ``ERR?`` returns its error number. In an answer of several lines, all
lines except the last end with a space.
"""

from __future__ import annotations

import re

from ...line import Line, finite, need_silence
from ...protocols import RigError

PORT = 50000
_LONGEST = 1_000_000  # largest number of lines of an answer; more count as an endless answer, an error
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
    """Connection to a controller of PI; `identity` is the controller's answer to ``*IDN?``.

    After a late or invalid answer, answers can no longer be matched to queries, so all further queries raise
    RigError. `tell` still sends.

    Args:
        host: address of the controller.
        port: TCP port.
        timeout: longest wait for each answer, s.

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
            self.ask("ERR?")  # also clears the error number that an earlier program has left
        except RigError:
            self._line.close()
            raise

    @property
    def model(self) -> str:
        """Model name in the controller's identity; "controller" if the identity names none."""
        return [*self.identity.split(","), "controller"][1].strip()

    @property
    def name(self) -> str:
        """Name and address of the device for error messages."""
        return self._line.device

    def tell(self, command: str) -> None:
        """Send a command without a query of its error number. RigError if the connection is closed."""
        self._line.send(command.encode("latin-1") + b"\n")

    def do(self, command: str, allowed: tuple[int, ...] = ()) -> None:
        """Send a command and query its error number.

        Args:
            command: the command, without the line end.
            allowed: error numbers, besides 0, that are no failure.

        Raises:
            RigError: the command has failed with another error number, or the answer is late or invalid.
        """
        self.tell(command)
        said = self.ask("ERR?")[0]
        if not re.fullmatch(r"-?\d{1,6}", said):
            self._lost = True
            raise RigError(f"{self.name}: {command}, then ERR?: {said[:60]!r} came, late or garbage")
        if int(said) not in (0, *allowed):
            words = _ERRORS.get(int(said), "see the manual's list of errors")
            raise RigError(f"{self.name}: {command}: error {said}, {words}")

    def ask(self, query: str) -> list[str]:
        """Return the lines of the answer to a query, without spaces and line ends after them.

        The query is a text, or one control character such as chr(5).

        Raises:
            RigError: the answer is late or does not end, other data came too, or an earlier answer was late
                or invalid.
        """
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
        """Return the number in the first line of the answer to a query, after the last "=" if there is one.
        RigError if there is no finite number; all later queries are then refused."""
        said = self.ask(query)[0]
        found = re.fullmatch(r"(?:.*=)?\s*([-+.\deE]+)\s*", said)
        try:
            return finite(found[1] if found else "")
        except ValueError:
            self._lost = True
            raise RigError(f"{self.name}: {query} is answered by {said[:60]!r}, no number") from None

    def table(self, query: str) -> list[list[float]]:
        """Return the rows of numbers in the answer to a query, in the GCS array format.

        Raises:
            RigError: the header announces another number of rows (NDATA) or columns (DIM) than came, or a
                row contains something else than numbers.
        """
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
