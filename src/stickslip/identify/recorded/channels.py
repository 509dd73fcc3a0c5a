"""Checked access to the channels of recordings that an identification needs: names, units, drives,
saturation, jumps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...recording import SCALE_UNCERTAINTY, STANDARD_NAMES, RecordingError
from ...recording.schema import refuse_unit
from ...waveform.signal import Waveform
from .levels import converter_step

FEWEST_SAMPLES = 10  # fewest samples of a channel; a shorter one is refused
# Fewest equal samples in a row at the largest or smallest value that show clipping; fewer can be chance.
FEWEST_CLIPPED = 5
# A channel that stays at its greatest or least level is clipped if it passed this number of converter levels
# in an equal time before. A smooth reversal passes up to nine, up to twelve with noise, that of a sawtooth
# one or two.
FEWEST_LEVELS = 12.5
# A channel that settles at its end value slows down; a channel that is cut off does not. Take the time for
# the last 1.5 levels. BEFORE times as long ago, a settling channel was more than 2 BEFORE levels away from
# the end value; a channel at constant speed was 1.5 BEFORE levels away.
BEFORE = 4
# Largest change of the drive during which an unclipped channel may stay on one level at a reversal, as the
# motion of the channel in converter steps. A piezo is about half as steep just after a reversal.
HIDDEN = 3.0
# Smallest change of a drive from one sample to the next that is an edge, relative to its range.
EDGE = 0.05


def recordings_of(recordings: xr.Dataset | Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Return one or several recordings as a list.

    Raises:
        RecordingError: the list is empty, an item is not a recording or is given twice, or the scale of a
            channel has an uncertainty that is not a number from 0 to 1.
    """
    if hasattr(recordings, "columns"):  # the columns of a pandas table would be taken as a list of names
        raise RecordingError(f"a {type(recordings).__name__} is no recording: make_recording makes one")
    found = [recordings] if isinstance(recordings, xr.Dataset) else list(recordings)
    if not found:
        raise RecordingError("recordings is empty: give at least one, as ss.read_recording returns it")
    for i, recording in enumerate(found, start=1):
        if not isinstance(recording, xr.Dataset):
            raise RecordingError(
                f"recording {i} is a {type(recording).__name__}, not an xarray.Dataset: "
                "ss.read_recording reads one from a file, ss.make_recording makes one from arrays"
            )
        for name, variable in recording.variables.items():
            said = variable.attrs.get(SCALE_UNCERTAINTY, 0.0)
            if isinstance(said, str) or not 0.0 <= said < 1.0:
                raise RecordingError(
                    f"{name} of recording {i}: its attribute {SCALE_UNCERTAINTY} = {said!r} must be a share "
                    "from 0 to 1: the relative standard uncertainty of its scale"
                )
    _refuse_twice(found)
    return found


def _refuse_twice(recordings: Sequence[xr.Dataset]) -> None:
    """Raise RecordingError for a recording that is given twice. To save time, only recordings with equal last
    samples are compared in full."""
    ends: dict[Any, list[int]] = {}
    for i, one in enumerate(recordings):
        end = frozenset((name, np.ravel(v.values)[-1:].tobytes()) for name, v in one.variables.items())
        alike = ends.setdefault(end, [])
        for k in alike:
            if one is recordings[k] or one.equals(recordings[k]):
                raise RecordingError(f"recordings {k + 1} and {i + 1} are the same: it would count twice")
        alike.append(i)


def names_of(recordings: Sequence[xr.Dataset]) -> list[str]:
    """Return the name of each recording: its title, if all titles are different; else "recording 1", ...."""
    titles = [str(r.attrs.get("title", "")) for r in recordings]
    if all(titles) and len(set(titles)) == len(titles):
        return titles
    return [f"recording {i}" for i in range(1, len(recordings) + 1)]


def channel(recording: xr.Dataset, name: str, where: str, varies: bool = False) -> NDArray[np.float64]:
    """Return the values of a channel, shape (n,).

    Args:
        recording: over "time".
        name: name of the channel.
        where: name of the recording in errors.
        varies: True: refuse a constant channel.

    Raises:
        RecordingError: the channel is missing, has a unit that it cannot have, has fewer than
            `FEWEST_SAMPLES` samples, is not finite, or is constant.
    """
    meaning = STANDARD_NAMES.get(name)
    unit = f" [{meaning.unit}]" if meaning else ""
    if name not in recording:
        there = ", ".join(map(str, recording.data_vars)) or "no channel"
        instead = " (or give drive=, where the call takes it)" if name == "drive_voltage" else ""
        raise RecordingError(
            f"{where} has no {name}{unit}; it has {there}. Name its column when you read it{instead}"
        )
    refuse_unit(name, str(recording[name].attrs.get("units", "")), f" of {where}")
    values = np.ascontiguousarray(recording[name].values, dtype=float)
    if "time" not in recording.coords or values.shape != recording["time"].shape:
        raise RecordingError(f"{name}{unit} of {where} is not a channel over time [s]")
    if not values.size:
        raise RecordingError(
            f"{name}{unit} of {where} is empty; at least {FEWEST_SAMPLES} samples are needed"
        )
    if values.size < FEWEST_SAMPLES:
        raise RecordingError(
            f"{name}{unit} of {where} has {values.size} samples; at least {FEWEST_SAMPLES} are needed"
        )
    if not np.all(np.isfinite(values)):
        raise RecordingError(f"{name}{unit} of {where} is not finite everywhere")
    if varies and not np.ptp(values) > 0.0:
        raise RecordingError(
            f"{name}{unit} of {where} is {values[0]:g} throughout: a constant says nothing about friction"
        )
    return values


def same_number(items: Sequence[Any] | None, recordings: Sequence[xr.Dataset], what: str) -> list[Any]:
    """Return the items as a list, one for each recording; None for each if no items are given.

    Raises:
        RecordingError: there is another number of items than recordings; `what` names the items in the error.
    """
    if items is None:
        return [None] * len(recordings)
    if len(items) != len(recordings):
        raise RecordingError(f"there are {len(items)} {what} for {len(recordings)} recordings")
    return list(items)


def drives_of(
    drive: Waveform | Sequence[Waveform | None] | None, recordings: Sequence[xr.Dataset]
) -> list[Waveform | None]:
    """Return the waveform of each recording, None if not given; a single waveform is for all.

    Raises:
        RecordingError: there is another number of waveforms than recordings.
    """
    # A single waveform may be a (named) tuple, like a sequence of waveforms; only it has the method `drive`.
    given: Any = [drive] * len(recordings) if hasattr(drive, "drive") else drive
    return same_number(given, recordings, "drives")


def unit_of(recordings: Sequence[xr.Dataset], name: str) -> str:
    """Return the unit of a channel, the same in all recordings: from its attribute "units", else the usual
    unit of this name ("" for an unknown name).

    Raises:
        RecordingError: recordings have different units.
    """
    usual = STANDARD_NAMES[name].unit if name in STANDARD_NAMES else ""
    found = [str(r[name].attrs.get("units", "") or usual) if name in r else usual for r in recordings]
    for where, unit in zip(names_of(recordings), found, strict=True):
        if unit != found[0]:
            raise RecordingError(
                f"{name} of {where} is in {unit}, of {names_of(recordings)[0]} in {found[0]}"
            )
    return found[0]


def refuse_clipped(
    values: NDArray[np.float64],
    name: str,
    where: str,
    drive: NDArray[np.float64] | None = None,
    step: float = 0.0,
    rests: bool = False,
) -> None:
    """Raise `RecordingError` if a channel is saturated at its largest or smallest value.

    A saturated channel reaches the value in full motion and stays exactly there, for at least
    `FEWEST_CLIPPED` samples and longer than a smooth reversal stays on one level of the converter.

    Args:
        values: values of the channel, [n].
        name: name of the channel.
        where: name of the recording.
        drive: drive that the channel follows, [n]: it must move while the channel stays at its end.
        step: converter step, in the unit of the channel; by default it is estimated.
        rests: True for a channel that rests at its ends, such as the force of a slipping contact. It is
            saturated if it has noise elsewhere but not there.
    """
    meaning = STANDARD_NAMES.get(name)
    unit = f" [{meaning.unit}]" if meaning else ""
    change = np.abs(np.diff(values))
    moving = change[change > 0.0]
    if not moving.size:
        return
    hidden = 0.0 if drive is None else HIDDEN * step * float(np.ptp(drive) / np.ptp(values))
    for end, what in ((values.max(), "greatest"), (values.min(), "least")):
        at = np.flatnonzero(np.diff(np.concatenate([[0], (values == end).astype(int), [0]])))
        for first, last in zip(at[::2], at[1::2], strict=True):
            # Clipping shortens the last change before the end value, so the larger of the last two changes
            # shows the speed.
            before = change[max(first - 2, 0) : first].max(initial=0.0)
            if drive is not None and np.ptp(drive[first:last]) <= hidden:
                continue
            if last - first < FEWEST_CLIPPED:
                continue
            level = step or converter_step(values)
            came_from = values[max(2 * first - last, 0) : first + 1]
            if not rests and np.ptp(came_from) < FEWEST_LEVELS * level:
                continue
            if not rests and level and _settles(np.abs(values[:first] - end) / level):
                continue
            if _noisy(values) if rests else before >= 0.5 * np.median(moving):
                raise RecordingError(
                    f"{name}{unit} of {where} is clipped: it stays at its {what} value, {end:g}, for "
                    f"{last - first} samples from sample {first} on; it must be recorded within the sensor's "
                    "and the converter's range"
                )


def _settles(away: NDArray[np.float64]) -> bool:
    """Return True if a channel slows down before it stays at an end value (see `BEFORE`). `away` are the
    distances of all samples before from this value, in converter steps, [n]."""
    further = np.flatnonzero(away > 1.5)
    last = away.size - 1 - int(further[-1]) if further.size else away.size
    return last > 1 and bool(away[max(away.size - BEFORE * last, 0)] > 2.0 * BEFORE)


def _noisy(values: NDArray[np.float64]) -> bool:
    """Return True if a channel [n] has noise above its converter steps, except at its largest and smallest
    value.

    Fourth differences of noise alternate in sign; those of a smooth signal do not.
    """
    ends = (values == values.max()) | (values == values.min())
    runs = np.split(values, np.flatnonzero(np.diff(ends)) + 1)
    turns = [change[1:] * change[:-1] for change in (np.diff(run, 4) for run in runs if run.size > 5)]
    turns = np.concatenate([np.zeros(0), *turns])
    turns = turns[turns != 0.0]
    apart = np.diff(np.unique(values))
    least = 2.0 * apart[apart > 1e-9 * np.ptp(values)].min()
    return bool(turns.size and np.mean(turns < 0.0) > 0.5 and np.median(-turns) > 70.0 * least**2)


def edges(drive: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return an array [n] that is True at the samples to which a drive [n] jumps from the previous sample, by
    more than the share `EDGE` of its range. Steps and walks have such edges, slow loops do not."""
    return np.abs(np.diff(drive, prepend=drive[0])) > EDGE * np.ptp(drive)
