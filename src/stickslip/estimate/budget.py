"""CPU budget of a search that explains little: it ends early, and says so."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

# s of CPU, after which a search of a model that explains little ends.
SECONDS = 30.0
# Share of the motion beyond its noise that a model explains at least while it converges to the right one. Right
# models of walks explain more after the first short searches, and wrong friction laws do too.
LITTLE = 0.8
# Fewest evaluations before that: so a slow machine, or a long recording, ends no search that has hardly begun.
FEWEST = 60


@dataclass
class Budget:
    """What all searches of one identification share.

    Attributes:
        total: sum of squares of the recordings about their means, weighted as the residuals are.
        noise: what of that is their white noise.
        over: whether the budget was spent.
    """

    total: float
    noise: float
    over: bool = False
    _begun: float = field(default=math.nan, init=False)
    _evaluations: int = field(default=0, init=False)
    _lowest: float = field(default=math.inf, init=False)

    @classmethod
    def of(cls, measured: Sequence[NDArray[np.float64]], white: Sequence[float], unit: float = 1.0) -> Budget:
        """Return the budget for recordings.

        Args:
            measured: [n] of each recording.
            white: standard deviation of the white noise of each.
            unit: standard deviation that residuals are weighted by.
        """
        total = sum(float(np.var(x)) * x.size for x in measured)
        noise = sum(sigma**2 * x.size for sigma, x in zip(white, measured, strict=True))
        return cls(total / unit**2, min(noise, total) / unit**2)

    @property
    def explained(self) -> float:
        """Share of the motion beyond its noise that the best model explains."""
        left = max(self._lowest - self.noise, 0.0)
        return max(1.0 - left / (self.total - self.noise), 0.0) if self.total > self.noise else 1.0

    def spend(self, cost: float) -> bool:
        """Count an evaluation with the lowest weighted sum of squares so far, and return whether all is spent.

        The time starts after the first evaluations, for these may compile.
        """
        self._evaluations += 1
        self._lowest = min(self._lowest, cost)
        if self._evaluations <= 3 or math.isnan(self._begun):
            self._begun = time.thread_time()
        late = time.thread_time() - self._begun > SECONDS and self._evaluations >= FEWEST
        self.over = self.over or (late and self.explained < LITTLE)
        return self.over

    @property
    def said(self) -> str:
        """A sentence on a search that ended early."""
        return (
            f"stopped after {SECONDS:g} s of CPU, because the model explains only {100.0 * self.explained:.2g} "
            "% of the motion beyond its noise: check which drive and model belong to the recordings"
        )
