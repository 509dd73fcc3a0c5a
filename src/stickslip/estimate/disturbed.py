"""Faults of instruments in the recordings of a fit, and their effect on the values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .blas import single_threaded
from .disturbances import MOVES, Disturbance, disturbances
from .lack import Lack, lacks_of
from .moves import moves
from .result import Fit

# Kinds of fault that are single events. The change of a value by such a fault is divided by the standard
# error that the fit would have without the fault. Hum and spikes count as noise, which the standard errors
# contain.
SINGLE = ("jump", "burst", "freeze")

Array = NDArray[np.float64]


@single_threaded
def with_disturbances(fit: Fit) -> Fit:
    """Return a copy of the fit with the faults of instruments that its residuals show, as `disturbances`, in
    place of earlier ones.

    The sentences on faults that change a value by more than one standard error are added to `doubts` (and so
    to `failures`), the others to `remarks`. Without a Jacobian, times or measured values, no fault is
    searched for.
    """
    fit = _without(fit)
    if fit.jacobian is None or not all(t.size == r.size == x.size for t, r, x in _parts(fit)):
        return fit
    ends = np.cumsum([r.size for r in fit.residuals])
    found: list[Disturbance] = []
    for i, (t, r, x) in enumerate(_parts(fit)):
        rows = slice(ends[i] - r.size, ends[i])
        seen = disturbances(
            r,
            t,
            slope=np.gradient(r + x, t),
            measured=x,
            jacobian=fit.jacobian[rows],
            known=fit.known[i] if fit.known else None,
            name=fit.recordings[i].name,
            unit=fit.recordings[i].unit or "m",
        )
        found += _with_moves(fit, seen, rows, t)
    doubts = [one.sentence for one in found if one.moves > MOVES]
    remarks = [one.sentence for one in found if not one.moves > MOVES]
    return replace(
        fit,
        disturbances=tuple(found),
        doubts=(*fit.doubts, *doubts),
        remarks=(*fit.remarks, *remarks),
    )


def lack_beside_faults(fit: Fit) -> tuple[Lack, ...]:
    """Return the lack-of-fit test of each recording, with the known faults of instruments removed from the
    residuals; unchanged for a recording that shows no lack with its faults, and `fit.lack` if the fit has no
    known noise."""
    if len(fit.known) != len(fit.residuals):
        return fit.lack
    left = left_beside_faults(fit)
    sizes = [r.size for r in fit.residuals]
    parts = np.split(left, np.cumsum(sizes)[:-1])
    names = [one.name for one in fit.recordings]
    found = lacks_of(parts, fit.known, names, len(fit.parameters) / left.size, fit.judgement)
    # Removal of faults only lowers residuals, so a recording without a lack of fit keeps its result.
    return tuple(now if was.seen else was for was, now in zip(fit.lack, found, strict=True))


def left_beside_faults(fit: Fit) -> Array:
    """Return the residuals of all recordings, joined, in the unit of the data, shape (n,), without the part
    that the faults of instruments and linearised changes of the fitted values explain. Without faults, the
    residuals are unchanged."""
    r = np.concatenate(fit.residuals)
    ends = np.cumsum([part.size for part in fit.residuals])
    columns = [] if fit.jacobian is None else [np.where(np.isfinite(fit.jacobian), fit.jacobian, 0.0)]
    for i, (t, part, _) in enumerate(_parts(fit)):
        for shape in (one.shapes(t) for one in fit.disturbances if one.name == fit.recordings[i].name):
            column = np.zeros((r.size, shape.shape[1]))
            column[ends[i] - part.size : ends[i]] = shape
            columns.append(column)
    if not fit.disturbances or not columns:
        return r
    every = np.concatenate(columns, axis=1)
    norms = np.linalg.norm(every, axis=0)
    every = every[:, norms > 0.0] / norms[norms > 0.0]
    return np.asarray(r - every @ np.linalg.lstsq(every, r, rcond=1e-9)[0])


def _without(fit: Fit) -> Fit:
    """Return a copy of the fit without `disturbances`, and without their sentences in `doubts` and
    `remarks`."""
    old = {one.sentence for one in fit.disturbances}
    doubts, remarks = (tuple(s for s in said if s not in old) for said in (fit.doubts, fit.remarks))
    return replace(fit, disturbances=(), doubts=doubts, remarks=remarks)


def _parts(fit: Fit) -> list[tuple[Array, Array, Array]]:
    return list(zip(fit.times, fit.residuals, fit.measured, strict=True))


def _with_moves(fit: Fit, found: Sequence[Disturbance], rows: slice, times: Array) -> list[Disturbance]:
    """Return the faults of one recording, each with its fields `moved` and `moves` set: the fitted value that
    it changes most, and this change in standard errors. Jitter, drift and the faults of a robust fit are
    unchanged.

    Args:
        fit: fit with its Jacobian.
        found: faults of the recording.
        rows: rows of the Jacobian that belong to the recording.
        times: times of the recording's samples, s, [n].
    """
    assert fit.jacobian is not None
    shapes = [one.shapes(times) for one in found]
    if fit.loss != "linear" or not sum(s.shape[1] for s in shapes):
        return list(found)
    r = np.concatenate(fit.residuals)[rows]
    every = np.concatenate([fit.jacobian[rows], np.ones((r.size, 1)), *shapes], axis=1)
    every = np.where(np.isfinite(every), every, 0.0)
    norms = np.linalg.norm(every, axis=0)
    norms[norms == 0.0] = 1.0
    sizes = np.linalg.lstsq(every / norms, r, rcond=1e-9)[0] / norms
    errors = np.sqrt(np.diag(fit.uncertainty.covariance))
    # Share of the rms residual that remains without the faults. A fault is not noise, so it must not widen
    # the standard error by which its effect is judged.
    left = max(float(np.linalg.norm(r - every @ sizes) / np.linalg.norm(r)), 1e-9)
    start, made = fit.jacobian.shape[1] + 1, []
    for one, shape in zip(found, shapes, strict=True):
        own = sizes[start : start + shape.shape[1]]
        start += shape.shape[1]
        if not own.size:
            made.append(one)
            continue
        column = np.zeros((len(fit.jacobian), 1))
        column[rows, 0] = shape @ own
        with np.errstate(invalid="ignore", divide="ignore"):
            by = np.nan_to_num(np.abs(moves(fit, column)[:, 0]) / errors, posinf=0.0)
        by /= left if one.kind in SINGLE else 1.0
        most = int(np.argmax(by))
        made.append(one._replace(moved=fit.parameters[most].name, moves=float(by[most])))
    return made
