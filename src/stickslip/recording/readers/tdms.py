"""Reader of TDMS files of LabVIEW and other NI programs, by npTDMS, extra stickslip[labview]."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from ...gate.files import name_of, opened
from .library import Signal, SignalGroup, clocked_source, equally_spaced, library, read_by_library
from .source import FileContent, Rows, add_format

_WHAT = "TDMS file"
# Time between 1904, from which dates in TDMS files count, and 1970, in s.
_SINCE_1904 = 2_082_844_800.0
_FRACTION = 2.0**-64  # unit of the fractions of a second in these dates, s
_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def read_tdms(path: Path) -> FileContent:
    """Return the content of a TDMS file: its channels, each with the clock that its properties describe.

    Raises:
        RecordingError: npTDMS is not installed, or the file is damaged or has no channels with samples.
        GateError: there are more channels or samples than `LIMITS` allows.
    """
    tdms = library("nptdms", "TDMS files", "npTDMS", "labview")
    with read_by_library(_WHAT), opened(path) as file:
        content = tdms.TdmsFile.read_metadata(name_of(file))
        found = [one for group in content.groups() for one in group.channels() if len(one)]
        names = Counter(one.name for one in found)
        clocks: dict[tuple[float, float, int] | None, list[Signal]] = {}
        for one in found:
            clocks.setdefault(_clock(one), []).append(_signal(path, tdms, one, names[one.name] > 1))
    return clocked_source(
        path,
        "tdms",
        [SignalGroup(None if said is None else equally_spaced(*said), of) for said, of in clocks.items()],
        _WHAT,
    )


def _clock(channel: Any) -> tuple[float, float, int] | None:
    """Return first time [s], sampling interval [s] and number of samples of a channel of npTDMS; None if its
    properties contain no positive interval."""
    step = channel.properties.get("wf_increment")
    if not isinstance(step, int | float) or not step > 0:
        return None
    return float(channel.properties.get("wf_start_offset", 0.0)), float(step), len(channel)


def _signal(path: Path, tdms: Any, channel: Any, shared: bool) -> Signal:
    kind = channel.dtype.kind
    unit = next((str(text) for name in _UNITS if (text := channel.properties.get(name))), "")
    name = f"{channel.group_name}.{channel.name}" if shared else channel.name

    def load(rows: Rows) -> np.ndarray:
        with opened(path) as file, tdms.TdmsFile.open(name_of(file), raw_timestamps=True) as content:
            one = content[channel.group_name][channel.name]
            stop = len(one) if rows.stop is None else min(rows.stop, len(one))
            return one.read_data(min(rows.start, stop), max(stop - rows.start, 0))

    key = (channel.group_name, channel.name)
    if kind != "M":
        return Signal(name, unit, len(channel), load, key, kind in "iufb")
    start: Any = load(Rows(0, 1))
    first = int(start.seconds[0])

    def since(rows: Rows) -> np.ndarray:
        dates: Any = load(rows)
        return (dates.seconds - first).astype(float) + dates.second_fractions * _FRACTION

    return Signal(name, "s", len(channel), since, key, epoch=float(first) - _SINCE_1904)


add_format(read_tdms, "tdms", (".tdms",), lambda head, ending: head.startswith(b"TDSm"))
