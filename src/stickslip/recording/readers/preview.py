"""Preview of a file: its columns, their first values, and their probable meaning."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...quantities.units import QuantityError
from .. import STANDARD_NAMES, RecordingError, fits_name
from .file_units import is_unit, to_si_unit
from .formats import find_format
from .opening import source_of
from .selection import common_clock
from .source import FileChannel, Rows, is_clock, pointer

SHOWN = 8  # number of values at the start of a column that a preview contains
MOST_COLUMNS = 200
LOOKED_AT = 20_000  # number of samples at the start of a file from which ranges and units are guessed
# Patterns of words in a column's name, and the standard name that the column gets as a guess; the first match
# counts.
_MEANINGS = (
    (r"strain|elongation|stage|piezo (pos|disp)", "stage_position"),
    (r"volt|drive|\bu\b|\bhv\b|excitation|command|input", "drive_voltage"),
    (r"sliding", "sliding_displacement"),
    (r"friction", "friction_force"),
    (r"velocity|speed", "end_effector_velocity"),
    (r"normal (force|load)|^normal$", "normal_force"),
    (r"force|load cell", "force"),
    (r"pos|disp|slider|runner|effector|interferometer|\bx\b|\by\b", "end_effector_position"),
)
_DRIVES = {"drive_voltage", "voltage"}


def look(path: Path) -> dict[str, Any]:
    """Return a description of a file that `read_recording` reads, with guesses of names and units.

    Returns:
        Dictionary with reader (name), samples (their number, at most `LOOKED_AT`), and columns (a list, at
        most `MOST_COLUMNS`). Each column is a dictionary: index, name, column (reference to the column: name
        or index), numeric, first (first values in the file's unit, 6 digits; None for NaN), low, high (range;
        None without numbers), clock (True for a time), time (reference to the column's time column, if there
        are several; otherwise ""), unit (in the file; "" without one), known (False for an unknown unit),
        guess (standard name of such a quantity; "" for none), guessed_unit (from the range of values, if the
        file has none; otherwise ""), unread (reason why apparent
        numbers are not read; otherwise "").

    Raises:
        RecordingError: the format is unknown, or the file is damaged, is a recording of this package, or has
            no columns of numbers.
        GateError: the file is damaged, or exceeds `LIMITS`.
        GateError: a name in the file is too long.
    """
    kind = find_format(path)
    if kind == "nc":
        raise RecordingError(f"{path.name} is a recording of ours already: it needs no columns or units")
    source = source_of(path, kind)
    numeric = [i for i, one in enumerate(source.channels[:MOST_COLUMNS]) if one.numeric]
    if not numeric:
        raise RecordingError(f"{path.name} has no columns of numbers")
    read = zip(numeric, source.read(numeric, Rows(0, LOOKED_AT)), strict=True)
    arrays = {i: values + source.channels[i].epoch for i, values in read}
    clock = _clock(source.channels)
    columns = [
        _described(i, source.channels, arrays.get(i), clock)
        for i in range(len(source.channels[:MOST_COLUMNS]))
    ]
    taken: dict[str, str] = {}
    # Each guess is used once; a column whose name is repeated in the file gets a number.
    for one in columns:
        first = taken.setdefault(one["guess"], one["name"])
        again = [other for other in columns[: one["index"]] if other["name"] == one["name"]]
        if one["guess"] and (again or first != one["name"]):
            one["guess"] = f"{again[0]['guess']}_{len(again) + 1}" if again and again[0]["guess"] else ""
    _as_of_an_actuator(columns)
    _as_of_a_contact(columns)
    return {"reader": source.reader, "samples": max(a.size for a in arrays.values()), "columns": columns}


def _as_of_an_actuator(columns: list[dict[str, Any]]) -> None:
    """Change the guessed names of the columns (see `look`) in place, if they include a voltage and a
    position: to the standard names of the drive voltage and the end-effector's position."""
    by_guess = {one["guess"]: one for one in columns}
    drive = by_guess.get("drive_voltage") or by_guess.get("voltage")
    moved = next((by_guess[name] for name in ("position", "displacement") if name in by_guess), None)
    if drive and moved and "end_effector_position" not in by_guess:
        drive["guess"], moved["guess"] = "drive_voltage", "end_effector_position"


def _as_of_a_contact(columns: list[dict[str, Any]]) -> None:
    """Change the guessed name of a position column (see `look`) in place to "position", as on a tribometer.

    This requires a friction force, no drive voltage and no other column guessed as "position", and a column
    name that does not mean the actuator's slider.
    """
    by_guess = {one["guess"]: one for one in columns}
    if "friction_force" not in by_guess or "position" in by_guess or _DRIVES & by_guess.keys():
        return
    moved = by_guess.get("end_effector_position") or by_guess.get("displacement")
    if moved and not re.search(r"effector|slider|runner", moved["name"], re.IGNORECASE):
        moved["guess"] = "position"


def _clock(channels: Sequence[FileChannel]) -> int | None:
    """Return the index of the common time column; None if no column is a time, or if several are possible."""
    try:
        return common_clock(channels, {}, {c.name: i for i, c in enumerate(channels) if c.numeric}, {})
    except RecordingError:
        return None


def _described(
    i: int, channels: Sequence[FileChannel], values: np.ndarray | None, clock: int | None
) -> dict[str, Any]:
    channel = channels[i]
    known = not channel.unit or is_unit(channel.unit)
    found: dict[str, Any] = {
        "index": i, "name": channel.shown, "column": pointer(channels, i), "numeric": channel.numeric,
        "unread": channel.unread,
        "unit": channel.unit, "known": known, "guess": "", "guessed_unit": "", "first": [], "low": None,
        "high": None, "time": "",
    }  # fmt: skip
    found["clock"] = times = i == clock or is_clock(channel) or channel.clock == i
    if channel.clock not in (None, i, clock):
        found["time"] = pointer(channels, channel.clock)
    if values is None or not values.size:
        return found
    real = values[np.isfinite(values)]
    found["first"] = [float(f"{one:.6g}") if np.isfinite(one) else None for one in values[:SHOWN]]
    if not real.size:
        return found
    found["low"], found["high"] = float(real.min()), float(real.max())
    name = "time" if times else _meaning(channel)
    if known and (not times or clock in (None, i)):
        found["guess"] = name
    if not channel.unit and not channel.stamp:
        found["guessed_unit"] = likely_unit(name, real)
    return found


def _meaning(channel: FileChannel) -> str:
    text = re.sub(r"[_\W]+", " ", channel.name.lower()).strip()
    whole = text.replace(" ", "_")
    if whole in STANDARD_NAMES:
        return whole
    said = _dimension(channel.unit)
    # A phase without a unit, or in rad, belongs to a frequency response and is not a position.
    if said in ("rad", "") and re.search(r"\bphase\b|\barg\b", text):
        return ""
    for pattern, name in _MEANINGS:
        if re.search(pattern, text) and (not said or fits_name(name, said)):
            return name
    position, force = "end_effector_position", "force"
    known = {"V": "drive_voltage", "m": position, "rad": position, "N": force, "N m": force}
    return known.get(said, "")


def _dimension(unit: str) -> str:
    try:
        return to_si_unit(unit).unit if unit else ""
    except QuantityError:
        return ""


def likely_unit(name: str, values: np.ndarray) -> str:
    """Return a probable unit for values of the standard variable `name` that have no unit: for a time from
    its median step, for a position from its range, otherwise the SI unit of the variable ("" if the name is
    "")."""
    if name == "time":
        step = float(np.median(np.abs(np.diff(values)))) if values.size > 1 else 0.0
        return "s" if step < 0.02 else "ms" if step < 20.0 else "us"
    unit = STANDARD_NAMES[name].unit if name else ""
    if unit != "m":
        return unit
    span = float(values.max() - values.min())
    return "m" if span < 2e-3 else "um" if span < 2e3 else "nm"
