"""Schema of recordings and its checks. A recording is an ``xarray.Dataset`` over "time", the same for files,
rigs and simulations.

The schema and its reasons: docs/decisions/recording-schema.md.
"""

from __future__ import annotations

import functools
import re
import warnings
from collections.abc import Mapping
from datetime import UTC, datetime
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._version import __version__
from ..quantities.units import ANGLE, QuantityError
from .conversion import to_si_unit

if TYPE_CHECKING:
    import xarray as xr

SCHEMA_VERSION = 1
# Attribute of a variable: relative standard uncertainty of its scale, common to all its samples.
SCALE_UNCERTAINTY = "scale_uncertainty"


class RecordingError(ValueError):
    """Error: a recording, or the file from which it comes, does not satisfy the requirements."""


class RecordingWarning(UserWarning):
    """Warning: a recording lacks relevant information; the message names the assumption."""


class Meaning(NamedTuple):
    """Meaning of a standard variable: its SI `unit` and its descriptive `long_name`."""

    unit: str
    long_name: str


# Standard names of variables, which all parts of the package know; users may choose other names for other
# variables. For rotary bodies, positions are angles and forces are torques (`fits_name`).
STANDARD_NAMES = {
    "drive_voltage": Meaning("V", "drive voltage"),
    "stage_position": Meaning("m", "stage position"),
    "stage_velocity": Meaning("m/s", "stage velocity"),
    "end_effector_position": Meaning("m", "end-effector position"),
    "end_effector_velocity": Meaning("m/s", "end-effector velocity"),
    "sliding_displacement": Meaning("m", "sliding displacement"),
    "bristle_deflection": Meaning("m", "bristle deflection"),
    "friction_force": Meaning("N", "friction force"),
    "normal_force": Meaning("N", "normal force"),
    "position": Meaning("m", "position"),
    "displacement": Meaning("m", "displacement"),
    "velocity": Meaning("m/s", "velocity"),
    "voltage": Meaning("V", "voltage"),
    "force": Meaning("N", "force"),
}


def fits_name(name: str, unit: str) -> bool:
    """Return True if a channel with this name may have this SI unit. A standard name allows its unit and the
    corresponding one for rotary bodies (rad for m); any other name allows any unit."""
    standard = STANDARD_NAMES.get(name)
    return standard is None or unit in (standard.unit, ANGLE.unit(standard.unit))


def usual_long_name(name: str, unit: str) -> str:
    """Return the descriptive name of a variable for which the user gives none: that of the standard name, or
    the name without underscores."""
    standard = STANDARD_NAMES.get(name)
    if standard is None:
        return name.replace("_", " ")
    # A standard variable in another unit is that of a rotary body: an angle or a torque.
    return standard.long_name if unit == standard.unit else ANGLE.name(standard.long_name)


@functools.cache
def meant_name(name: str) -> str:
    """Return the standard name (or "time") of which a name is probably a misspelling; "" if it is similar to
    none.

    The result is also "" for a standard name itself, and for a user's name that contains all words of one,
    such as ``end_effector_position_2`` or ``position_raw``.
    """
    known = ["time", *STANDARD_NAMES]
    # Smallest similarity (0 to 1) to a known name; a wrong letter reduces that of a short name more.
    cutoff = 0.9 if len(name) > 4 else 0.85
    close = get_close_matches(name.lower(), known, n=1, cutoff=cutoff)
    words = set(re.split(r"[\W\d_]+", name))
    return "" if not close or words.issuperset(close[0].split("_")) else close[0]


def _warn_of_misspelling(name: str) -> None:
    meant = meant_name(name)
    if meant:
        warnings.warn(
            f"nothing knows the name {name!r} (did you mean {meant!r}?): it is kept, and has no unit but one "
            "that is said",
            RecordingWarning,
            stacklevel=3,
        )


class Sampling(NamedTuple):
    """Sampling intervals of a time axis, s: the median (`interval`), `smallest_gap` and `largest_gap`."""

    interval: float
    smallest_gap: float
    largest_gap: float

    @property
    def regular(self) -> bool:
        """Return True if every interval is within 1 % of the median; this allows for times printed with few
        digits."""
        close = 0.01 * self.interval
        return self.largest_gap - self.interval <= close and self.interval - self.smallest_gap <= close


def sampling(recording: xr.Dataset) -> Sampling:
    """Return the median, smallest and largest sampling interval of a recording, computed from its time
    axis."""
    return _sampling(recording["time"].values)


def _sampling(time: np.ndarray) -> Sampling:
    gaps = np.diff(time)
    smallest, largest = float(gaps.min()), float(gaps.max())
    return Sampling(float(np.median(gaps, overwrite_input=True)), smallest, largest)


def make_recording(
    time: ArrayLike,
    variables: Mapping[str, Any],
    *,
    title: str = "",
    notes: str = "",
    source: str = "",
    reader: str = "",
    calibration: str = "",
    processing: str = "",
    epoch: str = "",
    long_names: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Return a recording made from arrays, after checks. A RecordingWarning reports a name that is probably a
    misspelled standard name.

    Args:
        time: seconds, strictly ascending, at least two samples.
        variables: name -> array, taken to be in SI, or (array, unit) such as ``(counts, "um")``. One number
            per time. Arrays already in SI are not copied. The unit of a pint quantity, or in the attribute
            ``units`` of a DataArray, is used, also for the time.
        title, notes: free text.
        source, reader: origin file of the data, and its reader.
        calibration: calibrations of the sensors, as text or JSON.
        processing: processing steps since the measurement.
        epoch: date and time of time zero, in ISO 8601, if known.
        long_names: descriptive names of variables with unclear names, by variable.

    Raises:
        RecordingError: see `validate_recording`; or a unit is unknown or does not fit a standard name.
    """
    time = _seconds(time)
    data, labels, long_names = {}, [], long_names or {}
    for name, value in variables.items():
        if name == "time":
            raise RecordingError("'time' is the name of the time axis, not of a variable")
        _warn_of_misspelling(str(name))
        array, unit = _in_si(str(name), *_with_unit(value))
        long_name = long_names.get(name) or usual_long_name(str(name), unit)
        if array.shape != time.shape:
            raise RecordingError(f"{name} has the shape {array.shape}, but time has {time.shape}")
        data[name] = _over_time(array)
        labels.append(_Label(name, unit, long_name))
    frame = _kept_frame if time.size <= _OFTEN else _frame
    made = frame(time.tobytes(), tuple(labels)).copy(data=data)
    for name, unit, _ in labels:
        _check_finite(name, unit, data[name].values)
    made.attrs = with_schema(
        {
            "title": title,
            "notes": notes,
            "source": source,
            "reader": reader,
            "calibration": calibration,
            "processing": processing,
            "epoch": epoch,
        }
    )
    return made


class _Label(NamedTuple):
    name: str
    unit: str
    long_name: str


def _over_time(array: np.ndarray, **attributes: str) -> xr.Variable:
    """Return samples as an xarray variable over "time". This fast path avoids a check for which xarray
    imports dask."""
    import xarray as xr

    return xr.Variable("time", array, attributes, fastpath=True)


def _frame(seconds: bytes, labels: tuple[_Label, ...]) -> xr.Dataset:
    """Return a recording with zeros as samples, which copies fill: the time axis with its sampling, and
    labelled variables.

    Args:
        seconds: the times [s] as bytes of float64, so that calls can be cached.
        labels: name, unit and long name of each variable.
    """
    import pandas as pd
    import xarray as xr

    time = np.frombuffer(seconds)
    empty = np.broadcast_to(0.0, time.shape)
    data = {one.name: _over_time(empty, units=one.unit, long_name=one.long_name) for one in labels}
    # The index is made here, because xarray would import pint to make one from an array.
    axis = ("time", pd.Index(time, name="time"), {"units": "s", "long_name": "time"})
    frame = validate_recording(xr.Dataset(data, coords={"time": axis}))
    found = _sampling(time)
    frame.variables["time"].attrs.update(
        sample_interval=found.interval, largest_gap=found.largest_gap, regular=int(found.regular)
    )
    return frame


# `_kept_frame` caches `_frame`, because xarray takes most of the time for combining variables, and thousands
# of simulations have the same time axis and labels. _OFTEN: largest number of samples for which the cache is
# used. With more, other steps take longer, and the cache would need memory.
_kept_frame = functools.lru_cache(maxsize=8)(_frame)
_OFTEN = 20_000


def _with_unit(value: Any) -> tuple[Any, str | None]:
    """Return the values and the unit (None if unknown) of an array, an (array, unit) tuple, a DataArray or a
    pint quantity."""
    import xarray as xr

    match value:
        case (array, str() | None as unit) if isinstance(value, tuple):
            return array, unit
    if isinstance(value, xr.DataArray):
        return value.values, value.attrs.get("units")
    # NumPy would remove the unit of a pint quantity.
    if hasattr(value, "magnitude"):
        return value.magnitude, str(value.units)
    return value, None


def _seconds(time: Any) -> np.ndarray:
    array, unit = _with_unit(time)
    # Dates and durations are refused: NumPy would convert them to counts of their time unit, such as ns.
    if np.asarray(array).dtype.kind in "mM":
        raise RecordingError(
            "time holds dates or durations, not numbers: give seconds since the first sample"
        )
    values, unit = _in_si("time", array, unit)
    if unit not in ("s", ""):
        raise RecordingError(f"time is given in {unit}, not in s")
    if values.ndim != 1:
        raise RecordingError(f"time has the shape {values.shape}; it must be one row of numbers")
    return values


def _in_si(name: str, array: Any, unit: str | None) -> tuple[np.ndarray, str]:
    """Return the values as float64 in SI, and the SI unit. With None as unit, values are taken to be in the
    unit of the standard name, or plain numbers. Raises RecordingError for wrong values or units."""
    standard = STANDARD_NAMES.get(name)
    try:
        # Masked values become NaN (missing), because `np.asarray` would ignore the mask.
        if np.ma.isMaskedArray(array):
            array = np.ma.filled(array.astype(np.float64), np.nan)
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{name} is not an array of numbers: {error}") from None
    if unit is None:
        return values, standard.unit if standard else ""
    try:
        conversion = to_si_unit(unit)
    except QuantityError as error:
        raise RecordingError(f"{name}: {error}") from None
    if standard and not fits_name(name, conversion.unit):
        raise RecordingError(f"{name} is given in {unit!r}, but {name} is a quantity in {standard.unit}")
    if conversion.factor != 1.0 or conversion.offset != 0.0:
        values = values * conversion.factor + conversion.offset
    return values, conversion.unit


def with_schema(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes of a recording as a dictionary, with missing ones of the schema added:
    schema_version, library, the date of creation, and empty texts."""
    own = {
        "schema_version": SCHEMA_VERSION,
        "library": f"stickslip {__version__}",
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    texts = ("title", "notes", "source", "reader", "calibration", "processing", "epoch")
    return {**own, **dict.fromkeys(texts, ""), **attrs}


def validate_recording(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording itself if it follows the schema.

    Raises:
        RecordingError: the recording is not a Dataset or has no variables; "time" is missing or not the only
            coordinate, has fewer than two samples, or is not strictly ascending; a variable is not float64
            over "time", not finite, lacks units or long_name, or has a known unit that is not in SI or a name
            that is no identifier; the schema has another version.
    """
    import xarray as xr

    if not isinstance(recording, xr.Dataset):
        raise RecordingError(
            f"a {type(recording).__name__} is no recording: make_recording makes one, an xarray.Dataset"
        )
    version = recording.attrs.get("schema_version", SCHEMA_VERSION)
    if version != SCHEMA_VERSION:
        raise RecordingError(f"the recording follows schema {version}; this library knows {SCHEMA_VERSION}")
    if set(recording.coords) != {"time"}:
        raise RecordingError(
            f"the recording has the coordinates {sorted(map(str, recording.coords))}, not ['time']"
        )
    if not recording.data_vars:
        raise RecordingError("the recording has no variables")
    # `variables` is used, because recording[name] makes a DataArray, which takes longer than all checks.
    for name in ("time", *recording.data_vars):
        _check_variable(str(name), recording.variables[name])
    time = recording.variables["time"].values
    if len(time) < 2:
        raise RecordingError(f"a recording needs at least two samples, this one has {len(time)}")
    ascending = time[1:] > time[:-1]
    if not ascending.all():
        at = int(np.argmin(ascending)) + 1
        raise RecordingError(
            f"time does not increase at sample {at}: {time[at]:.9g} s after {time[at - 1]:.9g} s"
        )
    return recording


def refuse_unit(name: str, unit: str, where: str = "") -> None:
    """Raise RecordingError if the unit of a variable is known, but not an SI unit without prefix, as
    recordings require. `where` is text that follows the variable's name in the message."""
    try:
        conversion = to_si_unit(unit)
    except QuantityError:
        # Users may choose a unit that the package does not know.
        return
    if (conversion.factor, conversion.offset) != (1.0, 0.0):
        raise RecordingError(
            f"{name}{where} is labelled {unit!r}, but recordings are in {conversion.unit or 'numbers'}: "
            f"make_recording(time, {{{name!r}: (values, {unit!r})}}) converts"
        )


def _check_variable(name: str, variable: xr.Variable) -> None:
    if not name.isidentifier():
        raise RecordingError(f"{name!r} is no name for a variable: letters, digits and underscores only")
    if variable.dims != ("time",):
        raise RecordingError(f"{name} has the dimensions {variable.dims}, not ('time',)")
    if variable.dtype != np.float64:
        raise RecordingError(f"{name} is of the type {variable.dtype}, not float64")
    for attr in ("units", "long_name"):
        if not isinstance(variable.attrs.get(attr), str):
            raise RecordingError(f"{name} lacks the attribute {attr!r}")
    refuse_unit(name, variable.attrs["units"])
    _check_finite(name, variable.attrs["units"], variable.values)


def _check_finite(name: str, unit: str, values: np.ndarray) -> None:
    finite = np.isfinite(values)
    if not finite.all():
        raise RecordingError(f"{name} [{unit}] is not finite at sample {int(np.argmin(finite))}")
