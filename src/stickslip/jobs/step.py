"""Kinds of steps of a job, and the state of a running job that its steps share."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from ..quantities.progress import Progress, unheard
from ..recording import RecordingWarning
from ..recording.replacing import to_bin
from ..report import Document


class JobRun:
    """State of a running job: its output folder `out`, and the results of the steps so far.

    `figures` is True if figures are drawn. `experiment` is the content and the folder of the last recorded
    experiment, None before one. `results` is the path of the results (JSON) of the last identification, None
    before one. `number` (from 1), `file` (of the content), `folder` (of the relative paths in the content)
    and `progress` belong to the present step.
    """

    def __init__(self, out: Path, figures: bool) -> None:
        self.out, self.figures = out, figures
        self.experiment: tuple[Any, Path] | None = None
        self.results: Path | None = None
        self.number, self.file = 0, Path()
        self.progress: Progress = unheard
        self._used: set[str] = set()

    @property
    def folder(self) -> Path:
        """Return the folder of the relative paths in the present step: the folder of its file."""
        return self.file.parent

    def room(self, name: str) -> Path:
        """Return the path of a folder for a step's results, which does not exist yet.

        The folder is `name` in the output folder, with a number added if an earlier step of this run uses the
        name. A folder of an earlier run with this path is moved to the subfolder ".bin" with a
        RecordingWarning. A new name for each run would let users take old results for new ones.
        """
        number, found = 2, name
        while found in self._used:
            found, number = f"{name}_{number}", number + 1
        self._used.add(found)
        if os.path.lexists(self.out / found):
            moved = to_bin(self.out, found)
            said = f"{self.out / found}: what an earlier run had put there is in {moved}"
            warnings.warn(said, RecordingWarning, stacklevel=2)
        return self.out / found


class StepKind(NamedTuple):
    """Kind of a step of a job: how its content is read, checked and run.

    Args:
        schema: pydantic model of the content, or a union of models.
        run: takes the record of the content and the running job; returns the report of the step.
        lacks: takes the record and the kinds of earlier steps; returns a text that says which earlier step is
            missing, "" if none is.
        makes: takes the number of the step in the job; returns the files that a later step can name, relative
            to the output folder.
        reads: takes the plain content; returns its record. Only needed if validation by the schema is not
            enough.
    """

    schema: Any
    run: Callable[[Any, JobRun], Document]
    lacks: Callable[[Any, Collection[str]], str] = lambda spec, before: ""
    makes: Callable[[int], Iterable[str]] = lambda number: ()
    reads: Callable[[dict[str, Any]], Any] | None = None

    @property
    def titled(self) -> bool:
        """Return True if the content has a title; it may then also be in a file of its own."""
        return "title" in getattr(self.schema, "model_fields", {"title": None})

    def read(self, content: dict[str, Any]) -> Any:
        """Return the validated record of a content, a mapping; raises pydantic's ValidationError, or
        InputFileError."""
        if self.reads is not None:
            return self.reads(content)
        return TypeAdapter(self.schema).validate_python(content)
