"""Reader of text files of numbers: CSV, TSV, or separated by white space.

pandas reads them in chunks, 70 to 100 MB/s on one core (four times ``numpy.loadtxt``), into arrays that grow
in place, so the memory is that of the result plus one chunk. Dates become seconds since the first date,
because float64 seconds since 1970 have a resolution of only 0.2 us.
"""

from __future__ import annotations

import os
from collections.abc import Hashable, Iterator, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from ...gate.errors import GateError
from ...gate.files import opened
from ...gate.limits import LIMITS
from .. import RecordingError
from .fields import OVERLOAD
from .layout import LINE_END, TextLayout, find_layout
from .progress import reading_progress
from .source import FileContent, Rows, no_numbers
from .stamps import Stamped, iso

if TYPE_CHECKING:
    import pandas as pd

# Size of the part of a text that is read at once, in bytes.
CHUNK = 1 << 23


def read_csv(
    path: Path,
    delimiter: str | None = None,
    decimal: str | None = None,
    skip: int = 0,
    missing_values: Sequence[str] = (),
) -> FileContent:
    r"""Return the content of a text file: its columns as channels, and a function that reads them. See
    `find_layout` for the arguments.

    Raises:
        RecordingError: there are no numbers. Later, its `read` raises the same error if a field is not a
            number, a row has too many fields, or the last row has too few.
        GateError: there are too many columns, or later a line is too long.
    """
    layout = find_layout(path, delimiter, decimal, skip, missing_values)
    channels = layout.channels

    def read(indices: Sequence[int], rows: Rows) -> list[np.ndarray]:
        for i in indices:
            if not channels[i].numeric:
                raise RecordingError(no_numbers(channels[i]))
        if rows.stop is None:
            _check_last_line(path, layout)
        held = [i for i in range(len(layout.kinds)) if channels[i].numeric and i not in layout.clocks]
        held += [0] if layout.counts else []
        stored = [i for i in indices if i in held] or held[:1]
        columns = dict(zip(stored, _read_columns(path, layout, stored, rows), strict=True))
        for i, clock in layout.clocks.items():
            number = columns[i] if i in columns else rows.start + np.arange(columns[stored[0]].size)
            columns[i] = clock.start + clock.increment * number
        return [columns[i] for i in indices]

    return FileContent("csv", channels, read, lambda row: f"line {_line_of(path, layout, row)}")


def _read_columns(path: Path, layout: TextLayout, indices: list[int], rows: Rows) -> list[np.ndarray]:
    # Too large an estimate of the number of rows costs nothing, because the system assigns memory only when
    # it is written to.
    capacity = int(path.stat().st_size / layout.line_bytes) + 1
    if rows.stop is not None:
        capacity = min(capacity, rows.stop)
    columns = [np.empty(capacity) for _ in indices]
    filled = position = 0
    with (
        reading_progress(path) as show_progress,
        opened(path) as raw,
        TextIOWrapper(raw, encoding=layout.encoding, errors="replace", newline="") as file,
    ):
        for _ in range(layout.first_line):
            file.readline()
        try:
            for chunk in _chunks(_Lines(path, file, layout), layout, indices, rows.stop):
                kept = slice(max(rows.start - position, 0), None)
                position += len(chunk)
                part = chunk.iloc[kept]
                values = [_numbers(part, layout, i) for i in indices]
                end = filled + (len(values[0]) if values else 0)
                if end > capacity:
                    capacity = int(1.2 * end)
                    for column in columns:
                        column.resize(capacity, refcheck=False)
                for column, new in zip(columns, values, strict=True):
                    column[filled:end] = new
                filled = end
                show_progress(raw.tell())
        except GateError:
            raise
        # pandas' ParserError is a ValueError.
        except (ValueError, OverflowError) as error:
            raise _explained(path, layout, indices, error) from error
    # Rows of delimiters at the end are removed only if the file was read to its end.
    if rows.stop is None or position < rows.stop:
        filled = max(filled - _blank_rows_at_the_end(path, layout), 0)
    for column in columns:
        column.resize(filled, refcheck=False)
    return [
        layout.stamps[i].whole(c) if i in layout.stamps else c for i, c in zip(indices, columns, strict=True)
    ]


class _Lines:
    """A text file, opened from the path `path`, in the form that pandas reads: lines rewritten for pandas,
    none longer than `LIMITS.line` characters."""

    def __init__(self, path: Path, file: TextIO, layout: TextLayout) -> None:
        self._path, self._file, self._layout, self._run = path, file, layout, 0

    def read(self, size: int = -1) -> str:
        """Return the next lines of the text: about `size` characters, up to the end of a line; "" at the end
        of the file.

        Raises:
            GateError: a line is too long.
        """
        part = self._file.read(size)
        # Complete the last line, so that no number is cut in two.
        part += self._file.readline(LIMITS.line)
        end = max(part.rfind("\n"), part.rfind("\r"))
        self._run = self._run + len(part) if end < 0 else len(part) - end - 1
        if self._run > LIMITS.line:
            raise GateError(f"{self._path}: a line has more than {LIMITS.line:,} characters: no numbers")
        return self._layout.rewritten(part)

    def __iter__(self) -> Iterator[str]:
        return iter(lambda: self._file.readline(LIMITS.line), "")


def _chunks(file: Any, layout: TextLayout, indices: list[int], stop: int | None) -> Iterator[pd.DataFrame]:
    import pandas as pd

    # Numbers are read exactly to the last bit: pandas does so by default from 3.1 on, and earlier with this
    # option.
    recent = (*map(int, pd.__version__.split(".")[:2]),) >= (3, 1)
    exact: Any = {} if recent else {"float_precision": "round_trip"}
    # A column that was not requested is kept as one byte per row. With ``usecols`` instead, pandas would not
    # detect rows that are too long.
    types: dict[Hashable, Any] = dict.fromkeys(range(len(layout.kinds)), "S1")
    dates = [layout.stamps[i].date for i in indices if i in layout.stamps]
    types |= {i: np.float64 if layout.kinds[i] == "n" else str for i in indices}
    types |= {i: str for i in dates if i is not None}
    chunks: Any = pd.read_csv(
        file,
        header=None,
        names=range(len(layout.kinds)),
        dtype=types,
        sep=layout.delimiter,
        decimal=layout.decimal,
        comment=layout.comment,
        skipinitialspace=True,
        keep_default_na=False,
        **exact,
        na_values=list(layout.missing),
        nrows=stop,
        chunksize=max(int(CHUNK / layout.line_bytes), 1),
    )
    with chunks as reader:
        yield from reader


def _numbers(chunk: pd.DataFrame, layout: TextLayout, i: int) -> np.ndarray:
    if layout.kinds[i] == "n":
        found = chunk[i].to_numpy()
        beyond = np.abs(found) >= OVERLOAD
        return np.where(beyond, np.inf, found) if beyond.any() else found
    how = layout.stamps[i]
    texts: Any = chunk[i] if how.date is None else chunk[how.date].str.cat(chunk[i], " ")
    return _since(texts, how)


def _since(texts: pd.Series, how: Stamped) -> np.ndarray:
    """Return time stamps (texts) in s since the epoch of their column; NaN for blank ones. `how` describes
    the column.

    Raises:
        ValueError: a text is no date or time.
    """
    import pandas as pd

    made = texts.map(lambda text: iso(text, how.first_is_day), na_action="ignore")
    times = pd.to_datetime(made, utc=True, format="ISO8601")
    return (times - pd.Timestamp(how.epoch, unit="s", tz="UTC")).dt.total_seconds().to_numpy()


def _is_date(text: str, how: Stamped) -> bool:
    import pandas as pd

    try:
        _since(pd.Series([text]), how)
    except ValueError:
        return False
    return True


def _rows(path: Path, layout: TextLayout) -> Iterator[tuple[int, str]]:
    """Yield the line number in the file (from 1) and the text of each row of data. This is slow, so it only
    serves to locate an error."""
    with opened(path) as raw, TextIOWrapper(raw, encoding=layout.encoding, errors="replace") as file:
        for number, line in enumerate(_Lines(path, file, layout), 1):
            if number > layout.first_line and layout.is_data(line):
                line = layout.rewritten(line)
                yield number, line.split(layout.comment)[0] if layout.comment else line


def _line_of(path: Path, layout: TextLayout, row: int) -> int:
    return next(number for i, (number, _) in enumerate(_rows(path, layout)) if i == row)


def _explained(path: Path, layout: TextLayout, indices: list[int], error: Exception) -> RecordingError:
    """Return an error that names the first field that is neither a number nor a date, or the first row with
    too many fields; without such a field or row, the message of pandas' `error`. `indices` are the columns
    that were read."""
    width = len(layout.kinds)
    for number, line in _rows(path, layout):
        fields = layout.split(line)
        if len(fields) > width and any(fields[width:]):
            return RecordingError(f"line {number} has {len(fields)} fields, the header {width}")
        for i in indices:
            dates = layout.kinds[i] == "d"
            read = not dates or i >= len(fields) or not fields[i] or _is_date(fields[i], layout.stamps[i])
            if i < len(fields) and not (layout.fits(fields[i], i) and read):
                name, what = layout.channels[i].shown, "a date" if dates else "a number"
                return RecordingError(f"line {number}, column {name!r}: {fields[i]!r} is not {what}")
    return RecordingError(f"{error}")


def _tail(path: Path, layout: TextLayout) -> list[str]:
    """Return the lines in the last 64 KiB of a file; the first of these lines may be incomplete."""
    with opened(path) as file:
        file.seek(max(os.fstat(file.fileno()).st_size - (1 << 16), 0))
        tail = file.read().decode(layout.encoding, errors="replace")
    return LINE_END.split(layout.rewritten(tail))


def _blank_rows_at_the_end(path: Path, layout: TextLayout) -> int:
    """Return the number of rows at the end of a file that contain only delimiters, as spreadsheets write
    them; 0 for UTF-16."""
    count = 0
    for line in reversed(_tail(path, layout) if layout.encoding != "utf-16" else []):
        if layout.is_data(line):
            if any(layout.split(line)):
                break
            count += 1
    return count


def _check_last_line(path: Path, layout: TextLayout) -> None:
    """Raise RecordingError for a file whose last row has too few fields: the file was cut off, and even its
    last number may be wrong. Files in UTF-16 are not checked."""
    if layout.encoding == "utf-16":
        # The part that `_tail` reads may start in the middle of a two-byte character of UTF-16.
        return
    # This is "" if the file ends with a line end, as most files do.
    last = _tail(path, layout)[-1]
    fields = layout.split(last)
    if layout.is_data(last) and len(fields) < len(layout.kinds):
        raise RecordingError(
            f"the last line {last!r} has {len(fields)} of {len(layout.kinds)} fields: "
            "the file is cut off. What is complete can be read with rows=(0, number of rows), in a YAML file "
            "rows: [0, number of rows]"
        )
