"""Knots and samples with a period, where steady stepping takes the period from them."""

from __future__ import annotations

import pytest

from stickslip.actuator import load_actuator
from stickslip.simulation import steady_step
from stickslip.units import QuantityError
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sampled import Sampled

ACTUATOR = load_actuator("kang2007")


@pytest.mark.parametrize(
    "waveform",
    [
        PeriodicKnots([0, 0.1998], [0, 65], 0.2),
        PeriodicKnots([0, 0.1998], [0, 65], 0.2, periods=4),
        Sampled([0, 0.1998], [0, 65], period=0.2),
    ],
    ids=["knots", "counted", "sampled"],
)
def test_steady_step_is_that_of_the_same_sawtooth(waveform) -> None:
    same = steady_step(ACTUATOR, Sawtooth(65, 5, rise_fraction=0.999))
    assert abs(same) > 1e-6  # it walks
    assert steady_step(ACTUATOR, waveform) == pytest.approx(same, abs=1e-11)


def test_steady_step_does_not_ask_where_the_period_begins() -> None:
    late = PeriodicKnots([0.05, 0.0503], [65, 0], 0.2, smooth=True)
    early = PeriodicKnots([0, 0.0003], [65, 0], 0.2, smooth=True)
    step = steady_step(ACTUATOR, early)
    assert abs(step) > 1e-6
    assert steady_step(ACTUATOR, late) == pytest.approx(step, abs=1e-9)


def test_samples_without_a_period_have_no_steady_step() -> None:
    with pytest.raises(QuantityError, match="Sampled has no period"):
        steady_step(ACTUATOR, Sampled([0, 1], [0, 65]))
