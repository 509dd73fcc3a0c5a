"""Reading of dates and times of day in their usual spellings ("20.02.2020 10:00:00,5", "2/20/2020 1:05:07
PM") and as numbers of days."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from .source import FileChannel, is_clock

DAY, HOUR = 86400.0, 3600.0  # lengths of a day and of an hour, s
# Plausible ranges of the serial days of Excel (since 1899-12-30) and MATLAB (since year 0): least and
# greatest number, and the number of the day 1970-01-01.
SERIAL_DAYS = ((2e4, 8e4, 25_569.0), (7e5, 8e5, 719_529.0))
# Largest step, in days, at which the numbers in a time column without a unit are taken as days; with larger
# steps they are taken as seconds.
LONGEST_SERIAL_STEP = 2e-5
_MONTHS = {
    name: k
    for k, name in enumerate(
        ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"], 1
    )
}
_MONTHS |= {"mai": 5, "okt": 10, "dez": 12, "mär": 3, "mrz": 3}
_DATE = (
    r"(?:(?P<y1>\d{4})(?P<sign1>[-/.])(?P<m1>\d{1,2})[-/.](?P<d1>\d{1,2})"
    r"|(?P<a2>\d{1,2})(?P<sign2>[-/.])(?P<b2>\d{1,2})[-/.](?P<y2>\d{4}|\d\d)"
    r"|(?P<d3>\d{1,2})[- .](?P<m3>[^\W\d_]{3,9})[- ,.](?P<y3>\d{4}|\d\d)"
    r"|(?P<m4>[^\W\d_]{3,9}) (?P<d4>\d{1,2}),? (?P<y4>\d{4}))"
)
_CLOCK = (
    r"(?P<h>\d{1,3}):(?P<min>\d\d)(?::(?P<s>\d\d)(?:[.,:](?P<f>\d*))?|[.,](?P<mf>\d+))?"
    r"(?:\s?(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_STAMP = re.compile(rf"(?:{_DATE})?(?:(?:^|T|_|, ?| {{1,3}}){_CLOCK})?\s?(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?")
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)?")


def is_stamp(text: str) -> bool:
    """Return True if a text is a date, a time of day, or both."""
    found = _STAMP.fullmatch(text) if text[:1].isalnum() else None
    return found is not None and (_has_date(found) or found["h"] is not None)


def has_date(text: str) -> bool:
    """Return True if a time stamp contains a date."""
    found = _STAMP.fullmatch(text)
    return found is not None and _has_date(found)


def has_time(text: str) -> bool:
    """Return True if a time stamp contains a time of day."""
    found = _STAMP.fullmatch(text)
    return found is not None and found["h"] is not None


def _has_hours(text: str) -> bool:
    found = _STAMP.fullmatch(text)
    return found is not None and found["mf"] is None


def _has_date(found: re.Match[str]) -> bool:
    return any(found[name] is not None for name in ("y1", "y2", "y3", "y4"))


def day_first(texts: Sequence[str]) -> bool | None:
    """Return True if dates like "1/2/2020" in the texts have the day before the month, as with any other sign
    than "/". The result is False if the month is first or there are no such dates, and None if both orders
    are possible."""
    found = [one for text in texts if (one := _STAMP.fullmatch(text)) and one["y2"] is not None]
    if any(int(one["a2"]) > 12 for one in found) or any(one["sign2"] != "/" for one in found):
        return True
    return False if any(int(one["b2"]) > 12 for one in found) or not found else None


def iso(text: str, first_is_day: bool) -> str:
    """Return a date or time of day (text) in ISO 8601. A time of day without a date gets the date 1970-01-01.
    `first_is_day` is True if the day is before the month in dates like "1/2/2020".

    Raises:
        ValueError: the text is not a time stamp.
    """
    return text if _ISO.fullmatch(text) else _iso(text, first_is_day)


def _second(text: str, first_is_day: bool) -> float:
    """Return the time of a time stamp (text) in s since 1970, rounded down to a whole second; see `iso` for
    `first_is_day` and errors."""
    made = datetime.fromisoformat(iso(text, first_is_day))
    return float(np.floor((made if made.tzinfo else made.replace(tzinfo=UTC)).timestamp()))


def _iso(text: str, first_is_day: bool) -> str:
    found = _STAMP.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is not a date")
    hours, minutes, whole = (int(found[name] or 0) for name in ("h", "min", "s"))
    part = found["f"] or found["mf"] or ""
    # "05:07.250" means minutes and seconds, not hours and minutes.
    if found["mf"] is not None:
        hours, minutes, whole = 0, hours, minutes
    if found["half"]:
        hours = hours % 12 + (12 if found["half"] in "pP" else 0)
    date = f"1970-01-{1 + hours // 24:02d}" if not _has_date(found) else _iso_date(found, first_is_day)
    zone = "" if found["zone"] in (None, "UTC") else found["zone"]
    hours %= 24 if not _has_date(found) else 100
    return f"{date}T{hours:02d}:{minutes:02d}:{whole:02d}.{part or 0}{zone}"


def _iso_date(found: re.Match[str], first_is_day: bool) -> str:
    if found["y1"]:
        year, month, day = found["y1"], found["m1"], found["d1"]
    elif found["y2"]:
        year, one, other = found["y2"], found["a2"], found["b2"]
        month, day = (other, one) if first_is_day else (one, other)
    else:
        year = found["y3"] or found["y4"]
        name = (found["m3"] or found["m4"]).lower()[:3]
        month, day = _MONTHS.get(name, 0), found["d3"] or found["d4"]
    return f"{2000 + int(year) if len(year) < 3 else int(year):04d}-{int(month):02d}-{int(day):02d}"


class Stamped(NamedTuple):
    """Description of a column of dates or times of day: texts, perhaps with their dates in another column, or
    numbers of days (serial days)."""

    first_is_day: bool = True  # True: the day is before the month in dates like "1/2/2020"
    # Time from which the numbers of the column count, in s since 1970 (since midnight for times of day).
    epoch: float = 0.0
    # Index of the column with the dates of times of day; None: there is no such column.
    date: int | None = None
    # Period, s, after which times of day without a date start again at 0; infinite for others.
    wraps: float = np.inf
    # Number of the first day, rounded down, if the column contains numbers of days; otherwise None.
    days: float | None = None

    def whole(self, values: np.ndarray) -> np.ndarray:
        """Return the samples of the column in s since `epoch`: numbers of days are converted, and times of
        day that start again at 0 are continued, in place."""
        if self.days is not None:
            return (values - self.days) * DAY
        for at in np.flatnonzero(np.diff(values) < -0.5 * self.wraps):
            values[at + 1 :] += self.wraps
        return values


def find_stamps(
    channels: Sequence[FileChannel], kinds: str, rows: Sequence[Sequence[str]], decimal: str
) -> tuple[list[FileChannel], dict[int, Stamped]]:
    """Find the columns of dates, times of day and serial days (numbers of days) in a text file.

    Args:
        channels, kinds: channel and kind of each column.
        rows: fields of the first samples.
        decimal: decimal sign.

    Returns:
        The channels, with `stamp` and `epoch` (whole second of the first sample; only its time of day if day
        and month may be exchanged) set for such columns; and a dictionary with the description (`Stamped`) of
        each such column by its index. A column of dates beside other times is marked as not numeric.
    """
    made, found = list(channels), {}
    texts = {i: [row[i] for row in rows if i < len(row) and row[i]] for i in range(len(channels))}
    stamps = [i for i, kind in enumerate(kinds) if kind == "d" and texts[i]]
    dates = [i for i in stamps if not any(map(has_time, texts[i]))]
    times = [i for i in stamps if i not in dates and not any(map(has_date, texts[i]))]
    for i in stamps:
        near = [k for k in (i - 1, i + 1) if i in times and k in dates]
        date = near[0] if near else None
        order = day_first(texts[date if date is not None else i])
        whole = f"{texts[date][0]} {texts[i][0]}" if date is not None else texts[i][0]
        try:
            epoch = _second(whole, bool(order))
        # The error is raised later, when the column is read.
        except ValueError:
            epoch = 0.0
        alone = i in times and date is None
        wraps = (DAY if any(map(_has_hours, texts[i])) else HOUR) if alone else np.inf
        found[i] = Stamped(bool(order), epoch, date, wraps)
        # With an ambiguous order of day and month, only the time of day is known.
        sure = epoch if order is not None else epoch % DAY
        made[i] = made[i]._replace(stamp=True, epoch=sure)
    paired = {one.date for one in found.values()}
    for i in dates:
        other = i in paired or len(stamps) > 1 or any(is_clock(one) for one in channels if one.numeric)
        if other and not is_clock(channels[i]):
            made[i] = made[i]._replace(stamp=False, epoch=0.0, numeric=False)
            found.pop(i)
    for i, kind in enumerate(kinds):
        days = _serial(channels[i], texts[i], decimal) if kind == "n" else None
        if days is not None:
            found[i] = Stamped(epoch=days[1], days=days[0])
            made[i] = made[i]._replace(stamp=True, epoch=days[1], unit="")
    return made, found


def _serial(channel: FileChannel, texts: Sequence[str], decimal: str) -> tuple[float, float] | None:
    """Return the first sample's whole day number, and the start of this day in s since 1970, if a column
    contains serial days of Excel or MATLAB; otherwise None.

    Args:
        channel: description of the column.
        texts: first fields of the column.
        decimal: decimal sign.
    """
    named = re.search(r"date|datum|stamp|serial|excel", channel.name, re.IGNORECASE) is not None
    in_days = channel.unit.lower() in ("d", "day", "days")
    if not (named or in_days or is_clock(channel)) or (channel.unit and not in_days):
        return None
    try:
        numbers = [float(text.replace(decimal, ".")) for text in texts]
    except ValueError:
        return None
    steps = np.diff(numbers)
    if not numbers or (not (named or in_days) and not np.all(steps <= LONGEST_SERIAL_STEP)):
        return None
    for low, high, zero in SERIAL_DAYS:
        if low < numbers[0] < high and (len(steps) == 0 or np.all(np.abs(steps) < 1.0)):
            first = float(np.floor(numbers[0]))
            return first, (first - zero) * DAY
    return None
