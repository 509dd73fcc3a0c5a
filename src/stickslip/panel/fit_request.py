"""Request for a fit on the Identify page, checked by the server."""

from __future__ import annotations

from pydantic import Field

from .exploration import Model, Value


class FitRequest(Model):
    """Request for a fit of recordings in the panel's folder.

    The fields of `Model` give the initial guess. `recordings` are fitted from `begin` to `end` [s]; `others`
    are only predicted. `free` names the fitted parameters, `bounds` their lower and upper bounds.

    `loops` and `steps` are recordings with the end-effector clamped. Loops, driven slowly to and fro, give
    hysteresis and creep; voltage steps give the mode of the stage. `slew_rate` [V/s] is the amplifier's, None
    if unknown. The fit is repeated from `starts` initial guesses; `hops` is the largest number of further
    searches for a lower minimum.
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
