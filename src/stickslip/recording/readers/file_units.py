"""Units in measurement files whose short names the general unit parser would take for other units.

"mil" is a thousandth of an inch in every data sheet, but an angle for the parser; "C" is a charge, but in a
column of temperatures a degree; "(rod)" names the measured part, but is a length of five metres for the
parser. Units with several meanings in files are refused.
"""

from __future__ import annotations

import functools
import re

from ...quantities.units import QuantityError
from .. import conversion
from ..conversion import Conversion
from .source import FileChannel

# Units as files spell them, and the spelling that the unit parser understands.
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
# Names of parts, channels and levels that the unit parser would take for units.
_WORDS = frozenset(
    ["hand", "rod", "pole", "perch", "link", "chain", "point", "pica", "act", "ch", "b", "B", "c", "D", "e"]
)
# Pattern of texts in round brackets after a column's name that are not units: a place, a role, a statistic.
_ROLE = re.compile(
    r"left|right|top|bottom|upper|lower|front|rear|back|inner|outer|raw|filtered|smoothed|measured|actual|real|"
    r"set ?point|target|ref(erence)?|command(ed)?|cmd|demand|desired|input|output|in|out|sensor|encoder|"
    r"stage|interferometer|laser|capacitive|strain|slider|runner|rotor|piezo|actuator|monitor|feedback|"
    r"main|abs(olute)?|rel(ative)?|mean|avg|average|min|max|peak|rms|std|[uvwxyz]|[xyz]-?axis|axis ?\w|"
    r"ch(an(nel)?)? ?\w+|a[io]\d+|\W*\d*\W*",
    re.IGNORECASE,
)
# Units of one letter whose meaning depends on the name of the column: the letter, a pattern of names, and the
# unit that is meant. In a column "acceleration", g means standard gravity, not gram.
_BY_NAME = (
    ("g", re.compile(r"acc|beschl", re.IGNORECASE), "standard_gravity"),
    ("C", re.compile(r"temp", re.IGNORECASE), "degC"),
    ("F", re.compile(r"temp", re.IGNORECASE), "degF"),
)
# Units in round brackets that are also words ("max (min)", "Voltage (in)"), and the columns in which they are
# units.
_LENGTH = re.compile(r"pos|disp|dist|stroke|travel|elongation|gap|weg|length", re.IGNORECASE)
_TIME = re.compile(r"^t\b|time|zeit|temps|elapsed|duration", re.IGNORECASE)
_ONLY_OF = {"in": _LENGTH, "min": _TIME, "d": _TIME, "h": _TIME}


def to_si_unit(unit: str) -> Conversion:
    """Return the conversion to SI of a unit in its usual meaning in files, as a `Conversion`.

    Raises:
        QuantityError: the unit is unknown, or has several meanings in files.
    """
    return conversion.to_si_unit(_meant(unit))


def to_si_scale(text: str) -> Conversion:
    """Return the conversion to SI, as a `Conversion`, of a unit with a number, in its usual meaning in files:
    "0.5 mil/V".

    Raises:
        QuantityError: see `to_si_unit`; or the number is 0 or not finite.
    """
    return conversion.to_si_scale(_meant(text) if isinstance(text, str) else text)


@functools.lru_cache(
    maxsize=10_000
)  # One entry for each column of the widest allowed file, because each unit is checked several times.
def is_unit(text: str) -> bool:
    """Return True if `to_si_unit` accepts the text as a unit."""
    return conversion.is_unit(text, to_si_unit)


def is_unit_of(name: str, text: str) -> bool:
    """Return True if a text in round brackets after the column's name `name` is a unit and not a word, as
    "in" is after "Position" but not after "Voltage"."""
    only = _ONLY_OF.get(text)
    return is_unit(text) and (only is None or only.search(name) is not None)


def is_word(text: str) -> bool:
    """Return True if a text in round brackets after a column's name is certainly not a unit, such as "left"
    or "load cell"."""
    several = len(text.split()) > 1 and "unit" not in text.lower()
    return text in _WORDS or text in _ONLY_OF or several or _ROLE.fullmatch(text) is not None


def is_unsure(unit: str) -> bool:
    """Return True if a unit has several meanings in files, so that `to_si_unit` refuses it."""
    return unit.strip() in _UNSURE


def in_seconds(channel: FileChannel) -> bool:
    """Return True if the unit of a channel is a unit of time (s, ms, ...)."""
    return is_unit(channel.unit) and to_si_unit(channel.unit).unit == "s"


def of_its_name(channel: FileChannel) -> FileChannel:
    """Return the channel with a one-letter unit replaced by the unit that the channel's name suggests: C of a
    temperature means degrees Celsius, g of an acceleration standard gravity. Other channels are unchanged."""
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
