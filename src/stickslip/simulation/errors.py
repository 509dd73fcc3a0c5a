"""Errors and warnings of simulations."""

from __future__ import annotations

from .periodic import Orbit


class SimulationError(RuntimeError):
    """Error: a simulation cannot be done at all."""


class SimulationWarning(UserWarning):
    """Warning: a simulation ended early or is less accurate than requested; the message gives the reason."""


class NotPeriodicError(SimulationError):
    """Error: no periodic motion was found; `orbit` is the best attempt, with its multipliers."""

    def __init__(self, message: str, orbit: Orbit) -> None:
        super().__init__(message)
        self.orbit = orbit
