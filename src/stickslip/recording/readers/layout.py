"""Detection of the layout of a text file of numbers: encoding, delimiter, decimal sign, start of the data,
header.

The layout is found from the first lines. That delimiter and decimal sign are chosen with which the most lines
are rows of numbers. Lines above the header are used only for settings.
"""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from ...gate.files import opened
from ...gate.limits import LIMITS, check_count
from .. import RecordingError
from .fields import (
    COMMENT,
    FORTRAN,
    LIBRARY,
    MISSING,
    SHEET_ERRORS,
    SPACE,
    Signs,
    split,
    thousands,
    without_sign,
)
from .settings import HeaderClock, find_settings, in_table, with_settings
from .source import FileChannel
from .stamps import Stamped, find_stamps
from .titles import channel_of, cut, header_fields, titles, with_header_clock

# fewest lines, evenly spread over the first part of the file, from which the delimiter is determined (all
# lines if there are fewer)
SAMPLE = 100
HEADER = 400  # number of lines at the top that are searched for settings of an instrument
FEW = 20  # number of rows from which a column is recognised as times
END = "\x1a"  # end-of-file mark of DOS programs, which is removed
LINE_END = re.compile(r"\r\n|\n|\r")


class TextLayout(NamedTuple):
    """Layout of a text file, the result of `find_layout`; `channels` and `kinds` have one entry for each
    column.

    `encoding`, `delimiter` and `decimal` are those of the file.
    """

    encoding: str
    delimiter: str
    decimal: str
    comment: str | None  # sign that starts a comment, "#" or "%"; None: there are no such comments
    first_line: int  # number of lines above the first row of data
    line_bytes: float  # mean length of a line in bytes
    channels: tuple[FileChannel, ...]
    kinds: str  # kind of each column: "n" numbers, "d" dates, "s" text, "e" always empty
    missing: frozenset[str] = MISSING  # texts that mark missing numbers
    fortran: bool = False  # True: numbers are written as in Fortran, "1.0D-03"
    # Clocks that the header describes, by the index of the channel that gets the times computed from them: a
    # blank column of the file, its column of sample numbers, or a new channel after the last column.
    clocks: Mapping[int, HeaderClock] = MappingProxyType({})
    counts: bool = False  # True: the first column contains the numbers of the samples
    # Columns of dates and times of day: their description by the index of the column.
    stamps: Mapping[int, Stamped] = MappingProxyType({})

    def split(self, line: str) -> list[str]:
        """Return the fields of a line, without quotes and surrounding blanks."""
        return split(line, self.delimiter)

    def fits(self, field: str, column: int) -> bool:
        """Return True if a field (text) has the kind of the column with this index, or is a mark for a
        missing number."""
        return Signs(self.decimal, self.missing).kind(field) in (self.kinds[column], "e")

    def is_data(self, line: str) -> bool:
        """Return True if a line below the header is a row of data, that is, neither blank nor a comment."""
        return bool(line.strip()) and not (self.comment and COMMENT.match(line))

    def rewritten(self, text: str) -> str:
        """Return lines in a form that pandas reads: "1.0D-03" becomes "1.0e-03", and "1.#QNAN" or "#N/A"
        becomes "nan", so that its "#" does not start a comment."""
        if END in text:
            text = text.replace(END, "")
        if "#" in text:
            text = LIBRARY.sub("nan", text)
            for error in SHEET_ERRORS:
                text = text.replace(error, "nan")
        return FORTRAN.sub("e", text) if self.fortran else text


def find_layout(
    path: Path,
    delimiter: str | None = None,
    decimal: str | None = None,
    skip: int = 0,
    missing_values: Sequence[str] = (),
) -> TextLayout:
    r"""Return the layout of a text file, found from its first lines.

    Args:
        path: the file.
        delimiter, decimal: delimiter and decimal sign from the user; None: find them. ``r"\s+"`` is any white
            space.
        skip: number of lines at the top that are neither header nor data.
        missing_values: texts for missing numbers in addition to `MISSING`.

    Raises:
        RecordingError: there are no numbers, the decimal sign is ambiguous, or the first row of data cannot
            be read.
        GateError: there are more columns than `LIMITS` allows.
    """
    encoding, head, lines = _head(path)
    data = [i for i in range(skip, len(lines)) if lines[i].strip() and not COMMENT.match(lines[i])]
    sample = [lines[i] for i in data[:: max(len(data) // SAMPLE, 1)]]
    asked_decimal = decimal
    missing = MISSING | set(missing_values)
    kinds, delimiter, decimal = _judge(sample, _ways(delimiter, decimal), missing)
    if not kinds:
        raise RecordingError(f"there are no rows of numbers in the first {len(lines)} lines")
    check_count(path, len(kinds), LIMITS.channels, "columns")
    signs = Signs(decimal, missing)
    parts = [split(line, delimiter) for line in sample]
    if asked_decimal is None:
        _refuse_thousands([row for row in parts if len(row) == len(kinds)], kinds, signs)
    kinds = _without_settings(parts, kinds, signs)
    width = len(kinds)
    bare = [without_sign(line) for line in lines[skip : skip + HEADER]]
    said = find_settings(bare, [split(line, delimiter) for line in bare])
    first = next(
        i for i in data if i - skip not in said.below and _begins(split(lines[i], delimiter), kinds, signs)
    )
    filled = [split(lines[i], delimiter) for i in data if i >= first]
    kinds = "".join(
        "e" if all(row[k : k + 1] in ([], [""]) for row in filled) else kind for k, kind in enumerate(kinds)
    )
    above = (i for i in range(skip, first) if i - skip not in said.lines)
    blank = width - len(kinds.rstrip("e"))
    rows = {i: header_fields(lines[i], delimiter, width, blank) for i in above}
    if asked_decimal is None:
        _refuse_split_numbers(rows, first, delimiter, width)
    rows, clock, counts = in_table(rows)
    rows = {i: cut(fields, width) for i, fields in rows.items()}
    channels = titles(lines, rows, kinds, signs, {first: filled[0]}, said)
    channels = [
        c._replace(numeric=k in "nd", unread=_unread(filled, i, missing) if k == "s" else "")
        for i, (k, c) in enumerate(zip(kinds, channels, strict=True))
    ]
    channels, clocks = with_header_clock(channels, said, clock, counts, filled[:FEW], signs)
    channels = with_settings(channels, said, bool(clocks))
    channels, stamps = find_stamps(channels, kinds, filled[: HEADER // 2], decimal)
    marks = [found[1][0] for line in lines if (found := COMMENT.match(line))]
    return TextLayout(
        encoding,
        delimiter,
        decimal,
        next((mark for mark in marks if mark in "#%"), None),
        first,
        max(len(head) / max(len(lines), 1), 2.0),
        tuple(channels),
        kinds,
        missing,
        any(FORTRAN.search(line) for line in sample),
        clocks,
        counts,
        stamps,
    )


def _head(path: Path) -> tuple[str, bytes, list[str]]:
    """Return the encoding of a text file, its first bytes (up to `LIMITS.line`), and the lines in them.

    Raises:
        RecordingError: the first line is longer than that.
    """
    with opened(path) as file:
        head = file.read(LIMITS.line)
        more = len(head) == LIMITS.line and file.read(1) != b""
    encoding = _encoding(head)
    # Lines are not split by `str.splitlines`, because it also splits at other characters.
    lines = LINE_END.split(head.decode(encoding, errors="replace"))
    if len(lines) == 1 and more:
        raise RecordingError(f"its first line has more than {LIMITS.line:,} characters: no table of numbers")
    return encoding, head, lines


def _encoding(head: bytes) -> str:
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        # Old instruments write latin-1 or a Windows code page, in which µ and ° have the same codes.
        return "latin-1"
    return "utf-8"


def _ways(delimiter: str | None, decimal: str | None) -> list[tuple[str, str]]:
    ways = [
        ("\t", "."),
        ("\t", ","),
        (";", "."),
        (";", ","),
        (",", "."),
        (SPACE, "."),
        (SPACE, ","),
        (",", ","),
    ]
    if delimiter is not None:
        ways = [(SPACE if delimiter in (" ", "") else delimiter, sign) for sign in ".,"]
    return [(split, sign) for split, sign in ways if decimal in (None, sign)]


def _judge(
    lines: Sequence[str], ways: Sequence[tuple[str, str]], missing: frozenset[str]
) -> tuple[str, str, str]:
    """Return the kinds of the columns, the delimiter and the decimal sign with which the most lines are rows
    of numbers; the kinds are "" if no line is such a row.

    Args:
        lines: some lines of the file.
        ways: pairs of delimiter and decimal sign to try; the first of equally good ones is chosen.
        missing: texts for missing numbers.
    """
    best, best_score = ("", "", "."), (0, 0, 0)
    quoted = any('"' in line for line in lines)
    for delimiter, decimal in ways:
        if delimiter == decimal and not quoted:
            continue
        rows = (Signs(decimal, missing).kinds(split(line, delimiter)) for line in lines)
        # Blank fields count as numbers only in a line that has a number; otherwise lines of words that end
        # with a delimiter would be rows of data.
        counted = Counter(kinds.replace("e", "n") for kinds in rows if "n" in kinds)
        for kinds, count in counted.most_common(1):
            score = (count, -kinds.count("s"), len(kinds) - max(kinds.count("d") - 1, 0))
            if score > best_score:
                best, best_score = (kinds, delimiter, decimal), score
    return best


def _refuse_thousands(rows: Sequence[Sequence[str]], kinds: str, signs: Signs) -> None:
    """Raise RecordingError if a sign may be a thousands separator: in a column with "531" and "1,062", or in
    a column with another decimal sign than the other columns.

    Args:
        rows: fields of some lines.
        kinds: kind of each column.
        signs: decimal sign, and texts for missing numbers.
    """
    decimal, other = signs.decimal, "," if signs.decimal == "." else "."
    parted = re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(decimal)}\d{{3}}")
    rows = [row for row in rows if "n" in signs.kinds(row)]
    for k, kind in enumerate(kinds):
        fields = [row[k] for row in rows if row[k] not in signs.missing]
        signed = [field for field in fields if decimal in field]
        whole = [field for field in fields if re.fullmatch(r"[+-]?\d{1,3}", field)]
        several = signed and whole and len(signed) + len(whole) == len(fields)
        if kind == "n" and several and all(map(parted.fullmatch, signed)):
            raise RecordingError(
                f"column {k + 1} has {whole[0]!r} and {signed[0]!r}: if {decimal!r} parts thousands, write "
                f"the numbers without; if it is the decimal sign, say decimal={decimal!r}"
            )
        foreign = [field for field in fields if other in field]
        otherwise = signs._replace(decimal=other).kinds(fields)
        if kind == "s" and foreign and set(otherwise) == {"n"}:
            raise RecordingError(
                f"column {k + 1} has {foreign[0]!r}, but the decimal sign of the others is {decimal!r}: if "
                f"{other!r} parts thousands, write the numbers without"
            )


def _refuse_split_numbers(rows: dict[int, list[str]], first: int, delimiter: str, count: int) -> None:
    """Raise RecordingError if a decimal comma was probably taken as the delimiter: the rows have twice as
    many fields as the line of names with units above them.

    Args:
        rows: fields of the lines above the data, by index of the line.
        first: index of the first line of data.
        delimiter: the delimiter that was found.
        count: number of fields in a row.
    """
    above = [fields for i, fields in rows.items() if i < first and any(fields)]
    names = [channel_of(field) for field in above[-1]] if above else []
    if delimiter == "," and count == 2 * len(names) and all(one.unit for one in names):
        raise RecordingError(
            f"the rows have {count} fields, but the names above them are {len(names)}: if the comma is the "
            "decimal sign, say decimal=','"
        )


def _unread(rows: Sequence[Sequence[str]], k: int, missing: frozenset[str]) -> str:
    """Return the reason why column `k` of these rows (fields) has no numbers although it seems so; "" for
    words. `missing` are the texts for missing numbers."""
    parted = thousands([row[k] for row in rows if k < len(row)], missing)
    return f"{parted!r} has separators of thousands: write the numbers without" if parted else ""


def _begins(fields: Sequence[str], kinds: str, signs: Signs) -> bool:
    """Return True if a line with these fields can be the first row of data: the fields have the kinds of the
    columns or are missing."""
    found = signs.kinds(fields)
    return len(found) == len(kinds) and all(
        b == "e" or a in (b, "e") for a, b in zip(found, kinds, strict=True)
    )


def _without_settings(rows: Sequence[Sequence[str]], kinds: str, signs: Signs) -> str:
    """Return the kinds of the columns, with "e" (empty) for columns that are blank in over 90 % of the rows.

    This applies if some such column contains words: an oscilloscope has stored its settings beside the first
    samples. Otherwise the kinds are unchanged.
    """
    found = [row for row in map(signs.kinds, rows) if len(row) == len(kinds) and "n" in row]
    blank = [sum(row[k] == "e" for row in found) > 0.9 * len(found) for k in range(len(kinds))]
    if not any(b and any(row[k] == "s" for row in found) for k, b in enumerate(blank)):
        return kinds
    return "".join("e" if b else kind for b, kind in zip(blank, kinds, strict=True))
