"""The recordings of a campaign, ready to be fitted: cut, without bias, in the scale of the reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from ..analysis.alignment import POSITION, Aligned, aligned, with_position
from ..experiment import Recorded
from ..experiment.cells import drive_of
from ..experiment.file import ExperimentFile
from ..experiment.running import read_experiment, record_experiment
from ..identify.recorded.channels import channel
from ..input_file import InputFileError
from ..progress import Progress
from ..recording import RecordingError
from ..units import QuantityError
from ..waveform.signal import Waveform
from .file import CampaignFile, OwnSpec

# s, beside a step: the mean over so much of rest is a level.
LEVEL = 0.05


class Scale(NamedTuple):
    """The position channel over the reference on clamped steps: mean ratio, its standard error, and each."""

    value: float
    standard_error: float
    ratios: tuple[float, ...]


def gather(
    file: CampaignFile,
    folder: Path,
    out: Path,
    progress: Progress,
    experiment: tuple[ExperimentFile, Path] | None = None,
) -> tuple[list[Aligned], list[Recorded]]:
    """All recordings, those of the experiment recorded first into ``out/recordings`` unless they are there.

    Raises:
        InputFileError: a pattern fits no recording, or two recordings have one name.
        RecordingError: a file cannot be read, or is not what it must be.
    """
    recorded: list[Recorded] = []
    left: dict[str, tuple[Waveform, xr.Dataset]] = {}
    label = folder / (file.experiment or "experiment")
    if file.experiment is not None:
        experiment = read_experiment(label), label.parent
    if experiment is not None:
        recorded = record_experiment(
            *experiment,
            out / "recordings",
            progress,
            lambda cell, recording: left.update({cell.name: (cell.drive, recording)}),
            label=label,
        )
    found: list[Aligned] = []
    for spec in file.recordings:
        if isinstance(spec, OwnSpec):
            whole = spec.cut(spec.read(folder))
            try:
                drive = drive_of(spec.waveform, {}, folder) if spec.waveform else None
            except QuantityError as error:
                raise InputFileError(f"recordings: {spec.label}: {error}") from error
            try:
                one = aligned(whole, drive, spec.label, file.slew_rate)
            except RecordingError as error:
                raise RecordingError(f"{spec.file}: {error}") from None
            found.append(one._replace(use=spec.use))
            continue
        names = [name for name in left if fnmatchcase(name, spec.cells)]
        if not names:
            raise InputFileError(f"recordings: no cell of {label.name} that is left fits {spec.cells!r}")
        for name in names:
            drive, whole = left.pop(name)
            found.append(aligned(whole, drive, name, file.slew_rate)._replace(use=spec.use))
    names = [one.name for one in found]
    for name in names:
        if names.count(name) > 1:
            raise InputFileError(f"recordings: two are called {name!r}; give each a 'name'")
    return found, recorded


def scale_of(steps: Sequence[Aligned], reference: str, settling: float) -> Scale:
    """How the position channel stands to a reference: their changes over each clamped step.

    Args:
        steps: of the clamped end-effector.
        reference: a channel in the unit of the position.
        settling: s after the step, left out.

    Raises:
        RecordingError: there is no step, or no such channel, or a level lasts too short.
    """
    if not steps:
        raise RecordingError(f"the scale of {POSITION} is taken from clamped steps, and there is none")
    ratios = []
    for one in steps:
        values = channel(one.recording, reference, one.name, varies=True)
        unit, own = (one.recording[name].attrs["units"] for name in (reference, POSITION))
        if unit != own:
            raise QuantityError(f"{reference} of {one.name} is in {unit}: a reference must be in {own}")
        since = one.recording["time"].values - one.begin
        before = (since < -1e-3) & (since > -1e-3 - LEVEL)
        after = (since > settling) & (since < settling + LEVEL)
        if np.count_nonzero(before) < 10 or np.count_nonzero(after) < 10:
            raise RecordingError(f"{one.name} has less than 10 samples at rest before or after its step")
        position = one.recording[POSITION].values
        changes = [float(x[after].mean() - x[before].mean()) for x in (position, values)]
        ratios.append(changes[0] / changes[1])
    error = float(np.std(ratios, ddof=1) / math.sqrt(len(ratios))) if len(ratios) > 1 else 0.0
    return Scale(float(np.mean(ratios)), error, tuple(ratios))


def scaled(one: Aligned, scale: float) -> Aligned:
    """The recording with its position divided by the scale."""
    position = one.recording[POSITION].values / scale
    return one._replace(recording=with_position(one.recording, position), noise=one.noise / scale)
