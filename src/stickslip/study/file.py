"""What the parts of an identification file have in common: sources of data."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import xarray as xr
from pydantic import Field

from ..datasets import dataset_path
from ..input_file import Hertz, InputFileError, Seconds, Strict
from ..readers import read_recording

StudyError = InputFileError


class Source(Strict):
    """Where data come from: a `file`, relative to the identification file, or a file of a published
    `dataset`."""

    file: str
    dataset: str | None = None

    def path(self, folder: Path) -> Path:
        """The file, fetched first if it is published and not here.

        Raises:
            RecordingError: see `stickslip.datasets.dataset_path`.
        """
        return dataset_path(self.dataset, self.file) if self.dataset else folder / self.file


class Recorded(Source):
    """A recording in a file: `columns` and `units` as for `read_recording`; `start` and `end` cut a part of
    it out."""

    columns: dict[str, str | int | list[str | int]] = Field(default_factory=dict)
    units: dict[str, str] = Field(default_factory=dict)
    sample_rate: Hertz | None = None
    start: Seconds | None = None
    end: Seconds | None = None
    use: Literal["fit", "verify"] = "fit"
    name: str = ""

    def read(self, folder: Path) -> xr.Dataset:
        """The recording, cut to its part.

        Raises:
            RecordingError: the file cannot be read, or the part holds fewer than two samples.
        """
        columns = {k: tuple(v) if isinstance(v, list) else v for k, v in self.columns.items()}
        path = self.path(folder)
        recording = read_recording(path, columns or None, self.units or None, sample_rate=self.sample_rate)
        cut = recording.sel(time=slice(self.start, self.end))
        if cut.sizes["time"] < 2:
            first, last = (float(recording["time"][i]) for i in (0, -1))
            raise StudyError(
                f"{path.name}: from {self.start} s to {self.end} s there are {cut.sizes['time']} samples; "
                f"the recording runs from {first:g} s to {last:g} s"
            )
        return cut

    @property
    def label(self) -> str:
        """What to call it in tables and figures."""
        return self.name or Path(self.file).stem


class Study(Strict):
    """What every identification file begins with."""

    title: str
    citation: list[str] = Field(default_factory=list)
    notes: str = ""
