"""Controllers of a user's own, for the rig's process, which runs this file by its path."""

from __future__ import annotations

import threading

from stickslip.quantities import registry
from stickslip.quantities.units import QuantityError

PATIENCE = 300.0  # s
ANSWER = threading.Event()  # until a controller that stalls may answer


@registry.controllers.add
class Ramping:
    """`slope` V each tick, up to `top`; then what a test wants to see at the tick `at`."""

    def __init__(self, slope: float, top: float, at: int = 10**9, does: str = "") -> None:
        self.slope, self.top, self.at, self.does = slope, top, at, does
        self.done = False
        self.ticks = 0

    def command(self, top: float) -> None:
        if top < 0.0:
            raise QuantityError("top [V] must not be below 0")
        self.top = top

    def told(self) -> dict[str, float]:
        return {"ticks": self.ticks, "top": self.top}

    def step(self, measured: float, target: float, tick: int) -> float:
        self.ticks = tick + 1
        if tick == self.at:
            if self.does == "raise":
                raise RuntimeError("broken")
            if self.does == "nan":
                return float("nan")
            if self.does == "stall":
                ANSWER.wait(PATIENCE)
            self.done = self.does == "done"
        return min(self.slope * tick, self.top)
