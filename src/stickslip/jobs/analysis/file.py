"""Parts that identification files have in common: title, and the sources of data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from ...quantities.input_file import Hertz, InputFileError, Seconds, Strict
from ...quantities.registry import allowed_file, own_path
from ...recording import SCALE_UNCERTAINTY, RecordingError
from ...recording.calibration import apply_calibration
from ...recording.datasets import dataset_path
from ...recording.readers import read_recording

if TYPE_CHECKING:
    import xarray as xr

AnalysisError = InputFileError
# Pairs of numbers by parameter: lower and upper bound, or mean and standard deviation of a prior; in SI, or
# as texts with units.
Pairs = Annotated[dict[str, tuple[float | str, float | str]], Field(default_factory=dict)]
# _FORMAT: fields that determine how a file is read. OF_SOURCE: all fields that determine its content.
# Recordings with equal values of these are parts of one file, which is read once.
_FORMAT = ("columns", "units", "clocks", "sample_rate", "reader", "rows", "missing", "missing_values")
OF_SOURCE = {"dataset", "file", "calibration", "rename", "scale_uncertainty", *_FORMAT}


class SourceFile(Strict):
    """Source of data: the path `file`, relative to the input file; with `dataset`, the name `file` of a file
    in this published dataset."""

    file: str
    dataset: str | None = None

    def path(self, folder: Path) -> Path:
        """Return the path of the file; a published file is downloaded if necessary.

        Raises:
            RecordingError: the dataset is unknown, or its file cannot be downloaded.
        """
        return dataset_path(self.dataset, self.file) if self.dataset else folder / self.file


class RecordingFile(SourceFile):
    """A recording in a file.

    `columns`, `units`, `clocks`, `sample_rate`, `rows`, `missing` and `missing_values` are as for
    `read_recording`. `reader` is the format if it cannot be recognised from the content, or a user's own
    reader, "my_reader.py:scope". `calibration` lists the calibrations of each variable, in order; `rename`
    gives new names of calibrated variables. `start` and `end` [s] select a part. `scale_uncertainty` is the
    relative standard uncertainty of a variable's scale, if its calibrations do not give it. `use` is "fit" or
    "verify": the recording is fitted, or predicted. `name` is its name in tables and figures.
    """

    columns: dict[str, str | int | list[str | int]] = Field(default_factory=dict)
    units: dict[str, str] = Field(default_factory=dict)
    clocks: dict[str, str | int | list[str | int]] = Field(default_factory=dict)
    calibration: dict[str, list[str]] = Field(default_factory=dict)
    rename: dict[str, str] = Field(default_factory=dict)
    scale_uncertainty: dict[str, Annotated[float, Field(gt=0, lt=1)]] = Field(default_factory=dict)
    sample_rate: Hertz | None = None
    reader: str = ""
    rows: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=1)] | None] = (0, None)
    missing: Literal["error", "drop"] = "error"
    missing_values: list[str] = Field(default_factory=list)
    start: Seconds | None = None
    end: Seconds | None = None
    use: Literal["fit", "verify"] = "fit"
    name: str = ""

    @property
    def label(self) -> str:
        """Return the name of the recording in tables and figures, by default that of its file."""
        return self.name or Path(self.file).stem

    def read(self, folder: Path) -> xr.Dataset:
        """Return the whole content of the file, calibrated, with scale uncertainties as attributes.

        `folder` is the folder of the input file. Raises RecordingError, CalibrationError, and RegistryError
        for a user's own reader.
        """
        recording = self._calibrated(folder)
        for name, share in self.scale_uncertainty.items():
            if name not in recording:
                known = ", ".join(map(str, recording.data_vars))
                raise RecordingError(f"scale_uncertainty: there is no variable {name!r}; there are {known}")
            recording[name].attrs[SCALE_UNCERTAINTY] = share
        return recording

    def _calibrated(self, folder: Path) -> xr.Dataset:
        columns, clocks = (
            {k: tuple(v) if isinstance(v, list) else v for k, v in named.items()}
            for named in (self.columns, self.clocks)
        )
        own, name = own_path(self.reader)
        recording = read_recording(
            self.path(folder),
            columns or None,
            self.units or None,
            clocks=clocks or None,
            sample_rate=self.sample_rate,
            reader=f"{allowed_file(own, folder)}:{name}" if own else name,
            rows=self.rows,
            missing=self.missing,
            missing_values=self.missing_values,
        )
        if not self.calibration:
            return recording
        calibrations = {
            name: [folder / text if text.endswith(".json") else text for text in chain]
            for name, chain in self.calibration.items()
        }
        return apply_calibration(recording, calibrations, self.rename)

    def cut(self, whole: xr.Dataset) -> xr.Dataset:
        """Return the part from `start` to `end`, titled with the label; raises AnalysisError if it has fewer
        than two samples."""
        part = whole.sel(time=slice(self.start, self.end))
        if part.sizes["time"] < 2:
            first, last = (float(whole["time"][i]) for i in (0, -1))
            raise AnalysisError(
                f"{Path(self.file).name}: from {self.start} s to {self.end} s there are "
                f"{part.sizes['time']} samples; the recording runs from {first:g} s to {last:g} s"
            )
        return part.assign_attrs(title=self.label)


def read_parts(recordings: Sequence[RecordingFile], folder: Path) -> dict[str, xr.Dataset]:
    """Return the recordings of an input file by label, in order, each cut to its part.

    A file of which several recordings are parts is read once. `folder` is the folder of the input file.

    Raises:
        RecordingError, CalibrationError: a file cannot be read, or its calibration is wrong.
        AnalysisError: two recordings have the same label, or a part has fewer than two samples.
    """
    whole: dict[str, xr.Dataset] = {}
    parts: dict[str, xr.Dataset] = {}
    for recording in recordings:
        if recording.label in parts:
            raise AnalysisError(
                f"recordings: two are called {recording.label!r}; give each a 'name', such as its part"
            )
        source = recording.model_dump_json(include=OF_SOURCE)
        if source not in whole:
            whole[source] = recording.read(folder)
        parts[recording.label] = recording.cut(whole[source])
    return parts


class Analysis(Strict):
    """Fields that every identification file has.

    `title` is the title of the report, `citation` lists keys of publications, and `notes` is a text for the
    report.
    """

    title: str
    citation: list[str] = Field(default_factory=list)
    notes: str = ""
