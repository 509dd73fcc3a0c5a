"""Where segments of a drive turn, and when they come to a value: against closed forms."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pytest

from engine.inner import Inner
from engine.library import built
from stickslip.engine.binding import DriveTable
from stickslip.waveform.drive import Drive

C = """
#include "ways.h"
double inner_turning(const struct table *drive, int64_t i, double a, double b);
double inner_reached(const struct table *drive, int64_t i, double a, double b, double value);
double inner_turning(const struct table *drive, int64_t i, double a, double b)
{
    return turning(drive, i, a, b);
}
double inner_reached(const struct table *drive, int64_t i, double a, double b, double value)
{
    return reached(drive, i, a, b, value);
}
"""


@pytest.fixture(scope="module")
def ways(tmp_path_factory: pytest.TempPathFactory) -> Inner:
    return Inner(ctypes.CDLL(str(built(tmp_path_factory.mktemp("ways"), of=C))))


def segment(*polynomial: float, start: float = 1.0, wave: tuple[float, ...] = ()) -> Drive:
    waves = np.array([wave]) if wave else np.zeros((0, 4))
    first = np.array([0, len(waves)])
    return Drive(0.0, np.array([start]), np.array([polynomial], float), first, waves)


@pytest.mark.parametrize(
    ("drive", "turns"),
    [
        (segment(1.0, 2.0, 0.0, 0.0), 3.0),
        (segment(1.0, 2.0, -1.0, 0.0), 2.0),
        (segment(1.0, -3.0, 0.0, 1.0), 2.0),
        (segment(1.0, 3.0, 0.0, 1.0), 3.0),
        (segment(0.0, 0.02, -0.3, 1.0), 1.0 + 0.1 - math.sqrt(0.01 - 0.02 / 3.0)),  # back within 0.12 s
        (segment(0.0, 0.0, 0.0, 0.0, wave=(2.0, 3.0, 0.0, 0.0)), 1.0 + 0.5 * math.pi / 3.0),
        (
            segment(0.0, 0.0, 0.0, 0.0, wave=(2.0, 10.0, 0.0, 300.0)),
            1.0 + (math.sqrt(25 + 150 * math.pi) - 5) / 300,
        ),
        (
            segment(0.0, 0.0, 0.0, 0.0, wave=(2.0, 0.0, -1.5, 400.0)),
            1.0 + math.sqrt((1.5 + math.pi / 2) / 400),
        ),
    ],
)
def test_a_segment_turns_where_its_slope_is_zero(ways: Inner, drive: Drive, turns: float) -> None:
    begin = 1.0 + (1e-6 if drive.harmonic.size else 0.0)  # where a slope may begin with zero
    assert ways.plain("turning", DriveTable(drive), 0, begin, 3.0) == pytest.approx(turns, rel=1e-13)


@pytest.mark.parametrize("at", [1.0, 1.3, 2.9, 3.0])
@pytest.mark.parametrize(
    "drive",
    [
        segment(1.0, 2.0, 0.0, 0.0),
        segment(1.0, -2.0, 0.0, 0.0),
        segment(1.0, 2.0, 1.0, 0.0),
        segment(1.0, 2.0, 0.0, 1.0),
        segment(1.0, -2.0, -0.5, -3.0),
        segment(1.0, 0.0, 0.0, 0.0, wave=(2.0, 0.7, 0.1, 0.0)),
    ],
)
def test_when_a_segment_comes_to_a_value(ways: Inner, drive: Drive, at: float) -> None:
    tau, wave = at - 1.0, drive.harmonic[0] if drive.harmonic.size else np.zeros(4)
    value = np.polyval(drive.polynomial[0, ::-1], tau) + wave[0] * math.sin(wave[2] + wave[1] * tau)
    found = ways.plain("reached", DriveTable(drive), 0, 1.0, 3.0, float(value))
    assert found == pytest.approx(at, abs=1e-12)
