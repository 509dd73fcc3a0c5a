"""Application of calibrations to the variables of a recording."""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...gate.results import json_attribute
from .. import (
    SCALE_UNCERTAINTY,
    STANDARD_NAMES,
    RecordingError,
    RecordingWarning,
    fits_name,
    validate_recording,
)
from ..schema import usual_long_name
from .polynomial import Calibration, CalibrationError
from .storage import load_calibration, to_text

if TYPE_CHECKING:
    import xarray as xr

Part = Calibration | str | os.PathLike[str]
Chain = Part | Sequence[Part]
# Share of a calibration's range by which readings may exceed this range without a warning, because noise may
# cause it.
BEYOND = 0.05


def calibration_chain(chain: Chain, unit: str) -> tuple[Calibration, ...]:
    """Return one or several calibrations as a tuple, in the order of application, after a check that their
    units fit.

    Args:
        chain: a calibration (object, name of one in the package, or path of a JSON file), or a sequence of
            them.
        unit: SI unit of the uncalibrated values.

    Raises:
        CalibrationError: the sequence is empty, a calibration cannot be loaded, or its input has another unit
            than the previous output.
    """
    parts = (chain,) if isinstance(chain, Calibration | str | os.PathLike) else tuple(chain)
    loaded = tuple(part if isinstance(part, Calibration) else load_calibration(part) for part in parts)
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


def apply_calibration(
    recording: xr.Dataset, calibrations: Mapping[str, Chain], rename: Mapping[str, str] | None = None
) -> xr.Dataset:
    """Return a copy of the recording with some of its variables calibrated; the attribute "calibration"
    contains the applied calibrations.

    Args:
        recording: dataset over "time".
        calibrations: calibration of each variable by name (an object, a name, a file, or a sequence of them):
            ``{"sensor": ["kang2007-inductive-5", "kang2007-recalibration"]}``.
        rename: new names of calibrated variables by their old names. A variable with the standard name of a
            position cannot be in V, so ``{"sensor": "end_effector_position"}`` gives this name to the
            calibrated variable in m.

    Raises:
        CalibrationError: a calibration cannot be loaded, or does not fit the variable's unit or new name; or
            a variable is renamed but not calibrated.
        RecordingError: the recording has no such variable, or the result breaks the schema.

    Warns:
        RecordingWarning: a variable exceeds the range of a calibration by over 5 % of this range; the
            polynomial is not valid there.
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
        new = (rename or {}).get(name, name)
        unit = loaded[-1].y_unit
        if not fits_name(new, unit):
            raise CalibrationError(f"{new} is a quantity in {STANDARD_NAMES[new].unit}, not {unit}")
        values = recording[name].values
        for calibration in loaded:
            _warn_beyond(name, calibration, values)
            values = calibration(values)
        before = recording[name].attrs
        attrs = {**before, "units": unit}
        attrs |= scale_attribute(loaded, attrs.pop(SCALE_UNCERTAINTY, 0.0))
        # A long name that the user has given stays with the variable's name.
        if new != name or before.get("long_name") == usual_long_name(name, before["units"]):
            attrs["long_name"] = usual_long_name(new, unit)
        if new != name:
            made = made.drop_vars(name)
        made[new] = ("time", values, attrs)
        applied[new] = [to_text(calibration) for calibration in loaded]
    for name in rename or {}:
        if name not in calibrations:
            raise CalibrationError(f"{name!r} is renamed but not calibrated")
    made.attrs["calibration"] = calibration_attribute(applied, str(recording.attrs.get("calibration", "")))
    return validate_recording(made)


def scale_attribute(chain: Sequence[Calibration], before: float = 0.0) -> dict[str, float]:
    """Return the attribute of a calibrated variable that states the uncertainty of its scale:
    ``{"scale_uncertainty": u}`` with the root sum of squares u of the calibrations' relative standard
    uncertainties and of `before`.

    The dictionary is empty without calibrations, or if the uncertainty of one is unknown. `before` is the
    relative uncertainty of the uncalibrated variable's scale.
    """
    known = [one.scale_uncertainty for one in chain if one.scale_uncertainty is not None]
    return {SCALE_UNCERTAINTY: math.hypot(before, *known)} if chain and len(known) == len(chain) else {}


def _warn_beyond(name: str, calibration: Calibration, values: NDArray[np.float64]) -> None:
    found = values[np.isfinite(values)]
    low, high = calibration.low, calibration.high
    room = BEYOND * (high - low)
    if found.size and not (found.min() >= low - room and found.max() <= high + room):
        unit = calibration.x_unit
        warnings.warn(
            f"{name} goes from {found.min():.4g} to {found.max():.4g} {unit}, and {calibration.name!r} was "
            f"made for {low:.4g} to {high:.4g} {unit}: beyond, its polynomial is a guess",
            RecordingWarning,
            stacklevel=3,
        )


def calibration_attribute(applied: Mapping[str, Sequence[str]], before: str = "") -> str:
    """Return the attribute "calibration" of a recording: JSON text of a dictionary with the list of
    calibrations of each variable; "" without calibrations.

    Args:
        applied: JSON texts of the new calibrations, by the variable's name.
        before: the attribute of the uncalibrated recording. Its calibrations come first; a text that is not
            JSON is kept under "notes".
    """
    known = json_attribute({"calibration": before}, "calibration")
    if before and not known:
        known["notes"] = before  # The previous attribute is free text, not JSON.
    for name, texts in applied.items():
        if not texts:
            continue
        earlier = known.get(name, [])  # a text, if the variable has the name of the entry "notes"
        known[name] = [*(earlier if isinstance(earlier, list) else [earlier]), *map(json.loads, texts)]
    return json.dumps(known, ensure_ascii=False) if known else ""
