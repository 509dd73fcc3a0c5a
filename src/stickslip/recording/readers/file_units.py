"""Units as files of measurements mean them, where the unit parser takes a short name for something else.

"mil" is a thousandth of an inch in every data sheet, and a part of a turn to the parser; "C" is a charge, but
of a temperature a degree; "(rod)" says what was measured, and is a length of five metres to it. What files do
not agree about is refused by name.
"""

from __future__ import annotations

import functools
import re

from ...quantities.units import QuantityError
from .. import conversion
from ..conversion import Conversion
from .source import FileChannel

# Meaning of units in files, as the parser spells it.
_MEANT = {"MIL": "thou", "pct": "percent"}
_MEANT |= {"rev": "turn", "revs": "turn", "gon": "grad", "cycle": "", "cycles": ""}
_MIL = re.compile(r"\b[mM]ils?\b")
# Units with several meanings in files, and their possible meanings.
_UNSURE = {
    "a": "a year, or an acceleration",
    "u": "an atomic mass, or micrometres",
    "au": "arbitrary units, or an astronomical one",
    "AU": "arbitrary units, or an absorbance",
    "dB": "a ratio of powers or of amplitudes, and no measure of it",
    "Gs": "gauss, or gigaseconds",
    "Mm": "mm, or megametres",
    "Ms": "ms, or megaseconds",
    "cps": "counts per second, or cycles",
}
# Names of parts, channels and levels that the parser takes for units.
_WORDS = frozenset(
    ["hand", "rod", "pole", "perch", "link", "chain", "point", "pica", "act", "ch", "b", "B", "c", "D", "e"]
)
# Texts in round brackets after a name that are not an unknown unit: a place, a role, a statistic.
_ROLE = re.compile(
    r"left|right|top|bottom|upper|lower|front|rear|back|inner|outer|raw|filtered|smoothed|measured|actual|real|"
    r"set ?point|target|ref(erence)?|command(ed)?|cmd|demand|desired|input|output|in|out|sensor|encoder|"
    r"stage|interferometer|laser|capacitive|strain|slider|runner|rotor|piezo|actuator|monitor|feedback|"
    r"main|abs(olute)?|rel(ative)?|mean|avg|average|min|max|peak|rms|std|[uvwxyz]|[xyz]-?axis|axis ?\w|"
    r"ch(an(nel)?)? ?\w+|a[io]\d+|\W*\d*\W*",
    re.IGNORECASE,
)
# By what a column is called: a unit of one letter is that of another quantity.
_BY_NAME = (
    ("g", re.compile(r"acc|beschl", re.IGNORECASE), "standard_gravity"),
    ("C", re.compile(r"temp", re.IGNORECASE), "degC"),
    ("F", re.compile(r"temp", re.IGNORECASE), "degF"),
)
# Units in round brackets that are as often a word ("max (min)", "Voltage (in)"), and the columns they are of.
_LENGTH = re.compile(r"pos|disp|dist|stroke|travel|elongation|gap|weg|length", re.IGNORECASE)
_TIME = re.compile(r"^t\b|time|zeit|temps|elapsed|duration", re.IGNORECASE)
_ONLY_OF = {"in": _LENGTH, "min": _TIME, "d": _TIME, "h": _TIME}


def to_si_unit(unit: str) -> Conversion:
    """Return the conversion of a unit as files mean it, see `recording.conversion`.

    Raises:
        QuantityError: the unit is unknown, or files use it differently.
    """
    return conversion.to_si_unit(_meant(unit))


def to_si_scale(text: str) -> Conversion:
    """Return the conversion of a unit with a number, as files mean it: "0.5 mil/V".

    Raises:
        QuantityError: see `to_si_unit`; or the number is 0 or not finite.
    """
    return conversion.to_si_scale(_meant(text) if isinstance(text, str) else text)


@functools.lru_cache(
    maxsize=10_000
)  # a file may have as many columns, each of which is checked several times
def is_unit(text: str) -> bool:
    """Return whether `to_si_unit` knows the unit."""
    return conversion.is_unit(text, to_si_unit)


def is_unit_of(name: str, text: str) -> bool:
    """Return whether a text in round brackets after a name is its unit, and not a word."""
    only = _ONLY_OF.get(text)
    return is_unit(text) and (only is None or only.search(name) is not None)


def is_word(text: str) -> bool:
    """Return whether a text in round brackets after a name is certainly not a unit: "left", "load cell"."""
    several = len(text.split()) > 1 and "unit" not in text.lower()
    return text in _WORDS or text in _ONLY_OF or several or _ROLE.fullmatch(text) is not None


def is_unsure(unit: str) -> bool:
    """Return whether files use a unit with different meanings."""
    return unit.strip() in _UNSURE


def in_seconds(channel: FileChannel) -> bool:
    """Return whether a channel is in a unit of time."""
    return is_unit(channel.unit) and to_si_unit(channel.unit).unit == "s"


def of_its_name(channel: FileChannel) -> FileChannel:
    """The channel with a unit of one letter spelled as that of what it is called: [C] of a temperature."""
    for unit, name, meant in _BY_NAME:
        if channel.unit == unit and name.search(channel.name):
            return channel._replace(unit=meant, header=channel.shown)
    return channel


def _meant(unit: str) -> str:
    text = unit.strip()
    if text in _UNSURE:
        raise QuantityError(f"the unit {text!r} may be {_UNSURE[text]}: spell it otherwise")
    if text in _WORDS:
        raise QuantityError(f"the unit {text!r} is not known here")
    return _MEANT[text] if text in _MEANT else _MIL.sub("thou", text)
