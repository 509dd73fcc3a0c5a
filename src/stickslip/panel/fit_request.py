"""Request for a fit on the Identify page; the server checks it before a fit starts."""

from __future__ import annotations

from pydantic import Field

from .exploration import Model, Value


class FitRequest(Model):
    """Request to fit walks: recordings in the panel's folder, named by their paths relative to it.

    Times and rates are numbers in SI, or texts with units. The fields of `Model` are the initial guess.

    Attributes:
        recordings: walks to fit, from `begin` to `end` [s]; None: from the start, to the end.
        others: walks that are only predicted, from `begin` to `end`.
        steps: voltage steps with the end-effector clamped, which give the vibration mode of the stage.
        loops: slow drives to and fro with the end-effector clamped, which give hysteresis and creep.
        slew_rate: slew rate of the amplifier [V/s]; None if unknown.
        free, bounds: names of the fitted parameters, and their lower and upper bounds.
        starts: number of initial guesses from which the fit is repeated.
        hops: largest number of further searches for a lower minimum.
    """

    recordings: list[str] = Field(min_length=1, max_length=20)
    others: list[str] = Field(default_factory=list, max_length=40)
    steps: list[str] = Field(default_factory=list, max_length=20)
    loops: list[str] = Field(default_factory=list, max_length=20)
    begin: Value | None = None
    end: Value | None = None
    slew_rate: Value | None = None
    free: list[str] = Field(max_length=30)
    bounds: dict[str, tuple[Value, Value]] = Field(default_factory=dict, max_length=30)
    starts: int = Field(default=1, ge=1, le=20)
    hops: int = Field(default=0, ge=0, le=6)
