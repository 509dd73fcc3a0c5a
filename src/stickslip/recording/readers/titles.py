"""Recognition of the names, units and clock of columns from the lines above the samples of a text file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

from .. import RecordingError
from .fields import COMMENT, SPACE, Signs, split
from .file_units import in_seconds, is_unit, is_unit_of, is_word, to_si_unit
from .settings import MARKS, HeaderClock, HeaderSettings
from .source import FileChannel, is_clock

_IN = re.compile(r"((?P<name>\S+( \S+)?) )?in (?P<unit>\S+)", re.IGNORECASE)
_OVER_UNIT = re.compile(r"\s/\s(\S+)$")
# Pattern of a name with a unit without brackets: "Zeit/ms" and "Time, s". Only some units count, because
# "I/O" and "max/min" are names.
_TIGHT = re.compile(
    r"(?P<name>[^/,]*[^/,\s])\s*[/,]\s*(?P<unit>[pnuµμmckMG]?(?:[smVNAWJ]|Hz|Pa|rad)(?:/s)?|sec|deg)\s*"
)
# Pattern of a field in a row of units below the names: "[ms]", "(ms)", "<ms>", "{ms}", "'ms'", "in ms".
_UNIT_ALONE = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)|<([^<>]*)>|\{([^{}]*)\}|'([^']*)'|in\s+(.+)")
# Pattern of a word in a header, with its unit in brackets: "Time [s]" is one word.
_HEADER_WORD = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\]]{0,60}\]|\([^)]{0,60}\)))?")


def header_fields(line: str, delimiter: str, count: int, blank: int) -> list[str]:
    """Return the fields of a line above the data, without comment sign, as many as there are columns
    (`count`) if possible.

    The last `blank` columns have no samples, because the data lines end with delimiters. If their names are
    missing too, blank fields are appended.
    """
    mark = COMMENT.match(line)
    line = line[mark.end() :] if mark else line
    fields = split(line, delimiter)
    # Every name may have the comment sign: "%Time %Position".
    if mark:
        fields = [field.lstrip(mark[1]) for field in fields]
    if count - blank <= len(fields) < count:
        return [*fields, *[""] * (count - len(fields))]
    # LabVIEW names a last column "Comment", which is blank in most rows and therefore not counted as a
    # column.
    if len(fields) == count + 1 and fields[-1].lower() == "comment":
        return fields[:-1]
    if len(fields) != count and (
        mark or delimiter == SPACE
    ):  # Names may contain blanks, or have another delimiter than the data.
        ways = [_HEADER_WORD.findall(line)] if delimiter == SPACE else []
        ways += [split(line.strip(), sign) for sign in (",", ";", "\t")] if count > 1 else []
        for other in (*ways, re.split(r"\s{2,}|\t", line.strip())):
            if len(other) == count:
                return other
    return fields


def cut(fields: list[str], count: int) -> list[str]:
    """Return the first `count` fields if all further ones are blank; otherwise all fields."""
    return fields[:count] if len(fields) > count and not any(fields[count:]) else fields


def titles(
    lines: Sequence[str],
    above: dict[int, list[str]],
    kinds: str,
    signs: Signs,
    data: dict[int, list[str]],
    said: HeaderSettings,
) -> list[FileChannel]:
    """Return the columns with their names and units, from the lines above the data. Without names, the
    columns are named by their index.

    Args:
        lines: lines of the file.
        above: fields of the lines above the data, by index of the line.
        kinds: kind of each column.
        signs: decimal sign, and texts for missing numbers.
        data: fields of the first line of data, by index of the line.
        said: settings above the data.

    Raises:
        RecordingError: a line below the header may be a row of data with a wrong field.
    """
    rows = {i: fields for i, fields in above.items() if len(fields) == len(kinds) and not _marks(fields)}
    texts = [i for i, fields in rows.items() if set(signs.kinds(fields)) in ({"s"}, {"s", "e"})]
    header = texts[-1] if texts else -1
    titled = rows[header] if texts else None
    below = {i: fields for i, fields in rows.items() if i > header and not COMMENT.match(lines[i])}
    for i, fields in below.items():
        _refuse_words(i, fields, kinds, signs, titled, data)
    if not texts or any(map(any, below.values())) or COMMENT.match(lines[header]):
        found = _said_names(kinds, said)
        if found is not None:
            return found
    if not texts:
        return [FileChannel(str(k) if kinds[k] != "e" else "") for k in range(len(kinds))]
    names, units = _names_and_units(
        [rows[i] for i in (header - 2, header - 1, header) if i in rows and "s" in signs.kinds(rows[i])]
    )
    columns = [channel_of(name) for name in names]
    return _distinct(
        [
            one if one.unit or not unit else FileChannel(name, unit)
            for one, name, unit in zip(columns, names, units or [""] * len(names), strict=True)
        ]
        if units and any(names)
        else columns
    )


def _refuse_words(
    line: int,
    fields: list[str],
    kinds: str,
    signs: Signs,
    titled: list[str] | None,
    data: dict[int, list[str]],
) -> None:
    """Raise RecordingError for a line below the header that has numbers or dates in their columns, but also a
    field of another kind than its column.

    Such a line is not skipped silently, because it may be a row of data with a wrong field.

    Args:
        line: index of the line.
        fields: fields of the line.
        kinds: kind of each column.
        signs: decimal sign, and texts for missing numbers.
        titled: names of the columns; None without a header.
        data: fields of the first line of data, by index of the line.
    """
    wrong = [k for k, field in enumerate(fields) if signs.kind(field) not in (kinds[k], "e")]
    fits = any(signs.kind(field) == kinds[k] in ("n", "d") for k, field in enumerate(fields))
    if not fits or all(kinds[k] == "e" for k in wrong):
        return
    name = str(wrong[0]) if titled is None else titled[wrong[0]]
    hint = f" (if the line is no data: skip={line + 1})" if titled is None else ""
    # If the wrong field is a number, most fields of its column are words, for example because of thousands
    # separators. The first line of data is then the wrong one.
    if signs.kind(fields[wrong[0]]) == "n":
        ((line, fields),) = data.items()
    raise RecordingError(f"line {line + 1}, column {name!r}: {fields[wrong[0]]!r} is not a number{hint}")


def _said_names(kinds: str, said: HeaderSettings) -> list[FileChannel] | None:
    """Return the columns with the names in the settings `said` above the data; `kinds` has a letter for each
    column.

    The result is None unless there is a name for each column, for each numeric column, or for each numeric
    column except the first.
    """
    numeric = [k for k, kind in enumerate(kinds) if kind in "nd"]
    for places in (list(range(len(kinds))), numeric, numeric[1:]):
        if names := said.names(len(places)):
            named = dict(zip(places, names, strict=True))
            return _distinct([channel_of(named.get(k, "")) for k in range(len(kinds))])
    return None


def _marks(fields: Sequence[str]) -> bool:
    """Return True if the fields of a line only mark the start of the samples, such as "Waveform Data,"."""
    return re.sub(r"\W|_", "", "".join(fields)).lower() in MARKS


def _names_and_units(rows: Sequence[list[str]]) -> tuple[list[str], list[str]]:
    """Return the row of names and the row of units below or above it, from `rows`, the fields of the last
    lines above the data. Without units, the second row is empty and the names are the last row."""
    for k in range(len(rows) - 1, -1, -1):
        beside = rows[k - 1] if k else rows[1] if len(rows) > 1 else []
        units = [_unit_alone(field) for field in rows[k]]
        if beside and _are_units(units, beside):
            return beside, units
    return rows[-1], []


def _are_units(units: Sequence[str], names: Sequence[str]) -> bool:
    """Return True if the row `units` contains units for the row `names`: all its texts are known units or, if
    a name is that of a time, at least half of them."""
    given = [unit for unit in units if unit]
    known = sum(map(is_unit, given))
    clocks = [any(is_clock(channel_of(one)) for one in row) for row in (units, names)]
    enough = 2 * known >= len(given) if clocks[1] else known == len(given)
    return bool(given) and known > 0 and enough and not clocks[0] and not all(map(is_unit, names))


def _ticks(numbers: Sequence[float], increment: float) -> bool:
    """Return True if numbers increase by the header's sampling interval `increment`, within 1 %, so that they
    are times."""
    return all(0.99 < (b - a) / increment < 1.01 for a, b in pairwise(numbers))


def with_header_clock(
    channels: list[FileChannel],
    said: HeaderSettings,
    in_fields: Sequence[HeaderClock],
    counts: bool,
    data: Sequence[Sequence[str]],
    signs: Signs,
) -> tuple[list[FileChannel], dict[int, HeaderClock]]:
    """Assign the clocks in the header to the channels, unless the file has a time column. If the first
    numeric column increases by the header's interval, this column is the time column.

    Args:
        channels: channels of the columns.
        said: settings above the data.
        in_fields: list with the clock found by `in_table`, or empty.
        counts: True: the first column contains the numbers of the samples.
        data: fields of the first rows of data.
        signs: decimal sign, and texts for missing numbers.

    Returns:
        The channels, with a time channel (a blank column, the column of numbers, or a new one) for each
        different clock; and the clocks by the index of their time channel.
    """
    times = [i for i, one in enumerate(channels) if one.numeric and (is_clock(one) or in_seconds(one))]
    if times and not counts:
        return channels, {}
    columns = [i for i, one in enumerate(channels) if one.numeric and i not in times]
    each = list(in_fields) * len(columns) or said.clocks(len(columns))
    if not each:
        return channels, {}
    steps = [row[columns[0]] for row in data if len(row) > columns[0]]
    numbers = [float(one.replace(signs.decimal, ".")) for one in steps if signs.kind(one) == "n"]
    if not counts and len(numbers) > 1 and _ticks(numbers, each[0].increment):
        timed = channels[columns[0]]._replace(unit="s")
        return [*channels[: columns[0]], timed, *channels[columns[0] + 1 :]], {}
    blank = [i for i, one in enumerate(channels) if not one.numeric and is_clock(one)]
    blank += [0] if not channels[0].numeric and not channels[0].name else []
    places = [*times[:1], *blank[:1], *range(len(channels), len(channels) + len(columns))]
    made: dict[HeaderClock, int] = {}
    for clock in each:
        made.setdefault(clock, places[len(made)])
    extra = max(max(made.values()) + 1 - len(channels), 0)
    found = [*channels, *[FileChannel("")] * extra]
    for number, i in enumerate(sorted(made.values()), 1):
        name = found[i].name or ("time" if number == 1 else f"time ({number})")
        found[i] = found[i]._replace(name=name, unit="s", numeric=True, clock=i)
    for i, clock in zip(columns, each, strict=True):
        found[i] = found[i]._replace(clock=made[clock])
    return found, {i: clock for clock, i in made.items()}


def _unit_alone(field: str) -> str:
    found = _UNIT_ALONE.fullmatch(field)
    return found[found.lastindex or 0].strip() if found else field


def channel_of(header: str) -> FileChannel:
    """Return the channel for the header of a column, with the unit in it: "Position [mm]" has the unit mm,
    "Force (left)" no unit, and "u (mVpp)" the unknown unit mVpp."""
    name, unit, certain = _name_and_unit(header)
    if not name:
        tight = _TIGHT.fullmatch(header)
        if tight and is_unit(header) and not (tight["name"] == "t" or _of_one(tight["name"], header)):
            # The whole header is a unit, such as "N/m".
            tight = None
        return FileChannel(tight["name"], tight["unit"], header=header) if tight else FileChannel(header)
    if certain or is_unit_of(name, unit):
        return FileChannel(name, unit, header=header)
    return FileChannel(header) if is_word(unit) else FileChannel(header, unit, header=header)


def _name_and_unit(header: str) -> tuple[str, str, bool]:
    """Return the name and the unit in "name [unit]", "name (unit)", "name / unit" or "name in unit", and True
    for square brackets, whose content is certainly a unit. Both texts are "" for other headers."""
    text = header.rstrip()
    opening = {"]": "[", ")": "("}.get(text[-1:], "")
    at = text.rfind(opening) if opening else -1
    if at > 0 and text[-1] in text[at + 1 : -1]:
        at = -1
    over = _OVER_UNIT.search(text)
    if over and (at < 1 or over.start() < at):
        return text[: over.start()].rstrip(), over[1], False
    if at > 0:
        return text[:at].rstrip(), text[at + 1 : -1].strip(), opening == "["
    found = _IN.fullmatch(text)
    return (
        (found["name"] or text, found["unit"], False) if found and is_unit(found["unit"]) else ("", "", False)
    )


def _of_one(name: str, unit: str) -> bool:
    """Return True if `unit`, a ratio such as "V/mV" whose first part is the one-letter `name`, has no
    dimension: this header means a column V in mV."""
    return len(name) == 1 and not to_si_unit(unit).unit


def _distinct(columns: Sequence[FileChannel]) -> list[FileChannel]:
    """Return the columns with numbers after repeated names: "Time", "x", "Time (2)", "x (2)"."""
    seen: Counter[str] = Counter()
    result = []
    for column in columns:
        seen[column.name] += 1
        again = column.name and seen[column.name] > 1
        result.append(column._replace(name=f"{column.name} ({seen[column.name]})") if again else column)
    return result
