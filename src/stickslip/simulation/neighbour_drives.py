"""Drives of neighbours, whose fields differ a little, and where the normal force breaks beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuator import Actuator
from ..units import QuantityError
from ..waveform.drive import Drive
from ..waveform.members import Drives, stacked
from ..waveform.pieces import with_breaks
from .models import drive_table
from .varied import waveform_value, with_field

# Relative, and absolute where a value is zero. The steps are the same, so only rounding limits it.
DIFFERENCE = 1e-6
# How much longer the tables of neighbours are, whose breaks may be later.
LONGER = 1.01
# How far their breaks may be from the trajectory's own, over its length; and their formulas, relative.
MOST_APART = 1e-4


def beside(waveform: Any, name: str) -> tuple[Any, float]:
    """The waveform with a number that differs a little, to the side that its record allows, and by how
    much."""
    value = waveform_value(waveform, name)
    step = DIFFERENCE * (abs(value) or 1.0)
    try:
        return with_field(waveform, name, value + step), step
    except QuantityError:
        try:
            return with_field(waveform, name, value - step), -step
        except QuantityError as error:
            raise QuantityError(f"no derivative by {name!r} at {value:g}: {error}") from None


def own_table(model: Actuator, waveform: Any, end: float) -> Drive:
    """Over two periods at least."""
    return drive_table(model, waveform, max(end, 2.0 * (getattr(waveform, "period", None) or 0.0)))


def breaks_apart(load: Drive | None, drive: Drive, end: float) -> NDArray[np.float64]:
    """Where the normal force breaks away from the breaks of the drive, s. A neighbour's step is at the same
    fraction of its own segment, and the normal force stays where it is."""
    if load is None:
        return np.zeros(0)
    times = load.start[(load.start > 0.0) & (load.start < end)]
    near = np.searchsorted(drive.start, times + MOST_APART * end * np.array([[-1.0], [1.0]]))
    return times[near[0] == near[1]]


def neighbour_drives(
    model: Actuator,
    waveform: Any,
    itself: Drive,
    waveforms: list[Any],
    names: Sequence[str],
    end: float,
    breaks: NDArray[np.float64],
) -> Drives:
    """The tables of the neighbours, over a little more than the trajectory.

    Raises:
        QuantityError: one has other segments than the waveform itself, so that there is no derivative.
    """
    tables = [own_table(model, w, LONGER * end) for w in waveforms]
    for name, table in zip(names, tables, strict=True):
        n = itself.start.size
        alike = table.start.size >= n and np.array_equal(table.first[: n + 1], itself.first[: n + 1])
        if alike:
            apart = np.abs(table.polynomial[:n] - itself.polynomial).max(axis=0)
            alike = np.all(apart <= MOST_APART * np.abs(itself.polynomial).max(axis=0) + 1e-9)
        if not alike or np.max(np.abs(table.start[:n] - itself.start)) > MOST_APART * end:
            why = "the drive has a jump or a kink there that appears or vanishes"
            if model.piezo is not None:
                why = "after the piezo's hysteresis and creep the drive has other pieces beside it"
            raise QuantityError(
                f"no derivative by {name!r} at {waveform_value(waveform, name):g}: {why}; take differences "
                "of `simulate` instead"
            )
    return stacked([with_breaks(table, breaks) for table in tables])
