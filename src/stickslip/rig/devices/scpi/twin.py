"""Twins of a function generator and an oscilloscope with one stage."""

from __future__ import annotations

from typing import NamedTuple

from ....quantities import registry
from ...twins.axis import Clock
from ...twins.stage import Stage
from .twin_generator import GeneratorTwin
from .twin_oscilloscope import OscilloscopeTwin
from .twin_wiring import Wiring


class InstrumentPair(NamedTuple):
    """Both instruments, for two servers."""

    generator: GeneratorTwin
    oscilloscope: OscilloscopeTwin


def make_pair(stages: list[Stage], seed: int = 0, clock: Clock | None = None) -> InstrumentPair:
    """Return both instruments, connected by an amplifier of 15 V/V and a sensor of 10 um/V on a stage."""
    del seed
    wiring = Wiring(stages[0], clock=clock)
    return InstrumentPair(GeneratorTwin(wiring), OscilloscopeTwin(wiring))


registry.twins.add(make_pair, "scpi")
