"""The rig of the study of stops: the virtual rig in real time, which writes down when it is told to ramp."""

from __future__ import annotations

import os
import time
from pathlib import Path

from stickslip.physics.actuator import load_actuator
from stickslip.quantities import registry
from stickslip.rig import VirtualRig, load_bench


@registry.rigs.add
class TimedRig(VirtualRig):
    """See `stickslip.rig.Rig`. Args: a file, to which each ramp adds its time, s of the monotonic clock."""

    def __init__(self, told: str) -> None:
        actuator = load_actuator("kang2007").replace(stage_reaction=False)
        super().__init__(actuator, load_bench("kang2007-bench"), real_time=True)
        self._told = Path(told)

    def stop(self, slew: float) -> None:
        now, running = time.perf_counter(), self._running
        super().stop(slew)
        if running:
            file = os.open(self._told, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
            os.write(file, f"{now!r}\n".encode())
            os.close(file)
