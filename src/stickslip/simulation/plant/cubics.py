"""Cubic polynomials that are added to a drive: they approximate hysteresis or creep between points of known
value and slope.

The drive keeps its formulas; each of its segments is divided into pieces, and each piece has one cubic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine._abi import ffi
from ...engine.binding import doubles
from ...engine.members import integers
from ...quantities.units import QuantityError
from ...waveform.drive import Drive

Array = NDArray[np.float64]

# Largest number of pieces of a table, about 200 MB. A drive that needs more is refused.
MOST_PIECES = 4_000_000


class Cubics(NamedTuple):
    """Cubic pieces that are added to a drive.

    Fields: `start` [n], start of each piece, s; `source` [n], index of the drive's segment that contains the
    piece; `cubic` [n, 4], coefficients of the added polynomial of the time since `start`, constant term
    first.
    """

    start: Array
    source: NDArray[np.int64]
    cubic: Array


def cubics_struct(pieces: Cubics) -> Any:
    """Return a C struct with pointers to the arrays of `pieces`, which the engine fills. The struct is valid
    as long as the arrays exist."""
    cubic = ffi.cast("real_t (*)[4]", doubles(pieces.cubic, "pieces", True))
    start, source = doubles(pieces.start, "pieces", True), integers(pieces.source, "pieces")
    return ffi.new("struct cubics *", (pieces.start.size, start, source, cubic))


def filled(fill: Callable[[Array, Cubics], int], state: Array, room: int) -> Cubics:
    """Return the pieces that the function `fill` makes, in arrays that are enlarged until the pieces fit.

    Args:
        fill: function of the state and of empty `Cubics` to fill; it replaces the state by that at the end,
            and returns the number of pieces, or -1 if they do not fit.
        state: state of hysteresis or creep at the start, V; replaced by the state at the end.
        room: number of pieces for which the arrays of the first attempt have room.

    Raises:
        QuantityError: more pieces are needed than `MOST_PIECES`.
    """
    begun, room = state.copy(), min(room, MOST_PIECES)
    while True:
        pieces = Cubics(np.empty(room), np.empty(room, np.int64), np.empty((room, 4)))
        state[:] = begun
        count = fill(state, pieces)
        if count >= 0:
            return Cubics(pieces.start[:count], pieces.source[:count], pieces.cubic[:count])
        if room == MOST_PIECES:
            raise QuantityError(
                f"hysteresis and creep make more than {MOST_PIECES} segments of the drive: shorten the "
                "drive, or allow a greater tolerance"
            )
        room = min(4 * room, MOST_PIECES)


def with_cubics(drive: Drive, pieces: Cubics, before: float) -> Drive:
    """Return the sum of the drive and the cubics as a segment table, whose value before its start is `before`
    [V]; each piece becomes a segment."""
    made = moved_on(drive, pieces.source, pieces.start)
    return Drive(before, pieces.start, made.polynomial + pieces.cubic, made.first, made.harmonic)


def moved_on(drive: Drive, source: NDArray[np.int64], start: Array) -> Drive:
    """Return a drive whose segment i is a part of segment `source[i]` of the given one: it starts at
    `start[i]` [s], and its formula is rewritten for the time since then. The signal is not changed."""
    tau = start - drive.start[source]
    c0, c1, c2, c3 = drive.polynomial[source].T
    polynomial = np.column_stack(
        [c0 + tau * (c1 + tau * (c2 + tau * c3)), c1 + tau * (2 * c2 + 3 * tau * c3), c2 + 3 * tau * c3, c3]
    )
    rows = np.diff(drive.first)[source]
    first = np.append(0, np.cumsum(rows)).astype(np.int64)
    which = np.repeat(drive.first[:-1][source] - first[:-1], rows) + np.arange(first[-1])
    amplitude, omega, phase, chirp = drive.harmonic[which].T
    late = np.repeat(tau, rows)
    columns = (amplitude, omega + 2.0 * chirp * late, phase + late * (omega + chirp * late), chirp)
    return Drive(drive.before, start, polynomial, first, np.column_stack(columns))
