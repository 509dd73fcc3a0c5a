"""Preparation of a campaign's recordings for the fits: recording of its experiment, reading of the user's own
files, alignment with the drives, and scaling.

If the campaign names a more accurate reference channel, the position is scaled to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...identify.recorded.channels import channel
from ...quantities.input_file import InputFileError
from ...quantities.progress import Progress
from ...quantities.units import QuantityError
from ...recording import SCALE_UNCERTAINTY, RecordingError
from ...rig.experiment import Recorded
from ...rig.experiment.cells import drive_of
from ...rig.experiment.file import ExperimentFile
from ...rig.experiment.running import record_experiment
from ...waveform.signal import Waveform
from ..analysis.alignment import POSITION, Aligned, aligned, aligned_by_itself, with_position
from .file import CampaignFile, OwnRecordingSpec

if TYPE_CHECKING:
    import xarray as xr

# Length of the two intervals over which the position is averaged, before a step and after its settling, s.
LEVEL = 0.05


class SensorScale(NamedTuple):
    """Ratio of the position channel's step height to the reference's, with the end-effector clamped.

    `value` is the mean over the steps, `standard_error` its standard error (0, if there is only one step,
    which does not show the scatter), and `ratios` are the ratios of the steps.
    """

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
    """Record a campaign's experiment and read the user's own files.

    The user's files are read first, so that errors in them are reported before the experiment is recorded.
    The experiment's recordings go into ``out/recordings``; existing ones are used again.

    Args:
        file, folder: a campaign that passed `check_campaign`, and the folder of its relative paths.
        out: the output folder.
        progress: called with the current recording and the finished fraction.
        experiment: the experiment whose recordings the entries `cells` of the file select, and the folder of
            its relative paths; None without one.

    Returns:
        The recordings of the campaign in the order of the file, aligned with their drives; and the records of
        the experiment's runs.

    Raises:
        InputFileError: a recording's drive is wrong.
        RecordingError: a file cannot be read, or is not suitable.
        RigError: the rig fails, or a recording is refused or stopped; see `rig.run_experiment`.
    """
    found = {
        i: _own(spec, file, folder)
        for i, spec in enumerate(file.recordings)
        if isinstance(spec, OwnRecordingSpec)
    }
    recorded: list[Recorded] = []
    left: dict[str, tuple[Waveform, xr.Dataset]] = {}
    if experiment is not None:
        recorded = record_experiment(
            *experiment,
            out / "recordings",
            progress,
            lambda cell, recording: left.update({cell.name: (cell.drive, recording)}),
            label=folder / (file.experiment or "experiment"),
        )
    gathered: list[Aligned] = []
    for i, spec in enumerate(file.recordings):
        if isinstance(spec, OwnRecordingSpec):
            gathered.append(found[i])
            continue
        for name in [name for name in left if fnmatchcase(name, spec.cells)]:
            drive, whole = left.pop(name)
            gathered.append(aligned(whole, drive, name, file.slew_rate)._replace(use=spec.use))
    return gathered, recorded


def _own(spec: OwnRecordingSpec, file: CampaignFile, folder: Path) -> Aligned:
    """Return a recording of a user's file, aligned with its drive.

    Args:
        spec: entry of the recording in the campaign file.
        file: the campaign.
        folder: folder of its relative paths.

    Raises:
        InputFileError: the waveform of the entry is wrong.
        RecordingError: the file cannot be read, or is not suitable.
    """
    whole = spec.cut(spec.read(folder))
    try:
        drive = drive_of(spec.waveform, {}, folder) if spec.waveform else None
    except QuantityError as error:
        raise InputFileError(f"recordings: {spec.label}: {error}") from error
    try:
        # Hysteresis depends on every sample of the drive, so no waveform is put in the place of the samples.
        if drive is None and spec.use != "piezo":
            one = aligned_by_itself(whole, spec.label, file.slew_rate)
        else:
            one = aligned(whole, drive, spec.label, file.slew_rate)
        if file.reference is not None and spec.use in ("piezo", "step"):
            channel(whole, file.reference, spec.label, varies=True)
    except RecordingError as error:
        raise RecordingError(f"{spec.file}: {error}") from None
    return one._replace(use=spec.use)


def scale_of(steps: Sequence[Aligned], reference: str, settling: float) -> SensorScale:
    """Return the ratio of the position channel to a reference channel, from the heights of clamped steps.

    Args:
        steps: recordings of steps with the end-effector clamped.
        reference: name of a channel in the unit of the position.
        settling: time left out after the step, s.

    Raises:
        RecordingError: there is no step, no such channel, or there are fewer than 10 samples at rest before
            or after a step.
        QuantityError: the reference has another unit than the position.
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
    return SensorScale(float(np.mean(ratios)), error, tuple(ratios))


def scaled(one: Aligned, scale: float, share: float = 0.0) -> Aligned:
    """Return the recording with its position and noise divided by the scale.

    `scale` is the ratio of the position channel to the reference. `share` is the relative standard
    uncertainty of the reference's scale, which the position gets too; 0 if unknown.
    """
    recording = with_position(one.recording, one.recording[POSITION].values / scale)
    attrs = {k: v for k, v in recording[POSITION].attrs.items() if k != SCALE_UNCERTAINTY}
    recording[POSITION].attrs = attrs | ({SCALE_UNCERTAINTY: share} if share else {})
    return one._replace(recording=recording, noise=one.noise / scale)
