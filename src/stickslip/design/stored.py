"""Maps as studies: their points are computed into stores that can be resumed, on this machine or on a
cluster."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.progress import Progress
from ..study import Draws, SteadySteps, Study, open_study, run_study
from .solving import NOT_COMPUTED, Common, Solved

Array = NDArray[np.float64]


class Stored(NamedTuple):
    """Folder with the stores of a map, and address of the dask scheduler that computes them; None: none."""

    folder: Path
    scheduler: str | None


def solved_in_store(
    common: Common, stored: Stored, progress: Progress, drawn: Mapping[str, Array] | None = None
) -> Solved:
    """Return the steady steps of all points, or of all draws and points; results that are in the store are
    read from it, the others are computed and stored.

    Args:
        common: arguments of the computation, as for `solved`.
        stored: folder, and scheduler if any.
        progress: called with activity and finished fraction.
        drawn: draws of the parameters by name, arrays [draws], SI; None: the points alone.

    Raises:
        StudyDiffers, StudyError: see `run_study`.
    """
    model, waveform, columns, tolerance, normal_load, threads, output = common
    points = [Draws(columns, "point")] if drawn is None else [Draws(drawn), Draws(columns, "point")]
    study = Study(
        points,
        SteadySteps(model, waveform, tolerance, normal_load, output),
        keep=("net_step", "error_estimate"),
        title="points of a map of the step" if drawn is None else "draws of a map of the step",
    )
    store = stored.folder / ("steps.zarr" if drawn is None else "draws.zarr")
    try:
        run_study(study, store, workers=threads, scheduler=stored.scheduler, progress=progress)
        interrupted = False
    except KeyboardInterrupt:
        interrupted = True
    found = open_study(store).load()
    there = found.status.values != -1
    status = np.where(there, found.status.values, NOT_COMPUTED).astype(np.int8)
    reasons = np.where(there, found.reason.values, "not computed").ravel().tolist()
    return Solved(found.net_step.values, found.error_estimate.values, {}, status, reasons, interrupted)
