r"""A drive after Duhem hysteresis (`physics.piezo.duhem`: Bouc-Wen, or a user's model), whose hysteretic part
h is approximated by cubics.

The result is u - h, in which the formulas of the voltage u are unchanged. Values and slopes of h [V] are
known at any time between reversals of u. Each cubic covers a piece so short that its error stays within the
precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.binding import DriveTable, doubles
from ...engine.library import library
from ...physics.piezo.duhem import EXACT, EngineModel, output, rested
from ...quantities.units import QuantityError
from ...waveform.drive import Drive
from .cubics import Cubics, cubics_struct, filled, with_cubics

Array = NDArray[np.float64]

# Smallest precision of a table, V: ten times the error of the computed h. Smaller ones are replaced by this.
FINEST = 10.0 * EXACT
# Largest number of periods that are computed to find the steady state, in which h repeats from period to
# period.
SETTLES = 1_000


def duhem_drive(of: Any, drive: Drive, end: float, precision: float, settled: bool = False) -> Drive:
    """Return the segment table of the drive [V] after Duhem hysteresis, up to `end` [s]. Before its start,
    the piezo has rested for long at `drive.before`.

    Args:
        of: model of the hysteresis.
        drive: segment table of the voltage.
        end: end of the result, s.
        precision: largest error, V, at least `FINEST`.
        settled: return one period in the steady state, after many periods; `end` is then the period.

    Raises:
        QuantityError: more pieces than fit into memory, or h is not finite.
    """
    _refuse_infinite(of, drive, end)
    most = max(precision, FINEST)
    state = np.array([drive.before, rested(of, drive.before)])
    model, table, cubics = EngineModel(of), DriveTable(drive), library().stickslip_duhem_cubics

    def fill(state: Array, pieces: Cubics) -> int:
        into = doubles(state, "state", True)
        return model.call(cubics, table.struct, end, into, most, cubics_struct(pieces))

    room = 64 + 32 * drive.start.size
    pieces = filled(fill, state, room)
    for _ in range(SETTLES if settled else 0):
        before = state[1]
        pieces = filled(fill, state, room)
        if math.isclose(state[1], before, rel_tol=1e-14, abs_tol=1e-3 * FINEST):
            break
    return with_cubics(drive, pieces, drive.before - rested(of, drive.before))


def _refuse_infinite(of: Any, drive: Drive, end: float) -> None:
    """Raise QuantityError if the hysteretic part h becomes infinite or NaN in cycles between the smallest and
    the largest voltage of the segment table `drive` up to `end` [s].

    Args:
        of: model of the hysteresis.
        drive: segment table of the voltage.
        end: s.
    """
    rows = np.diff(drive.first)
    swing = np.bincount(np.repeat(np.arange(rows.size), rows), np.abs(drive.harmonic[:, 0]), rows.size)
    lasts = np.maximum(np.append(drive.start[1:], max(end, drive.start[-1])) - drive.start, 0.0)
    ends = np.sum(drive.polynomial * lasts[:, None] ** np.arange(drive.polynomial.shape[1]), axis=1)
    u = np.concatenate([drive.polynomial[:, 0], ends, [drive.before]])
    swing = np.concatenate([swing, swing, [0.0]])
    low, high = float(np.min(u - swing)), float(np.max(u + swing))
    if not np.all(np.isfinite(output(of, [high, low, high, low, 0.0]))):
        raise QuantityError(
            f"{type(of).__name__}: h is not finite between {low:.4g} V and {high:.4g} V: dh/du must be "
            "finite at every voltage of the drive"
        )
