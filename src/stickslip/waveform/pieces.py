"""How segment tables are built: a list of pieces, once or period after period."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..units import QuantityError
from .drive import Drive

# A start that comes closer to the end than this (relative) is the end itself, but for rounding: 8 periods of
# 0.1 s in 0.8 s must not leave a ninth of 1e-16 s.
_SLIVER = 1e-12


class Piece(NamedTuple):
    """One formula of `drive.Drive`: start, c_0.. (up to four), and rows of amplitude, rad/s, rad, rad/s²."""

    start: float
    polynomial: tuple[float, ...]
    harmonics: tuple[tuple[float, float, float, float], ...] = ()


def assemble(before: float, pieces: Iterable[Piece], duration: float) -> Drive:
    """The drive made of pieces whose starts [s] ascend from 0; of several at one time, the last counts."""
    kept: dict[float, Piece] = {piece.start: piece for piece in pieces}
    drive = _table(before, list(kept.values()))
    return cut(drive, duration)


def repeat(
    pieces: Sequence[Piece], frequency: float, periods: float | None, rest: float, duration: float
) -> Drive:
    """The drive that repeats one period and then rests.

    Args:
        pieces: one period; starts are fractions of it, ascending from 0 to below 1, the rest as in `Piece`.
        frequency: Hz.
        periods: how many, None for no end.
        rest: value before t = 0 and after the last period.
        duration: s, finite; what lies beyond is left out.
    """
    if not math.isfinite(duration):
        raise QuantityError(
            f"duration = {duration} s is out of range: a periodic drive is tabulated up to a finite time"
        )
    needed = math.floor(max(duration, 0.0) * frequency) + 1
    count = needed if periods is None else min(needed, int(periods))
    one = _table(rest, pieces)
    # (k + fraction)/f rounds once: no error builds up, and sampling times n/rate that should meet it do
    start = ((np.arange(count)[:, None] + one.start) / frequency).ravel()
    polynomial = np.tile(one.polynomial, (count, 1))
    rows = np.tile(np.diff(one.first), count)
    harmonic = np.tile(one.harmonic, (count, 1))
    if periods is not None:
        start = np.append(start, periods / frequency)
        polynomial = np.append(polynomial, [[rest, 0.0, 0.0, 0.0]], axis=0)
        rows = np.append(rows, 0)
    return cut(Drive(float(rest), start, polynomial, np.append(0, np.cumsum(rows)), harmonic), duration)


def cut(drive: Drive, duration: float) -> Drive:
    """The drive without the segments that begin at `duration` [s], or later; the first one always stays."""
    count = max(1, int(np.searchsorted(drive.start, duration * (1 - _SLIVER))))
    rows = drive.first[count]
    return Drive(
        drive.before,
        drive.start[:count],
        drive.polynomial[:count],
        drive.first[: count + 1],
        drive.harmonic[:rows],
    )


def join(drives: Sequence[Drive], begins: Sequence[float]) -> Drive:
    """Drives one after the other, each from its begin [s] on; each must be cut at the next one's begin."""
    rows = np.concatenate([np.diff(drive.first) for drive in drives])
    return Drive(
        drives[0].before,
        np.concatenate([begin + drive.start for drive, begin in zip(drives, begins, strict=True)]),
        np.concatenate([drive.polynomial for drive in drives]),
        np.append(0, np.cumsum(rows)),
        np.concatenate([drive.harmonic for drive in drives]),
    )


def _table(before: float, pieces: Sequence[Piece]) -> Drive:
    polynomial = np.zeros((len(pieces), 4))
    for i, piece in enumerate(pieces):
        polynomial[i, : len(piece.polynomial)] = piece.polynomial
    rows = [row for piece in pieces for row in piece.harmonics]
    return Drive(
        float(before),
        np.array([piece.start for piece in pieces], dtype=float),
        polynomial,
        np.append(0, np.cumsum([len(piece.harmonics) for piece in pieces])).astype(np.int64),
        np.array(rows, dtype=float).reshape(-1, 4),
    )
