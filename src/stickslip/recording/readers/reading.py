"""Reading of a user's file as a recording: choice of columns, conversion to SI, checks, labels.

The readers of the single formats return columns as they are in the file; this module checks all requirements
of a recording.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...quantities import registry
from ...quantities.units import optional_si, to_si
from .. import STANDARD_NAMES, RecordingError, make_recording, open_recording
from .clocks import Clocked, complete_samples, onto_one_clock, without_empty_end
from .formats import TEXT, find_format
from .opening import source_of
from .selection import FileVariable, Selection, select
from .source import Column, FileContent, Rows
from .unlikely import refuse_unlikely, warn_of_unread, warn_of_unsaid

if TYPE_CHECKING:
    import xarray as xr

# Smallest first time, s, for which times are taken as dates, counted from 1970: no recording lasts three
# years.
_SINCE_1970 = 1e8
# Largest time since 1970 that is taken as a date, s (the year 5138).
_LAST_DATE = 1e11
# Largest number of characters of an error message, which may contain many names of a file.
_LONGEST_MESSAGE = 1500
# Largest number of characters of a quote in a message, because a field may be as long as a line.
_LONGEST_QUOTE = 80
# Pattern of a long text in quotes as Python writes it, "'abc...'"; an apostrophe in a word is not a quote.
_SIGN = r"(?:[^{0}\\]|\\.)"
_QUOTE = re.compile(
    "|".join(
        rf"(?<!\w){mark}({sign}{{{_LONGEST_QUOTE}}}){sign}+{mark}(?!\w)"
        for mark in "'\""
        for sign in [_SIGN.format(mark)]
    )
)


def read_recording(
    path: str | os.PathLike[str],
    columns: Mapping[str, Column] | None = None,
    units: Mapping[str, str] | None = None,
    *,
    sample_rate: float | str | None = None,
    start_time: float | str | None = None,
    clocks: Mapping[str, Column] | None = None,
    rows: tuple[int, int | None] = (0, None),
    missing: Literal["error", "drop"] = "error",
    missing_values: Sequence[str] = (),
    delimiter: str | None = None,
    decimal: str | None = None,
    skip: int = 0,
    title: str = "",
    notes: str = "",
    calibration: str = "",
    reader: str = "",
) -> xr.Dataset:
    r"""Return the recording in a file of a format that `stickslip list readers` names, or in a ``.nc`` or
    ``.nxs`` file of this package. Its values are in SI.

    Args:
        path: the file. Its content decides how it is read; its extension must not contradict.
        columns: standard name -> column: the name in the file (with or without its unit), the index from 0,
            or a tuple of an array's name and indices from 0, ``("trace_y", 1)``. "time" names the time
            column; without it, the column called time (or t, timestamp, ...) is taken. Without other names,
            all columns are read.
        units: standard name -> unit in the file ("mm", "uN"), which overrides the file's own, also with a
            number: "20 V" (a divider), "0.5 um/V" or "2 mdeg/V" (a sensor, whose column is in volts). Without
            a unit here, in a name ("disp_um") or in a header, plausible numbers are taken as SI, with a
            RecordingWarning.
        sample_rate: Hz, for a file without time.
        start_time: time of the first sample, s. By default that of the file; 0 for dates and if the file has
            none.
        clocks: standard name -> its time column, if it differs from the common one. Such a channel is
            interpolated linearly onto the common time.
        rows: samples (start, stop) to read, from 0, stop not included; None for the end.
        missing: action for a number that is missing, NaN, infinite or an overload (9.9E37): "error" to raise
            an error, "drop" to leave the sample out.
        missing_values: texts by which a text file says that a number is missing ("n.v.", "-9999"), in
            addition to those that are known: blank, NaN, OL, --, #DIV/0!, 1.#QNAN and the like.
        delimiter, decimal: those of a text file; by default found automatically. ``r"\s+"`` is any white
            space.
        skip: number of lines at the top of a text file that are neither header nor data.
        title, notes, calibration: free text, kept with the recording.
        reader: the format by name ("text", "npy"), or a user's, "my_reader.py:scope"; by default found from
            the content.

    Raises:
        RecordingError: the file is not a recording; the message names file, line or sample, and column.
    """
    path = Path(path)
    text_options = delimiter is not None or decimal is not None or skip != 0 or len(missing_values) > 0
    with named_file(path):
        rate, start_time = _rate(sample_rate), optional_si(start_time, "s", "start_time")
        _check_arguments(
            columns=columns,
            units=units,
            clocks=clocks,
            missing=missing,
            skip=skip,
            missing_values=missing_values,
        )
        kind = _kind(path, reader)
        if kind != "text" and text_options:
            raise RecordingError(
                f"delimiter, decimal, skip and missing_values are for text; this file is {kind}"
            )
        changes = columns or units or clocks or (sample_rate, start_time, *rows) != (None, None, 0, None)
        if kind == "nc" and changes:
            raise RecordingError("a saved recording is read as it is, without columns, units, clocks or rows")
    if kind == "nc":
        return open_recording(path)
    with named_file(path):
        text = {"delimiter": delimiter, "decimal": decimal, "skip": skip, "missing_values": missing_values}
        source = source_of(path, kind, **(text if kind == TEXT else {}))
        chosen = select(source.channels, columns or {}, units or {}, clocks or {}, equally_spaced=rate > 0)
        if not set(columns or {}) - {"time"}:  # all columns are read
            warn_of_unread(path, source.channels)
        window = _window(rows)
        groups = _load(source, chosen, window, rate)
        whole, steps = _on_one_clock(source, chosen, groups, missing, window)
        refuse_unlikely(chosen, groups, units or {})
        warn_of_unsaid(path, chosen, groups)
        time, epoch = _from_start(whole.time, start_time, _epoch(chosen))
        return make_recording(
            time,
            {v.name: (whole.values[v.name], v.conversion.unit) for v in chosen.variables},
            title=title,
            notes=notes,
            source=path.name,
            reader=source.reader,
            calibration=calibration,
            processing="; ".join(steps),
            epoch=epoch,
            long_names={v.name: v.column.name for v in chosen.variables if _is_own_name(v)},
        )


def _kind(path: Path, reader: str) -> str:
    if reader in ("", TEXT):
        return reader or find_format(path)
    return registry.readers.find(reader).name


def _check_arguments(**given: Any) -> None:
    """Raise RecordingError for arguments (given by name) of the wrong type or with a wrong value, which would
    otherwise be misunderstood."""
    for name in ("columns", "units", "clocks"):
        if given[name] is not None and not isinstance(given[name], Mapping):
            raise RecordingError(
                f"{name} = {given[name]!r} must be a mapping from our names: {{'time': ...}}"
            )
    if given["missing"] not in ("error", "drop"):
        raise RecordingError(f"missing = {given['missing']!r} must be 'error' or 'drop'")
    if not isinstance(given["skip"], int) or given["skip"] < 0:
        raise RecordingError(f"skip = {given['skip']!r} must be a number of lines, 0 or more")
    values = given["missing_values"]
    if isinstance(values, str) or not all(isinstance(one, str) for one in values):
        raise RecordingError(f"missing_values = {values!r} must be a list of texts: ['n.v.', '-9999']")


def _is_own_name(variable: FileVariable) -> bool:
    """Return True if the variable has no standard name and the file's name for it starts with a letter, so
    that this name is kept as its long name."""
    return variable.name not in STANDARD_NAMES and variable.column.name[:1].isalpha()


@contextmanager
def named_file(path: Path) -> Iterator[None]:
    """Turn every ValueError and OSError in the block into a RecordingError with the file's name, because
    inner functions know only lines, samples and columns."""
    try:
        yield
    # These include QuantityError, GateError and failures of the disk.
    except (ValueError, OSError) as error:
        raise RecordingError(said(path, error)) from error


def said(path: Path, error: ValueError | OSError) -> str:
    """Return the path of the file and the message of an error as one line of text, with long quotes and
    messages shortened."""
    whole = (isinstance(error, OSError) and error.strerror) or str(error).removeprefix(f"{path}: ")
    text = _QUOTE.sub(_shortened, " ".join(whole.split()))
    cut = text if len(text) <= _LONGEST_MESSAGE else f"{text[: _LONGEST_MESSAGE - 300]} ... {text[-300:]}"
    return f"{path}: {cut}"


def _shortened(quote: re.Match[str]) -> str:
    return f"'{quote[1] or quote[2]}...'"


def _rate(sample_rate: float | str | None) -> float:
    """Return the user's sample rate in Hz; 0 if the user gives no rate, because the file has its own time.
    Raises RecordingError unless the rate is positive and finite, QuantityError for a wrong unit."""
    if sample_rate is None:
        return 0.0
    rate = to_si(sample_rate, "Hz", "sample_rate")
    if not 0 < rate < np.inf:
        raise RecordingError(f"sample_rate = {sample_rate!r} must be > 0 Hz")
    return rate


def _window(rows: tuple[int, int | None]) -> Rows:
    try:
        start, stop = rows
        window = Rows(index(start), None if stop is None else index(stop))
    except (TypeError, ValueError):
        raise RecordingError(f"rows = {rows!r} must be two whole numbers, or one and None") from None
    if window.start < 0 or (window.stop is not None and window.stop <= window.start):
        raise RecordingError(f"rows = {rows!r} must be (start, stop) with 0 <= start < stop")
    return window


def _epoch(chosen: Selection) -> float:
    """Return the epoch of the common clock: for dates, the time in s since 1970 from which its numbers count;
    otherwise 0."""
    clock = next(iter(chosen.clocks.values()))
    return 0.0 if clock is None else clock.column.epoch


def _load(source: FileContent, chosen: Selection, window: Rows, rate: float) -> list[Clocked]:
    """Read the chosen variables and return them in SI, grouped by clock, the common clock first; the times
    [s] of all groups count from the epoch of the common clock.

    Args:
        source: content of the file.
        chosen: variables and clocks.
        window: samples to read.
        rate: sample rate [Hz] of variables without a clock.

    Raises:
        RecordingError: a variable has another number of samples than its time.
    """
    wanted = [v for v in (*chosen.clocks.values(), *chosen.variables) if v is not None]
    channels = list(dict.fromkeys(v.channel for v in wanted))
    raw = dict(zip(channels, source.read(channels, window), strict=True))
    uses = Counter(v.channel for v in wanted)

    def in_si(variable: FileVariable, epoch: float = 0.0) -> np.ndarray:
        uses[variable.channel] -= 1
        array = raw[variable.channel].copy() if uses[variable.channel] else raw.pop(variable.channel)
        if variable.conversion.factor != 1.0:
            array *= variable.conversion.factor
        shift = variable.conversion.offset + variable.column.epoch - epoch
        if shift != 0.0:
            array += shift
        return array

    groups = []
    for channel, clock in chosen.clocks.items():
        values = {v.name: in_si(v) for v in chosen.variables if v.clock == channel}
        time = (
            np.arange(float(len(next(iter(values.values()))))) / rate
            if clock is None
            else in_si(clock, _epoch(chosen))
        )
        for name, array in values.items():
            if array.shape != time.shape:
                raise RecordingError(f"{name} has {len(array)} samples, but its time has {len(time)}")
        groups.append(Clocked("time" if clock is None else clock.label, time, values))
    return groups


def _on_one_clock(
    source: FileContent,
    chosen: Selection,
    groups: list[Clocked],
    missing: Literal["error", "drop"],
    window: Rows,
) -> tuple[Clocked, list[str]]:
    """Return all variables at the times of the common clock, and a list of sentences on the processing:
    columns read, samples dropped, variables interpolated.

    Args:
        source, chosen, window: content of the file, chosen variables, and samples that were read.
        groups: variables grouped by clock.
        missing: "error" or "drop": action for incomplete samples.
    """
    labels = {v.name: v.label for v in chosen.variables}
    steps = [f"read {', '.join(labels.values())}"]
    groups = _joined(groups)
    if len(groups) > 1:
        groups = [without_empty_end(group) for group in groups]
    complete = [
        complete_samples(g, labels, missing, lambda i: source.place(i + window.start)) for g in groups
    ]
    dropped = sum(len(a.time) - len(b.time) for a, b in zip(groups, complete, strict=True))
    if dropped:
        steps.append(f"dropped {dropped} incomplete samples")
    common, *others = complete
    steps += [
        f"interpolated {', '.join(g.values)} linearly from {g.clock} onto {common.clock}" for g in others
    ]
    return onto_one_clock(common, others), steps


def _joined(groups: list[Clocked]) -> list[Clocked]:
    """Return the groups, with those that have equal times joined into one, because these need no
    interpolation."""
    found: list[Clocked] = []
    for group in groups:
        for k, other in enumerate(found):
            if np.array_equal(group.time, other.time, equal_nan=True):
                found[k] = other._replace(values={**other.values, **group.values})
                break
        else:
            found.append(group)
    return found


def _from_start(time: np.ndarray, start_time: float | None, epoch: float) -> tuple[np.ndarray, str]:
    """Return the times [s], shifted so that they start at `start_time`, and the date of time zero in ISO
    8601; "" for times that are no dates.

    Dates, and times with an epoch, start at 0 by default. Other times are unchanged without a `start_time`.

    Args:
        time: times since `epoch`, s; changed in place.
        start_time: time of the first sample, s; None: by default.
        epoch: epoch of the clock, s since 1970; 0 without dates.

    Raises:
        RecordingError: the first time is too large for a date.
    """
    first = float(time[0]) + epoch
    dated = first >= _SINCE_1970
    if start_time is None and not dated and epoch == 0.0:
        return time, ""
    start = start_time or 0.0
    if first > _LAST_DATE:
        raise RecordingError(
            f"time starts at {first:.4g} s; say units={{'time': ...}} if it is in ms, us or ns"
        )
    date = datetime.fromtimestamp(first - start, UTC).isoformat() if dated else ""
    time -= time[0]
    time += start
    return time, date
