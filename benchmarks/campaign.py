"""The campaign's friction fit as a problem for every tool: the walk of 65 V, 5 Hz, and the drive at the
piezo.

NumPy only, for peers import this; `prepare` alone needs our package. Five values are free, sigma_0, sigma_1
and F_C on a logarithmic scale, the delay and the offset of the sensor; the start is the thesis's.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.quantities.progress import unheard

from .problems import START
from .truth import TRUTH

Array = NDArray[np.float64]

FILE = TRUTH.with_name("campaign.npz")
MASS = 0.1
START_DELAY, LONGEST_DELAY, LARGEST_OFFSET = 0.5e-3, 5e-3, 1e-6
# Of a fit that is the same within the error bars: of the greatest distance from ours, in standard errors.
SAME = 1.0


class Walk(NamedTuple):
    """A recording and its drive: u = level[i] + slope[i] (t - start[i]) from start[i] on.

    `stage` is (gain, natural frequency, damping ratio); `values` and `errors` are those of our fit.
    """

    time: Array
    position: Array
    start: Array
    level: Array
    slope: Array
    stage: Array
    values: Array
    errors: Array


def prepare() -> None:
    """Record the campaign of the examples, fit it, and store what the tools need."""
    import importlib.resources

    from stickslip.jobs.campaign.evaluation import evaluate
    from stickslip.jobs.campaign.file import read_campaign
    from stickslip.jobs.campaign.gathering import gather
    from stickslip.rig.experiment.running import read_experiment

    path = Path(str(importlib.resources.files("stickslip") / "examples" / "kang2007_campaign.yaml"))
    file = read_campaign(path)
    with tempfile.TemporaryDirectory() as folder:
        assert file.experiment is not None
        experiment = read_experiment(path.parent / file.experiment), path.parent
        gathered, _ = gather(file, path.parent, Path(folder), unheard, experiment)
        model = file.load_model(path.parent)
        found = evaluate(file, model, gathered, unheard)
    (walk,) = (one for one in found.walks if one.use == "fit")
    assert walk.drive is not None
    time = walk.recording["time"].values
    table = walk.drive.drive(float(time[-1]))
    model, fit = found.friction.model, found.friction
    FILE.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        FILE,
        time=time,
        position=walk.recording["end_effector_position"].values,
        start=table.start,
        level=table.polynomial[:, 0],
        slope=table.polynomial[:, 1],
        stage=np.array([model.gain, model.natural_frequency, model.damping_ratio]),
        values=np.array(list(fit.values.values())),
        errors=np.array(list(fit.standard_errors.values())),
    )


def load() -> Walk:
    with np.load(FILE) as stored:
        return Walk(**{name: stored[name] for name in Walk._fields})


def start() -> Array:
    """sigma_0, sigma_1, F_C, delay and offset, in SI."""
    return np.array([*START, START_DELAY, 0.0])


class Fitted(NamedTuple):
    """What a tool found: values, evaluations of the model (without those for derivatives, where it has them
    from elsewhere), whether it ended by itself, and the rms of what is left [m]."""

    values: Array
    evaluations: int
    ended: bool
    rms: float


def judge(found: Fitted) -> dict[str, Any]:
    """What a row says of a fit: how far it ended from ours, in standard errors."""
    known = load()
    away = float(np.max(np.abs(found.values - known.values) / known.errors))
    return {
        "values": [float(f"{v:.6g}") for v in found.values],
        "away_in_standard_errors": away,
        "global": away < SAME,
        "evaluations": found.evaluations,
        "ended": found.ended,
        "rms_m": found.rms,
    }
