"""Recognition of settings above (or beside) the samples of a text file: names and units of columns, and the
clock (start and sampling interval).

Instruments write a key and its values in many spellings: "Sampling Period,1e-4", "# SAMPLE_TIME = 0.0001",
"dt:" above a line of values. `KEYS` lists the role of each key.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from ...quantities.units import QuantityError, to_si
from ..conversion import is_number
from .source import FileChannel, is_clock

_MEANT = {
    "increment": "deltax deltat dt tinc xinc xincr xincrement increment hresolution samplingperiod "
    "sampleperiod sampletime samplingtime sampleinterval samplinginterval timeinterval timeincrement "
    "timestep interval timepersample secondspersample abtastintervall abtastzeit",
    "rate": "samplerate samplingrate samplefrequency samplingfrequency samplingfreq samplefreq fs scanrate "
    "acquisitionrate datarate recordrate samplespersecond abtastrate abtastfrequenz",
    "start": "x0 t0 tstart hoffset xzero xorigin xoffset timeoffset starttimes start",
    "names": "tracename tracenames channelname channelnames channeltitle signalname signalnames names source "
    "columns column fields variables header signals channels",
    "across": "horizontalunits horizontalunit hunit xunit xunits xunitlabel timeunit timeunits xdimension",
    "upward": "verticalunits verticalunit vunit yunit yunits yunitlabel",
    "each": "units unit channelunits columnunits",
}
KEYS = {key: role for role, keys in _MEANT.items() for key in keys.split()}
_ASSIGNED = re.compile(
    r"\s*(?P<key>[^\W\d][^:=,;\t]{0,60}?|\d{1,3}(?=\s*[:=]\s+[^\W\d]))\s*[:=]\s*(?P<value>.*)"
)
_NUMBERED = re.compile(r"(?:columns?|col|channel|ch|name|unit)?[ _]?(?P<number>\d{1,3})", re.IGNORECASE)
_UNIT = re.compile(r"[\[(](?P<inside>[^\])]*)[\])]|_(?P<end>hz|khz|s|ms|us|ns)$", re.IGNORECASE)
_VALUE = re.compile(r"(?:\w+\s*:\s*)?(?P<number>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s,;]*)")
_RATE = re.compile(r"(?P<prefix>[kKMGm]?)(Sa?/s(ec)?|S/s|sps|SPS|samples?/s(ec)?)")
_PLACES = re.compile(r"\W|_")
# Spellings of the second. The parser would take "S" for siemens, which recordings do not contain.
_SECONDS = {"S": "s", "Sec": "s", "SEC": "s", "Time": "s"}
LONGEST_KEY = 200  # largest number of characters of a key; longer texts are no keys
# Texts of lines after which the samples start, in lower case and without blanks and signs.
MARKS = frozenset(["data", "waveformdata", "begindata", "values", "samples", "endheader", "endofheader"])


class HeaderClock(NamedTuple):
    """Clock that a file's header describes: the time of sample k (from 0) is ``start + k * increment``, in
    s."""

    start: float
    increment: float


class HeaderSettings(NamedTuple):
    """Settings in the lines above the samples.

    `values` contains lists of texts by role: "increment" and "rate" (sampling interval and rate), "start"
    (first time), "names" (of columns), and units: "across" (horizontal axis), "upward" (vertical axis),
    "each" (all columns).
    """

    values: dict[str, list[str]]
    # Texts of keys with a number, "NAME0 = ...", by role and number.
    numbered: dict[str, dict[int, str]]
    lines: frozenset[int]  # indices of the lines with settings, from 0
    # Indices of lines with values, whose key is in the line above.
    below: frozenset[int]

    def names(self, width: int) -> list[str]:
        """Return the names of `width` columns; an empty list if the settings contain another number of
        names."""
        return self._said("names", width)

    def units(self, width: int) -> list[str]:
        """Return the units of the columns in order; a single unit is repeated for all `width` columns. The
        list is empty without units, and may be shorter or longer than `width`."""
        found = self._said("upward", width) or self.values.get("upward", []) or self.values.get("each", [])
        # LabVIEW writes a blank beside each unit.
        if len(found) > width and not any(found[1::2]):
            found = found[::2]
        return found * width if len(found) == 1 else found

    def _said(self, role: str, width: int) -> list[str]:
        numbered = self.numbered.get(role, {})
        for first in (0, 1):
            if len(numbered) == width and set(numbered) == set(range(first, first + width)):
                return [numbered[k] for k in sorted(numbered)]
        found = self.values.get(role, [])
        return found if len(found) == width and not all(map(is_number, found)) else []

    def clocks(self, width: int) -> list[HeaderClock]:
        """Return the clock of each of `width` columns; an empty list if the settings do not contain the
        clocks of all columns. A single interval or start is that of all columns.

        Raises:
            QuantityError: an interval and a rate contradict each other.
        """
        increments = _numbers(self.values.get("increment", []), "s")
        rates = _numbers(self.values.get("rate", []), "Hz")
        by_rate = [1.0 / rate for rate in rates if rate > 0.0]
        increments = [one for one in increments if one > 0.0]
        if increments and by_rate and not 0.99 < increments[0] / by_rate[0] < 1.01:
            raise QuantityError(
                f"above the samples, their interval is {increments[0]:g} s and their rate "
                f"{1 / by_rate[0]:g} Hz: say sample_rate=..."
            )
        steps = increments or by_rate
        starts = _numbers(self.values.get("start", []), "s") or [0.0]
        steps, starts = (one * width if len(one) == 1 else one for one in (steps, starts))
        if len(steps) < width or len(starts) < width:
            return []
        return [HeaderClock(*pair) for pair in zip(starts[:width], steps[:width], strict=True)]


def find_settings(lines: Sequence[str], split: Sequence[Sequence[str]]) -> HeaderSettings:
    """Return the settings in the lines above the samples, as `HeaderSettings`.

    Args:
        lines: lines without comment signs.
        split: the same lines as lists of fields.
    """
    values: dict[str, list[str]] = {}
    numbered: dict[str, dict[int, str]] = {}
    used: set[int] = set()
    below: set[int] = set()
    for i, (line, fields) in enumerate(zip(lines, split, strict=True)):
        key, found = _key_and_values(line, fields)
        own = any(found)
        if key and not own and i + 1 < len(lines) and line.rstrip().endswith(":"):
            # SignalExpress writes "dt:" in one line and the values in the next.
            found = list(split[i + 1])
        if not key or not any(found):
            continue
        number = _NUMBERED.fullmatch(key)
        if number and not is_number(found[0]) and _ASSIGNED.fullmatch(line):
            role = "upward" if key.lower().startswith("unit") else "names"
            text = line.split(key, 1)[1].lstrip(" :=\t,;").rstrip(" \t,;")
            numbered.setdefault(role, {})[int(number["number"])] = text
            used.add(i)
        role, unit = _role(key)
        if role in ("increment", "rate", "start"):
            found = [f"{one} {unit}" if unit and is_number(one) else one for one in found]
            known = bool(_numbers(found[:1], "Hz" if role == "rate" else "s"))
        else:
            known = bool(role) and not is_number(found[0])
        if known:
            # The list of units ends at the first number, because an oscilloscope writes samples beside its
            # settings.
            end = next((k for k, one in enumerate(found) if is_number(one)), None)
            values.setdefault(role, found[:end] if role in ("across", "upward", "each") else _trimmed(found))
            used |= {i} if own else {i, i + 1}
            below |= set() if own else {i + 1}
    return HeaderSettings(values, numbered, frozenset(used), frozenset(below))


def _key_and_values(line: str, fields: Sequence[str]) -> tuple[str, list[str]]:
    """Return the key and the list of values in a line "key,value,value", "key,value,key,value" (the same key)
    or "key: value, value"; "" and no values for other lines. `fields` are the fields of the line."""
    said = _ASSIGNED.fullmatch(line.strip().strip('"'))
    # A file with one column has no delimiter, so its settings are split at the usual ones.
    if len(fields) == 1 and not said:
        fields = [part.strip() for part in re.split(r"[,;\t]", line)]
    if not said:
        again = [one for one in fields[2::2] if one]
        repeated = bool(again) and set(again) == {fields[0]}
        return (fields[0], [*fields[1::2]] if repeated else [*fields[1:]]) if len(fields) > 1 else ("", [])
    value = said["value"].strip()
    parts = next((p for p in (re.split(r"[,;\t]", value), re.split(r"\s{2,}", value)) if len(p) > 1), [value])
    return said["key"], [part.strip().strip('"') for part in parts]


def _role(key: str) -> tuple[str, str]:
    """Return the role of a key in `HeaderSettings` ("" for none) and the unit in the key ("" without one):
    "rate" and "kHz" for "Sample rate [kHz]"."""
    if len(key) > LONGEST_KEY:
        return "", ""
    unit = _UNIT.search(key)
    name = key[: unit.start()] if unit and unit.start() else key
    found = KEYS.get(_PLACES.sub("", name).lower(), "")
    return found, ((unit["inside"] or unit["end"]) if unit else "")


def _trimmed(found: list[str]) -> list[str]:
    last = max((k for k, one in enumerate(found) if one), default=-1)
    return found[: last + 1]


def _numbers(texts: Sequence[str], unit: str) -> list[float]:
    """Return the numbers at the start of a list of texts, in SI, up to the first text that is not a number.
    `unit` is the SI unit of the result, and the unit of texts without one; "1 MSa/s" is 1e6 Hz."""
    result = []
    for text in texts:
        found = _VALUE.fullmatch(text.strip())
        try:
            said = _RATE.sub(r"\g<prefix>Hz", found["unit"]) if found else ""
            if not found:
                break
            result.append(to_si(f"{found['number']} {_SECONDS.get(said, said) or unit}", unit))
        except (QuantityError, ValueError):
            break
    return result


def in_table(rows: dict[int, list[str]]) -> tuple[dict[int, list[str]], list[HeaderClock], bool]:
    """Find a clock in the fields of the lines above the samples, as Rigol's oscilloscopes write it.

    Examples are "X,CH1,Start,Increment" above "Sequence,Volt,-5e-2,5e-4", and "Time(s),CH1V,t0 =-5e-2,tInc =
    5e-4".

    Args:
        rows: fields of the lines by index of the line.

    Returns:
        The lines by index, with the fields of the clock made blank; a list with the clock (`HeaderClock`), or
        an empty list; and True if the first column contains the numbers of the samples.
    """
    for i, fields in rows.items():
        below = rows.get(i + 1, [])
        said: dict[str, float] = {}
        places = set()
        for k, field in enumerate(fields):
            assigned = _ASSIGNED.fullmatch(field)
            role, unit = _role(assigned["key"] if assigned else field)
            text = assigned["value"] if assigned else below[k] if k < len(below) else ""
            number = _numbers([text], unit or "s") if role in ("start", "increment") and text else []
            if number:
                said[role] = number[0]
                places.add(k)
        if said.keys() == {"start", "increment"} and said["increment"] > 0.0:
            counts = below[:1] == ["Sequence"]
            heads = ["" if k in places else field for k, field in enumerate(fields)]
            units = ["" if k in places or field == "Unknown" else field for k, field in enumerate(below)]
            if counts:
                heads[0], units[0] = "time", "s"
            changed = {i: heads, i + 1: units} if below else {i: heads}
            return rows | changed, [HeaderClock(said["start"], said["increment"])], counts
    return rows, [], False


def with_settings(
    channels: Sequence[FileChannel], said: HeaderSettings, in_header: bool
) -> list[FileChannel]:
    """Return the channels with units from the settings, as far as they have none of their own.

    Times get the units of the horizontal axis, the other channels those of the vertical axis in order.
    Settings with one unit for each numeric column count for all of these instead. If no channel has the name
    of a time, the first numeric column is taken as the time, unless the header contains a clock
    (`in_header`).
    """
    made, numeric = list(channels), [i for i, one in enumerate(channels) if one.numeric]
    across = [_SECONDS.get(one, one) for one in said.values.get("across", [])]
    clocks = [i for i in numeric if is_clock(channels[i])]
    if not clocks and across and not in_header:
        clocks = numeric[:1]
    others = [i for i in numeric if i not in clocks]
    each = _trimmed(said.values.get("each", []))
    if len(each) == len(numeric) > len(others):
        clocks, across, others = numeric, each, []
    across = across * len(clocks) if len(set(across)) == 1 else across
    for i, unit in [*zip(clocks, across, strict=False), *zip(others, said.units(len(others)), strict=False)]:
        if unit and not made[i].unit:
            made[i] = made[i]._replace(unit=unit, header=made[i].shown)
    return made
