"""Export of recordings as NeXus files: HDF5 with the classes of https://manual.nexusformat.org.

The samples are in the group "/entry/data" (NXdata), over "time". Each position is also an NXpositioner, and
each applied calibration an NXcalibration. The group "/entry/recording" (NXcollection, whose content NeXus
does not prescribe) contains the attributes of the recording, from which `open_recording` restores it.
"""

from __future__ import annotations

import json
import os
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._version import __version__
from ..gate.results import json_attribute
from .calibration.polynomial import Calibration, CalibrationError
from .calibration.storage import from_text
from .replacing import replaced_whole
from .schema import RecordingError, validate_recording, with_schema
from .storage import storable_attributes

if TYPE_CHECKING:
    import xarray as xr

NEXUS = ".nxs"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
# Pattern of variable names that have another meaning as fields of an NXdata group.
_TAKEN = re.compile(r"(title|(.*_)?(errors|offset|scaling_factor)|.*_(weights|mask|set|indices))")
_POINTS = 11  # number of points of a calibration curve that is written as a table


def save_nexus(recording: xr.Dataset, path: str | os.PathLike[str]) -> Path:
    """Write a recording to a NeXus file (``.nxs``) and return the absolute path; an existing file is replaced
    as a whole.

    `open_recording` and `read_recording` return the same recording from this file.

    Raises:
        RecordingError: the recording breaks the schema, an attribute cannot be stored, or the name of the
            file does not end in ``.nxs``; or NeXus does not allow the name of a variable or attribute.
        OSError: the file cannot be written.
    """
    # The import is here, because only writing needs the module.
    from ..gate.hdf5_writing import Group, hdf5_bytes, hdf5_version

    target = Path(path).resolve()
    if target.suffix != NEXUS:
        raise RecordingError(f"{target}: its name must end in {NEXUS}")
    _check_names(validate_recording(recording))
    attributes = {"NX_class": "NXroot", "default": "entry", "HDF5_Version": hdf5_version()}
    content = hdf5_bytes(Group(attributes, {"entry": _entry(recording)}))
    with replaced_whole(target) as temporary:
        temporary.write_bytes(content)
    return target


def _check_names(recording: xr.Dataset) -> None:
    from ..gate.nexus import OF_RECORDING, OF_VARIABLE

    for name in map(str, recording.data_vars):
        if not _NAME.fullmatch(name):
            raise RecordingError(
                f"{name!r} is no name in NeXus: rename it with ASCII letters, digits and underscores"
            )
        if _TAKEN.fullmatch(name):
            raise RecordingError(f"{name!r} has a meaning of its own in a NeXus file (NXdata): rename it")
    of_variables = [(OF_VARIABLE, recording[name].attrs) for name in recording.variables]
    for taken, attrs in ((OF_RECORDING, recording.attrs), *of_variables):
        if found := taken & attrs.keys():
            raise RecordingError(f"the attribute {min(found)!r} is one of NeXus itself: rename it")


def _group(nx_class: str, members: dict[str, Any], **attributes: Any) -> Any:
    from ..gate.hdf5_writing import Field, Group

    whole = {name: Field(one) if isinstance(one, str | float | int) else one for name, one in members.items()}
    return Group({"NX_class": nx_class, **attributes}, whole)


def _entry(recording: xr.Dataset) -> Any:
    """Return the NXentry group of a recording's file: title, start and end time, program and notes in their
    NeXus fields, and the groups of data, instrument, calibrations and attributes. Empty fields and groups are
    left out."""
    from ..gate.hdf5_writing import Field

    attrs, time = recording.attrs, recording["time"].values
    epoch, notes = str(attrs.get("epoch", "")), str(attrs.get("notes", ""))
    members: dict[str, Any] = {
        "title": str(attrs.get("title", "")) or "recording",
        "start_time": _moment(epoch, float(time[0])),
        "end_time": _moment(epoch, float(time[-1])),
        "program_name": Field("stickslip", {"version": __version__}),
        "notes": _group("NXnote", {"type": "text/plain", "description": notes}) if notes else None,
        "recording": _group("NXcollection", {}, **storable_attributes(with_schema(attrs))),
        "data": _data(recording),
        "instrument": _instrument(recording),
        "calibrations": _calibrations(attrs),
    }
    return _group("NXentry", {name: one for name, one in members.items() if one}, default="data")


def _moment(epoch: str, seconds: float) -> str:
    """Return the date and time, ISO 8601, at `seconds` [s] in the time of a recording whose time zero is
    `epoch` (ISO 8601); "" without a valid epoch."""
    try:
        return (datetime.fromisoformat(epoch) + timedelta(seconds=seconds)).isoformat()
    except (ValueError, OverflowError):
        return ""


def _data(recording: xr.Dataset) -> Any:
    from ..gate.hdf5_writing import Field
    from ..gate.nexus import DATA

    names, positions = [str(name) for name in recording.data_vars], _positions(recording)
    signal = "end_effector_position" if "end_effector_position" in positions else (positions or names)[0]
    others = [name for name in names if name != signal]
    attributes: dict[str, Any] = {"signal": signal, "axes": ["time"], "time_indices": 0}
    members = {}
    for name in ("time", *names):
        variable = recording[name]
        # NeXus requires the attribute "target" in a field to which other groups have links.
        links = {"target": f"{DATA}/{name}"} if name in positions else {}
        members[name] = Field(variable.values, {**storable_attributes(variable.attrs, f"{name}."), **links})
    return _group("NXdata", members, **attributes, **({"auxiliary_signals": others} if others else {}))


def _positions(recording: xr.Dataset) -> list[str]:
    return [
        str(name)
        for name, variable in recording.data_vars.items()
        if variable.attrs["units"] in ("m", "rad") and "position" in str(name).split("_")
    ]


def _instrument(recording: xr.Dataset) -> Any:
    from ..gate.hdf5_writing import Link
    from ..gate.nexus import DATA

    positioners: dict[str, Any] = {
        name: _group(
            "NXpositioner",
            {
                "name": name,
                "description": recording[name].attrs["long_name"],
                "value": Link(f"{DATA}/{name}"),
            },
        )
        for name in _positions(recording)
    }
    members = {"name": "stick-slip actuator", **positioners}
    return _group("NXinstrument", members) if positioners else None


def _calibrations(attrs: dict[Any, Any]) -> Any:
    """Return an NXcollection of the calibrations in a recording's attributes, each as polynomial and as
    table, named "VARIABLE_NUMBER" in the order of application; None without calibrations."""
    made = {}
    for name, applied in json_attribute(attrs, "calibration").items():
        for k, said in enumerate(applied if isinstance(applied, list) else [], 1):
            try:
                made[f"{name}_{k}"] = _calibration(name, k, from_text(json.dumps(said)))
            except CalibrationError:
                # An entry of the user that is no calibration remains only in the attribute "calibration".
                continue
    return _group("NXcollection", made) if made else None


def _calibration(name: str, place: int, one: Calibration) -> Any:
    from ..gate.hdf5_writing import Field

    powers = ["", " * x", *(f" * x^{p}" for p in range(2, one.order + 1))]
    x = np.linspace(one.low, one.high, _POINTS)
    members = {
        "description": f"{one.name}: {one.source}" if one.source else one.name,
        "physical_quantity": name,
        "sequence_index": place,
        "applied": True,
        "fit_formula_description": " + ".join(f"a{p}{power}" for p, power in enumerate(powers)),
        "calibration_parameters": _group(
            "NXparameters", {f"a{p}": value for p, value in enumerate(one.coefficients)}
        ),
        "original_axis": Field(x, {"units": one.x_unit}),
        "calibrated_axis": Field(one(x), {"units": one.y_unit}),
    }
    return _group("NXcalibration", members)
