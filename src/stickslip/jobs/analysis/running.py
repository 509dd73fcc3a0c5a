"""Runner of identification files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from ...parameters import ParameterSetError
from ...quantities.input_file import explain, load_yaml
from ...quantities.progress import Progress, unheard
from ...quantities.units import QuantityError
from ...recording import RecordingWarning
from ...report import Document
from .comparison import ComparisonAnalysis
from .file import AnalysisError
from .frequency import FrequencyAnalysis
from .loops import LoopAnalysis
from .piezo import PiezoAnalysis
from .pulled import PulledAnalysis
from .stribeck import StribeckAnalysis
from .verification import VerificationAnalysis
from .walk import WalkAnalysis

_Any = Annotated[
    LoopAnalysis
    | FrequencyAnalysis
    | PiezoAnalysis
    | PulledAnalysis
    | StribeckAnalysis
    | VerificationAnalysis
    | WalkAnalysis
    | ComparisonAnalysis,
    Field(discriminator="kind"),
]
_FILE: TypeAdapter[Any] = TypeAdapter(_Any)


def run_file(
    path: str | os.PathLike[str], progress: Progress = unheard, changes: Sequence[str] = ()
) -> Document:
    """Fit and verify as an identification file describes; return the report.

    Assumptions that had to be made about a recording are among the assumptions of the report.

    Args:
        path: path of the file.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        changes: changes to the file, as for `load_yaml`.

    Raises:
        AnalysisError: the file is invalid; the message names the file and the field.
        RecordingError, FitError: data are missing or wrong, or cannot be fitted.

    Warns:
        RecordingWarning: a recording lacks relevant information.
    """
    content = load_yaml(path, changes)
    try:
        analysis = _FILE.validate_python(content)
    except ValidationError as error:
        raise explain(path, error, content=content) from error
    try:
        return run_analysis(analysis, Path(path).parent, progress)
    except (QuantityError, ParameterSetError) as error:
        raise AnalysisError(f"{path}: {error}") from error


def run_analysis(analysis: Any, folder: Path, progress: Progress = unheard) -> Document:
    """Run an identification file whose content was read; return the report.

    A RecordingWarning with the same text is issued only once, and its text is also among the report's
    assumptions. Raises the errors of the analysis, see its method `run`.

    Args:
        analysis: content of the file, such as a `WalkAnalysis`.
        folder: folder of the relative paths in the file.
        progress: called with the current activity and the finished fraction, from 0 to 1.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordingWarning)
        document = analysis.run(folder, progress)
    unseen = {str(w.message): w for w in caught if issubclass(w.category, RecordingWarning)}
    for w in (*unseen.values(), *(w for w in caught if not issubclass(w.category, RecordingWarning))):
        warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)
    return replace(document, assumptions=(*document.assumptions, *unseen))


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of identification files, for editors."""
    return _FILE.json_schema()


__all__ = ["AnalysisError", "Progress", "json_schema", "run_file"]
