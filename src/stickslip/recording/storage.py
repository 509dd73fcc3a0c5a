"""Recordings as NetCDF files, written so that a killed write leaves the old file."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import xarray as xr

from .replacing import replaced_whole
from .schema import RecordingError, validate_recording, with_schema

_ALWAYS, _RATIO = 256 * 2**20, 20  # bytes that a file may unpack to, and times its own size


def save_recording(recording: xr.Dataset, path: str | os.PathLike[str]) -> Path:
    """Write a recording to a ``.nc`` file (NetCDF 4) and return the path.

    The data go into a new file beside the target, onto the disk, and only then take the target's name: at
    every moment the name holds a whole recording, the old one or the new one.

    Raises:
        RecordingError: the recording breaks the schema, an attribute cannot be stored, or the name is no
            ``.nc``.
        OSError: the folder is missing or cannot be written.
    """
    target = Path(path).resolve()
    if target.suffix != ".nc":
        raise RecordingError(f"{target}: a recording is saved as .nc")
    validate_recording(recording)
    stored = recording.copy()
    stored.attrs = {name: _storable(name, value) for name, value in with_schema(recording.attrs).items()}
    for name in stored.variables:
        attrs = recording[name].attrs
        stored[name].attrs = {attr: _storable(f"{name}.{attr}", value) for attr, value in attrs.items()}
        stored[name].encoding = {"_FillValue": None}  # a recording has no missing values
    # Through memory: where a disk is full, HDF5 brings the whole process down when it closes the file.
    content = stored.to_netcdf(None, engine="h5netcdf")
    with replaced_whole(target) as temporary:
        temporary.write_bytes(content)
    return target


def open_recording(path: str | os.PathLike[str]) -> xr.Dataset:
    """The recording of a ``.nc`` file, in memory.

    Raises:
        RecordingError: the file is missing, damaged, no recording, or of a newer schema.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file, or it is none")
    try:
        recording = _stored(path)
    except Exception as error:  # HDF5 reports a damaged file in half a dozen ways
        raise RecordingError(
            f"{path}: not a readable NetCDF 4 file (cut off or damaged?): {error}"
        ) from error
    if "schema_version" not in recording.attrs:
        raise RecordingError(f"{path}: NetCDF, but no stickslip recording (it lacks 'schema_version')")
    try:
        return validate_recording(recording)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def _stored(path: Path) -> xr.Dataset:
    """The variables of the file, as they are; through h5netcdf itself, for xarray's reader around it takes
    half as long again, which matters to a campaign of many recordings."""
    import h5netcdf  # not by those who only simulate
    import h5py

    with h5py.File(path, "r") as opened:
        # h5netcdf asks this too: failing there, it fails once more when freed.
        opened.attrs.get("_nc3_strict")
        file = h5netcdf.File(opened, "r")
        declared = sum(math.prod(one.shape) * one.dtype.itemsize for one in file.variables.values())
        if declared > max(_ALWAYS, _RATIO * path.stat().st_size):
            raise RecordingError(
                f"it says that it holds {declared / 1e6:.0f} MB, which such a small file cannot"
            )
        variables = {
            name: (one.dimensions, one[...], dict(one.attrs)) for name, one in file.variables.items()
        }
        coordinates = {name for name, (dimensions, _, _) in variables.items() if dimensions == (name,)}
        data = {name: one for name, one in variables.items() if name not in coordinates}
        return xr.Dataset(data, {name: variables[name] for name in coordinates}, dict(file.attrs))


def _storable(name: str, value: object) -> object:
    """The attribute as NetCDF can hold it; truth becomes 0 or 1."""
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, str):
        if "\0" in value or any("\ud800" <= sign <= "\udfff" for sign in value):
            raise RecordingError(f"the attribute {name} = {value!r} holds characters that cannot be stored")
        return value
    if isinstance(value, int | float | np.integer | np.floating):
        return value
    raise RecordingError(f"the attribute {name} is a {type(value).__name__}; text and numbers can be stored")
