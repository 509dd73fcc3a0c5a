"""Checks of the load that a user gives: the normal force relative to the one at which the friction parameters
hold, a pure number."""

from __future__ import annotations

import math
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from ..quantities.units import QuantityError, with_prefix
from ..waveform.signal import Waveform

# Largest relative deviation of a ratio of two periods from a whole number. Rounding of 1/frequency causes it.
_WHOLE = 1e-9


def load_range(load: Waveform | float) -> tuple[float, float]:
    """Return the smallest and the largest value of a load (a number or a waveform) over all time.

    Raises:
        QuantityError: the load is neither a number nor a waveform.
    """
    if isinstance(load, Real):
        return float(load), float(load)
    found = getattr(load, "range", None)
    if found is None:
        raise QuantityError(
            f"load = {load!r} is no load: it is the normal force over its reference, a number or a waveform. "
            "An external force is a field of the actuator, external_force"
        )
    return found()


def refuse_other_period(load: Waveform | float, period: float | None) -> None:
    """Raise QuantityError unless the load is constant, or repeats for ever and an integer number of times in
    the `period` [s] of the drive (None: any period). Otherwise no motion has the drive's period."""
    low, high = load_range(load)
    if low == high:
        return
    name, own, end = type(load).__name__, getattr(load, "period", None), getattr(load, "duration", math.inf)
    instead = "follow the motion itself with `simulate`"
    drive = "the drive's period" if period is None else f"the drive's period of {with_prefix(period, 's', 9)}"
    if own is None or math.isfinite(end):
        what = "has no period" if own is None else f"ends after {with_prefix(end, 's', 9)}"
        raise QuantityError(
            f"load: a steady step needs one that repeats within {drive} for ever, and this {name} {what}: "
            f"give what it is in the end as a number, or {instead}"
        )
    periods = 1.0 if period is None else period / own
    if periods < 0.5 or abs(periods - round(periods)) > _WHOLE * periods:
        raise QuantityError(
            f"load: the period of this {name}, {with_prefix(own, 's', 9)}, is no whole part of {drive}, so "
            f"that no step is as the one before: give it that period, a half, a third, ..., or {instead}"
        )


def refuse_other_periods(load: Waveform | float, periods: NDArray[np.float64], reasons: list[str]) -> None:
    """Store in `reasons` [members] the message of `refuse_other_period` for each member whose drive's period
    (`periods` [members], s) does not fit the load. Members that already have a reason are skipped."""
    for m in (m for m, reason in enumerate(reasons) if not reason):
        try:
            refuse_other_period(load, float(periods[m]))
        except QuantityError as error:
            reasons[m] = str(error)
