"""Request for a fit on the Identify page, checked by the server."""

from __future__ import annotations

from pydantic import Field

from .exploration import Model, Value


class FitRequest(Model):
    """Request for a fit.

    It names the recordings (in the panel's folder), their part from `begin` to `end` [s], the model at which
    the fit starts, its free parameters, and their bounds. `others` are only predicted.

    `loops` and `steps` are recordings of the clamped end-effector: loops, driven slowly to and fro, give
    hysteresis and creep; steps give the mode of the stage. `slew_rate` [V/s] is the amplifier's, if known.
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
