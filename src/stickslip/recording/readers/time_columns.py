"""Assignment of several time columns of a table to its other columns: each is the clock of the columns that
follow."""

from __future__ import annotations

import re

import numpy as np

from .file_units import in_seconds, to_si_unit
from .source import FileChannel, FileContent, Rows, is_clock

LOOKED = 1000  # number of samples at the start of a file with which time columns are compared
AGREE = 0.1  # largest difference of two clocks, in sampling intervals, that may come from rounding
_NAMED_FOR = re.compile(r"(time|t|zeit)[ _.-]\w.*|.*\w[ _.-](time|t|zeit)", re.IGNORECASE)


def with_clocks(source: FileContent) -> FileContent:
    """Return the content of a file with the index of a time column as `clock` of each channel, if the file
    has several time columns; otherwise the unchanged content.

    A time column that no column follows is ignored if it agrees with the next time column, such as a date
    beside seconds. If it does not agree, the content is unchanged, so that `select` asks the user for the
    time column.
    """
    channels = source.channels
    maybe = [i for i, one in enumerate(channels) if one.numeric and _may_be_time(one)]
    if len(maybe) < 2 or any(one.clock is not None for one in channels):
        return source
    ticks = {
        i: _seconds(channels[i], values)
        for i, values in zip(maybe, source.read(maybe, Rows(0, LOOKED)), strict=True)
    }
    clocks = [i for i in maybe if is_clock(channels[i]) or _increases(ticks[i])]
    others = [i for i, one in enumerate(channels) if one.numeric and i not in maybe]
    served = {i: max((c for c in clocks if c < i), default=clocks[0]) for i in others} if clocks else {}
    used = [c for c in clocks if c in served.values()]
    for idle in [c for c in clocks if c not in used]:
        near = min((c for c in used if c > idle), default=max(used, default=idle))
        if near == idle or not _agree(ticks[idle], ticks[near]):
            return source
    served |= {c: c for c in used}
    return source._replace(
        channels=tuple(one._replace(clock=served.get(i)) for i, one in enumerate(channels))
    )


def _may_be_time(channel: FileChannel) -> bool:
    """Return True if the unit of a channel is a unit of time or, without a unit, its name may mean a time."""
    if channel.unit:
        return in_seconds(channel)
    return is_clock(channel) or _NAMED_FOR.fullmatch(channel.name.strip()) is not None


def _seconds(channel: FileChannel, values: np.ndarray) -> np.ndarray:
    return values * to_si_unit(channel.unit).factor if channel.unit else values


def _increases(ticks: np.ndarray) -> bool:
    real = ticks[np.isfinite(ticks)]
    return real.size > 1 and bool(np.all(np.diff(real) > 0.0))


def _agree(one: np.ndarray, other: np.ndarray) -> bool:
    """Return True if two clocks (times [n], s) differ only by a constant offset and rounding, or have fewer
    than two times.

    Rounding is at most `AGREE` sampling intervals of `other`. If times repeat in `one`, which may count full
    seconds, the smallest step of `one` is added.
    """
    if one.size < 2:
        return True
    step, own = float(np.nanmedian(np.abs(np.diff(other)))), np.abs(np.diff(one))
    # Times that repeat show a clock with a coarse step, such as full seconds.
    coarse = float(own[own > 0.0].min(initial=np.inf)) if np.any(own == 0.0) else 0.0
    apart = (one - one[0]) - (other - other[0])
    return bool(np.all(np.abs(apart) <= AGREE * step + coarse))
