"""Twins (simulated devices) of a function generator and an oscilloscope, with one stage between them."""

from __future__ import annotations

from typing import NamedTuple

from ....quantities import registry
from ...twins.axis import Clock
from ...twins.stage import Stage
from .twin_generator import GeneratorTwin
from .twin_oscilloscope import OscilloscopeTwin
from .twin_wiring import Wiring


class InstrumentPair(NamedTuple):
    """Simulated generator and oscilloscope with common wiring; each needs a `TwinServer` of its own."""

    generator: GeneratorTwin
    oscilloscope: OscilloscopeTwin


def make_pair(stages: list[Stage], seed: int = 0, clock: Clock | None = None) -> InstrumentPair:
    """Return both simulated instruments, connected by an amplifier (15 V/V), a stage and a sensor (10 um/V).

    Args:
        stages: simulated stages, of which only the first one is used.
        seed: not used, because these twins have no noise by default.
        clock: clock of the motions; by default the computer's.
    """
    del seed
    wiring = Wiring(stages[0], clock=clock)
    return InstrumentPair(GeneratorTwin(wiring), OscilloscopeTwin(wiring))


registry.twins.add(make_pair, "scpi")
