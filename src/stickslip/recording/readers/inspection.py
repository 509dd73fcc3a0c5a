"""Inspection of a file before it is used: columns, units, sampling, noise, and suggested names."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...quantities.units import with_prefix
from .. import RecordingError
from ..shown_drive import drive_begins
from ..taken_drive import taken_drive
from .blocks import read_log
from .formats import TEXT, find_format
from .frequency_table import read_frequency_response, response_columns
from .preview import LOOKED_AT, SHOWN, look
from .reading import read_recording, said
from .source import FileChannel
from .uff import ENDINGS as UNIVERSAL

if TYPE_CHECKING:
    import xarray as xr

# Gap between samples, in median sampling intervals, above which it is reported as a pause.
PAUSE = 1.5
# LARGE: size of a large file in bytes. MOST: number of samples read from such a file.
LARGE, MOST = 50_000_000, 50_000
# Largest number of characters of a name in the table of columns; longer names are shortened.
WIDEST = 80
# Largest time, in sampling intervals, that is shown as 0 s, because rounding may cause it.
ROUNDED = 1e-6


class Inspection(NamedTuple):
    """Result of `inspect_file`; as text (``str``), a report for the user.

    Attributes:
        path: path of the file.
        reader: name of the reader.
        cut: True if the ranges of `columns` are of the first samples only.
        columns: description of each column, see `preview.look`; empty for a recording of this package, a log,
            or a universal file without functions of time.
        named, units, clocks: arguments of `read_recording`, guessed where the file does not state them; for a
            frequency response, `named` are its columns by role.
        recording: the recording read with these arguments; None if that failed, or for a frequency response
            or a log.
        problem: message of the failure; "" without a failure.
        response: frequency response, if the file contains one; otherwise None.
        log: table of a log of "key: value" blocks, if the file contains one; otherwise None.
        large: True if the recording contains only the first `MOST` samples.
    """

    path: Path
    reader: str
    cut: bool
    columns: list[dict[str, Any]]
    named: dict[str, str | int]
    units: dict[str, str]
    clocks: dict[str, str | int]
    recording: xr.Dataset | None
    problem: str
    response: xr.Dataset | None = None
    large: bool = False
    log: xr.Dataset | None = None

    @property
    def interval(self) -> float:
        """Return the median sampling interval of the recording, s."""
        assert self.recording is not None
        return float(np.median(np.diff(self.recording["time"].values)))

    @property
    def pauses(self) -> list[tuple[float, float]]:
        """Return start [s] and length [s] of each gap between samples that is longer than `PAUSE` median
        intervals."""
        assert self.recording is not None
        time = self.recording["time"].values
        steps = np.diff(time)
        return [(float(time[i]), float(steps[i])) for i in np.flatnonzero(steps > PAUSE * self.interval)]

    @property
    def drive_begins(self) -> float | None:
        """Return the time of the last sample before the drive voltage changes, s. The result is None if there
        is no recording or drive, if the drive does not rest first, or if it never changes."""
        return None if self.recording is None else drive_begins(self.recording)

    def noise(self, name: str) -> float:
        """Return the standard deviation of the recording's variable `name` before the drive starts, in the
        unit of the variable; NaN with fewer than 20 such samples or without a start of the drive."""
        begins = self.drive_begins
        if self.recording is None or begins is None:
            return math.nan
        before = self.recording[name].values[self.recording["time"].values < begins]
        return float(np.std(before, ddof=1)) if before.size >= 20 else math.nan

    @property
    def yaml(self) -> str:
        """Return the entry of this file as YAML text for the list ``recordings:`` of a job or identification
        file: its name, columns, clocks and units."""

        def flow(mapping: Mapping[str, str | int]) -> str:
            parts = (f"{name}: {json.dumps(text, ensure_ascii=False)}" for name, text in mapping.items())
            return f"{{{', '.join(parts)}}}"

        said = {"columns": self.named, "clocks": self.clocks, "units": self.units}
        lines = [f"- file: {json.dumps(self.path.name, ensure_ascii=False)}"]
        return "\n".join([*lines, *(f"  {key}: {flow(one)}" for key, one in said.items() if one)])

    def __str__(self) -> str:
        part = f" (ranges are of the first {LOOKED_AT} samples)" if self.cut else ""
        part += f"\nThe file is large: what follows is of its first {MOST} samples" if self.large else ""
        lines = [f"{self.path.name}: {self.reader}{part}"]
        if self.log is not None:
            return "\n".join([*lines, *_said_of_log(self.log), "", "To read it in Python:", self._call])
        if self.columns:
            lines += _table([["column", "unit", "from", "to", "taken as"], *map(self._row, self.columns)])
        if self.response is not None:
            return "\n".join([*lines, *_said_of(self.response), "", "To read it in Python:", self._call])
        if self.recording is None:
            return "\n".join([*lines, f"cannot be read so: {self.problem}"])
        return "\n".join([*lines, *self._said(), "", "To paste under recordings:", self.yaml])

    @property
    def _call(self) -> str:
        name = json.dumps(self.path.name, ensure_ascii=False)
        if self.log is not None:
            return f"table = stickslip.recording.read_log({name})"
        read = f"stickslip.recording.read_frequency_response({name})"
        return f"fit = stickslip.identify_frequency({read}, modes=1)"

    def _row(self, column: dict[str, Any]) -> list[str]:
        name = next((ours for ours, theirs in self.named.items() if theirs == column["column"]), "")
        unit = column["unit"] or (f"{self.units[name]} (guessed)" if name in self.units else "")
        unit += "" if column["known"] else " (not known)"
        served = [ours for ours, clock in self.clocks.items() if clock == column["column"]]
        name = f"time of {', '.join(served)}" if served else name
        low, high = ("" if column[end] is None else f"{column[end]:.6g}" for end in ("low", "high"))
        words = "" if column["numeric"] else column["unread"] or "no numbers"
        return [column["name"], unit, low, high, name or words]

    def _said(self) -> list[str]:
        assert self.recording is not None
        time, interval = self.recording["time"].values, self.interval
        steps = np.diff(time) / interval
        # Intervals longer than a pause are gaps, which are reported below, and not irregularity.
        jitter = float(np.max(np.abs(steps[steps <= PAUSE] - 1.0)))
        lines = [
            f"{time.size} samples, {with_prefix(interval, 's')} apart ({with_prefix(1.0 / interval, 'Hz')}"
            f"{f', up to {100 * jitter:.2g} % irregular' if jitter > 1e-3 else ''}), from "
            f"{with_prefix(float(time[0]), 's')} to {with_prefix(float(time[-1]), 's')}"
        ]
        pauses = self.pauses
        if pauses:
            at, lasts = pauses[0]
            first = f"the first at {with_prefix(at, 's')}, of {with_prefix(lasts, 's')}"
            lines.append(f"{len(pauses)} gap{'s' if len(pauses) > 1 else ''} in the samples: {first}")
        begins = self.drive_begins
        if begins is not None:
            # Rounding errors, as in -0.05 + 100 * 0.0005, are shown as 0.
            begins = 0.0 if abs(begins) < ROUNDED * interval else begins
            lines.append(f"the drive begins after {with_prefix(begins, 's')}")
        taken = taken_drive(self.recording)
        if taken is not None:
            lines.append(f"drive: {taken.said()}")
        if begins is not None:
            for name, channel in self.recording.data_vars.items():
                noise = self.noise(str(name))
                if name != "drive_voltage" and math.isfinite(noise):
                    lines.append(f"{name} before that: {with_prefix(noise, channel.attrs['units'])} rms")
        return lines


def inspect_file(path: str | Path) -> Inspection:
    """Return the content of a file that `read_recording`, `read_frequency_response` or `read_log` reads, with
    guesses for missing units and names.

    Args:
        path: file of a format in `stickslip list readers`, or a recording of this package.

    Raises:
        RecordingError: the format is unknown, or the file is damaged or has no columns of numbers.
    """
    path = Path(path)
    try:
        kind = find_format(path)
        found = None if kind == "nc" else look(path)
    except (ValueError, OSError) as error:
        if path.suffix.lower() in UNIVERSAL and (response := _response(path)[0]) is not None:
            return Inspection(path, "uff", False, [], {}, {}, {}, None, "", response)
        if (log := _log(path)) is not None:
            return Inspection(path, "log", False, [], {}, {}, {}, None, "", log=log)
        raise RecordingError(said(path, error)) from error
    if found is None:
        return Inspection(path, "recording", False, [], {}, {}, {}, read_recording(path), "")
    cut, columns = found["samples"] >= LOOKED_AT, found["columns"]
    roles = _roles(columns)
    if roles:
        response, problem = _response(path)
        return Inspection(path, found["reader"], cut, columns, roles, {}, {}, None, problem, response)
    words = not all(one["numeric"] for one in columns) and all(one["name"].isdigit() for one in columns)
    if words and (log := _log(path)) is not None:
        return Inspection(path, "log", False, [], {}, {}, {}, None, "", log=log)
    large = cut and path.stat().st_size > LARGE
    taken = [one for one in found["columns"] if one["guess"]]
    named = {one["guess"]: one["column"] for one in taken}
    clocks = {one["guess"]: one["time"] for one in taken if one["time"] != ""}
    units = {one["guess"]: one["guessed_unit"] for one in taken if one["guessed_unit"]}
    try:
        rows = (0, MOST if large else None)
        recording, problem = read_recording(path, named, units, clocks=clocks, rows=rows), ""
    except RecordingError as error:
        recording, problem = None, str(error).removeprefix(f"{path}: ")
    return Inspection(
        path, found["reader"], cut, columns, named, units, clocks, recording, problem, large=large
    )


def _roles(columns: list[dict[str, Any]]) -> dict[str, str | int]:
    """Return the columns of a frequency response as a dictionary: role ("frequency", "gain", "phase 2") ->
    name of the column. It is empty if the file has a time column or is not a response."""
    channels = [FileChannel(one["name"], one["unit"], numeric=one["numeric"]) for one in columns]
    found = None if any(one["clock"] for one in columns) else response_columns(channels)
    if found is None:
        return {}
    roles: dict[str, str | int] = {"frequency": channels[found.frequency].name}
    for k, pair in enumerate(found.pairs):
        for role, i in zip(("gain", "phase") if found.polar else ("real", "imag"), pair, strict=True):
            roles[f"{role} {k + 1}" if k else role] = channels[i].name
    return roles


def _log(path: Path) -> xr.Dataset | None:
    """Return the table in a log with blocks of "key: value"; None for other files."""
    try:
        return read_log(path) if find_format(path) == TEXT else None
    except (ValueError, OSError):
        return None


def _said_of_log(log: xr.Dataset) -> list[str]:
    count = f"a log of {log.sizes['record']} records"
    shown = [str(name) for name in log.data_vars]
    heads = [f"{name} [{unit}]" if (unit := log[name].attrs.get("units")) else name for name in shown]
    rows = [
        [f"{value:.6g}" if isinstance(value, float) else str(value) for value in values]
        for values in zip(*(log[name].values[:SHOWN].tolist() for name in shown), strict=True)
    ]
    more = [f"  and {log.sizes['record'] - SHOWN} more"] if log.sizes["record"] > SHOWN else []
    return [count, *_table([heads, *rows]), *more]


def _response(path: Path) -> tuple[xr.Dataset | None, str]:
    """Return the frequency response of a file (a dataset) and "". If it cannot be read, return None and the
    reason."""
    try:
        return read_frequency_response(path), ""
    except RecordingError as error:
        return None, str(error).removeprefix(f"{path}: ")


def _said_of(response: xr.Dataset) -> list[str]:
    frequency, unit = response["frequency"].values, response["response"].attrs["units"]
    size = np.abs(response["response"].values)
    outputs = f", {response.sizes['output']} outputs" if response.sizes["output"] > 1 else ""
    low, high = (with_prefix(float(one), "" if unit == "1" else unit) for one in (size.min(), size.max()))
    first, last = (with_prefix(float(frequency[i]), "Hz") for i in (0, -1))
    count = f"{frequency.size} frequencies from {first} to {last}"
    return [f"a frequency response{outputs}: {count}, gain from {low} to {high}"]


def _table(rows: list[list[str]]) -> list[str]:
    rows = [[_cell(text) for text in row] for row in rows]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def _cell(text: str) -> str:
    """Return a text from a file as one line of printable characters, shortened to `WIDEST` characters."""
    shown = "".join(sign if sign.isprintable() else "?" for sign in text)
    return shown if len(shown) <= WIDEST else f"{shown[: WIDEST - 3]}..."
