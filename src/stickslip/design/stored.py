"""Maps computed as studies: the results at their points are kept in folders (stores), so that an interrupted
computation resumes. The work is done on this machine or on a cluster."""

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
    """Place of the stores of a map: their `folder`, and the address of the dask `scheduler` whose workers
    compute them; None: processes of this machine compute them."""

    folder: Path
    scheduler: str | None


def solved_in_store(
    common: Common, stored: Stored, progress: Progress, drawn: Mapping[str, Array] | None = None
) -> Solved:
    """Return the steady steps at all points, or for all draws at all points.

    Results in the store (``steps.zarr``, or ``draws.zarr`` with draws) are read; the others are computed and
    stored. Arrays of the result have the shape [points], or [draws, points] with `drawn`; after Ctrl-C the
    points that are left have the status `NOT_COMPUTED`.

    Args:
        common: arguments of the computation, see `solving.Common`; the number of threads becomes that of
            processes.
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
