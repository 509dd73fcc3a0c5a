"""Net motion between equal phases of a drive, of a motion that is known exactly."""

import numpy as np
import pytest

from stickslip.simulation.whole_periods import mean_velocity, whole_periods
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.shapes import Step

STEP, STROKE = 2e-6, 7e-6


def position(periods: np.ndarray) -> np.ndarray:
    """Steps of `STEP`, and a stroke that each period takes back at its end."""
    return STEP * np.floor(periods + 1e-9) + STROKE * (periods - np.floor(periods + 1e-9))


@pytest.mark.parametrize("hertz", [50.0, 60.0, 18.1])  # 1 kHz samples only the periods of 50 Hz at their ends
@pytest.mark.parametrize("rest", [0.0, 0.3, 0.95])
def test_a_stroke_that_is_taken_back_does_not_count(hertz: float, rest: float) -> None:
    time = np.arange(0, (6 + rest) / hertz, 1e-3)
    x = position(hertz * time)
    found = whole_periods(time, x, Sawtooth(65.0, hertz))
    assert found is not None
    assert found[0] >= 3
    assert found[1] == pytest.approx(found[0] * STEP, rel=1e-6)
    assert mean_velocity(time, x, Sawtooth(65.0, hertz)) == pytest.approx(STEP * hertz, rel=1e-6)


def test_a_rest_after_the_drive_is_no_period() -> None:
    time = np.arange(401) * 1e-3
    x = position(np.minimum(50.0 * time, 4.0))
    assert whole_periods(time, x, Sawtooth(65.0, 50.0, periods=4)) == (3, pytest.approx(3 * STEP))


def test_too_few_periods_are_none() -> None:
    time = np.arange(40) * 1e-3  # ends before the second period does
    assert whole_periods(time, time, Sawtooth(65.0, 50.0)) is None
    assert mean_velocity(time, time, Sawtooth(65.0, 50.0)) is None
    time = np.arange(41) * 1e-3  # 2.4 periods, whose ends are not sampled
    assert whole_periods(time, time, Sawtooth(65.0, 60.0)) is None


def test_a_drive_without_a_period_is_counted_from_end_to_end() -> None:
    time = np.arange(11) * 1e-3
    assert whole_periods(time, 3.0 * time, Step(10.0)) is None
    assert mean_velocity(time, 3.0 * time, Step(10.0)) == pytest.approx(3.0)
