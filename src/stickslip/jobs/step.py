"""A kind of step of a job, and what a running step knows."""

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
    """The running job: its folder `out`, and the results of the steps so far.

    `experiment` is the content and the folder of the last recorded one, `results` the file of the last
    identification. `number` (from 1), `file` (of its content), `folder` (of the paths in it) and `progress`
    belong to the present step.
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
        """Folder of the paths in the present step."""
        return self.file.parent

    def room(self, name: str) -> Path:
        """Return the folder of this name, with a number if an earlier step of this run uses it.

        Results of an earlier run are moved to the bin; otherwise old code would have the obvious name.
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
    """A kind of step.

    Args:
        schema: pydantic model of the content, or a union of models.
        run: runs a step with its content, and returns its report.
        lacks: what a content needs of earlier steps (their kinds), and is not there; "" if nothing.
        makes: files that a later step can name, relative to the job's folder, by content and number.
        reads: makes the record of a content, if it is more than validation by the schema.
    """

    schema: Any
    run: Callable[[Any, JobRun], Document]
    lacks: Callable[[Any, Collection[str]], str] = lambda spec, before: ""
    makes: Callable[[Any, int], Iterable[str]] = lambda spec, number: ()
    reads: Callable[[dict[str, Any]], Any] | None = None

    @property
    def titled(self) -> bool:
        """True if the content has a title, and may be a file of its own."""
        return "title" in getattr(self.schema, "model_fields", {"title": None})

    def read(self, content: dict[str, Any]) -> Any:
        """Return a content as its record. Raises pydantic's ValidationError, or InputFileError."""
        if self.reads is not None:
            return self.reads(content)
        return TypeAdapter(self.schema).validate_python(content)
