"""Recognition of units in the names of columns, such as ``disp_um`` and ``timestamp_us``."""

from __future__ import annotations

import re

from .source import FileChannel, is_clock, time_unit

# Endings of column names (in lower case) that are units, and the unit. Of one-letter units, V counts after
# any name, but s only after a time, m after a length and a capital N after a force: "x_m" may be "measured",
# "force_n" the normal force or the n-th one. A never counts, because A is a channel as often as ampere or
# angstrom.
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
# The name before the unit is matched as short as possible, so that the unit of "v_m_s" is m_s and not s.
_ENDED = re.compile(
    rf"(?P<name>.*?[^\W_])[_ ](?P<unit>{'|'.join(sorted(_ENDS, key=len, reverse=True))})", re.I
)
_LENGTH = re.compile(r"pos|disp|dist|stroke|travel|elongation|weg", re.IGNORECASE)
_FORCE = re.compile(r"force|friction|load|kraft|reibung", re.IGNORECASE)


def named_unit(channel: FileChannel) -> FileChannel:
    """Return the channel with the unit that its name states, at the end ("disp_um" becomes "disp" in um) or
    as a whole ("seconds"). A channel with a unit or without numbers is unchanged."""
    if channel.unit or not channel.numeric:
        return channel
    if time_unit(channel.name):
        return channel._replace(unit=time_unit(channel.name))
    found = _ENDED.fullmatch(channel.name.replace("µ", "u").replace("μ", "u"))
    if not found:
        return channel
    made = channel._replace(name=found["name"], unit=_ENDS[found["unit"].lower()], header=channel.shown)
    fits = {"s": is_clock(made), "m": ends_in_m(channel.shown), "n": _ends_in_newtons(channel.shown)}
    return made if fits.get(found["unit"].lower(), True) else channel


def ends_in_m(name: str) -> bool:
    """Return True if a name of a length (such as position) ends with "_m" or " m", which can mean metres or
    "measured"."""
    return name[-2:].lower() in ("_m", " m") and _LENGTH.search(name) is not None


def _ends_in_newtons(name: str) -> bool:
    return name.endswith("N") and _FORCE.search(name) is not None
