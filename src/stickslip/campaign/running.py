"""Run a campaign file."""

from __future__ import annotations

import os
from pathlib import Path

from ..input_file import InputFileError
from ..parameters import ParameterSetError
from ..report import Document
from ..units import QuantityError
from .document import campaign_document
from .evaluation import evaluate
from .file import read_campaign
from .gathering import Progress, gather


def run_campaign(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Progress | None = None,
    *,
    figures: bool = True,
) -> Document:
    """Record (where the file says so), identify, verify.

    Args:
        path: a campaign file.
        out: the folder whose `recordings` take those of the experiment; those that are there are kept.
        progress: called with what is being done and how much of all is done, from 0 to 1.
        figures: draw them.

    Raises:
        InputFileError: the file is not as it must be; names the file and the field.
        RecordingError, FitError: a recording is missing or wrong, or cannot be fitted.
    """
    path, tell = Path(path), progress or (lambda doing, done: None)
    file = read_campaign(path)
    try:
        gathered, recorded = gather(file, path.parent, Path(out), lambda doing, done: tell(doing, 0.4 * done))
        found = evaluate(file, path.parent, gathered, lambda doing, done: tell(doing, 0.4 + 0.4 * done))
    except (InputFileError, QuantityError, ParameterSetError) as error:
        raise InputFileError(f"{path}: {error}") from error
    tell("drawing" if figures else "writing", 0.8)
    return campaign_document(file, found, recorded, figures=figures)
