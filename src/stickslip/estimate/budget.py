"""CPU budget of a search whose model explains little: the search ends early and reports it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .result import Fit

# CPU time, in s, after which the searches end if the model explains little of the motion.
SECONDS = 30.0
# Largest `explained` share at which a model counts as explaining little. After the first short searches, even
# wrong friction laws explain more.
LITTLE = 0.8
# Fewest evaluations of the model before the budget can end a search, so that a slow machine does not stop a
# search at once.
FEWEST = 60


@dataclass
class EvaluationBudget:
    """CPU budget that all searches of one identification share; the clock starts with the first evaluation.

    Attributes:
        total: sum of squares of the recordings about their means, divided by the squared `unit` of `of`.
        noise: part of `total` that is white noise.
        over: True once the budget is spent.
    """

    total: float
    noise: float
    over: bool = False
    _begun: float = field(default=math.nan, init=False)
    _evaluations: int = field(default=0, init=False)
    _lowest: float = field(default=math.inf, init=False)

    @classmethod
    def of(
        cls, measured: Sequence[NDArray[np.float64]], white: Sequence[float], unit: float = 1.0
    ) -> EvaluationBudget:
        """Return the unspent budget for recordings.

        Args:
            measured: measured values [n] of each recording.
            white: standard deviation of the white noise of each recording, in the unit of the data.
            unit: standard deviation by which the searches divide all residuals, in the unit of the data.
        """
        total = sum(float(np.var(x)) * x.size for x in measured)
        noise = sum(sigma**2 * x.size for sigma, x in zip(white, measured, strict=True))
        return cls(total / unit**2, min(noise, total) / unit**2)

    @property
    def explained(self) -> float:
        """Return the share, 0 to 1, of the motion's sum of squares beyond its noise that the best model so
        far explains; 1 if there is only noise."""
        left = max(self._lowest - self.noise, 0.0)
        return max(1.0 - left / (self.total - self.noise), 0.0) if self.total > self.noise else 1.0

    def spend(self, cost: float) -> bool:
        """Count an evaluation of the model; return True if the budget is spent.

        The budget is spent after `SECONDS` of this thread's CPU time and `FEWEST` evaluations, if `explained`
        is below `LITTLE` then. A spent budget stays spent.

        Args:
            cost: lowest weighted sum of squares of this search so far; a higher one than in an earlier search
                is ignored.
        """
        self._evaluations += 1
        self._lowest = min(self._lowest, cost)
        if math.isnan(self._begun):
            self._begun = time.thread_time()
        late = time.thread_time() - self._begun > SECONDS and self._evaluations >= FEWEST
        self.over = self.over or (late and self.explained < LITTLE)
        return self.over

    def told(self, fit: Fit) -> Fit:
        """Return a copy of the fit that is marked as not converged, with the reason as its message, if the
        budget was spent; otherwise the fit itself."""
        return replace(fit, converged=False, message=self.said) if self.over else fit

    @property
    def said(self) -> str:
        """Return the sentence that explains why a search ended early, with the explained share in percent."""
        share = f"{100.0 * self.explained:.2g} %"
        return (
            f"stopped after {SECONDS:g} s of CPU, because the model explains only {share}"
            " of the motion beyond its noise: check which drive and model belong to the recordings"
        )
