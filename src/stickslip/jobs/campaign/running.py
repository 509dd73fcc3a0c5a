"""Runner of campaign files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ...parameters import ParameterSetError
from ...quantities.input_file import InputFileError
from ...quantities.progress import Progress, unheard, within
from ...quantities.units import QuantityError
from ...report import Document
from ...rig.experiment.cells import cell_names
from ...rig.experiment.file import ExperimentFile
from ...rig.experiment.running import read_experiment
from .checking import check_campaign
from .document import campaign_document
from .evaluation import evaluate
from .file import CampaignFile, read_campaign
from .gathering import gather
from .kept import FOLDER, Kept, own_laws


def run_campaign(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Progress = unheard,
    *,
    figures: bool = True,
    changes: Sequence[str] = (),
) -> Document:
    """Run a campaign: record (if the file names an experiment), identify and verify; return the report.

    Args:
        path: a campaign file.
        out: the output folder. Recordings of the experiment go into its subfolder `recordings`; existing ones
            are used again. Finished stages go into `stages`, from which an interrupted campaign continues.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        figures: True to draw the figures of the report.
        changes: changes to the file, as for `load_yaml`.

    Raises:
        InputFileError: the file is invalid; the message names the file and the field.
        RecordingError, FitError: a recording is missing or wrong, or cannot be fitted.
        RigError: the rig fails, or a recording is refused or stopped; see `rig.run_experiment`.
    """
    path = Path(path)
    try:
        return campaign_of(read_campaign(path, changes), path.parent, Path(out), progress, figures=figures)
    except (InputFileError, QuantityError, ParameterSetError) as error:
        raise InputFileError(f"{path}: {error}" if str(path) not in str(error) else str(error)) from error


def campaign_of(
    file: CampaignFile,
    folder: Path,
    out: Path,
    progress: Progress = unheard,
    experiment: tuple[ExperimentFile, Path] | None = None,
    *,
    figures: bool = True,
) -> Document:
    """Run a campaign whose file has been read; return the report.

    Args:
        file: content of the campaign file.
        folder: folder of the relative paths in the file.
        out: output folder.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        experiment: if the file names no experiment, the experiment whose recordings the entries `cells` of
            the file select, and the folder of its relative paths; None: no experiment.
        figures: True to draw the figures of the report.
    """
    if file.experiment is not None:
        path = folder / file.experiment
        experiment = read_experiment(path), path.parent
    model = check_campaign(file, folder, [] if experiment is None else cell_names(experiment[0]))
    gathered, recorded = gather(file, folder, out, partial(within, progress, 0.0, 0.4), experiment)
    kept = Kept.of(file, model, gathered, out / FOLDER, [type(model.friction), *own_laws(file, folder)])
    found = evaluate(file, model, gathered, partial(within, progress, 0.4, 0.4), folder, kept)
    progress("drawing" if figures else "writing", 0.8)
    return campaign_document(file, found, recorded, figures=figures)
