"""Saving of recordings as NetCDF files, so that an interrupted write leaves the old file, and opening of such
files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..gate.errors import GateError
from .replacing import replaced_whole
from .schema import RecordingError, validate_recording, with_schema

if TYPE_CHECKING:
    import xarray as xr


def save_recording(recording: xr.Dataset, path: str | os.PathLike[str]) -> Path:
    """Write a recording to a ``.nc`` file (NetCDF 4) and return the absolute path.

    The data are first written to a new file beside the target, which then takes the target's name: at every
    moment the name refers to a complete recording, the old one or the new one.

    Raises:
        RecordingError: the recording breaks the schema, an attribute cannot be stored, or the name does not
            end in ``.nc``.
        OSError: the folder is missing or cannot be written.
    """
    target = Path(path).resolve()
    if target.suffix != ".nc":
        raise RecordingError(f"{target}: a recording is saved as .nc")
    validate_recording(recording)
    stored = recording.copy()
    stored.attrs = storable_attributes(with_schema(recording.attrs))
    for name in stored.variables:
        stored[name].attrs = storable_attributes(recording[name].attrs, f"{name}.")
        # A recording has no missing values, so no value marks them.
        stored[name].encoding = {"_FillValue": None}
    # The file is made in memory first, because on a full disk HDF5 crashes the process when it closes a file.
    content = stored.to_netcdf(None, engine="h5netcdf")
    with replaced_whole(target) as temporary:
        temporary.write_bytes(content)
    return target


def open_recording(path: str | os.PathLike[str]) -> xr.Dataset:
    """Return the recording in a ``.nc`` file, or in a NeXus file that `save_nexus` wrote; all data are loaded
    into memory.

    Raises:
        RecordingError: the file is missing, damaged, contains no recording, or has another schema version.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file, or it is a folder; check the name")
    try:
        recording = _stored(path)
    except GateError as error:
        raise RecordingError(f"{error}") from error
    # xarray raises ValueError or TypeError for inconsistent axes; a disk raises OSError.
    except (ValueError, TypeError, OSError) as error:
        said = " ".join(str(error).split())
        raise RecordingError(f"{path}: not a readable NetCDF 4 file (damaged?): {said}") from error
    if "schema_version" not in recording.attrs:
        raise RecordingError(f"{path}: no stickslip recording (it lacks 'schema_version')")
    try:
        return validate_recording(recording)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def _stored(path: Path) -> xr.Dataset:
    """Return the content of a NetCDF or NeXus file as a Dataset without checks of the schema. The function
    does not use xarray's reader, which takes several times as long."""
    # The imports are here, so that simulations, which do not need HDF5, start faster.
    import xarray as xr

    from ..gate.hdf5 import has_attribute
    from ..gate.netcdf import read_netcdf
    from ..gate.nexus import ATTRIBUTES, read_nexus

    found = read_netcdf(path)
    if "schema_version" not in found.attributes and has_attribute(path, "schema_version", ATTRIBUTES):
        found = read_nexus(path)
    whole = {name: (one.axes, one.values, one.attributes) for name, one in found.variables.items()}
    coordinates = {name: one for name, one in whole.items() if one[0] == (name,)}
    data = {name: one for name, one in whole.items() if name not in coordinates}
    return xr.Dataset(data, coordinates, found.attributes)


def storable_attributes(attrs: Mapping[Any, Any], of: str = "") -> dict[str, Any]:
    """Return the attributes in types that HDF5 can store; booleans become 0 or 1. `of` is a prefix of the
    attributes' names in messages.

    Raises:
        RecordingError: an attribute is neither text nor a number, or contains characters that cannot be
            stored.
    """
    return {str(name): _storable(f"{of}{name}", value) for name, value in attrs.items()}


def _storable(name: str, value: object) -> object:
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, str):
        if "\0" in value or any("\ud800" <= sign <= "\udfff" for sign in value):
            raise RecordingError(f"the attribute {name} = {value!r} holds characters that cannot be stored")
        return value
    if isinstance(value, int | float | np.integer | np.floating):
        return value
    raise RecordingError(f"the attribute {name} is a {type(value).__name__}; text and numbers can be stored")
