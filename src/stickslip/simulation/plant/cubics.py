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

# Largest number of pieces of a table, about a gigabyte. A drive that needs more is refused.
MOST_PIECES = 4_000_000


class Cubics(NamedTuple):
    """Cubic pieces: `start` [n], s; `source` [n], index of the drive's segment; `cubic` [n, 4], coefficients
    of the added polynomial of the time since `start`, constant term first."""

    start: Array
    source: NDArray[np.int64]
    cubic: Array


def cubics_struct(pieces: Cubics) -> Any:
    """Return the pieces as a C struct for the engine to fill; it is valid as long as their arrays exist."""
    cubic = ffi.cast("real_t (*)[4]", doubles(pieces.cubic, "pieces", True))
    start, source = doubles(pieces.start, "pieces", True), integers(pieces.source, "pieces")
    return ffi.new("struct cubics *", (pieces.start.size, start, source, cubic))


def filled(fill: Callable[[Array, Cubics], int], state: Array, room: int) -> Cubics:
    """Return the pieces that the function `fill` makes, in arrays that are enlarged until the pieces fit.

    Args:
        fill: function of the state and of empty `Cubics` to fill; it replaces the state by that at the end,
            and returns the number of pieces, or -1 if they do not fit.
        state: state at the start.
        room: number of pieces in the first attempt.

    Raises:
        QuantityError: more pieces than fit into memory.
    """
    begun = state.copy()
    while room <= 4 * MOST_PIECES:
        pieces = Cubics(np.empty(room), np.empty(room, np.int64), np.empty((room, 4)))
        state[:] = begun
        count = fill(state, pieces)
        if count >= 0:
            return Cubics(pieces.start[:count], pieces.source[:count], pieces.cubic[:count])
        room *= 4
    raise QuantityError(
        f"hysteresis and creep make more than {MOST_PIECES} segments of the drive: shorten the drive, or "
        "allow a greater tolerance"
    )


def with_cubics(drive: Drive, pieces: Cubics, before: float) -> Drive:
    """Return the drive plus the cubics as a segment table; before its start, its value is `before` [V]."""
    made = moved_on(drive, pieces.source, pieces.start)
    return Drive(before, pieces.start, made.polynomial + pieces.cubic, made.first, made.harmonic)


def moved_on(drive: Drive, source: NDArray[np.int64], start: Array) -> Drive:
    """Return the segments `source` [n] of a drive with their formulas rewritten for later start times `start`
    [n], s."""
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
