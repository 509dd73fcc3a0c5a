"""Twins of a function generator and an oscilloscope with one stage."""

from __future__ import annotations

from ...physics.actuator import Actuator
from ...quantities.units import to_si
from ..variation import Variation
from .generator import GeneratorTwin
from .oscilloscope import OscilloscopeTwin
from .stage import MEASURED, Stage
from .wiring import Wiring


def make_pair(
    actuator: Actuator,
    *,
    generator: str = "33500",
    oscilloscope: str = "infiniivision",
    travel: float | str = 4e-3,
    variation: Variation = MEASURED,
    seed: int = 0,
) -> tuple[GeneratorTwin, OscilloscopeTwin]:
    """Return both instruments, connected by an amplifier of 15 V/V and a sensor of 10 um/V, for two servers.

    Args:
        actuator: the actuator that the amplifier drives.
        generator, oscilloscope: families, see `generator.GENERATORS` and `oscilloscope.OSCILLOSCOPES`.
        travel: m, from end stop to end stop.
        variation: variation of the contact from piece to piece of the motion.
        seed: seed of the variation and of the initial position.
    """
    travel = to_si(travel, "m", "travel")
    wiring = Wiring(Stage(actuator, travel=travel, variation=variation, seed=seed))
    return GeneratorTwin(wiring, generator), OscilloscopeTwin(wiring, oscilloscope)
