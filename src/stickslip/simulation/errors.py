"""Errors and warnings of simulations."""

from __future__ import annotations

from .periodic import Orbit


class SimulationError(RuntimeError):
    """A simulation could not be done at all."""


class SimulationWarning(UserWarning):
    """A simulation ended before its time: what there is of it comes back, with the reason."""


class NotPeriodicError(SimulationError):
    """No periodic motion was found; `orbit` is the best that was, with its multipliers."""

    def __init__(self, message: str, orbit: Orbit) -> None:
        super().__init__(message)
        self.orbit = orbit
