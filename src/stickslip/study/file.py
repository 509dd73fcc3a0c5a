"""What the parts of an identification file have in common: sources of data, quantities with units, errors."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import xarray as xr
import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, ValidationInfo

from ..datasets import dataset_path
from ..readers import read_recording
from ..units import QuantityError, to_si


class StudyError(ValueError):
    """An identification file that cannot be used; the message names the file and the field."""


def quantity(unit: str) -> BeforeValidator:
    """Makes a field a quantity: a number in SI, or a text with a unit such as "30.7 g"."""

    def convert(value: Any, info: ValidationInfo) -> float:
        return to_si(value, unit, str(info.field_name))

    return BeforeValidator(convert)


Seconds = Annotated[float, quantity("s")]
Hertz = Annotated[float, quantity("Hz")]


class Strict(BaseModel):
    """A part of a file: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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

    columns: dict[str, str | int | list[str | int]] = {}
    units: dict[str, str] = {}
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
    citation: list[str] = []
    notes: str = ""


def load_yaml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The content of a YAML file.

    Raises:
        StudyError: it cannot be read, is no YAML, or is no mapping.
    """
    try:
        found = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: {error}") from error
    except yaml.YAMLError as error:
        raise StudyError(f"{path} is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(found, dict):
        raise StudyError(f"{path}: an identification file is a mapping with 'kind', 'title' and so on")
    return found


def explain(path: str | os.PathLike[str], error: ValidationError) -> StudyError:
    """The first thing that is wrong in a file, in one line."""
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    cause = first.get("ctx", {}).get("error")
    text = str(cause) if isinstance(cause, QuantityError) else first["msg"]
    return StudyError(f"{path}: {where}: {text}{more}")
