"""The rig of the fault study, from the side of the process that owns it: a device behind a socket."""

from __future__ import annotations

import socket
from typing import Any

import numpy as np

from stickslip.quantities import registry
from stickslip.rig import Capabilities, RigError
from stickslip.rig.wire import receive, send

PATIENCE = 10.0  # s for an answer


@registry.rigs.add
class FarRig:
    """See `stickslip.rig.Rig`. Args: the device's port of this machine; s that samples may take."""

    origin = 0.0

    def __init__(self, port: int, patience: float) -> None:
        self._patience = patience
        try:
            self._link = socket.create_connection(("127.0.0.1", port), PATIENCE)
            self.capabilities = Capabilities(**self._ask("open")[0]["capabilities"])
        except OSError as error:
            raise RigError(f"the device cannot be reached: {error}") from None

    def load(self, volts: np.ndarray) -> None:
        self._ask("load", volts)

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        self._ask("arm", inputs=inputs, samples=samples)

    def start(self) -> None:
        self._ask("start")

    def fetch(self) -> np.ndarray:
        return self._ask("fetch", within=self._patience)[1]

    def stop(self, slew: float) -> None:
        self._ask("stop", slew=slew)

    def close(self) -> None:
        self._link.close()

    def _ask(
        self, do: str, values: Any = None, within: float = PATIENCE, **what: Any
    ) -> tuple[dict[str, Any], np.ndarray]:
        try:
            self._link.settimeout(within)
            send(self._link, {"do": do, **what}, values)
            answer, block = receive(self._link)
        except (OSError, EOFError) as error:
            self._link.close()  # which answer is to what is not known any more
            raise RigError(f"the device: {do}: {error}") from None
        if "error" in answer:
            raise RigError(f"the device: {do}: {answer['error']}")
        self.origin = answer["origin"]
        return answer, block
