"""Periods of drive and load that the engine copies, on tables whose periods are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.inner import Inner
from stickslip.engine.binding import DriveTable
from stickslip.waveform.drive import Drive, constant

STEADY = constant(1.0)
# Of a period: instants that are the same but for rounding, and instants that are not.
CLOSE, APART = 0.5e-9, 2.5e-9


def steps(starts: Any, values: Any) -> Drive:
    """Constant values, each from its start on."""
    start, polynomial = np.array(starts, float), np.zeros((len(values), 4))
    polynomial[:, 0] = values
    return Drive(0.0, start, polynomial, np.zeros(start.size + 1, np.int64), np.zeros((0, 4)))


def pulses(*widths: float, late: float = 0.0) -> Drive:
    """A pulse at the start of each second; all but the first start are a little late."""
    starts = np.column_stack([np.arange(len(widths)), np.arange(len(widths)) + np.array(widths)]).ravel()
    return steps([0.0, *(starts[1:] + late)], [1.0, 0.5] * len(widths))


def before_others(drive: Drive, segments: int) -> Drive:
    """The first segments of a drive; the rest stays behind them in memory, where nothing may look."""
    return drive._replace(
        start=drive.start[:segments],
        polynomial=drive.polynomial[:segments],
        first=drive.first[: segments + 1],
    )


def cycle(inner: Inner, drive: Drive, load: Drive = STEADY) -> list[int]:
    """Segments of a period, the first of these, and segments of the load; zeros where nothing repeats."""
    found = np.zeros(3, np.int64)
    inner.plain("cycle", DriveTable(drive), DriveTable(load), found)
    return found.tolist()


def repeats(inner: Inner, drive: Drive, i: int, end: float, load: Drive = STEADY) -> int:
    """How many periods from segment i on are like the one before."""
    found = np.array(cycle(inner, drive, load))
    return int(inner.plain("repeats", DriveTable(drive), DriveTable(load), i, found, 1.0, end))


def test_periods_of_a_drive(inner: Inner) -> None:
    drive = pulses(0.25, 0.25, 0.25, 0.25, 0.25)
    assert cycle(inner, drive) == [2, 0, 0]
    assert repeats(inner, drive, 2, 5.0) == 4
    assert repeats(inner, drive, 4, 5.0) == 3
    assert repeats(inner, drive, 2, 4.5) == 3  # the last one is cut short
    assert repeats(inner, drive, 2, 6.0) == 3  # the last one lasts longer
    assert repeats(inner, drive, 2, 2.5) == 1


def test_pulses_of_another_width_are_another_period(inner: Inner) -> None:
    """Their formulas are the same."""
    drive = pulses(0.25, 0.25, 0.5, 0.5, 0.25)
    assert [repeats(inner, drive, i, 5.0) for i in (2, 4, 6, 8)] == [1, 0, 1, 0]
    assert cycle(inner, pulses(0.25, 0.5, 0.25, 0.5, 0.25)) == [4, 0, 0]


def test_harmonics_belong_to_the_formula(inner: Inner) -> None:
    """The same ones in each period, as many in each."""
    drive = steps([0.0, 0.5, 1.0, 1.5, 2.0, 2.5], [1.0, 0.5] * 3)
    wave, other = [2.0, 7.0, 0.3, 0.0], [2.0, 7.0, 0.3, 1.0]

    def rippled(first: list[int], *harmonics: list[float]) -> Drive:
        return drive._replace(first=np.array(first, np.int64), harmonic=np.array(harmonics))

    alike = rippled([0, 1, 2, 3, 4, 5, 6], wave, other, wave, other, wave, other)
    changed = rippled([0, 1, 2, 3, 4, 5, 6], wave, other, wave, other, wave, wave)
    fewer = rippled([0, 1, 3, 4, 6, 7, 8], wave, other, wave, wave, other, wave, wave, other)
    assert [cycle(inner, one) for one in (alike, changed, fewer)] == [[2, 0, 0]] * 3
    assert [repeats(inner, one, 2, 3.0) for one in (alike, changed, fewer)] == [2, 1, 1]


def test_what_happens_once_does_not_repeat(inner: Inner) -> None:
    assert cycle(inner, STEADY) == [0, 0, 0]
    assert cycle(inner, steps([0.0, 1.0, 2.0], [1.0, 2.0, 3.0])) == [0, 0, 0]
    # A later segment that is like the first is behind the end of the table.
    assert cycle(inner, before_others(pulses(0.25, 0.25), 2)) == [0, 0, 0]


def test_a_first_period_unlike_the_others(inner: Inner) -> None:
    later = pulses(0.25, 0.25, 0.25)
    drive = steps([0.0, *(1.0 + later.start)], [3.0, *later.polynomial[:, 0]])
    assert cycle(inner, drive) == [2, 1, 0]
    assert repeats(inner, drive, 3, 4.0) == 2


@pytest.mark.parametrize("late", [0.0, CLOSE, -CLOSE])
def test_a_load_that_repeats_with_the_drive(inner: Inner, late: float) -> None:
    """It may begin a moment later or earlier, but each time: here from the second period on."""
    drive, load = pulses(0.25, 0.25, 0.25, 0.25, 0.25), pulses(0.5, 0.5, 0.5, 0.5, 0.5, late=late)
    assert cycle(inner, drive, load) == ([2, 2, 2] if late > 0.0 else [2, 0, 2])
    assert repeats(inner, drive, 4, 5.0, load) == 3
    same = steps(np.arange(5.0) + late * (np.arange(5) > 0), [1.0] * 5)
    assert cycle(inner, drive, same) == ([2, 2, 1] if late > 0.0 else [2, 0, 1])


@pytest.mark.parametrize("late", [APART, -APART])
def test_a_load_that_begins_at_other_instants(inner: Inner, late: float) -> None:
    assert cycle(inner, pulses(0.25, 0.25, 0.25), pulses(0.5, 0.5, 0.5, late=late)) == [0, 0, 0]


def test_a_load_that_changes_ends_the_copies(inner: Inner) -> None:
    drive = pulses(0.25, 0.25, 0.25, 0.25, 0.25)
    wider, later = pulses(0.5, 0.5, 0.5, 0.6, 0.5), pulses(0.5, 0.5, 0.5, 0.5, 0.5)
    later.start[6] += 1e-3
    for load in (wider, later, before_others(pulses(0.5, 0.5, 0.5, 0.5, 0.5), 7)):
        assert cycle(inner, drive, load) == [2, 0, 2]
        assert repeats(inner, drive, 2, 5.0, load) == 2


def test_a_load_without_a_later_segment_does_not_begin_with_the_drive(inner: Inner) -> None:
    """Behind its end in memory is a segment that would."""
    assert cycle(
        inner, pulses(0.25, 0.25, 0.25), before_others(steps([0.0, 1.0 + CLOSE], [1.0, 1.0]), 1)
    ) == [2, 0, 0]
    rising = before_others(steps([0.0, 1.0 + CLOSE, 2.0 + CLOSE], [1.0, 1.0, 1.0]), 2)
    assert cycle(inner, pulses(0.25, 0.25, 0.25, 0.25), rising) == [0, 0, 0]
