"""Storage of a recording's drive waveform in its attribute "drive", as JSON that other programs can read too.

An example is ``{"waveform": "Sawtooth", "amplitude": 65.0, "frequency": 5.0, "periods": 8}``: the registered
name, and the fields that differ from their defaults, in SI. A sequence has its parts, and a user's own
waveform also the module or file that defines it.
"""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..gate.errors import damaged
from ..gate.results import json_attribute
from ..quantities import registry
from ..quantities.units import QuantityError
from ..waveform.sequence import Sequence
from ..waveform.signal import Waveform

if TYPE_CHECKING:
    import xarray as xr


def drive_text(waveform: Waveform) -> str:
    """Return the JSON text that describes a waveform, for the attribute "drive" of a recording: its
    registered name, and its fields (in SI) that differ from their defaults."""
    return json.dumps(_data(waveform))


def named_drive(recording: xr.Dataset) -> Waveform | None:
    """Return the waveform in a recording's attribute "drive". Its time is 0 at the start of the waveform,
    which may be later than the start of the recording.

    The result is None if the attribute is missing or invalid, or names an unknown waveform (see
    `registry.use_file`).
    """
    content = json_attribute(recording.attrs, "drive")
    with suppress(QuantityError), damaged(QuantityError, "drive"):
        made = _made(content)
        return made if hasattr(made, "drive") else None
    return None


def _data(value: Any) -> Any:
    if hasattr(value, "drive"):
        return registry.waveforms.written(type(value)) | _fields(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [_data(one) for one in value]
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _fields(waveform: Any) -> dict[str, Any]:
    if isinstance(waveform, Sequence):
        return {"parts": _data(waveform.parts)}
    if is_dataclass(waveform):
        of = {field.name: (getattr(waveform, field.name), field.default) for field in fields(waveform)}
    else:
        defaults = getattr(waveform, "_field_defaults", {})
        values = waveform._asdict() if hasattr(waveform, "_asdict") else vars(waveform)
        of = {name: (value, defaults.get(name, ...)) for name, value in values.items()}
    # Arrays are always stored, because comparison with a default gives no single truth value.
    kept = {n: value for n, (value, usual) in of.items() if isinstance(value, np.ndarray) or value != usual}
    return {name: _data(value) for name, value in kept.items()}


def _made(data: Any) -> Any:
    # A list that starts with a dictionary is one part of a sequence: a waveform and its duration [s].
    if isinstance(data, list) and data and isinstance(data[0], dict):
        return tuple(map(_made, data))
    if not isinstance(data, dict):
        return data
    kind = registry.waveforms.of_results(data)
    if kind is Sequence:
        return Sequence(*map(_made, data["parts"]))
    return kind(**{name: _made(value) for name, value in data.items() if not name.startswith("waveform")})
