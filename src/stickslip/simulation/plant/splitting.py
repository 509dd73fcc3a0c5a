r"""A drive after play operators: an exact conversion of segment tables.

While the drive moves in one direction, the operators' output is linear in u between the points at which a
play starts to move or a dead zone ends. So each segment of the drive becomes several segments, which start
where the drive reverses or reaches such a point. Each has the formula of the drive multiplied by a slope,
plus a level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine._abi import ffi
from ...engine.binding import DriveTable, doubles, sized
from ...engine.library import library
from ...engine.members import integers
from ...physics.piezo.operators import Operators, struct_of
from ...quantities.units import QuantityError
from ...waveform.drive import Drive
from .cubics import MOST_PIECES, moved_on

Array = NDArray[np.float64]


class Pieces(NamedTuple):
    """Pieces of the operators' output under a drive u: in each, the output is level + slope (u(t) -
    u(start)).

    Attributes:
        start: start of each piece, s, [n].
        source: index of the drive's segment that contains the piece, [n].
        slope: change of the output over the change of the drive (V/V), [n].
        level: output at the start of the piece, V, [n].
    """

    start: Array
    source: NDArray[np.int64]
    slope: Array
    level: Array


def split(plays: Operators, drive: Drive, end: float, z: Array, pieces: Pieces) -> int:
    """Fill `pieces` with the output of play operators under a drive; return the number of pieces, or -1 if
    the arrays are too small.

    Args:
        plays: the operators.
        drive: segment table of the voltage.
        end: end of the last piece, s.
        z: states of the plays at the start, V; replaced by those at the end.
        pieces: arrays to fill, from the start.
    """
    sized("z", z, plays.threshold.size)
    start, slope, level = (doubles(row, "pieces", True) for row in (pieces.start, pieces.slope, pieces.level))
    source = integers(pieces.source, "pieces")
    made = ffi.new("struct pieces *", (pieces.start.size, start, source, slope, level))
    table = DriveTable(drive)
    return library().stickslip_plays_split(struct_of(plays), table.struct, end, doubles(z, "z", True), made)


def through(plays: Operators, drive: Drive, end: float, z: Array, rest: float, cycle: int = 0) -> Drive:
    """Return the segment table of a drive after play operators, up to `end` [s].

    Args:
        plays: the operators.
        drive: segment table of the voltage.
        end: end of the result, s.
        z: states of the plays at the start, V; replaced by those at the end (with a `cycle`, after two
            periods).
        rest: output before the start, V.
        cycle: number of segments in a period of a drive that repeats from its start; 0 for another drive.
            Only two periods are then computed: plays remember only the extremes of the voltage, so that later
            periods repeat the second one.

    Raises:
        QuantityError: the output has more segments than `cubics.MOST_PIECES`, in proportion to the drive's.
    """
    room, before = 64 + 4 * drive.start.size * (1 + plays.weight.size // 4), z.copy()
    some = end
    if 0 < 2 * cycle < drive.start.size:
        some, room = min(end, float(drive.start[2 * cycle])), 64 + 8 * cycle * (2 + plays.weight.size)
    while True:
        pieces = Pieces(np.empty(room), np.empty(room, np.int64), np.empty(room), np.empty(room))
        z[:] = before
        count = split(plays, drive, some, z, pieces)
        if count >= 0:
            break
        room *= 4
        if room > MOST_PIECES + 64 * drive.start.size:
            raise QuantityError(
                f"hysteresis makes more than {MOST_PIECES} segments of the drive up to {end:g} s"
            )
    made = Pieces(pieces.start[:count], pieces.source[:count], pieces.slope[:count], pieces.level[:count])
    return _table(drive, _repeated(made, drive, cycle, end) if some < end else made, rest)


def _repeated(pieces: Pieces, drive: Drive, cycle: int, end: float) -> Pieces:
    """Return the `pieces` of two periods, followed by repetitions of the second one up to `end` [s]. `cycle`
    is the number of segments of the drive in a period."""
    second = pieces.source >= cycle
    tau = (pieces.start - drive.start[pieces.source])[second]
    more = drive.start.size // cycle  # more repetitions than needed; those beyond the end are removed below
    source = (pieces.source[second] + cycle * np.arange(1, more + 1)[:, None]).ravel()
    there = source < drive.start.size
    source = source[there]
    start = drive.start[source] + np.tile(tau, more)[there]
    kept = start < end
    return Pieces(
        np.append(pieces.start, start[kept]),
        np.append(pieces.source, source[kept]),
        np.append(pieces.slope, np.tile(pieces.slope[second], more)[there][kept]),
        np.append(pieces.level, np.tile(pieces.level[second], more)[there][kept]),
    )


def _table(drive: Drive, pieces: Pieces, before: float) -> Drive:
    """Return the operators' output, given as pieces, as a segment table with the value `before` [V] before
    its start."""
    made = moved_on(drive, pieces.source, pieces.start)
    rows = np.diff(made.first)
    harmonic = made.harmonic.copy()
    owner = np.repeat(np.arange(rows.size), rows)
    waves = np.bincount(owner, harmonic[:, 0] * np.sin(harmonic[:, 2]), rows.size)
    harmonic[:, 0] *= pieces.slope[owner]
    polynomial = made.polynomial * pieces.slope[:, None]
    polynomial[:, 0] = pieces.level - pieces.slope * waves
    return Drive(before, pieces.start, polynomial, made.first, harmonic)
