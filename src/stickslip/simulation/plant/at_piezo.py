"""Drive after a piezo: the voltage that would cause the same free stroke without hysteresis and creep.

This voltage is the free stroke of the piezo divided by the gain. The free stroke does not depend on the
stage, so it is computed once, before the equations of motion are solved. The stage then has a drive like any
other, with breaks where plays start to move.
"""

from __future__ import annotations

import numpy as np

from ...physics.piezo.duhem import is_duhem
from ...physics.piezo.maxwell_capacitor import MaxwellCapacitor
from ...physics.piezo.model import Piezo
from ...waveform.drive import Drive
from .creeping import creeping, settled_terms
from .duhem_drive import duhem_drive
from .splitting import through


def tabulated(piezo: Piezo | None) -> bool:
    """Return True if the segment table of the drive after this piezo is an approximation (creep, or Duhem
    hysteresis), whose precision can be chosen; False if it is exact, or for None."""
    return piezo is not None and (piezo.creep is not None or is_duhem(piezo.hysteresis))


def at_piezo(
    piezo: Piezo,
    drive: Drive,
    end: float,
    precision: float,
    period: float | None = None,
    settled: bool = False,
) -> Drive:
    """Return the segment table of the voltage [V] after hysteresis and creep, up to `end` [s].

    Args:
        piezo: the model; before the drive starts, the piezo has rested for long at `drive.before`, reached
            from 0 V.
        drive: segment table of the voltage.
        end: end of the result, s.
        precision: largest error, V: half from the hysteresis, half from the creep.
        period: period of a drive that repeats, s; None if it does not.
        settled: return one period in the steady state, after many periods; `end` is then the period.

    Raises:
        QuantityError: see `duhem_drive`, `splitting.through` and `creeping`.
    """
    made = drive
    if isinstance(piezo.hysteresis, MaxwellCapacitor):
        return made  # unchanged: the elements of a MaxwellCapacitor are part of the plant
    if is_duhem(piezo.hysteresis):
        made = duhem_drive(piezo.hysteresis, drive, end, 0.5 * precision, settled)
    elif piezo.hysteresis is not None:
        plays, z = piezo.hysteresis.operators, piezo.hysteresis.rested(drive.before)
        rest = piezo.hysteresis.at_rest(drive.before)
        if settled:
            through(plays, drive, end, z, rest)
        made = through(plays, drive, end, z, rest, 0 if settled else cycle_of(drive, period))
    if piezo.creep is not None:
        rested = np.full(len(piezo.creep.shares), made.before)
        before = made.before + float(np.array(piezo.creep.shares) @ rested)
        terms = settled_terms(piezo.creep, made, end) if settled else rested
        made = creeping(piezo.creep, made, end, terms, 0.5 * precision)._replace(before=before)
    return made


def cycle_of(drive: Drive, period: float | None) -> int:
    """Return the number of segments in one period [s] of a segment table. Return 0 if `period` is None, or
    the table covers less than two periods or does not repeat exactly."""
    if period is None:
        return 0
    count = int(np.searchsorted(drive.start, period * (1.0 - 1e-9)))
    n = drive.start.size - count
    if count == 0 or n < count:
        return 0
    rows = np.diff(drive.first)
    alike = np.array_equal(drive.polynomial[:n], drive.polynomial[count:]) and np.array_equal(
        rows[:n], rows[count:]
    )
    own = len(drive.harmonic) - int(drive.first[count])
    return count if alike and np.array_equal(drive.harmonic[:own], drive.harmonic[-own or None :]) else 0
