"""Comparison of two or more runs: their differences, and their channels on one clock."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ..gate.text import load_json
from ..recording import RecordingError
from ..recording.shown_drive import drive_begins

# Events of a recording that can be the zero of its clock, the preferred one first.
TRIGGER, DRIVE = "trigger", "begin of the drive"


def differences(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the columns and settings in which rows of the index differ.

    Settings are compared one by one, under names such as ``variables.voltage`` and ``capture.interval``. The
    columns name, changed, bytes, begun and links, which differ between any two runs, are left out.

    Args:
        rows: rows of the index (values by column), with `settings` as JSON text.

    Returns:
        Dictionary from each name with different values to the list of one value per row, in the order of
        `rows`; None if the row has no value.
    """
    flat = flat_rows(rows)
    names = dict.fromkeys(name for one in flat for name in one if name not in _ALWAYS)
    table = {name: [one.get(name) for one in flat] for name in names}
    return {name: values for name, values in table.items() if any(value != values[0] for value in values)}


def flat_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each row with its `settings` (JSON text) as separate columns, under names such as
    ``capture.interval`` for nested ones."""
    return [_flat({**row, "settings": json.loads(row.get("settings") or "{}")}) for row in rows]


# Columns that are not compared as a whole: they differ between any two runs, or are compared in parts
# (settings).
_ALWAYS = ("name", "changed", "bytes", "begun", "settings", "links")


def _flat(content: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(content, dict):
        return {name: content}
    found: dict[str, Any] = {}
    for key, value in content.items():
        below = f"{name}.{key}" if name and name != "settings" else str(key)
        found |= _flat(value, below)
    return found


class Zero(NamedTuple):
    """New zero of a recording's clock, for a comparison of recordings.

    `event` is the event at the new zero, `TRIGGER` or `DRIVE`, and `time` [s] is its time on the recording's
    own clock. Without an event (""), `time` is 0 and the clock stays. `triggered` is True if a trigger
    started the recording.
    """

    time: float
    event: str
    triggered: bool


def common_zeros(recordings: Sequence[xr.Dataset]) -> list[Zero]:
    """Return the new zero of each recording's clock, chosen so that corresponding events have the same time.

    If possible, all recordings use the same event: the one of the first recording that most of the others
    have, too. A recording without this event uses its own preferred one, or none. `comparable` finds the
    recordings with the common event; only they can be compared with the first.
    """
    known = [_events(one) for one in recordings]

    def shared(event: str) -> int:
        return sum(event in one for one in known) if event in known[0] else -1

    common = max((TRIGGER, DRIVE), key=shared)  # if both are equally frequent, this is TRIGGER
    zeros = []
    for one in known:
        event = common if common in one else next(iter(one), "")
        zeros.append(Zero(one.get(event, 0.0), event, TRIGGER in one))
    return zeros


def comparable(zeros: Sequence[Zero]) -> list[bool]:
    """Return for each zero True if the clock has the same event at zero as the clock of the first recording.

    Differences between recordings with different events at zero are meaningless.
    """
    return [zero.event != "" and zero.event == zeros[0].event for zero in zeros]


def _events(recording: xr.Dataset) -> dict[str, float]:
    """Return a dictionary from the events of a recording that can be the zero of its clock to their times
    [s], the preferred event first; empty if none is known."""
    capture = _capture(recording)
    before, triggered = capture.get("pre_trigger", 0.0), bool(capture.get("trigger"))
    found = {TRIGGER: float(before)} if triggered else {}
    begins = drive_begins(recording)
    if begins is None and capture and not triggered:
        begins = before  # a capture without a trigger starts `before` seconds earlier than the drive
    if begins is None and ("model" in recording.attrs or recording.attrs.get("source") == "simulation"):
        begins = float(recording["time"][0]) if "drive_voltage" in recording else None
    return found if begins is None else {**found, DRIVE: float(begins)}


def _capture(recording: xr.Dataset) -> dict[str, Any]:
    """Return the settings with which a rig recorded, by the names of the fields of `rig.Capture`, from the
    attribute "capture"; empty for a user's own file, or if the settings are damaged."""
    try:
        found = load_json(str(recording.attrs.get("capture") or "{}"), "capture")
        float(found.get("pre_trigger", 0.0))
    except (ValueError, AttributeError, TypeError):
        return {}
    return found


def on_one_clock(recordings: Sequence[xr.Dataset], channel: str) -> xr.Dataset:
    """Interpolate a channel of several recordings to the sampling times of the first one.

    Only times are used that all recordings cover. The times of the recordings must already be counted from a
    common zero (`common_zeros`), and ascend.

    Returns:
        Dataset over "run" (in the order of the recordings) and "time" [s]: the channel under its own name,
        and `difference`, each recording minus the first, in the unit of the channel.

    Raises:
        RecordingError: a recording lacks the channel or has another unit, or fewer than two sampling times of
            the first are in all of them.
    """
    for one in recordings:
        if channel not in one:
            raise RecordingError(f"{one.attrs.get('title') or 'a recording'} has no channel {channel}")
    units = dict.fromkeys(str(one[channel].attrs.get("units", "")) for one in recordings)
    if len(units) > 1:
        raise RecordingError(f"{channel} is in {' and in '.join(units)}: it cannot be compared")
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
