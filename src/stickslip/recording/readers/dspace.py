"""Reader of captures (recordings) of dSPACE boards in MAT files, in two layouts.

In the flat layout, ``trace_x`` is the time [s] and each row of ``trace_y`` a signal, without names or units
[kang2007, app. 8]; files of this package have these in ``trace_names`` and ``trace_units``. In the structure
that ControlDesk writes, one variable has the clocks ``.X(j).Data``, and the signals ``.Y(k).Name`` and
``.Y(k).Data``. With several clocks, a signal and its clock have the same ``.Raster``.

The clocks are the first channels. So with one clock, the index of a signal (from 0) is its row or k in MATLAB
(from 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...gate.limits import LIMITS
from .. import RecordingError
from .arrays import ArrayChannel, Leaf, array_parts
from .source import FileChannel

Capture = tuple[dict[str, Leaf], list[tuple[ArrayChannel, FileChannel]]]


def find_capture(tree: dict[str, Any]) -> Capture | None:
    """Return the arrays and channels of a dSPACE capture in the variables of a MAT file (`tree`: variables by
    name); None if there is no capture.

    The result is a dictionary of arrays (`Leaf`) by name, and a list with a tuple for each channel: its part
    of an array and its description.

    Raises:
        RecordingError: the numbers of samples, or the rasters, of a capture's signals and clocks do not
            match, or there are too many signals.
    """
    if isinstance(tree.get("trace_x"), Leaf) and isinstance(tree.get("trace_y"), Leaf):
        return _flat(tree["trace_x"], tree["trace_y"], tree)
    for variable in tree.values():
        if isinstance(variable, dict) and _has_data(variable.get("X")) and _has_data(variable.get("Y")):
            return _structure(_elements(variable["X"]), _elements(variable["Y"]))
    return None


def _flat(trace_x: Leaf, trace_y: Leaf, tree: dict[str, Any]) -> Capture:
    samples = int(np.prod(trace_x.shape))
    if len(trace_y.shape) != 2 or samples not in trace_y.shape:
        raise RecordingError(f"trace_y has the shape {trace_y.shape}, trace_x {samples} samples")
    # With as many signals as samples, the axes are ambiguous: rows are then taken as signals, as is usual.
    axis = 1 if trace_y.shape[1] == samples else 0
    channels = [(array_parts({"trace_x": trace_x})[0], FileChannel("trace_x", "s", ("trace_x", 0), 0))]
    count = trace_y.shape[1 - axis]
    if count > LIMITS.channels:
        raise RecordingError(f"trace_y has {count:,} signals; {LIMITS.channels:,} are read")
    names, units = (_texts(tree.get(key), count) for key in ("trace_names", "trace_units"))
    for row in range(count):
        name = f"trace_y({row + 1},:)" if axis == 1 else f"trace_y(:,{row + 1})"
        channel = FileChannel(names[row] or name, units[row], ("trace_y", row), 0, header=name)
        channels.append((ArrayChannel("trace_y", axis, (row,), False), channel))
    return {"trace_x": trace_x, "trace_y": trace_y}, channels


def _texts(node: Any, count: int) -> list[str]:
    """Return the `count` texts of a cell array (`node`, a list); empty texts if it is missing or has another
    length."""
    known = isinstance(node, list) and len(node) == count
    return [_text(one) for one in node] if known else [""] * count


def _structure(clocks: list[dict[str, Any]], signals: list[dict[str, Any]]) -> Capture:
    leaves: dict[str, Leaf] = {}
    channels = []
    for letter, elements in (("X", clocks), ("Y", signals)):
        for k, element in enumerate(elements):
            array = f"{letter}({k + 1})"
            leaves[array] = element["Data"]
            name = _text(element.get("Name")) or array
            clock = k if letter == "X" else _clock_of(element, clocks)
            unit = _text(element.get("Unit")) or ("s" if letter == "X" else "")
            part = array_parts({array: element["Data"]})[0]
            channels.append((part, FileChannel(name, unit, (letter, k), clock)))
    return leaves, channels


def _clock_of(signal: dict[str, Any], clocks: list[dict[str, Any]]) -> int:
    if len(clocks) == 1:
        return 0
    rasters = [_text(clock.get("Raster")) for clock in clocks]
    raster = _text(signal.get("Raster"))
    if not raster or rasters.count(raster) != 1:
        name = _text(signal.get("Name"))
        raise RecordingError(f"the signal {name!r} has the raster {raster!r}; the clocks have {rasters}")
    return rasters.index(raster)


def _elements(node: Any) -> list[dict[str, Any]]:
    return node if isinstance(node, list) else [node]


def _has_data(node: Any) -> bool:
    elements = _elements(node)
    return bool(elements) and all(isinstance(e, dict) and isinstance(e.get("Data"), Leaf) for e in elements)


def _text(node: Any) -> str:
    return node.strip() if isinstance(node, str) else ""
