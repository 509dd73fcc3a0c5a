"""Segment tables of drives: a waveform after the piezo, computed to the precision that a tolerance
requires."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..physics.actuator import Actuator, PulledSlider
from ..physics.electronics.output import OutputStage
from ..physics.piezo.model import Piezo
from ..quantities.units import QuantityError
from ..waveform.drive import Drive
from ..waveform.pieces import by_periods
from ..waveform.signal import Waveform
from . import two_port
from .jumps import cannot_jump, refuse_jumps
from .models import refuse_places
from .plant.at_piezo import at_piezo, tabulated

# Largest error of a table after the piezo, multiplied by the gain, as a share of the tolerance of a run,
# because a resonance or a slip amplifies it. Study: docs/benchmarks/random-actuators.md.
TABLE_SHARE = 0.02
# Largest number of segments in a period that the engine recognises, see `engine/c/repeats.h`.
LONGEST_CYCLE = 64


def refuse_no_waveform(waveform: Waveform) -> None:
    """Raise TypeError for an object that is not a drive."""
    if not hasattr(waveform, "drive"):
        raise TypeError(f"the drive is a waveform (Sawtooth, Sampled, ...), not a {type(waveform).__name__}")


def endless(waveform: Any) -> Any:
    """Return the waveform without an end, if it has a number of periods."""
    return waveform._replace(periods=None) if math.isfinite(waveform.duration) else waveform


class Driven(NamedTuple):
    """A waveform after a piezo, if there is one, within the precision [V]: the drive of the stage."""

    piezo: Piezo | None
    waveform: Any
    precision: float

    @property
    def period(self) -> float:
        """Return the period, s; 0 if the waveform does not repeat."""
        return getattr(self.waveform, "period", None) or 0.0

    def table(self, end: float, settled: bool) -> Drive:
        """Return the segment table up to `end` [s]; if `settled`, the table of one period after many."""
        table = self.waveform.drive(end)
        if self.piezo is None:
            return by_periods(table, self.period or None, end)
        return at_piezo(self.piezo, table, end, self.precision, self.period or None, settled)


class Scaled(NamedTuple):
    """A waveform multiplied by a factor; the waveform may be of any type."""

    of: Any
    factor: float

    @property
    def period(self) -> float | None:
        return getattr(self.of, "period", None)

    @property
    def duration(self) -> float:
        return float(self.of.duration)

    def drive(self, end: float) -> Drive:
        table = self.of.drive(end)
        harmonic = table.harmonic * np.array([self.factor, 1.0, 1.0, 1.0])
        before, polynomial = self.factor * table.before, self.factor * table.polynomial
        return table._replace(before=before, polynomial=polynomial, harmonic=harmonic)


def table_precision(model: Actuator | PulledSlider, tolerance: float) -> float:
    """Return the largest error [V] of the drive after the piezo that suits a tolerance [m] of the position;
    for an ensemble, whose fields are arrays, the smallest of all members."""
    if not isinstance(model, Actuator):
        return TABLE_SHARE * tolerance
    rows = model.further_modes.rows if model.further_modes is not None else ()
    gain = np.abs(model.gain) + sum(np.abs(row[0]) for row in rows)
    return TABLE_SHARE * tolerance / max(float(np.nanmax(gain)), 1e-300)


def tables(
    model: Actuator | PulledSlider, waveform: Waveform, end: float, periodic: bool
) -> Callable[[float], Drive]:
    """Return a function from the tolerance [m] of a run to the segment table of the drive; an exact table is
    always the same.

    It raises the errors of `checked_drive`.
    """
    exact = not (isinstance(model, Actuator) and tabulated(model.piezo))

    @functools.cache
    def made(tolerance: float) -> Drive:
        return checked_drive(model, waveform, end, periodic, tolerance)

    return lambda tolerance: made(1.0 if exact else tolerance)


def checked_drive(
    model: Actuator | PulledSlider, waveform: Waveform, end: float, periodic: bool, tolerance: float
) -> Drive:
    """Return the table of a waveform after the model's piezo, up to `end` [s], for a tolerance [m] of the
    position.

    Raises:
        QuantityError: the waveform cannot drive this model.
    """
    unit = "V" if isinstance(model, Actuator) else "m"
    refuse_no_waveform(waveform)
    if waveform.unit != unit:
        raise QuantityError(f"the drive of an {type(model).__name__} is in {unit}, not in {waveform.unit}")
    if periodic:
        refuse_places(model)
    piezo = model.piezo if isinstance(model, Actuator) else None
    driven = Driven(piezo, waveform, table_precision(model, tolerance))
    table = driven.table(end, periodic)
    if isinstance(model, Actuator):
        low, high = waveform.range()
        if low < model.min_voltage or high > model.max_voltage:
            raise QuantityError(out_of_range(model, low, high, model.min_voltage, model.max_voltage))
        if cannot_jump(model) or two_port.driven_by_voltage(model):
            refuse_jumps(model, table, end if periodic else None)
    if not periodic and end < 2.0 * driven.period and table.start.size <= LONGEST_CYCLE:
        # two periods, so that the engine recognises the repetition
        table = driven.table(2.0 * driven.period, False)
    return table


def out_of_range(model: Actuator, low: float, high: float, minimum: float, maximum: float) -> str:
    """Return the message for a drive [V] beyond the range of the actuator."""
    return (
        f"drive voltage from {low:g} V to {high:g} V is out of range: "
        f"{model.name or 'the actuator'} takes {minimum:g} V to {maximum:g} V"
    )


def behind(output: OutputStage, rows: list[Any], reasons: list[str]) -> list[Any]:
    """Return the voltages at the piezo, each different drive once; add refusals by the output stage to the
    reasons."""
    made: dict[Any, Any] = {}
    for m, row in enumerate(rows):
        if reasons[m] or row in made:
            continue
        try:
            made[row] = output.behind(row)
        except QuantityError as error:
            reasons[m] = str(error)
    return [made.get(row, row) for row in rows]


def refuse_voltages(model: Actuator, rows: list[Any], scale: NDArray[np.float64], reasons: list[str]) -> None:
    """Add to `reasons` a sentence for each waveform that, multiplied by its factor in `scale`, leaves the
    voltage range of the actuator."""
    lows, highs = (np.broadcast_to(v, len(rows)) for v in (model.min_voltage, model.max_voltage))
    for m, row in enumerate(rows):
        if reasons[m]:
            continue
        low, high = (float(scale[m]) * value for value in row.range())
        if low < lows[m] or high > highs[m]:
            reasons[m] = out_of_range(model, low, high, float(lows[m]), float(highs[m]))
