"""Segment tables of the drive of a model: a waveform after piezo hysteresis and creep, as precise as the
tolerance of a run requires."""

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

# Largest error of a segment table after piezo hysteresis and creep, multiplied by the stage's gain, as a
# fraction of the position tolerance of a run, because a resonance or a slip amplifies it. Study:
# docs/benchmarks/random-actuators.md.
TABLE_SHARE = 0.02
# Largest number of segments per period with which the engine detects that a drive repeats; the same number
# is in `engine/c/repeats.h`.
LONGEST_CYCLE = 64


def refuse_no_waveform(waveform: Waveform) -> None:
    """Raise TypeError if an object is not a waveform, that is, has no method `drive`."""
    if not hasattr(waveform, "drive"):
        raise TypeError(f"the drive is a waveform (Sawtooth, Sampled, ...), not a {type(waveform).__name__}")


def endless(waveform: Any) -> Any:
    """Return a periodic waveform that repeats without an end; a waveform that has no end is returned
    unchanged."""
    return waveform._replace(periods=None) if math.isfinite(waveform.duration) else waveform


class Driven(NamedTuple):
    """Drive of a stage: a waveform after the hysteresis and creep of a piezo (None: no piezo model).
    `precision` is the largest error of its table, V."""

    piezo: Piezo | None
    waveform: Any
    precision: float

    @property
    def period(self) -> float:
        """Return the period, s; 0 if the waveform does not repeat."""
        return getattr(self.waveform, "period", None) or 0.0

    def table(self, end: float, settled: bool) -> Drive:
        """Return the segment table up to `end` [s]. With `settled`, return one period in the steady state,
        after many periods."""
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
    """Return the largest error [V; m for a pulled slider] of the drive after the piezo that is allowed for a
    position tolerance [m].

    The fields of the model may be arrays over the members of an ensemble; the smallest error of all members
    is returned.
    """
    if not isinstance(model, Actuator):
        return TABLE_SHARE * tolerance
    rows = model.further_modes.rows if model.further_modes is not None else ()
    gain = np.abs(model.gain) + sum(np.abs(row[0]) for row in rows)
    return TABLE_SHARE * tolerance / max(float(np.nanmax(gain)), 1e-300)


def tables(
    model: Actuator | PulledSlider, waveform: Waveform, end: float, periodic: bool
) -> Callable[[float], Drive]:
    """Return a function from the position tolerance [m] of a run to the segment table of the drive up to
    `end` [s].

    Without creep or Duhem hysteresis the table is exact, and therefore the same for all tolerances. The
    function raises the errors of `checked_drive`.
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

    Args:
        model: actuator, driven by a voltage, or pulled slider, driven by a position.
        waveform: the drive, V or m.
        end: end of the table, s; with `periodic`, the period.
        periodic: return one period in the steady state instead of a table that starts from rest.
        tolerance: m.

    Raises:
        QuantityError: the waveform has the wrong unit, leaves the voltage range, or jumps and the model
            cannot follow.
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
        # The engine recognises a repetition only in a table of at least two periods.
        table = driven.table(2.0 * driven.period, False)
    return table


def out_of_range(model: Actuator, low: float, high: float, minimum: float, maximum: float) -> str:
    """Return the message for a drive [V] beyond the range of the actuator."""
    return (
        f"drive voltage from {low:g} V to {high:g} V is out of range: "
        f"{model.name or 'the actuator'} takes {minimum:g} V to {maximum:g} V"
    )


def behind(output: OutputStage, rows: list[Any], reasons: list[str]) -> list[Any]:
    """Return the waveforms at the piezo, after an output stage (converter and amplifier); equal drives are
    computed once.

    Args:
        output: the output stage.
        rows: waveform of each member.
        reasons: text per member, empty if it is valid; a refusal by the output stage is stored here, and the
            member keeps its waveform.
    """
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
    """Store in `reasons` [members] a sentence for each waveform that, multiplied by its factor in `scale`,
    leaves the voltage range of the actuator. Members that already have a reason are skipped."""
    lows, highs = (np.broadcast_to(v, len(rows)) for v in (model.min_voltage, model.max_voltage))
    for m, row in enumerate(rows):
        if reasons[m]:
            continue
        low, high = (float(scale[m]) * value for value in row.range())
        if low < lows[m] or high > highs[m]:
            reasons[m] = out_of_range(model, low, high, float(lows[m]), float(highs[m]))
