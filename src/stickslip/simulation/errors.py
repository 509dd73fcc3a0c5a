"""Errors and warnings of simulations."""

from __future__ import annotations

from .periodic import Orbit


class SimulationError(RuntimeError):
    """Error: a simulation cannot be done at all."""


class SimulationWarning(UserWarning):
    """Warning: a simulation ended early or is less accurate than requested; the message gives the reason."""


class NotPeriodicError(SimulationError):
    """Error: no stable periodic motion was found. The attribute `orbit` is the last iterate of the search, or
    the unstable orbit."""

    def __init__(self, message: str, orbit: Orbit) -> None:
        super().__init__(message)
        self.orbit = orbit
