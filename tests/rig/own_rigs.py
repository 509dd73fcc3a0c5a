"""A rig with an output to enable, for the rig's process, which runs this file by its path."""

from __future__ import annotations

from stickslip.physics.actuator import load_actuator
from stickslip.quantities import registry
from stickslip.rig import VirtualRig, load_bench


@registry.rigs.add
class Powered(VirtualRig):
    """The bench of these tests, taken for one that puts out volts."""

    simulated = False

    def __init__(self, real_time: bool = False) -> None:
        actuator = load_actuator("kang2007").replace(stage_reaction=False)
        super().__init__(actuator, load_bench("kang2007-bench"), seed=3, real_time=real_time)
