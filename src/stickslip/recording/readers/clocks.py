"""Checks of sample times, removal of incomplete samples, and interpolation of channels with different clocks
(time columns) onto one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

import numpy as np

from .. import RecordingError

Place = Callable[[int], str]


class Clocked(NamedTuple):
    """Channels with a common clock: sample times `time` [s], shape (n,), and `values` [n] by the channel's
    name."""

    clock: str  # name of the clock, for messages
    time: np.ndarray
    values: Mapping[str, np.ndarray]


def complete_samples(
    group: Clocked, labels: Mapping[str, str], missing: Literal["error", "drop"], place: Place
) -> Clocked:
    """Return the channels with a common clock, without incomplete samples (a time or value missing, NaN or
    infinite), after a check that time ascends.

    Args:
        group: the channels and their times.
        labels: text for each channel in messages (column and unit), by name.
        missing: "drop": leave incomplete samples out; "error": raise an error at the first one.
        place: function that takes the index of a sample and returns its place in the file as text.

    Raises:
        RecordingError: a number is missing (with "error"), no sample is left, or time does not ascend.
    """
    kept = np.isfinite(group.time)
    for values in group.values.values():
        kept &= np.isfinite(values)
    if not kept.all():
        if missing == "error":
            at = int(np.argmin(kept))
            bad = [group.clock] if not np.isfinite(group.time[at]) else []
            bad += [labels[name] for name, values in group.values.items() if not np.isfinite(values[at])]
            advice = (
                " (missing='drop', in a YAML file missing: drop, leaves such samples out)"
                if kept.sum() > 1
                else ", and no two samples are complete: name columns without it"
            )
            raise RecordingError(f"{place(at)}: {', '.join(bad)} is empty, NaN or infinite{advice}")
        group = Clocked(group.clock, group.time[kept], {name: v[kept] for name, v in group.values.items()})
    if not len(group.time):
        raise RecordingError(f"{group.clock}: there are no samples")
    ascending = group.time[1:] > group.time[:-1]
    if not ascending.all():
        at = int(np.argmin(ascending)) + 1
        raise RecordingError(
            f"{place(int(np.flatnonzero(kept)[at]))}: {group.clock} does not increase: "
            f"{group.time[at]:.9g} s after {group.time[at - 1]:.9g} s"
        )
    return group


def without_empty_end(group: Clocked) -> Clocked:
    """Return the channels up to their last finite time. In a table, the columns of a shorter group end with
    blanks, which are no missing samples."""
    ticks = np.flatnonzero(np.isfinite(group.time))
    end = int(ticks[-1]) + 1 if ticks.size else 0
    return Clocked(
        group.clock, group.time[:end], {name: values[:end] for name, values in group.values.items()}
    )


def onto_one_clock(common: Clocked, others: list[Clocked]) -> Clocked:
    """Return all channels at those times of the group `common` that lie within the time range of every other
    group; the channels of the others are interpolated linearly. The times of all groups must ascend.

    Raises:
        RecordingError: fewer than two times of the common clock lie within the range of the others.
    """
    if not others:
        return common
    start = max(group.time[0] for group in others)
    end = min(group.time[-1] for group in others)
    window = slice(*np.searchsorted(common.time, [start, np.nextafter(end, np.inf)]))
    time = common.time[window]
    if len(time) < 2:
        raise RecordingError(
            f"the clocks do not overlap: {common.clock} runs from {common.time[0]:.9g} s "
            f"to {common.time[-1]:.9g} s, {', '.join(group.clock for group in others)} "
            f"from {start:.9g} s to {end:.9g} s"
        )
    values = {name: values[window] for name, values in common.values.items()}
    for group in others:
        values |= {name: np.interp(time, group.time, series) for name, series in group.values.items()}
    return Clocked(common.clock, time, values)
