"""Layout of a text file of numbers: encoding, delimiter, decimal sign, start of the data, header.

Found from the first lines: of all ways to split them (delimiter and decimal sign) the one is taken that turns
most lines into most numbers. Whatever stands above the header is noise.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ...gate.files import opened
from ...gate.limits import LIMITS, check_count
from .. import RecordingError
from .counted import Counting, counted
from .fields import FORTRAN, LIBRARY, MISSING, SHEET_ERRORS, Signs
from .file_units import is_unit, is_unit_of, to_si_unit
from .headers import said_units, with_said_units
from .source import FileChannel, is_clock

SAMPLE = 100  # lines, at least and spread over the head, that settle the delimiter
BESIDE = 40  # lines of data beside which the settings of an instrument may stand
SPACE = r"\s+"
LINE_END = re.compile(r"\r\n|\n|\r")
# An error of Excel, "#N/A", is no comment.
_COMMENT = re.compile(rf"\s*(#(?!{'|'.join(re.escape(one[1:]) for one in SHEET_ERRORS)})|%|//)+")
_OVER_UNIT = re.compile(r"\s/\s(\S+)$")
# "Zeit/ms" and "Time, s": only of units that look like none but units, for "I/O" and "max/min" are names.
_TIGHT = re.compile(
    r"(?P<name>[^/,]*[^/,\s])\s*[/,]\s*(?P<unit>[pnuµμmckMG]?(?:[smVNAWJ]|Hz|Pa|rad)(?:/s)?|sec|deg)\s*"
)
# As a row below the names has it: "[ms]", "(ms)", "<ms>", "{ms}", "'ms'", "in ms".
_UNIT_ALONE = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)|<([^<>]*)>|\{([^{}]*)\}|'([^']*)'|in\s+(.+)")
_HEADER_WORD = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\]]{0,60}\]|\([^)]{0,60}\)))?")  # "Time [s]" is one word


class TextLayout(NamedTuple):
    """What `find_layout` found; `channels` and `kinds` have one entry per column."""

    encoding: str
    delimiter: str
    decimal: str
    comment: str | None
    first_line: int  # lines above the data
    line_bytes: float  # mean length of a line
    channels: tuple[FileChannel, ...]
    kinds: str  # "n" numbers, "d" dates, "s" text, "e" always empty
    missing: frozenset[str] = MISSING  # texts that stand for no number
    fortran: bool = False  # numbers are written "1.0D-03"
    counting: Counting | None = None  # of the first column, where it numbers the samples

    def split(self, line: str) -> list[str]:
        """The fields of a line, without quotes."""
        return _split(line, self.delimiter)

    def fits(self, field: str, column: int) -> bool:
        """Whether a field is of its column's kind, or missing."""
        return Signs(self.decimal, self.missing).kind(field) in (self.kinds[column], "e")

    def is_data(self, line: str) -> bool:
        """Whether a line below the header is a row of data, neither blank nor a comment."""
        return bool(line.strip()) and not (self.comment and _COMMENT.match(line))

    def rewritten(self, text: str) -> str:
        """Return lines as pandas reads them: "1.0D-03" becomes "1.0e-03", and "1.#QNAN" begins no comment."""
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
    r"""The layout of a text file.

    Args:
        path: the file.
        delimiter, decimal: as the user knows them, or None. ``r"\s+"`` is any white space.
        skip: lines at the top that are neither header nor data.
        missing_values: texts that stand for no number, beside those of `MISSING`.

    Raises:
        RecordingError: there are no numbers, or what should be the first row of data cannot be read.
    """
    encoding, head, lines = _head(path)
    data = [i for i in range(skip, len(lines)) if lines[i].strip() and not _COMMENT.match(lines[i])]
    sample = [lines[i] for i in data[:: max(len(data) // SAMPLE, 1)]]
    asked_decimal = decimal
    missing = MISSING | set(missing_values)
    kinds, delimiter, decimal = _judge(sample, _ways(delimiter, decimal), missing)
    if not kinds:
        raise RecordingError(f"there are no rows of numbers in the first {len(lines)} lines")
    check_count(path, len(kinds), LIMITS.channels, "columns")
    signs = Signs(decimal, missing)
    split = [_split(line, delimiter) for line in sample]
    if asked_decimal is None:
        _refuse_thousands([row for row in split if len(row) == len(kinds)], kinds, signs)
    kinds = _without_settings(split, kinds, signs)
    first = next(i for i in data if _begins(_split(lines[i], delimiter), kinds, signs))
    filled = [_split(lines[i], delimiter) for i in data if i >= first]
    blank = [all(row[k : k + 1] in ([], [""]) for row in filled) for k in range(len(kinds))]
    rows = {i: _header_fields(lines[i], delimiter, len(kinds), blank[-1]) for i in range(skip, first)}
    if asked_decimal is None:
        _refuse_split_numbers(rows, first, delimiter, len(kinds))
    rows, counting = counted(rows, len(kinds))
    if counting is not None and counting.blank:
        counting, kinds = (counting, "n" + kinds[1:]) if blank[0] else (None, kinds)
        blank[0] = False
    channels = _header(lines, rows, kinds, signs, {first: filled[0]})
    kinds = "".join("e" if b else k for k, b in zip(kinds, blank, strict=True))
    channels = [c._replace(numeric=k in "nd") for k, c in zip(kinds, channels, strict=True)]
    beside = [_split(line, delimiter) for line in lines[: first + BESIDE]]
    channels = with_said_units(channels, *said_units(beside))
    marks = [found[1][0] for line in lines if (found := _COMMENT.match(line))]
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
        counting,
    )


def _head(path: Path) -> tuple[str, bytes, list[str]]:
    """Return the encoding of a text, its first bytes, and their lines."""
    with opened(path) as file:
        head = file.read(LIMITS.line)
        more = len(head) == LIMITS.line and file.read(1) != b""
    encoding = _encoding(head)
    # str.splitlines breaks at more signs than text files do
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
        return "latin-1"  # old instruments; its micro and degree signs are those of the Windows code page
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
    """The kinds of the columns, delimiter and decimal sign of the best way; the first of equals."""
    best, best_score = ("", "", "."), (0, 0, 0)
    quoted = any('"' in line for line in lines)
    for delimiter, decimal in ways:
        if delimiter == decimal and not quoted:
            continue
        rows = (Signs(decimal, missing).kinds(_split(line, delimiter)) for line in lines)
        # Blanks count as numbers only beside one: else lines of words that end with a delimiter were rows.
        counted = Counter(kinds.replace("e", "n") for kinds in rows if "n" in kinds)
        for kinds, count in counted.most_common(1):
            score = (count, -kinds.count("s"), len(kinds))
            if score > best_score:
                best, best_score = (kinds, delimiter, decimal), score
    return best


def _refuse_thousands(rows: Sequence[Sequence[str]], kinds: str, signs: Signs) -> None:
    """Raise RecordingError where a sign may part thousands: in a column of "531" and "1,062", or where one
    column has another decimal sign than the others."""
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
    """Raise RecordingError where a delimiter is the decimal comma: rows of twice as many fields as the line
    of names and units above them."""
    above = [fields for i, fields in rows.items() if i < first and any(fields)]
    names = [_channel(field) for field in above[-1]] if above else []
    if delimiter == "," and count == 2 * len(names) and all(one.unit for one in names):
        raise RecordingError(
            f"the rows have {count} fields, but the names above them are {len(names)}: if the comma is the "
            "decimal sign, say decimal=','"
        )


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == SPACE:
        return [field.strip('"') for field in line.split()]
    if '"' not in line:
        return [field.strip() for field in line.split(delimiter)]
    rows = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    try:
        return [field.strip() for row in rows for field in row]
    except csv.Error as error:
        raise RecordingError(f"a line with quotes cannot be read: {error}") from None


def _begins(fields: Sequence[str], kinds: str, signs: Signs) -> bool:
    """Whether a line is the first of data."""
    found = signs.kinds(fields)
    return len(found) == len(kinds) and all(
        b == "e" or a in (b, "e") for a, b in zip(found, kinds, strict=True)
    )


def _without_settings(rows: Sequence[Sequence[str]], kinds: str, signs: Signs) -> str:
    """The kinds of the columns, those empty in which an oscilloscope keeps its settings beside the first
    samples: words in a few rows, blank in the others."""
    found = [row for row in map(signs.kinds, rows) if len(row) == len(kinds) and "n" in row]
    blank = [sum(row[k] == "e" for row in found) > 0.9 * len(found) for k in range(len(kinds))]
    if not any(b and any(row[k] == "s" for row in found) for k, b in enumerate(blank)):
        return kinds
    return "".join("e" if b else kind for b, kind in zip(blank, kinds, strict=True))


def _header_fields(line: str, delimiter: str, count: int, last_is_blank: bool) -> list[str]:
    """The fields of a line above the data, as many as there are columns if it can be read so."""
    if mark := _COMMENT.match(line):
        line = line[mark.end() :]
    fields = _split(line, delimiter)
    if (
        len(fields) == count - 1 and last_is_blank
    ):  # each row of data ends with a delimiter, the header does not
        return [*fields, ""]
    if len(fields) == count + 1 and fields[-1].lower() == "comment":  # of LabVIEW; mostly no row has one
        return fields[:-1]
    if delimiter == SPACE and len(fields) != count:  # names with blanks in them
        for fields in (_HEADER_WORD.findall(line), re.split(r"\s{2,}|\t", line.strip())):
            if len(fields) == count:
                break
    return fields


def _header(
    lines: Sequence[str], above: dict[int, list[str]], kinds: str, signs: Signs, data: dict[int, list[str]]
) -> list[FileChannel]:
    """The columns by name and unit, from the fields of the lines above the data; of that, the first line."""
    rows = {i: fields for i, fields in above.items() if len(fields) == len(kinds)}
    texts = [i for i, fields in rows.items() if set(signs.kinds(fields)) in ({"s"}, {"s", "e"})]
    header = texts[-1] if texts else -1
    for i, fields in rows.items():
        if i > header and not _COMMENT.match(lines[i]) and any(fields):
            k = next(k for k, field in enumerate(fields) if signs.kind(field) not in (kinds[k], "e"))
            name = rows[header][k] if texts else str(k)
            hint = "" if texts else f" (if the line is no data: skip={i + 1})"
            if signs.kind(fields[k]) == "n":  # most below are words, as with separators of thousands
                ((i, fields),) = data.items()
            raise RecordingError(f"line {i + 1}, column {name!r}: {fields[k]!r} is not a number{hint}")
    if not texts:
        return [FileChannel(str(k)) for k in range(len(kinds))]
    columns = [_channel(field) for field in rows[header]]
    names = rows.get(header - 1, [])  # a row of names, a row of units
    units = [_unit_alone(field) for field in rows[header]]
    if any("s" in signs.kind(name) for name in names) and _all_units(units, columns):
        columns = [FileChannel(name, unit) for name, unit in zip(names, units, strict=True)]
    return _distinct(columns)


def _unit_alone(field: str) -> str:
    found = _UNIT_ALONE.fullmatch(field)
    return found[found.lastindex or 0].strip() if found else field


def _all_units(units: Sequence[str], columns: Sequence[FileChannel]) -> bool:
    return all(map(is_unit, units)) and not any(map(is_clock, columns))


def _channel(header: str) -> FileChannel:
    """Name and unit: "Position [mm]" is in mm, but "Force (left)" is in no unit."""
    name, unit, certain = _name_and_unit(header)
    if not name:
        tight = _TIGHT.fullmatch(header)
        if tight and is_unit(header) and not (tight["name"] == "t" or _of_one(tight["name"], header)):
            tight = None  # "N/m"
        return FileChannel(tight["name"], tight["unit"], header=header) if tight else FileChannel(header)
    known = certain or is_unit_of(name, unit)
    return FileChannel(name, unit, header=header) if known else FileChannel(header)


def _name_and_unit(header: str) -> tuple[str, str, bool]:
    """Return the name and the unit in "name [unit]", "name (unit)" or "name / unit", and whether the brackets
    are square; empty texts if the header is none of these."""
    text = header.rstrip()
    opening = {"]": "[", ")": "("}.get(text[-1:], "")
    at = text.rfind(opening) if opening else -1
    if at > 0 and text[-1] in text[at + 1 : -1]:
        at = -1
    over = _OVER_UNIT.search(text)
    if over and (at < 1 or over.start() < at):
        return text[: over.start()].rstrip(), over[1], False
    return (text[:at].rstrip(), text[at + 1 : -1].strip(), opening == "[") if at > 0 else ("", "", False)


def _of_one(name: str, unit: str) -> bool:
    """Whether a unit is one over another of the same kind: "V/mV" is a voltage in mV."""
    return len(name) == 1 and not to_si_unit(unit).unit


def _distinct(columns: Sequence[FileChannel]) -> list[FileChannel]:
    """Names told apart: "Time", "x", "Time (2)", "x (2)"."""
    seen: Counter[str] = Counter()
    result = []
    for column in columns:
        seen[column.name] += 1
        again = column.name and seen[column.name] > 1
        result.append(column._replace(name=f"{column.name} ({seen[column.name]})") if again else column)
    return result
