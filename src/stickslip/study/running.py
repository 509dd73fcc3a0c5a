"""Run an identification file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from ..report import Document
from .file import StudyError, explain, load_yaml
from .frequency import FrequencyStudy
from .loops import LoopStudy
from .pulled import PulledStudy
from .walk import WalkStudy

# What is called as the work goes on: what is being done, and how much of all is done, from 0 to 1.
Progress = Callable[[str, float], None]

_Any = Annotated[LoopStudy | FrequencyStudy | PulledStudy | WalkStudy, Field(discriminator="kind")]
_FILE: TypeAdapter[Any] = TypeAdapter(_Any)


def run_file(path: str | os.PathLike[str], progress: Progress | None = None) -> Document:
    """Fit and verify as an identification file says.

    Raises:
        StudyError: the file is not as it must be; names the file and the field.
        RecordingError, FitError: data are missing or wrong, or cannot be fitted.
    """
    try:
        study = _FILE.validate_python(load_yaml(path))
    except ValidationError as error:
        raise explain(path, error) from error
    return study.run(Path(path).parent, progress or (lambda doing, done: None))


def json_schema() -> dict[str, Any]:
    """The JSON Schema of identification files, for editors."""
    return _FILE.json_schema()


__all__ = ["Progress", "StudyError", "json_schema", "run_file"]
