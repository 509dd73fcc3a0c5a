"""Errors and warnings of simulations."""

from __future__ import annotations

from .periodic import Orbit


class SimulationError(RuntimeError):
    """Error: a simulation cannot be done at all."""


class SimulationWarning(UserWarning):
    """Warning: a simulation ended early, is less accurate than requested, or was done in another way than
    requested (without the GPU, with another past of the piezo); the message gives the reason."""


class NotPeriodicError(SimulationError):
    """Error: no stable periodic motion was found, or this motion has no derivatives. The attribute `orbit` is
    the last iterate of the search, the unstable orbit, or the orbit without derivatives."""

    def __init__(self, message: str, orbit: Orbit) -> None:
        super().__init__(message)
        self.orbit = orbit
