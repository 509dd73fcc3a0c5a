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
    """Request for a run, in SI units.

    The inputs named in `inputs` are recorded for `samples` samples, `rest` of them before the drive. `volts`
    is the drive [n], V at the piezo, one value per update. `position` is the input that measures the
    position; with None end stops are not checked. `keep` is the path of the file in which the program stores
    its samples; None without such a file.

    With a `controller` (the data of `protocols.ControllerSpec.document`) the run is a closed loop, and
    `volts` are target positions [n], m (rad) from home; the last one stays. Then `plausibility` has the
    thresholds for the position (with None the controller's own), and `second` is another input that measures
    the position.

    `arm` is the reason for which the output is enabled for this run only; with "" it must be enabled already,
    unless the rig is simulated or the run is at 0 V. `Limits.heartbeat` counts from the last
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
        """Return True if the run may output anything but 0 V."""
        return self.controller is not None or bool(np.any(self.volts))
