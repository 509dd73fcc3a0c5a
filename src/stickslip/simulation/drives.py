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

# Largest error of a segment table after piezo hysteresis and creep, multiplied by the stage's gain, over the
# position tolerance of a run. The share is small, because a resonance or a slip amplifies the error. Study:
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
    """Return a periodic waveform without its limit on the number of periods; a waveform of infinite duration
    is returned unchanged."""
    return waveform._replace(periods=None) if math.isfinite(waveform.duration) else waveform


class Driven(NamedTuple):
    """Drive of a stage: a waveform, the piezo through whose hysteresis and creep it passes (None: no piezo
    model), and `precision`, the largest error of its segment table, V."""

    piezo: Piezo | None
    waveform: Any
    precision: float

    @property
    def period(self) -> float:
        """Return the period, s; 0 if the waveform does not repeat."""
        return getattr(self.waveform, "period", None) or 0.0

    def table(self, end: float, settled: bool) -> Drive:
        """Return the segment table from 0 to `end` [s]. With `settled`, return one period instead, as it is
        after many periods; `end` is then the period."""
        table = self.waveform.drive(end)
        if self.piezo is None:
            return by_periods(table, self.period or None, end)
        return at_piezo(self.piezo, table, end, self.precision, self.period or None, settled)


class Scaled(NamedTuple):
    """A waveform, the product of the waveform `of` (any type) and a constant factor."""

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
    """Return the largest error of the drive after the piezo, V (m for a pulled slider), that is allowed for a
    tolerance of the position, m. See `TABLE_SHARE`.

    The fields of the model may be arrays over the members of an ensemble; the smallest value of all members
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
    """Return a function from the position tolerance [m] of a run to the segment table of the drive.

    The function has the other arguments and the errors of `checked_drive`, and keeps the tables that it has
    computed. Without creep or Duhem hysteresis the table is exact, so it is the same for all tolerances.
    """
    exact = not (isinstance(model, Actuator) and tabulated(model.piezo))

    @functools.cache
    def made(tolerance: float) -> Drive:
        return checked_drive(model, waveform, end, periodic, tolerance)

    return lambda tolerance: made(1.0 if exact else tolerance)


def checked_drive(
    model: Actuator | PulledSlider, waveform: Waveform, end: float, periodic: bool, tolerance: float
) -> Drive:
    """Return the segment table of a waveform after the model's piezo. Unless `periodic`, a table shorter than
    two periods is extended to two, if it has at most `LONGEST_CYCLE` segments.

    Args:
        model: actuator, driven by a voltage, or pulled slider, driven by a position.
        waveform: the drive, V or m.
        end: end of the table, s; with `periodic`, the period.
        periodic: return one period in the steady state instead of a table that starts from rest.
        tolerance: tolerance of the position, m, for the precision of the table.

    Raises:
        TypeError: the drive is not a waveform.
        QuantityError: the waveform has the wrong unit, leaves the voltage range, or jumps and the model
            cannot follow; with `periodic`, the model has no steady step.
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
    """Return the message for a drive from `low` to `high` [V] outside the actuator's range, from `minimum` to
    `maximum` [V]."""
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
        reasons: text per member, empty if it is valid; members with a text are skipped. A refusal by the
            output stage is stored here, and the member keeps its waveform.
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
    """Store in `reasons` [members] a message for each member whose drive leaves the actuator's voltage range.
    Members that already have a reason are skipped.

    Args:
        model: the actuator, whose voltage limits may be arrays [members].
        rows: waveform of each member, V.
        scale: factor of each member on the waveform, [members].
        reasons: message for each member, "" if it is valid; changed in place.
    """
    lows, highs = (np.broadcast_to(v, len(rows)) for v in (model.min_voltage, model.max_voltage))
    for m, row in enumerate(rows):
        if reasons[m]:
            continue
        low, high = (float(scale[m]) * value for value in row.range())
        if low < lows[m] or high > highs[m]:
            reasons[m] = out_of_range(model, low, high, float(lows[m]), float(highs[m]))
