"""Request for a run, as a client sends it to the process of a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .gate import PositionInput
from .limits import Limits
from .plausibility import Plausibility
from .protocols import Array


class Order(NamedTuple):
    """Request for a run: limits, inputs, samples to record (`rest` of them before the drive), and the drive,
    V.

    `position` is the input that shows the position. `keep` is the file to which the program stores its
    samples, if any. With a `controller` (see `protocols.ControllerSpec`) the run is a closed loop and `volts`
    are targets, m. Then `plausibility` is the plausibility check of the position, by default the controller's
    own, and `second` another input that shows the position. `arm` is the reason for which the output is
    enabled for this run only; with "" it must be enabled already. `Limits.heartbeat` counts from the last
    `Supervisor.beat` if the run is `operated` by a page, else from the last `fetch` of the program.
    """

    limits: Limits
    inputs: tuple[str, ...]
    samples: int
    rest: int
    position: PositionInput | None
    volts: Array
    keep: Path | None = None
    controller: dict[str, Any] | None = None
    plausibility: Plausibility | None = None
    second: PositionInput | None = None
    arm: str = ""
    operated: bool = False

    @property
    def drives(self) -> bool:
        """True if the run may put out anything but 0 V."""
        return self.controller is not None or bool(np.any(self.volts))
