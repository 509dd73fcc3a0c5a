"""Under a load that varies, a step is steady only where the load is the same in each period of the drive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.simulation import steady_orbit, steady_step_derivatives
from stickslip.simulation.load import refuse_other_period
from stickslip.waveform import Sequence

KANG = ss.load_actuator("kang2007")
DRIVE = ss.Sawtooth("65 V", "50 Hz")
ENDS_ELSEWHERE = {
    "other": (ss.Sine(0.3, 30.0, offset=1.0), "33.3333333 ms.*whole part.*20 ms"),
    "close": (ss.PeriodicKnots([0.0, 0.01], [1.0, 1.3], 0.0200001), "20.0001 ms.*whole part.*20 ms"),
    "ramp": (ss.Sampled([0.0, 0.2], [1.0, 1.5]), "Sampled has no period"),
    "sequence": (Sequence((ss.Step(0.5, 0.0), 0.1), (ss.Step(1.0, 0.0), 0.1)), "Sequence has no period"),
    "counted": (ss.Sine(0.3, 50.0, offset=1.0, periods=3), "Sine ends after 60 ms"),
}


@pytest.mark.parametrize("name", ENDS_ELSEWHERE)
def test_other_loads_are_refused_by_all(name: str) -> None:
    load, words = ENDS_ELSEWHERE[name]
    calls: list[Any] = [
        lambda: ss.steady_step(KANG, DRIVE, load=load),
        lambda: steady_orbit(KANG, DRIVE, load=load),
        lambda: steady_step_derivatives(KANG, DRIVE, parameters=["coulomb_force"], load=load),
        lambda: ss.steady_steps(KANG, DRIVE, parameters={"amplitude": [60.0, 65.0]}, load=load),
        lambda: ss.steady_steps(KANG, DRIVE, parameters={"frequency": [50.0, 50.0]}, load=load),
        lambda: ss.step_map(KANG, DRIVE, voltage=[60.0, 65.0], normal_load=load),
        lambda: ss.step_map(KANG, DRIVE, frequency=50.0, normal_load=load),
    ]
    for call in calls:
        with pytest.raises(QuantityError, match=f"^load: .*{words}.*simulate"):
            call()


def test_periods_that_are_whole_but_for_rounding() -> None:
    rng = np.random.default_rng(3)
    for period in np.exp(rng.uniform(np.log(1e-5), np.log(10.0), 60)).tolist():
        parts = int(rng.integers(1, 200))
        for own in (period / parts, 1.0 / (parts / period), period * (1.0 / parts)):
            refuse_other_period(ss.Sine(0.3, 1.0 / own, offset=1.0), period)
            refuse_other_period(ss.Sampled([0.0, 0.3 * own], [1.0, 1.2], period=own), period)
        off = period / (parts + rng.uniform(1e-6, 1.0 - 1e-6))
        for other in (off, period * (parts + 1), period * (1.0 + rng.uniform(1e-6, 0.9))):
            with pytest.raises(QuantityError, match="whole part"):
                refuse_other_period(ss.PeriodicKnots([0.0, 0.4 * other], [1.0, 1.2], other), period)
            refuse_other_period(ss.Sine(0.0, 1.0 / other, offset=0.8), period)  # it does not vary


def test_a_load_that_fits_gives_the_step_that_is_waited_for() -> None:
    """Loads of a half to a fifth of the period, and of all of it, with jumps and without."""
    rng = np.random.default_rng(11)
    for parts in (1, int(rng.integers(2, 6))):
        frequency = float(rng.uniform(30.0, 120.0))
        own = 1.0 / frequency / parts
        jumps = ss.Sampled([0.0, rng.uniform(0.2, 0.8) * own], [0.8, 1.3], "hold", period=own)
        smooth = ss.Sine(0.3, parts * frequency, phase=float(rng.uniform(0.0, 6.0)), offset=1.0)
        for load in (jumps, smooth):
            drive = DRIVE._replace(frequency=frequency)
            times = np.append(0.0, np.arange(150, 155) / frequency)
            waited = ss.simulate(KANG, drive, times=times, load=load, tolerance=1e-10)
            steps = np.diff(waited["end_effector_position"].values[1:])
            assert ss.steady_step(KANG, drive, load=load) == pytest.approx(steps, abs=5e-10)


def test_members_into_whose_period_the_load_does_not_fit() -> None:
    load = ss.Sine(0.3, 50.0, offset=1.0)
    found = ss.steady_steps(KANG, DRIVE, parameters={"frequency": [50.0, 25.0, 40.0, -1.0]}, load=load)
    alone = [ss.steady_step(KANG, DRIVE._replace(frequency=f), load=load) for f in (50.0, 25.0)]
    assert found["net_step"].values[:2] == pytest.approx(alone, abs=1e-9)
    assert found["status"].values.tolist() == [0, 0, 4, 4]
    assert "20 ms, is no whole part of the drive's period of 25 ms" in str(found["reason"].values[2])
    assert "frequency" in str(found["reason"].values[3])
    with pytest.raises(QuantityError, match="no period"):
        ss.steady_steps(KANG, DRIVE, parameters={"frequency": [50.0, 25.0]}, load=ss.Step(0.5, 0.1, 1.0))


def test_no_derivative_by_the_drive_s_period_under_a_load_that_keeps_its_own() -> None:
    load = ss.Sine(0.3, 50.0, offset=1.0)
    assert steady_step_derivatives(KANG, DRIVE, parameters=["amplitude"], load=load)["amplitude"] > 0.0
    with pytest.raises(QuantityError, match=r"keeps its period.*'frequency'"):
        steady_step_derivatives(KANG, DRIVE, parameters=["amplitude", "frequency"], load=load)
