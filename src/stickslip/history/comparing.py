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

TRIGGER, DRIVE = "trigger", "begin of the drive"  # possible zeros of a clock, the preferred one first


def differences(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the differences between rows of an index: name -> one value per row; None without a value.

    Settings are compared one by one: ``variables.voltage``, ``capture.interval``.
    """
    flat = flat_rows(rows)
    names = dict.fromkeys(name for one in flat for name in one if name not in _ALWAYS)
    table = {name: [one.get(name) for one in flat] for name in names}
    return {name: values for name, values in table.items() if any(value != values[0] for value in values)}


def flat_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each row with its settings as separate columns."""
    return [_flat({**row, "settings": json.loads(row.get("settings") or "{}")}) for row in rows]


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
    """Zero of the clock of a compared recording.

    `time` [s] is the time of `event` on the recording's own clock; without an event ("") the clock is
    unchanged.
    """

    time: float
    event: str
    triggered: bool  # the recording started by a trigger


def common_zeros(recordings: Sequence[xr.Dataset]) -> list[Zero]:
    """Return the zero of each clock, so that simultaneous events coincide.

    All use the same event if possible: an event of the first recording that most of the others have too. Only
    recordings with that zero are compared with the first: see `comparable`.
    """
    known = [_events(one) for one in recordings]

    def shared(event: str) -> int:
        return sum(event in one for one in known) if event in known[0] else -1

    common = max((TRIGGER, DRIVE), key=shared)  # the first of equal ones
    zeros = []
    for one in known:
        event = common if common in one else next(iter(one), "")
        zeros.append(Zero(one.get(event, 0.0), event, TRIGGER in one))
    return zeros


def comparable(zeros: Sequence[Zero]) -> list[bool]:
    """Return True for each recording with the same zero as the first; differences between other clocks are
    meaningless."""
    return [zero.event != "" and zero.event == zeros[0].event for zero in zeros]


def _events(recording: xr.Dataset) -> dict[str, float]:
    """Return the events that can be the zero of a clock, with their times [s], the preferred one first."""
    capture = _capture(recording)
    before, triggered = capture.get("pre_trigger", 0.0), bool(capture.get("trigger"))
    found = {TRIGGER: float(before)} if triggered else {}
    begins = drive_begins(recording)
    if begins is None and capture and not triggered:
        begins = before  # from the capture's own data, see `rig.Capture`
    if begins is None and ("model" in recording.attrs or recording.attrs.get("source") == "simulation"):
        begins = float(recording["time"][0]) if "drive_voltage" in recording else None
    return found if begins is None else {**found, DRIVE: float(begins)}


def _capture(recording: xr.Dataset) -> dict[str, Any]:
    """Return the settings of the rig's capture; empty for a user's own file, or if they are damaged."""
    try:
        found = load_json(str(recording.attrs.get("capture") or "{}"), "capture")
        float(found.get("pre_trigger", 0.0))
    except (ValueError, AttributeError, TypeError):
        return {}
    return found


def on_one_clock(recordings: Sequence[xr.Dataset], channel: str) -> xr.Dataset:
    """Return a channel of several recordings at the times of the first, within the times of all.

    Returns:
        Dataset over "time" [s] and "run": the channel, and `difference` of each from the first, in its unit.

    Raises:
        RecordingError: a recording lacks the channel or has another unit, or the recordings have no time in
            common.
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
