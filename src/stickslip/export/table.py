"""A waveform as a table of straight lines of whole steps: what a timer interrupt plays."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..units import QuantityError
from ..waveform.drive import evaluate
from ..waveform.signal import Waveform
from .subset import real

_MOST_STEPS = 20_000_000
_MOST_LINES = 20_000


class Line(NamedTuple):
    """So many steps from one value to another."""

    steps: int
    begin: float
    end: float


class Played(NamedTuple):
    """The lines of one period (of everything, without one) and how often they are played."""

    lines: list[Line]
    repeats: int
    unit: str

    @property
    def steps(self) -> int:
        """Of all repeats."""
        return self.repeats * sum(line.steps for line in self.lines)


def played(waveform: Waveform, h: float, duration: float | None, tolerance: float = 1e-5) -> Played:
    """The waveform in steps of h [s]; lines are off by at most `tolerance` of its range.

    Raises:
        QuantityError: no duration, or too many steps or lines for a table.
    """
    period: float | None = getattr(waveform, "period", None)
    seconds = duration if duration is not None else waveform.duration
    if duration is None and period and not math.isfinite(seconds):
        seconds = 8.0 * period
    if not (math.isfinite(seconds) and seconds >= h):
        raise QuantityError(f"duration = {seconds:g} s must be finite and at least one step of {h:g} s")
    repeats, length = 1, seconds
    if period and abs(period / h - round(period / h)) < 1e-6 and seconds >= 2.0 * period * (1.0 - 1e-9):
        repeats, length = round(seconds / period), period
    steps = round(length / h)
    if steps > _MOST_STEPS:
        raise QuantityError(f"{length:g} s are {steps} steps of {h:g} s, more than {_MOST_STEPS}")
    table = waveform.drive(length)
    times: NDArray[np.float64] = np.arange(steps + 1, dtype=np.float64) * h
    nearly = h * 1e-7  # a jump on the grid of the steps belongs to the later step
    begin = evaluate(table, times[:-1] + nearly)[0]
    end = evaluate(table, times[1:] - nearly)[0]
    low, high = waveform.range()
    lines = _lines(begin, end, tolerance * max(high - low, 1e-300))
    if len(lines) > _MOST_LINES:
        raise QuantityError(
            f"the waveform needs {len(lines)} lines, more than {_MOST_LINES}: give a shorter duration"
        )
    return Played(lines, repeats, waveform.unit)


def _lines(begin: NDArray[Any], end: NDArray[Any], tolerance: float) -> list[Line]:
    """As few lines as a greedy search finds."""
    made, first, count = [], 0, begin.size
    while first < count:
        length, best = 1, 1
        while first + length <= count and _straight(begin, end, first, length, tolerance):
            best, length = length, 2 * length
        low, high = best, min(length, count - first + 1)  # the first that fails is above best
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if _straight(begin, end, first, middle, tolerance) else (low, middle)
        made.append(Line(low, float(begin[first]), float(end[first + low - 1])))
        first += low
    return made


def _straight(begin: NDArray[Any], end: NDArray[Any], first: int, length: int, tolerance: float) -> bool:
    last = first + length - 1
    if last >= begin.size:
        return False
    share = np.arange(length + 1) / length
    line = begin[first] + share * (end[last] - begin[first])
    starts, ends = begin[first : last + 1], end[first : last + 1]
    return bool(
        np.all(np.abs(line[:-1] - starts) <= tolerance) and np.all(np.abs(line[1:] - ends) <= tolerance)
    )


def table_h(name: str, what: str, table: Played, h: float) -> str:
    """A header with the table."""
    rows = ",\n".join(f"    {{{line.steps}L, {real(line.begin)}, {real(line.end)}}}" for line in table.lines)
    upper = name.upper()
    return (
        f"/* {what}, in steps of {h!r} s: steps, value at the begin, value at the end [{table.unit}]. */\n"
        f"#ifndef {upper}_H\n#define {upper}_H\n\n"
        '#include "stickslip_player.h"\n\n'
        f"#define {upper}_STEP {h!r}\n"
        f"#define {upper}_REPEATS {table.repeats}L\n\n"
        f"static const stickslip_line {upper}[] = {{\n{rows}\n}};\n\n"
        f"static const stickslip_player {upper}_START = {{\n"
        f"    {upper}, (int)(sizeof {upper} / sizeof {upper}[0]), {upper}_REPEATS, 0, 0L, 0L}};\n\n#endif\n"
    )
