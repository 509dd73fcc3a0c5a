"""A fit for the Identify page: read, fit, verify, report; what becomes of it is told as it goes on.

It runs in a process of its own, so that it can be ended at any time and the page's stream never waits for it.
"""

from __future__ import annotations

import math
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from ..identify.displacement import Displacement
from ..identify.fit import Progress
from ..identify.friction import CHANNEL, OBSERVED, identify_friction, observed
from ..identify.result import Fit
from ..readers import read_recording
from ..recording import RecordingError
from ..report import write_report
from ..simulation import SimulationError
from ..study.walk import Walk, walk_document
from ..units import QuantityError, to_si
from ..verification import verify
from .exploration import Model, Value
from .folder import Folder

PAUSE = 0.12  # s between two pictures of a fit in motion
SHOWN = 2000  # samples of a recording in a picture
_DRAFT = 1e-10  # m, tolerance of what is only looked at

Array = NDArray[np.float64]
# What is told: a kind, its fields, and arrays that belong to them.
Say = Callable[[str, dict[str, Any], Sequence[Array]], None]


class FitRequest(Model):
    """What to fit: the recordings (names in the panel's folder), from `begin` to `end` [s] of each, the model
    at which the fit starts, what is free in it, and bounds of that; `others` are only predicted."""

    recordings: list[str] = Field(min_length=1, max_length=20)
    others: list[str] = Field(default_factory=list, max_length=40)
    begin: Value | None = None
    end: Value | None = None
    free: list[str] = Field(max_length=30)
    bounds: dict[str, tuple[Value, Value]] = Field(default_factory=dict, max_length=30)
    starts: int = Field(default=1, ge=1, le=20)
    hops: int = Field(default=0, ge=0, le=6)


def fit_recordings(request: FitRequest, folder: Folder, out: str, say: Say) -> None:
    """Fit as requested, and say what happens: "recordings", "step" (often), "fitted", "verified", "report".

    Args:
        request: what is wanted.
        folder: where the recordings are.
        out: name of the folder in it for the report.
        say: called with each message.

    Raises:
        RecordingError, QuantityError, FitError: see `identify_friction`.
    """
    actuator = request.actuator()
    seen = [_read(folder, name, request) for name in request.recordings]
    unseen = [_read(folder, name, request) for name in request.others if name not in request.recordings]
    drafts = _Drafts(seen, request, say)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drafts.begin(actuator)
        fit = identify_friction(
            seen,
            actuator,
            request.free,
            bounds={name: (limits[0], limits[1]) for name, limits in request.bounds.items()},  # type: ignore[arg-type]
            starts=request.starts,
            hops=request.hops,
            progress=drafts,
        )
        drafts.draw(fit.values)
        say("fitted", {"fit": fit.to_dict(), "model": _told(fit), "correlation": _correlation(fit)}, [])
        if unseen:
            found = verify(fit, unseen)
            traces = [p[k].values for p in found.predictions for k in ("time", "measured", "predicted")]
            say("verified", {"verification": found.to_dict()}, [_thin(one) for one in traces])
        walks = {str(r.title): Walk("fit", r) for r in seen}
        walks |= {str(r.title): Walk("verify", r) for r in unseen}
        document = walk_document("Identification", fit, actuator, walks)
        write_report(document, folder.path(out), command="stickslip panel")
    said = dict.fromkeys(" ".join(str(w.message).split()) for w in caught)
    say("report", {"report": f"{out}/report.html", "notes": list(said)}, [])


class _Drafts:
    """The fit in motion: pictures of what the best values so far give. Called as `identify_friction` goes."""

    def __init__(self, recordings: Sequence[xr.Dataset], request: FitRequest, say: Say) -> None:
        self._recordings, self._say = recordings, say
        self._channel = [name for name in request.free if name in CHANNEL]
        self._shown, self._next = math.inf, 0.0
        self._count = sum(r.sizes["time"] for r in recordings)

    def begin(self, actuator: Any) -> None:
        """Read the drives, and show the recordings."""
        names = [str(r.title) for r in self._recordings]
        self._actuator = actuator
        self._motions = [
            Displacement(r, None, name, actuator, _DRAFT)
            for r, name in zip(self._recordings, names, strict=True)
        ]
        traces = [r[k].values for r in self._recordings for k in ("time", OBSERVED)]
        self._say("recordings", {"names": names}, [_thin(one) for one in traces])
        self.draw({})  # where it starts

    def __call__(self, progress: Progress) -> None:
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + PAUSE
        fields = {
            "evaluations": progress.evaluations,
            "start": progress.start,
            "starts": progress.starts,
            "rmse": math.sqrt(progress.sum_of_squares / self._count),
            "values": progress.values,
        }
        if progress.sum_of_squares == self._shown:
            self._say("step", fields, [])
        else:
            self._shown = progress.sum_of_squares
            self.draw(progress.values, fields)

    def draw(self, values: Mapping[str, float], fields: dict[str, Any] | None = None) -> None:
        """Say what the model gives for these values."""
        try:
            curves = [observed(motion, self._actuator, dict(values)) for motion in self._motions]
        except ArithmeticError:  # a trial that cannot be followed
            curves = []
        self._say("step", fields or {"values": dict(values)}, [_thin(curve) for curve in curves])


def _read(folder: Folder, name: str, request: FitRequest) -> xr.Dataset:
    recording = read_recording(folder.path(name))
    limits = [
        None if t is None else to_si(t, "s", f) for t, f in ((request.begin, "begin"), (request.end, "end"))
    ]
    part = recording.sel(time=slice(*limits))
    if part.sizes["time"] < 2:
        raise QuantityError(f"begin = {request.begin} s and end = {request.end} s leave nothing of {name}")
    if OBSERVED not in part:
        raise RecordingError(f"{name} has no channel {OBSERVED} [m], which is what is fitted")
    return part.assign_attrs(title=name)


def _thin(values: Array) -> Array:
    return values[:: math.ceil(values.size / SHOWN)]


def _told(fit: Fit) -> dict[str, Any]:
    """The model that was found, in the words of a request."""
    from .sliders import plain, values_of

    return {
        "model": {
            field: plain(getattr(fit.model, field)) for field in fit.values if field in fit.model._fields
        },
        "law": type(fit.model.friction).__name__,
        "friction": values_of(fit.model.friction),
    }


def _correlation(fit: Fit) -> dict[str, float]:
    return {g.name: g.lag_one_correlation for g in fit.recordings}


def work(connection: Connection, request: FitRequest, root: str, out: str) -> None:
    """What the process does: `fit_recordings`, told through the connection; at last "done" or "failed"."""

    def say(kind: str, fields: dict[str, Any], arrays: Sequence[Array] = ()) -> None:
        connection.send((kind, fields, [np.asarray(one, dtype="<f4") for one in arrays]))

    try:
        fit_recordings(request, Folder(Path(root)), out, say)
        say("done", {})
    except (ValueError, OSError, SimulationError) as error:
        say("failed", {"error": str(error)})
    except Exception as error:
        traceback.print_exc()
        say("failed", {"error": f"unexpected {type(error).__name__}: {error}"})
    finally:
        connection.close()
