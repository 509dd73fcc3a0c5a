"""Refusals of durations, rates and numbers of samples: each names the argument and what it makes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

import stickslip as ss
from stickslip.control import simulate_control
from stickslip.design import plan_experiment
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")
SAW = ss.Sawtooth(65.0, 5.0)


class Resting:
    """Controller that asks for 0 V."""

    def step(self, measured: float, target: float, tick: int) -> float:
        return 0.0


def _control(duration: Any = 0.01, sample_rate: Any = 1e3) -> Any:
    return simulate_control(KANG, Resting(), 1e-6, duration, rate=sample_rate)


def _ensemble(duration: Any = 0.01, sample_rate: Any = 1e3) -> Any:
    gains = {"gain": [KANG.gain]}
    return ss.simulate_ensemble(KANG, SAW, duration, sample_rate=sample_rate, parameters=gains)


def _sensitivities(duration: Any = 0.01, sample_rate: Any = 1e3) -> Any:
    return ss.simulation.sensitivities(KANG, SAW, duration, sample_rate=sample_rate, parameters=["sigma_0"])


def _plan(duration: Any = 0.01, sample_rate: Any = 1e3) -> Any:
    given = {"duration": duration, "sample_rate": sample_rate}
    return plan_experiment(KANG, [SAW], free=["sigma_0"], noise=1e-8, recordings=1, **given)


CALLS: dict[str, Callable[..., Any]] = {
    "simulate": lambda duration=0.01, sample_rate=1e3: ss.simulate(
        KANG, SAW, duration, sample_rate=sample_rate
    ),
    "simulate_ensemble": _ensemble,
    "sensitivities": _sensitivities,
    "plan_experiment": _plan,
    "simulate_control": _control,
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("argument", ["duration", "sample_rate"])
@pytest.mark.parametrize("value", [0.0, math.nan])
def test_a_duration_or_a_rate_that_is_none_is_named(call: str, argument: str, value: Any) -> None:
    name = "rate" if argument == "sample_rate" else argument
    with pytest.raises(QuantityError, match=rf"{name} = "):
        CALLS[call](**{argument: value})


@pytest.mark.parametrize("call", CALLS)
def test_more_samples_than_fit_into_memory_are_refused_with_their_number(call: str) -> None:
    with pytest.raises(QuantityError, match=r"2,000,000,000,000 samples.*at most [\d,]+"):
        CALLS[call](duration=2.0, sample_rate=1e12)


def test_the_samples_of_all_members_count() -> None:
    gains = {"gain": [KANG.gain] * 100}
    with pytest.raises(QuantityError, match=r"10,000,000 samples, and one call keeps at most 2,000,000"):
        ss.simulate_ensemble(KANG, SAW, 100.0, sample_rate=1e5, parameters=gains)


def test_a_member_of_too_many_periods_is_refused_alone() -> None:
    found = ss.simulate_ensemble(KANG, SAW, 0.01, parameters={"frequency": [5.0, 1e13]})
    assert found["status"].values.tolist() == [0, 4]
    assert "100,000,000,000 periods" in str(found["reason"].values[1])


def test_a_drive_without_an_end_asks_for_a_duration() -> None:
    with pytest.raises(QuantityError, match="duration is missing: this Sawtooth has no end"):
        ss.simulate(KANG, SAW)
    with pytest.raises(QuantityError, match="duration is missing: this Sawtooth has no end"):
        ss.simulate_ensemble(KANG, SAW, parameters={"gain": [KANG.gain]})


def test_a_run_that_starts_after_its_drive_has_ended_says_so() -> None:
    drive = ss.Sawtooth(65.0, 5.0, periods=1)
    state = ss.simulate(KANG, drive, 0.3)
    with pytest.raises(QuantityError, match=r"ends at 0\.2 s, and the run starts at 0\.3 s"):
        ss.simulate(KANG, drive, initial_state=state)
