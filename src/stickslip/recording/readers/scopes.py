"""Reader of waveform files of oscilloscopes (Tektronix, LeCroy, Keysight, Rigol, Yokogawa), by RigolWFM,
extra stickslip[scopes]."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ...gate.files import name_of, opened
from .. import RecordingError
from .library import (
    Signal,
    SignalGroup,
    clocked_source,
    equally_spaced,
    held,
    library,
    no_file_left_open,
    read_by_library,
)
from .source import FileContent, add_format

_WHAT = "waveform of an oscilloscope"
_ISF = re.compile(rb".{0,4000}?:?CURVE? +#(?P<digits>[1-9])(?P<bytes>\d{1,9})", re.DOTALL)
_BEGINNINGS = (
    rb"LLWFM|[\x0f\xf0]{2}:WFM#",  # start of Tektronix files
    rb".{0,64}?WAVEDESC",  # start of LeCroy files
    rb"AG(01|03|10)",  # start of Agilent and Keysight files
    # start of Rigol files
    rb"\xa5\xa5[\x00\x38]\x00|\xa1\xa5\x00\x00|\xa5\xa5\xa4\x01|\x01\xff\xff\xff|RG0[13]",
)
_KNOWN = re.compile(b"|".join(_BEGINNINGS), re.DOTALL)
_RIGOL_UNITS, _KEYSIGHT_UNITS = {0: "W", 1: "A", 2: "V"}, {1: "V", 4: "A"}
# Distance, in bytes, from the word WAVEDESC to the unit of the values, a text of up to 48 bytes.
_LECROY_UNIT = 196
_HEAD = 4096


def read_scope(path: Path) -> FileContent:
    """Return the channels of a waveform file of an oscilloscope.

    Raises:
        RecordingError: RigolWFM is not installed, the file is damaged, or of a kind that RigolWFM misreads.
        GateError: there are more channels or samples than `LIMITS` allows.
    """
    wfm = library("RigolWFM.wfm", "waveforms of oscilloscopes", "RigolWFM", "scopes")
    with opened(path) as file, no_file_left_open(), read_by_library(_WHAT):
        head = file.read(_HEAD)
        isf = _isf_settings(head, path.stat().st_size)
        clocks = _by_clock(wfm.Wfm.from_file(name_of(file)), head, isf)
    return clocked_source(
        path, "oscilloscope", [SignalGroup(equally_spaced(*said), of) for said, of in clocks.items()], _WHAT
    )


def _by_clock(found: Any, head: bytes, isf: dict[str, str]) -> dict[tuple[float, float, int], list[Signal]]:
    """Return the signals of a file as lists by their clock, a tuple: first time [s], sampling interval [s]
    and number of samples. Channels without samples are left out.

    Args:
        found: content of the file, from RigolWFM.
        head: first bytes of the file.
        isf: settings of a Tektronix ISF file; empty for other files.
    """
    clocks: dict[tuple[float, float, int], list[Signal]] = {}
    for one in found.channels:
        if not one.enabled or one.volts is None or not len(one.volts):
            continue
        clock = float(one.times[0]), float(one.seconds_per_point), len(one.volts)
        unit = _unit(found.parser_name, one.unit, head, isf)
        # The library writes "CH 1", an oscilloscope's screen shows CH1.
        name = one.name.replace(" ", "")
        clocks.setdefault(clock, []).append(Signal(name, unit, len(one.volts), held(one.volts)))
    return clocks


def _isf_settings(head: bytes, size: int) -> dict[str, str]:
    """Return the settings in the header of a Tektronix ISF file, by the first five letters of their keys;
    empty for other files.

    Args:
        head: first bytes of the file.
        size: size of the file in bytes.

    Raises:
        RecordingError: the file is cut off, or its numbers have a form that the library misreads.
    """
    curve = _ISF.match(head)
    if not curve:
        return {}
    digits = int(curve["digits"])
    there, said = size - curve.start("bytes") - digits, int(curve["bytes"][:digits])
    if there < said:
        raise RecordingError(f"the file is cut off: it holds {there:,} of {said:,} bytes of samples")
    text = head.partition(b"CURV")[0].decode("latin-1")
    pairs = (part.strip().rsplit(":", 1)[-1].split(None, 1) for part in text.split(";"))
    settings = {pair[0].upper()[:5]: pair[1].strip('" ') for pair in pairs if len(pair) == 2}
    form = settings.get("BN_F", settings.get("BN_FM", "RI"))
    if form != "RI":
        raise RecordingError(
            f"the samples are saved as {form!r} (BN_FMT), of which RigolWFM reads only RI: save it as CSV"
        )
    return settings


def _unit(parser: str, said: Any, head: bytes, isf: dict[str, str]) -> str:
    """Return the unit of a channel's values, from the file's header or from the library's unit code; "" if
    unknown.

    Args:
        parser: name of the library's parser.
        said: unit code of the library.
        head: first bytes of the file.
        isf: settings of a Tektronix ISF file; empty for other files.
    """
    if isf:
        return isf.get("YUN", isf.get("YUNIT", ""))
    code = getattr(said, "value", said)
    if parser == "agilent_bin":
        return _KEYSIGHT_UNITS.get(code, "")
    if parser == "lecroy_trc":
        at = head.find(b"WAVEDESC") + _LECROY_UNIT
        return head[at : at + 48].partition(b"\0")[0].decode("latin-1").strip()
    return _RIGOL_UNITS.get(code, "") if parser.startswith(("wfm", "bin", "dho")) else ""


def _is_scope(head: bytes, ending: str) -> bool:
    if _KNOWN.match(head) or (_ISF.match(head) and b"NR_P" in head):
        return True
    dho = ending == ".wfm" and head.startswith(b"\x02\x00\x00\x00")
    return dho or (head.startswith(b":") and all(one in head for one in (b"NR_PT:", b"XIN:", b"YMU:")))


add_format(read_scope, "oscilloscope", (".isf", ".wfm", ".trc"), _is_scope)
