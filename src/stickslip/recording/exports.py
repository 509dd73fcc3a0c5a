"""Export of recordings to other programs: MAT files in dSPACE's two layouts, CSV and NeXus, listed in
`EXPORTS`.

NeXus, like the package's own format NetCDF, keeps all attributes; MAT and CSV keep only samples, names and
units.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..quantities.units import QuantityError
from .conversion import to_si_unit
from .nexus import NEXUS, save_nexus
from .replacing import replaced_whole
from .schema import RecordingError, validate_recording

if TYPE_CHECKING:
    import xarray as xr

Layout = Literal["trace", "controldesk"]
_ROWS = 10_000  # number of rows that are written at a time


def save_matlab(
    recording: xr.Dataset,
    path: str | os.PathLike[str],
    layout: Layout = "trace",
    units: Mapping[str, str] | None = None,
) -> Path:
    """Write a recording to a ``.mat`` file (version 5) and return the absolute path; an existing file is
    replaced as a whole.

    Args:
        recording: dataset over "time".
        path: path of the new file.
        layout: "trace", the layout of [kang2007, app. 8]: ``trace_x`` is the time in s, ``trace_y`` has a row
            for each variable, and ``trace_names`` and ``trace_units`` contain the names and units of the
            rows. "controldesk", the structure that ControlDesk writes: named after the file, with ``.X.Data``
            and ``.Y(k).Name``, ``.Y(k).Unit``, ``.Y(k).Data``.
        units: unit in the file ("um") by the variable's name; SI for the others.

    Raises:
        RecordingError: the recording breaks the schema, a unit does not fit, `units` has an unknown variable,
            the layout is unknown, or the name does not end in ``.mat``.
        OSError: the file cannot be written.
    """
    target = _target(path, ".mat")
    columns = _columns(recording, units)
    time = recording["time"].values[None, :]
    if layout == "trace":
        content: dict[str, Any] = {
            "trace_x": time,
            "trace_y": np.array([values for _, _, values in columns]),
            "trace_names": np.array([name for name, _, _ in columns], dtype=object),
            "trace_units": np.array([unit for _, unit, _ in columns], dtype=object),
        }
    elif layout == "controldesk":
        content = {_matlab_identifier(target.stem): _structure(recording, time, columns)}
    else:
        raise RecordingError(f"layout = {layout!r} must be 'trace' or 'controldesk'")
    with replaced_whole(target) as temporary, temporary.open("wb") as file:
        scipy.io.savemat(file, content, do_compression=True, oned_as="row")
    return target


def save_csv(
    recording: xr.Dataset, path: str | os.PathLike[str], units: Mapping[str, str] | None = None
) -> Path:
    """Write a recording to a ``.csv`` file with the header "time [s],drive_voltage [V],..." and return the
    absolute path; an existing file is replaced as a whole.

    All digits of the numbers are written. `units` is as for `save_matlab`.

    Raises:
        RecordingError: the recording breaks the schema, a unit does not fit, `units` has an unknown variable,
            or the name does not end in ``.csv``.
        OSError: the file cannot be written.
    """
    target = _target(path, ".csv")
    columns = _columns(recording, units)
    header = ",".join(["time [s]", *(f"{name} [{unit}]" if unit else name for name, unit, _ in columns)])
    whole = [recording["time"].values, *(values for _, _, values in columns)]
    with replaced_whole(target) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(header + "\n")
        # Rows are written in parts, because lists of numbers take ten times the memory of an array.
        for at in range(0, whole[0].size, _ROWS):
            rows = np.array([values[at : at + _ROWS] for values in whole]).T.tolist()
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
    return target


def _target(path: str | os.PathLike[str], suffix: str) -> Path:
    target = Path(path).resolve()
    if target.suffix != suffix:
        raise RecordingError(f"{target}: its name must end in {suffix}")
    return target


def _columns(
    recording: xr.Dataset, units: Mapping[str, str] | None
) -> list[tuple[str, str, NDArray[np.float64]]]:
    """Return a tuple (name, unit, values [n]) of each variable, converted to the unit in `units` or else in
    SI.

    Raises:
        RecordingError: the recording breaks the schema, or `units` has an unknown variable or a wrong unit.
    """
    validate_recording(recording)
    units = dict(units or {})
    columns = []
    for name, variable in recording.data_vars.items():
        si = variable.attrs["units"]
        unit = units.pop(str(name), si)
        try:
            conversion = to_si_unit(unit)
        except QuantityError as error:
            raise RecordingError(f"{name}: {error}") from None
        if conversion.unit != si:
            raise RecordingError(f"{name} is in {si or 'no unit'}, and not to be had in {unit!r}")
        values = variable.values
        if unit != si:
            values = (values - conversion.offset) / conversion.factor
        columns.append((str(name), unit, values))
    if units:
        raise RecordingError(f"the recording has no variable {next(iter(units))!r}")
    return columns


def _structure(
    recording: xr.Dataset, time: NDArray[np.float64], columns: list[tuple[str, str, NDArray[np.float64]]]
) -> dict[str, Any]:
    interval = float(recording["time"].attrs.get("sample_interval", np.median(np.diff(time))))
    signals = np.empty((1, len(columns)), dtype=[(key, object) for key in ("Name", "Unit", "Data", "XIndex")])
    for k, (name, unit, values) in enumerate(columns):
        signals[0, k] = (name, unit, values[None, :], 1.0)
    return {
        "X": {"Name": "time", "Unit": "s", "Data": time, "Raster": "recording"},
        "Y": signals,
        "Capture": {"SamplingPeriod": interval, "Length": float(time[0, -1] - time[0, 0])},
        "Description": {"General": str(recording.attrs.get("title", "")) or " "},
    }


def _matlab_identifier(text: str) -> str:
    """Return a text as a valid name of a MATLAB variable: ASCII letters, digits and underscores, a letter
    first, at most 31 characters."""
    name = "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in text)
    return (name if name[:1].isalpha() else f"r_{name}")[:31]


class Export(NamedTuple):
    """A file format for other programs: `title` for users; `ending` of file names; and `write`, a function
    that writes a recording to a path and returns the path."""

    title: str
    ending: str
    write: Callable[[xr.Dataset, Path], Path]


# Export formats by the name that the experiment file's field `save_as` and the panel use.
EXPORTS = {
    "mat": Export("MAT", ".mat", save_matlab),
    "controldesk": Export(
        "MAT, as ControlDesk", "_controldesk.mat", partial(save_matlab, layout="controldesk")
    ),
    "csv": Export("CSV", ".csv", save_csv),
    "nexus": Export("NeXus", NEXUS, save_nexus),
}
