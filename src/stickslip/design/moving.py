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
# Tolerances of the net step, m (rad for a rotary actuator), for a search and, in the order in which they are
# tried, for its result: if the periodic motion is not found at one tolerance, the next is used. They are
# small because at an optimum the contact may be at the limit of slip.
SEARCHED = 1e-8
REPORTED = (1e-11, 1e-12, 1e-10, 1e-9, 1e-8)
# Tolerances for a result with a static friction law, likewise. They are larger, because such a law has no
# derivatives, without which the search for a periodic motion is slow.
REPORTED_STATIC = (1e-9, 1e-10, 1e-8)


class PeriodicMotions(NamedTuple):
    """Periodic motion of each drive under each condition: arrays of shape (n, conditions).

    `steps` are net steps per period, m, or rad for a rotary actuator. `ripple`, in the same unit, and
    `backward_rate` (0 to 1) are computed if requested (see `design.motion`). Values that are not requested,
    or of a drive without a periodic motion, are NaN.
    """

    steps: Array
    ripple: Array
    backward_rate: Array

    def of(self, i: int) -> PeriodicMotions:
        """Return the motion of drive number i under each condition, arrays of shape (1, conditions)."""
        return PeriodicMotions(*(column[i][None] for column in self))


def moved(
    model: Actuator,
    shapes: Polygons,
    columns: Mapping[str, Array],
    threads: int | None = None,
    own: Mapping[str, Array] | None = None,
    extras: tuple[str, ...] = (),
) -> PeriodicMotions:
    """Return the periodic motion of each drive under each condition, shape (n, conditions), at the tolerance
    of a search (`SEARCHED`). Raises KeyboardInterrupt if Ctrl-C stops the computation.

    Args:
        model: the actuator.
        shapes: n drives, each a polygon.
        columns: values of the model's fields in each condition by name, SI, arrays [conditions], the same for
            all drives.
        threads: number of threads; None: all processors.
        own: values of fields that differ between drives, by name, SI, arrays [n, conditions].
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
    tolerances of a result (`REPORTED`), which are tried in turn. Raises KeyboardInterrupt on Ctrl-C.

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
        members: varied fields of the model or the drive, by name, SI, arrays [members].
        tolerance: tolerance of the net step, m, or rad for a rotary actuator.
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
