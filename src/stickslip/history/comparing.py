"""Two or more runs side by side: what differed, and their channels on one clock."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from ..recording import RecordingError


def differences(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """What is not the same in all rows of an index: name -> one value a row; None where it says nothing.

    Settings are taken apart: ``variables.voltage``, ``capture.interval``.
    """
    flat = [_flat({**row, "settings": json.loads(row.get("settings") or "{}")}) for row in rows]
    names = dict.fromkeys(name for one in flat for name in one if name not in _ALWAYS)
    table = {name: [one.get(name) for one in flat] for name in names}
    return {name: values for name, values in table.items() if any(value != values[0] for value in values)}


_ALWAYS = ("name", "changed", "bytes", "begun", "settings", "links")


def _flat(content: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(content, dict):
        return {name: content}
    found: dict[str, Any] = {}
    for key, value in content.items():
        below = f"{name}.{key}" if name and name != "settings" else str(key)
        found |= _flat(value, below)
    return found


def on_one_clock(recordings: Sequence[xr.Dataset], channel: str) -> xr.Dataset:
    """A channel of several recordings at the times of the first, as far as all of them go.

    Returns:
        over "time" [s] and "run": the channel, and `difference` of each from the first, in its unit.

    Raises:
        RecordingError: one has no such channel, or they have no time in common.
    """
    for one in recordings:
        if channel not in one:
            raise RecordingError(f"{one.attrs.get('title') or 'a recording'} has no channel {channel}")
    begin = max(float(one["time"][0]) for one in recordings)
    end = min(float(one["time"][-1]) for one in recordings)
    time = recordings[0]["time"].values
    time = time[(time >= begin) & (time <= end)]
    if time.size < 2:
        raise RecordingError("the recordings have no time in common")
    values = np.array([np.interp(time, one["time"].values, one[channel].values) for one in recordings])
    attrs = recordings[0][channel].attrs
    return xr.Dataset(
        {
            channel: (("run", "time"), values, attrs),
            "difference": (("run", "time"), values - values[0], attrs),
        },
        {"time": ("time", time, {"units": "s"})},
    )
