"""Apply calibrations to the variables of a recording."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from ..recording import STANDARD_NAMES, RecordingError, validate_recording
from .polynomial import Calibration, CalibrationError
from .storage import load_calibration, to_text

Chain = Calibration | str | Sequence[Calibration | str]


def calibration_chain(chain: Chain, unit: str) -> tuple[Calibration, ...]:
    """The calibrations to be applied one after the other to values in `unit`; names and paths are loaded.

    Raises:
        CalibrationError: one cannot be loaded, or takes another unit than what comes before gives.
    """
    parts = (chain,) if isinstance(chain, Calibration | str) else tuple(chain)
    loaded = tuple(load_calibration(part) if isinstance(part, str) else part for part in parts)
    if not loaded:
        raise CalibrationError("no calibration is named")
    given = "the readings are in", unit
    for calibration in loaded:
        if calibration.x_unit != given[1]:
            raise CalibrationError(
                f"{given[0]} {given[1] or 'no unit'}, but {calibration.name!r} takes {calibration.x_unit}"
            )
        given = f"{calibration.name!r} gives", calibration.y_unit
    return loaded


def apply_calibration(recording: xr.Dataset, calibrations: Mapping[str, Chain]) -> xr.Dataset:
    """The recording with some of its variables calibrated; what was applied is kept in its attributes.

    Args:
        recording: over "time".
        calibrations: variable -> calibration, or its name or file, or a sequence of them:
            ``{"end_effector_position": ["kang2007-inductive-5", "kang2007-recalibration"]}``.

    Raises:
        CalibrationError: a calibration cannot be loaded, or does not fit the variable's unit.
        RecordingError: the recording has no such variable.
    """
    made, applied = recording.copy(), dict[str, list[str]]()
    for name, chain in calibrations.items():
        if name not in recording.data_vars:
            known = ", ".join(map(str, recording.data_vars))
            raise RecordingError(f"the recording has no variable {name!r}; it has {known}")
        try:
            loaded = calibration_chain(chain, recording[name].attrs["units"])
        except CalibrationError as error:
            raise CalibrationError(f"{name}: {error}") from None
        standard = STANDARD_NAMES.get(name)
        if standard is not None and standard.unit != loaded[-1].y_unit:
            raise CalibrationError(f"{name} is a quantity in {standard.unit}, not {loaded[-1].y_unit}")
        values = recording[name].values
        for calibration in loaded:
            values = calibration(values)
        made[name] = ("time", values, {**recording[name].attrs, "units": loaded[-1].y_unit})
        applied[name] = [to_text(calibration) for calibration in loaded]
    made.attrs["calibration"] = calibration_attribute(applied, str(recording.attrs.get("calibration", "")))
    return validate_recording(made)


def calibration_attribute(applied: Mapping[str, Sequence[str]], before: str = "") -> str:
    """What goes into the attribute "calibration" of a recording: JSON, variable -> list of calibrations."""
    try:
        known: dict[str, Any] = json.loads(before) if before else {}
    except ValueError:
        known = {"notes": before}  # free text of a reader
    for name, texts in applied.items():
        if not texts:
            continue
        known[name] = [*known.get(name, []), *map(json.loads, texts)]
    return json.dumps(known, ensure_ascii=False) if known else ""
