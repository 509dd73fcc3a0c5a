"""A rig behind VISA (network, USB, GPIB) that speaks the commands of `stickslip.rig.instrument`."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from .. import registry
from ..units import to_si
from .protocols import About, Array, Capabilities, RigError


class ScpiRig:
    """A rig behind VISA that understands SCPI; see `protocols.Rig`.

    Args:
        resource: VISA resource, ``TCPIP::127.0.0.1::5025::SOCKET``.
        timeout: s, for each answer. `patience`, the same by default, is that for samples.
        backend: of PyVISA: "@py" is pyvisa-py, which needs no driver.

    Raises:
        RigError: PyVISA is not installed, or nobody answers there.
    """

    about = About(
        device="what `stickslip instrument` serves, behind VISA",
        does="puts out and records",
        samples="as they come",
        safe_state="ramp to 0 V, by the device's own watchdog too",
        verified="the served virtual rig; no instrument on sale speaks this dialect",
    )

    def __init__(self, resource: str, *, timeout: float | str = 10.0, backend: str = "@py") -> None:
        timeout = to_si(timeout, "s", "timeout")
        try:
            import pyvisa
        except ModuleNotFoundError:
            raise RigError('a rig on the network needs pyvisa: pip install "stickslip[scpi]"') from None
        self._failures = (pyvisa.Error, OSError)
        try:
            self._manager = pyvisa.ResourceManager(backend)
            self._link: Any = self._manager.open_resource(
                resource, read_termination="\n", write_termination="\n", timeout=1000.0 * timeout
            )
        except (*self._failures, ValueError) as error:
            raise RigError(f"{resource} cannot be opened: {error}") from None
        self._resource, self._inputs = resource, 0
        self.timeout = self.patience = timeout
        self.origin = 0.0
        try:
            self._check()  # an instrument that another program holds says so
            self.capabilities = self._asked_capabilities()
        except RigError:
            self.close()
            raise

    def load(self, volts: Array) -> None:
        """Send the drive, V at the piezo, one value per update."""
        content = np.ascontiguousarray(volts, dtype="<f8")
        self._try(lambda: self._link.write_binary_values("SOUR:DATA ", content, datatype="d"))
        self._check()

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Record these inputs when the output starts."""
        self._asked_capabilities()
        self._do(f"SENS:CONF {samples},{','.join(inputs)}")
        self._do("INIT")
        self._inputs = len(inputs)

    def start(self) -> None:
        """Start output and recording."""
        self._do("*TRG")

    def fetch(self) -> Array:
        """The next samples [inputs, n]."""
        content = self._query_block("FETC?", self.patience)
        if not content:
            self._check()
        values = np.frombuffer(content, dtype="<f8")
        if not self._inputs or values.size % self._inputs:
            raise RigError(f"{self._resource}: {values.size} samples came for {self._inputs} inputs")
        return values.reshape(self._inputs, -1)

    def stop(self, slew: float) -> None:
        """Ramp to 0 V."""
        self._do(f"OUTP:STOP {slew!r}")

    def close(self) -> None:
        """Let go of the connection; a run that is going on is stopped by the instrument."""
        self._link.close()
        self._manager.close()

    def _asked_capabilities(self) -> Capabilities:
        """What it says of itself; `origin` is in it where readings begin at zero with each run."""
        try:
            found = json.loads(self._query_block("SYST:CAP?"))
            self.origin = float(found.pop("origin", 0.0))
            return Capabilities(**found)
        except (ValueError, TypeError) as error:
            raise RigError(f"{self._resource}: its capabilities cannot be read: {error}") from None

    def _do(self, command: str) -> None:
        self._try(lambda: self._link.write(command))
        self._check()

    def _check(self) -> None:
        """Raises RigError with the oldest error that the instrument remembers; forgets the others."""
        answer = self._try(lambda: self._link.query("SYST:ERR?"))
        number, _, words = str(answer).partition(",")
        if number.strip() not in ("0", "+0"):
            self._try(lambda: self._link.write("*CLS"))
            raise RigError(f"{self._resource}: {words.strip().strip(chr(34))} ({number})")

    def _query_block(self, command: str, patience: float | None = None) -> bytes:
        def ask() -> bytes:
            self._link.timeout = 1000.0 * (patience or self.timeout)
            self._link.write(command)
            digits = self._link.read_bytes(2)
            if digits[:1] != b"#" or not digits[1:].isdigit():
                raise RigError(f"{self._resource}: no block came for {command}, but {digits!r}")
            length = int(self._link.read_bytes(int(digits[1:])))
            content = self._link.read_bytes(length) if length else b""
            self._link.read_bytes(1)  # line feed
            self._link.timeout = 1000.0 * self.timeout
            return content

        return self._try(ask)

    def _try(self, talk: Any) -> Any:
        try:
            return talk()
        except self._failures as error:
            raise RigError(f"{self._resource}: {error}") from None


registry.rigs.add(ScpiRig, "scpi")
