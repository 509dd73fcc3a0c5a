"""Approximate a waveform by straight lines over whole time steps, for a microcontroller to play.

The lines are a table in C; a timer interrupt at each step computes the next value from the table.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..engine.translator import real
from ..quantities.units import QuantityError
from ..waveform.drive import Drive, evaluate
from ..waveform.signal import Waveform

_MOST_STEPS = 20_000_000
_MOST_LINES = 20_000
# Smallest difference between waveform and line within a step that is reported, as a multiple of the tolerance
# of the table. A slow sine in long steps differs by less.
_BENT = 10.0
# Sizes of array operations in the search for lines, which only affect its speed. _SHORT: largest number of
# steps of a line that is searched from many starts at once; _AT_ONCE: largest number of starts times steps in
# this search; _LONG: largest number of steps searched at once for a longer line.
_SHORT, _AT_ONCE, _LONG = 64, 4096, 65536


class TableLine(NamedTuple):
    """A straight line of the table: number of time steps, value at its start, value at its end.

    The values are in the waveform's unit.
    """

    steps: int
    begin: float
    end: float


class Played(NamedTuple):
    """A waveform as a table of lines.

    `lines` cover one period (or the whole duration), `repeats` is the number of times that they are played,
    and `unit` is the unit of their values. `missed` is the largest difference within a step between the
    waveform and the straight line over this step, in `unit`, such as at a corner; 0 if it is small.
    """

    lines: list[TableLine]
    repeats: int
    unit: str
    between: bool = False  # True if the waveform jumps within a step; the table ramps over this step instead
    missed: float = 0.0

    @property
    def steps(self) -> int:
        """Return the number of time steps of all repeats together."""
        return self.repeats * sum(line.steps for line in self.lines)


def played(
    waveform: Waveform, h: float, duration: float | None, tolerance: float = 1e-5, name: str = "waveform"
) -> Played:
    """Return a waveform as a table of straight lines over whole steps.

    If the period is a whole number of steps and is played at least twice, the table has one period, and the
    played part is rounded to whole periods. Otherwise it is rounded to whole steps.

    Args:
        waveform: the drive signal or motion.
        h: time step, s.
        duration: played part, s; None: the waveform's duration, or eight periods if that is infinite.
        tolerance: largest error at the steps, as a fraction of the waveform's range.
        name: name of the waveform in errors.

    Raises:
        QuantityError: the duration is infinite or shorter than a step, or there are too many steps or lines.
    """
    period: float | None = getattr(waveform, "period", None)
    seconds = duration if duration is not None else waveform.duration
    if duration is None and period and not math.isfinite(seconds):
        seconds = 8.0 * period
    if not (math.isfinite(seconds) and seconds >= h):
        of = f"{name} = {waveform!r:.60}: its duration" if duration is None else "duration"
        raise QuantityError(f"{of} = {seconds:g} s must be finite and at least one step of {h:g} s")
    repeats, length = 1, seconds
    if period and abs(period / h - round(period / h)) < 1e-6 and seconds >= 2.0 * period * (1.0 - 1e-9):
        repeats, length = round(seconds / period), period
    steps = round(length / h)
    if steps > _MOST_STEPS:
        raise QuantityError(f"{name}: {length:g} s are {steps} steps of {h:g} s, more than {_MOST_STEPS}")
    table = waveform.drive(length)
    times: NDArray[np.float64] = np.arange(steps + 1, dtype=np.float64) * h
    # Values are taken just inside each step, so that a jump between two steps belongs to neither.
    nearly = h * 1e-7
    begin = evaluate(table, times[:-1] + nearly)[0]
    end = evaluate(table, times[1:] - nearly)[0]
    low, high = waveform.range()
    lines = _lines(begin, end, tolerance * max(high - low, 1e-300))
    if len(lines) > _MOST_LINES:
        reached = sum(line.steps for line in lines) * h
        raise QuantityError(
            f"{name} = {waveform!r:.60} needs more than {_MOST_LINES} lines in steps of {h:g} s, which end "
            f"at {reached:g} s of {length:g} s: give a shorter one, or a longer step; if it repeats, a "
            "period of whole steps"
        )
    return Played(lines, repeats, waveform.unit, *_between(table, h, begin, end, tolerance * (high - low)))


def _between(
    table: Drive, h: float, begin: NDArray[np.float64], end: NDArray[np.float64], least: float
) -> tuple[bool, float]:
    """Return what straight lines over whole steps miss of a drive within the steps.

    Args:
        table: the drive.
        h: time step, s.
        begin, end: value of the drive at the start and at the end of each step.
        least: jumps up to this one do not count, nor differences up to `_BENT` times as much, in the drive's
            unit.

    Returns:
        Whether the drive jumps within a step, not at its end; and the largest difference between the drive
        and its line in the other steps, at corners and in the middle, in the drive's unit.
    """
    breaks, nearly = table.start[1:], h * 1e-7
    jump = np.abs(evaluate(table, breaks + nearly)[0] - evaluate(table, breaks - nearly)[0]) > least
    inside = np.abs(breaks / h - np.rint(breaks / h)) > 1e-6
    times = np.concatenate((breaks[inside & ~jump], h * (np.arange(begin.size) + 0.5))) / h
    times = times[(times < begin.size) & ~np.isin(np.floor(times), np.floor(breaks[inside & jump] / h))]
    step = times.astype(np.int64)
    line = begin[step] + (times - step) * (end[step] - begin[step])
    missed = float(
        np.max(np.abs(evaluate(table, np.multiply(h, times, dtype=np.float64))[0] - line), initial=0.0)
    )
    return bool(np.any(inside & jump)), missed if missed > _BENT * least else 0.0


class _Steps(NamedTuple):
    """Values of a waveform in each step, arrays [steps].

    `begin` and `end` are the values at start and end of the step. `over` and `under` are the larger and the
    smaller of the value at the end and the value at the next step's start. They differ at a jump; a line that
    continues through the jump must be near both.
    """

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    over: NDArray[np.float64]
    under: NDArray[np.float64]


def _lines(begin: NDArray[Any], end: NDArray[Any], tolerance: float) -> list[TableLine]:
    """Approximate values by few lines with a greedy search: each line is as long as the tolerance allows.

    The search stops as soon as there are more than `_MOST_LINES` lines; the caller refuses this table.

    Args:
        begin: value at the start of each step.
        end: value at the end of each step.
        tolerance: largest error of a line, in the unit of the values.
    """
    then = np.append(begin[1:], end[-1])
    steps = _Steps(begin, end, np.maximum(end, then), np.minimum(end, then))
    made: list[TableLine] = []
    first = 0
    # Guesses from the previous lines: number of steps that are searched for the end of the next line, and
    # number of consecutive starts from which lines are searched at once.
    likely, ahead = 8, 16

    def add(length: int) -> None:
        nonlocal first
        made.append(TableLine(length, float(begin[first]), float(end[first + length - 1])))
        first += length

    while first < begin.size and len(made) <= _MOST_LINES:
        of, starts = first, min(ahead, _AT_ONCE // likely, begin.size - first - likely + 1)
        if likely <= _SHORT and starts > 0:
            lengths = _short(steps, first, starts, likely, tolerance)
            while first < of + starts and lengths[first - of]:
                add(lengths[first - of])
            ahead = max(16, 2 * (first - of))
        if first < of + max(starts, 1):
            add(_longest(steps, first, likely, tolerance))
        likely = max(8, 4 * made[-1].steps)
    return made


def _short(steps: _Steps, first: int, starts: int, most: int, tolerance: float) -> list[int]:
    """Return the largest length of a line, in steps, from each of several consecutive steps.

    The length is 0 if it may exceed `most`; `_longest` must then find it.

    Args:
        steps: values of the waveform.
        first: index of the first step from which a line starts.
        starts: number of consecutive steps from which lines start.
        most: number of steps that are searched from each start.
        tolerance: largest error of a line, in the unit of the values.
    """
    end, over, under = (sliding_window_view(part, most)[first : first + starts] for part in steps[1:])
    low, high = np.full(starts, -np.inf), np.full(starts, np.inf)
    begin = steps.begin[first : first + starts, None]
    fits, low, high = _fitting(begin, end, over, under, 0, low, high, tolerance)
    return np.where(low <= high, 0, most - np.argmax(fits[:, ::-1], axis=1)).tolist()


def _longest(steps: _Steps, first: int, likely: int, tolerance: float) -> int:
    """Return the largest length, in steps, of a line from the step `first` on.

    The steps are searched in parts of increasing length. The first part has `likely` steps, or `_SHORT` if
    that is more; one part is enough if the line ends in it.
    """
    length, done, part = 1, 0, max(likely, _SHORT)
    low, high = np.float64(-np.inf), np.float64(np.inf)
    while low <= high and first + done < steps.begin.size:
        of = slice(first + done, first + done + part)
        end, over, under = steps.end[of], steps.over[of], steps.under[of]
        fits, low, high = _fitting(steps.begin[first], end, over, under, done, low, high, tolerance)
        where = np.flatnonzero(fits)
        length = done + int(where[-1]) + 1 if where.size else length
        done, part = done + part, min(2 * part, _LONG)
    return length


def _fitting(
    begin: Any, end: Any, over: Any, under: Any, done: int, low: Any, high: Any, tolerance: float
) -> tuple[Any, Any, Any]:
    """Test to which steps a straight line from a start stays within the tolerance of all values between.

    The slopes that pass all values so far within the tolerance form a cone [sklansky1980]. A line ends at a
    value of the waveform, and its slope must lie in the cone of the previous values.

    Args:
        begin: value at the start of the line.
        end, over, under: values of the steps, as in `_Steps`; the last axis is the step.
        done: number of steps between the start and the first of these steps.
        low, high: range of slopes, per step, that the previous steps allow.
        tolerance: largest error, in the unit of the values.

    Returns:
        For each step, whether a line may end with it, and the range of slopes (low, high) after the last one.
    """
    count = np.arange(done + 1, done + 1 + end.shape[-1])
    lows, highs = (over - begin - tolerance) / count, (under - begin + tolerance) / count
    lows[..., 0], highs[..., 0] = np.maximum(lows[..., 0], low), np.minimum(highs[..., 0], high)
    np.maximum.accumulate(lows, axis=-1, out=lows)
    np.minimum.accumulate(highs, axis=-1, out=highs)
    slope = (end - begin) / count
    fits = np.empty(slope.shape, np.bool_)
    fits[..., 0] = (low <= slope[..., 0]) & (slope[..., 0] <= high)
    np.less_equal(lows[..., :-1], slope[..., 1:], out=fits[..., 1:])
    fits[..., 1:] &= slope[..., 1:] <= highs[..., :-1]
    return fits, lows[..., -1], highs[..., -1]


def table_h(name: str, what: str, table: Played, h: float) -> str:
    """Return the text of a C header with the table of a waveform.

    The header also defines the step, the number of repeats, a flag for jumps within a step
    (`Played.between`), and the start of a player (`stickslip_player`).

    Args:
        name: name of the C array, in lower case.
        what: description of the waveform for the comment.
        table: the lines.
        h: time step, s.
    """
    rows = ",\n".join(f"    {{{line.steps}L, {real(line.begin)}, {real(line.end)}}}" for line in table.lines)
    upper = name.upper()
    return (
        f"/* {what}, in steps of {h!r} s: steps, value at the begin, value at the end [{table.unit}]. */\n"
        f"#ifndef {upper}_H\n#define {upper}_H\n\n"
        '#include "stickslip_player.h"\n\n'
        f"#define {upper}_STEP {h!r}\n"
        f"#define {upper}_REPEATS {table.repeats}L\n"
        f"#define {upper}_JUMPS_BETWEEN {int(table.between)} /* 1: a jump is played over a step */\n"
        f"#define {upper}_MISSED {table.missed!r} /* largest difference from its line within a step */\n"
        f'#define {upper}_UNIT "{table.unit}"\n\n'
        f"static const stickslip_line {upper}[] = {{\n{rows}\n}};\n\n"
        f"static const stickslip_player {upper}_START = {{\n"
        f"    {upper}, (int)(sizeof {upper} / sizeof {upper}[0]), {upper}_REPEATS, 0, 0L, 0L}};\n\n#endif\n"
    )
