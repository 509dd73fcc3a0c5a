"""Periodic motions of an actuator under conditions: fast for the search, and accurate for the result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction import elements
from ..physics.actuator import Actuator
from ..quantities.progress import unheard
from ..waveform.signal import Waveform
from .polygons import Polygons
from .solving import solved

Array = NDArray[np.float64]
# Tolerances of the net step, m, for the search and for the result. They are small because at an optimum the
# contact may be at the limit of slip. If the periodic motion is not found at one tolerance, the next is
# tried.
SEARCHED = 1e-8
REPORTED = (1e-11, 1e-12, 1e-10, 1e-9, 1e-8)
# Tolerances of the net step, m, of a result with a static friction law: without derivatives the periodic
# motion is found slowly.
REPORTED_STATIC = (1e-9, 1e-10, 1e-8)


class PeriodicMotions(NamedTuple):
    """Periodic motion of each drive under each condition: arrays of shape (n, conditions).

    `steps` are net steps, m. `ripple`, m, and `backward_rate` are computed if requested (see
    `design.motion`). Values that are not requested, or without a periodic motion, are NaN.
    """

    steps: Array
    ripple: Array
    backward_rate: Array

    def of(self, i: int) -> PeriodicMotions:
        """Return the motion of drive number i."""
        return PeriodicMotions(*(column[i][None] for column in self))


def moved(
    model: Actuator,
    shapes: Polygons,
    columns: Mapping[str, Array],
    threads: int | None = None,
    own: Mapping[str, Array] | None = None,
    extras: tuple[str, ...] = (),
) -> PeriodicMotions:
    """Return the periodic motion of each drive under each condition, shape (n, conditions).

    The tolerance is that of the search.

    Args:
        model: the actuator.
        shapes: n drives, each a polygon.
        columns: parameters of the conditions by name, arrays [conditions], the same for all drives.
        threads: number of threads; None: all processors.
        own: parameters that differ between drives, by name, arrays [n, conditions].
        extras: names of the requested results besides the net step: "ripple", "backward_rate".
    """
    n, own = len(shapes.period), own or {}
    conditions = max([1, *(c.size for c in columns.values()), *(c.shape[1] for c in own.values())])
    each = np.repeat(np.arange(n), conditions)
    k, period = shapes.shares.shape[1], shapes.period[each]
    varied: dict[str, Array] = {"period": period}
    for i in range(k):
        varied[f"value_{i + 1}"] = shapes.volts[each, i]
        if i:
            varied[f"time_{i + 1}"] = shapes.shares[each, i] * period
    varied |= {name: np.tile(column, n) for name, column in columns.items()}
    varied |= {name: column.ravel() for name, column in own.items()}
    found = _solved(model, shapes.one(0), varied, SEARCHED, threads, extras)
    return PeriodicMotions(*(column.reshape(n, conditions) for column in found))


def exactly(
    model: Actuator,
    drives: list[Waveform],
    columns: Mapping[str, Array],
    threads: int | None = None,
    extras: tuple[str, ...] = (),
) -> PeriodicMotions:
    """Return the periodic motion of each drive under each condition, shape (drives, conditions), at the
    tolerances of a result, which are tried in turn.

    Args:
        model, columns, threads, extras: as for `moved`.
        drives: any periodic waveforms, V.
    """
    conditions = max([1, *(c.size for c in columns.values())])
    rows = PeriodicMotions(*np.full((3, len(drives), conditions), np.nan))
    members = columns or {"external_force": np.array([model.external_force])}
    for i, drive in enumerate(drives):
        for tolerance in REPORTED if elements(model.friction) else REPORTED_STATIC:
            left = np.flatnonzero(np.isnan(rows.steps[i]))
            if not left.size:
                break
            part = {name: column[left] for name, column in members.items()}
            for row, found in zip(rows, _solved(model, drive, part, tolerance, threads, extras), strict=True):
                row[i, left] = found
    return rows


def _solved(
    model: Actuator,
    drive: Waveform,
    members: Mapping[str, Array],
    tolerance: float,
    threads: int | None,
    extras: tuple[str, ...],
) -> PeriodicMotions:
    """Return the periodic motion of each member, arrays [members].

    Args:
        model: the actuator.
        drive: the drive.
        members: varied parameters of the model or the drive, by name, arrays [members].
        tolerance: tolerance of the net step, m.
        threads: see `moved`.
        extras: see `moved`.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
    """
    found = solved(model, drive, members, tolerance, 1.0, threads, None, unheard, extras)
    if found.interrupted:
        raise KeyboardInterrupt
    none = np.full(found.steps.size, np.nan)
    beside = (found.beside.get(name, none) for name in PeriodicMotions._fields[1:])
    return PeriodicMotions(found.steps, *beside)
