"""Units that stand beside the columns: in their names, or in lines above the data as instruments write them.

Oscilloscopes of Tektronix write "Vertical Units,V", LabVIEW (LVM) "Y_Unit_Label  Volts  um"; many a script
calls its columns ``disp_um`` and ``timestamp_us``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from .file_units import is_unit
from .source import FileChannel, is_clock, is_seconds

_UNIT_LINE = re.compile(r"(?P<axis>vertical|horizontal|x|y)[ _]units?([ _]label)?:?", re.IGNORECASE)
# Ends of names that are units, spelled as names are. Of one letter V anywhere, s after a time, m after a
# length and a large N after a force only: "x_m" may be "measured", "force_n" the normal one or one of n, and
# A is as often a channel as ampere or angstrom.
_ENDS = {"sec": "s", "msec": "ms", "usec": "us", "nsec": "ns", "v": "V", "mv": "mV", "kv": "kV", "uv": "uV"}
_ENDS |= {
    "mn": "mN",
    "un": "uN",
    "kn": "kN",
    "hz": "Hz",
    "khz": "kHz",
    "ma": "mA",
    "ua": "uA",
    "micron": "um",
    "uinch": "uin",
    "microinch": "uin",
    "mils": "mil",
    "inch": "in",
    "inches": "in",
}
_ENDS |= {one: one for one in ("ms", "us", "ns", "pm", "nm", "um", "mm", "cm", "rad", "mrad", "urad", "deg")}
_ENDS |= {one: one for one in ("uin", "mil", "thou")}
_ENDS |= {f"{one}_{per}": f"{one}/s" for one in ("nm", "um", "mm", "m") for per in ("s", "per_s")}
_ENDS |= {"s": "s", "m": "m", "n": "N"}
# The shortest name comes first, so that "v_m_s" ends with m_s, not with s.
_ENDED = re.compile(
    rf"(?P<name>.*?[^\W_])[_ ](?P<unit>{'|'.join(sorted(_ENDS, key=len, reverse=True))})", re.I
)
_LENGTH = re.compile(r"pos|disp|dist|stroke|travel|elongation|weg", re.IGNORECASE)
_FORCE = re.compile(r"force|friction|load|kraft|reibung", re.IGNORECASE)


def named_unit(channel: FileChannel) -> FileChannel:
    """The channel with the unit that ends its name, "disp_um": displacement in um, or that is its name,
    "seconds"; else as it is."""
    if channel.unit or not channel.numeric:
        return channel
    if is_seconds(channel.name):
        return channel._replace(unit="s")
    found = _ENDED.fullmatch(channel.name.replace("µ", "u").replace("μ", "u"))
    if not found:
        return channel
    made = channel._replace(name=found["name"], unit=_ENDS[found["unit"].lower()], header=channel.shown)
    fits = {"s": is_clock(made), "m": ends_in_m(channel.shown), "n": _ends_in_newtons(channel.shown)}
    return made if fits.get(found["unit"].lower(), True) else channel


def ends_in_m(name: str) -> bool:
    """Whether a name is that of a length and ends with "_m", which says metres, or "measured"."""
    return name[-2:].lower() in ("_m", " m") and _LENGTH.search(name) is not None


def _ends_in_newtons(name: str) -> bool:
    return name.endswith("N") and _FORCE.search(name) is not None


def said_units(rows: Sequence[Sequence[str]]) -> tuple[list[str], list[str]]:
    """Units of the horizontal axis and of the vertical ones, as lines above (or beside) the data say."""
    across: list[str] = []
    upward: list[str] = []
    for fields in rows:
        if fields and fields[0].strip().lower() == "x_dimension" and "Time" in fields[1:2]:
            across.append("s")  # of LabVIEW, which counts time in nothing else
        found = _UNIT_LINE.fullmatch(fields[0].strip()) if fields else None
        if found:
            units = [field.strip() for field in fields[1:]]
            units = units[: next((i for i, unit in enumerate(units) if unit and not is_unit(unit)), None)]
            while units and not units[-1]:  # within, a blank is a column without a unit
                units.pop()
            (across if found["axis"].lower() in ("horizontal", "x") else upward).extend(units)
    return across, upward


def with_said_units(
    channels: Sequence[FileChannel], across: Sequence[str], upward: Sequence[str]
) -> list[FileChannel]:
    """Channels without a unit with those that lines above the data say: the clock's, and the others in order;
    without a clock by name, the first column of numbers is it. One vertical unit is that of all."""
    made, numeric = list(channels), [i for i, one in enumerate(channels) if one.numeric]
    clocks = [i for i in numeric if is_clock(channels[i])][:1] or (numeric[:1] if across else [])
    others = [i for i in numeric if i not in clocks]
    upward = list(upward) * len(others) if len(upward) == 1 else upward
    for i, unit in [*zip(clocks, across, strict=False), *zip(others, upward, strict=False)]:
        if unit and not made[i].unit:
            made[i] = made[i]._replace(unit=unit, header=made[i].shown)
    return made
