"""Reader of universal files (UFF, data set 58) of programs for vibration and modal analysis, by pyuff, extra
stickslip[modal]."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from ...gate.files import name_of, opened
from .. import RecordingError
from .library import Signal, SignalGroup, clocked_source, held, library, no_file_left_open, read_by_library
from .source import FileContent, add_format

ENDINGS = (".uff", ".unv", ".uf")
_WHAT = "universal file (UFF)"
_BEGINS = re.compile(rb"\s{0,100}-1\s*?\n\s{0,100}\d{2,4}b?\s")
_TIME = 17  # code of a time axis in data set 58
_DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read_uff(path: Path) -> FileContent:
    """Return the content of a universal file (UFF): its functions of time (data set 58) as channels.

    Functions with the same times share a clock.

    Raises:
        RecordingError: pyuff is not installed, the file is damaged, or contains no functions of time.
        GateError: there are more channels or samples than `LIMITS` allows.
    """
    functions = data_sets(path)
    of_time = [one for one in functions if one.get("abscissa_spec_data_type") == _TIME]
    if not of_time:
        frequency = (
            " (frequency responses: stickslip.recording.read_frequency_response reads them)"
            if functions
            else ""
        )
        raise RecordingError(f"the {_WHAT} holds no functions of time{frequency}")
    names = Counter(_name(one) for one in of_time)
    clocks: dict[bytes, tuple[np.ndarray, list[Signal]]] = {}
    for one in of_time:
        times, values = np.asarray(one["x"], float), np.asarray(one["data"])
        name = f"{_name(one)} {point(one)}" if names[_name(one)] > 1 else _name(one)
        signal = Signal(name, _label(one, "ordinate_axis_units_lab"), values.size, held(values))
        clocks.setdefault(times.tobytes(), (times, []))[1].append(
            signal._replace(numeric=not np.iscomplexobj(values))
        )
    return clocked_source(
        path,
        "uff",
        [SignalGroup(Signal("time", "s", times.size, held(times)), of) for times, of in clocks.values()],
        _WHAT,
    )


def data_sets(path: Path) -> list[dict[str, Any]]:
    """Return the functions (data sets of type 58) in a universal file, as the dictionaries of pyuff.

    Raises:
        RecordingError: pyuff is not installed, or the file is damaged.
    """
    pyuff = library("pyuff", "universal files (UFF)", "pyuff", "modal")
    with opened(path) as file, no_file_left_open(), read_by_library(_WHAT):
        content = pyuff.UFF(name_of(file))
        wanted = [k for k, kind in enumerate(content.get_set_types()) if int(kind) == 58]
        return [content.read_sets(k) for k in wanted]


def point(one: dict[str, Any]) -> str:
    """Return number and direction of the response point of a function as text, such as "8 +Z"; `one` is the
    function's dictionary of pyuff."""
    return f"{one.get('rsp_node', 0)} {_DIRECTIONS.get(one.get('rsp_dir', 0), '')}".strip()


def _name(one: dict[str, Any]) -> str:
    return _label(one, "ordinate_axis_lab") or _label(one, "id1") or "value"


def _label(one: dict[str, Any], key: str) -> str:
    text = str(one.get(key, "")).strip()
    return "" if text == "NONE" else text


add_format(read_uff, "uff", ENDINGS, lambda head, ending: bool(_BEGINS.match(head)))
