"""Units in the names of columns, such as ``disp_um`` and ``timestamp_us``."""

from __future__ import annotations

import re

from .source import FileChannel, is_clock, time_unit

# Endings of names that are units, in the spelling of names. Of one-letter units, V counts anywhere, s after a
# time, m after a length and a large N after a force only: "x_m" may be "measured", "force_n" the normal force
# or one of n, and A is a channel as often as ampere or angstrom.
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
# The shortest possible name comes first, so that "v_m_s" ends with m_s, not with s.
_ENDED = re.compile(
    rf"(?P<name>.*?[^\W_])[_ ](?P<unit>{'|'.join(sorted(_ENDS, key=len, reverse=True))})", re.I
)
_LENGTH = re.compile(r"pos|disp|dist|stroke|travel|elongation|weg", re.IGNORECASE)
_FORCE = re.compile(r"force|friction|load|kraft|reibung", re.IGNORECASE)


def named_unit(channel: FileChannel) -> FileChannel:
    """Return the channel with the unit at the end of its name ("disp_um": displacement in um) or equal to its
    name ("seconds"); otherwise unchanged."""
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
    """Return True if a length's name ends with "_m", which can mean metres or "measured"."""
    return name[-2:].lower() in ("_m", " m") and _LENGTH.search(name) is not None


def _ends_in_newtons(name: str) -> bool:
    return name.endswith("N") and _FORCE.search(name) is not None
