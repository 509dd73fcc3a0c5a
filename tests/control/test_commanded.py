"""A mover that is told what to do: each command against the model's own step, and against a sine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from stickslip.control import (
    Commanded,
    Pid,
    Regulator,
    Stepping,
    StepSizes,
    commanded,
    simulate_control,
    tune,
)
from stickslip.control.commanded import HEARTBEAT, WORDS
from stickslip.control.loops import sampled_loop, step_response
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import steady_step
from stickslip.waveform import PeriodicKnots

KANG = load_actuator("kang2007")
RATE = 20e3
# What it is told, and at which time, s.
TOLD: tuple[tuple[float, dict[str, Any]], ...] = (
    (0.01, {"do": "go", "to": 20e-6}),
    (0.25, {"do": "steps", "count": 3}),
    (0.5, {"do": "scan", "range": 4e-6, "frequency": 20.0, "cycles": 6}),
    (1.0, {"do": "release"}),
)


class Told:
    """The controller, with an operator. `said` is its state before each command, `ticks` at each tick."""

    def __init__(self, made: Commanded, told: Any = TOLD) -> None:
        self.made, self.left, self.said = made, list(told), list[dict[str, Any]]()
        self.ticks, self.refused = list[dict[str, Any]](), 0

    @property
    def done(self) -> bool:
        return self.made.done

    def step(self, measured: float, target: float, tick: int) -> float:
        if self.left and tick >= self.left[0][0] * RATE:
            self.said.append({**self.made.told(), "target": self.made.target})
            try:
                self.made.command(**self.left.pop(0)[1])
            except QuantityError:
                self.refused += 1
        volts = self.made.step(measured, target, tick)
        self.ticks.append({**self.made.told(), "target": self.made.target})
        return volts


@pytest.fixture(scope="module")
def regulator() -> Regulator:
    tuning = tune(KANG, RATE)
    return tuning.regulator(RATE, max_voltage=100.0, lead=tuning.lag)


@pytest.fixture(scope="module")
def spec(regulator: Regulator):
    table = StepSizes.of_model(KANG, RATE, "100 Hz", "100 V")
    return commanded(Stepping(), table, regulator, KANG.gain, 1e-6)


@pytest.fixture(scope="module")
def run(spec) -> tuple[Told, xr.Dataset]:
    told = Told(spec.made())
    return told, simulate_control(KANG, told, 0.0, 2.0, rate=RATE)


def at(found: xr.Dataset, time: float, name: str = "end_effector_position") -> float:
    return float(found[name].sel(time=time, method="nearest"))


def test_it_goes_there_and_rests_before(run: tuple[Told, xr.Dataset]) -> None:
    told, found = run
    assert np.all(found["drive_voltage"].sel(time=slice(0.0, 0.0099)) == 0.0)
    assert at(found, 0.24) == pytest.approx(20e-6, abs=2e-9)
    assert told.said[0]["phase"] == "rest"
    assert told.said[1]["settled"]
    assert told.said[1]["target"] == 20e-6
    assert {one["words"] for one in told.said} <= set(WORDS.values())


def test_so_many_steps_are_the_models(run: tuple[Told, xr.Dataset]) -> None:
    """Before the first, the piezo goes back, sticking, to the end of its range."""
    told, found = run
    step = steady_step(KANG, PeriodicKnots((0.0, 8e-3, 8.0001e-3), (0.0, 65.0, 0.0), 10e-3))
    begin = at(found, 0.24) - KANG.gain * at(found, 0.24, "drive_voltage")
    assert told.said[2]["target"] - begin == pytest.approx(3.0 * step, rel=0.05)
    assert told.said[2]["steps"] - told.said[1]["steps"] >= 3
    assert at(found, 0.49) == pytest.approx(told.said[2]["target"], abs=2e-9)


def test_a_scan_is_a_sine_about_where_it_held(run: tuple[Told, xr.Dataset]) -> None:
    told, found = run
    scanned = found.sel(time=slice(0.62, 0.72 - 1e-9))  # two whole periods
    x, time = scanned["end_effector_position"].values, scanned["time"].values
    part = 2.0 * np.mean((x - x.mean()) * np.exp(-2j * np.pi * 20.0 * time))
    assert abs(part) == pytest.approx(2e-6, rel=0.01)
    assert x.mean() == pytest.approx(told.said[2]["target"], abs=20e-9)
    assert told.said[3]["phase"] == "hold"
    assert at(found, 0.99) == pytest.approx(told.said[2]["target"], abs=2e-9)


def test_it_lets_go(run: tuple[Told, xr.Dataset]) -> None:
    told, found = run
    volts = found["drive_voltage"].values
    assert told.done
    assert volts[-1] == 0.0
    assert found["time"].values[-1] == pytest.approx(1.05, abs=1e-3)
    assert np.all(np.diff(volts[found["time"].values > 1.001]) <= 0.0)


class Jogged:
    """A page that says "jog" every 50 ms until 0.5 s, the other way until 0.6 s, and then is not heard."""

    def __init__(self, spec, halts: bool) -> None:
        self.commanded, self.halts = spec.made(), halts
        self.rate = RATE
        self.steps: list[int] = []

    def step(self, measured: float, target: float, tick: int) -> float:
        time = tick / RATE
        if tick % round(0.05 * RATE) == 0 and time <= 0.6:
            self.commanded.command("jog", way=1 if time <= 0.5 else -1)
        if self.halts and tick == round(0.62 * RATE):
            self.commanded.command("halt")
        volts = self.commanded.step(measured, target, tick)
        self.steps.append(self.commanded.told()["steps"])
        return volts


@pytest.mark.parametrize("halts", [False, True])
def test_a_jog_ends_when_it_is_not_heard_any_more(spec, halts: bool) -> None:
    jogged = Jogged(spec, halts)
    found = simulate_control(KANG, jogged, 0.0, 1.2, rate=RATE)
    x = found["end_effector_position"]
    farthest = float(x.sel(time=slice(0.0, 0.52)).max())
    assert farthest > 20 * 2e-6, "steps at 100 Hz"
    ends = 0.62 if halts else 0.6 + HEARTBEAT
    at_end = jogged.steps[round((ends + 0.011) * RATE)]  # the step that was being made
    assert jogged.steps[-1] - at_end <= 2, "but for those that bring the piezo back to mid-range"
    assert jogged.steps[round(ends * RATE)] > jogged.steps[round(0.58 * RATE)]
    assert float(x[-1]) < farthest
    assert jogged.commanded.mover.phase == "hold"


def jogged_until(time: float, *then: tuple[float, dict[str, Any]]) -> list[tuple[float, dict[str, Any]]]:
    """Return the commands of a jog, every 50 ms from 0 s on, and the later ones."""
    return [*((0.05 * k, {"do": "jog", "way": 1}) for k in range(round(time / 0.05) + 1)), *then]


@pytest.mark.parametrize(
    "what",
    [
        {"do": "dance"},
        {"do": "go", "to": "there"},
        {"do": "steps", "count": 1.5},
        {"do": "scan", "range": 1e-6, "frequency": 10.0, "cycles": 1},
        {"do": "jog", "way": 0.5},
    ],
)
def test_a_refused_command_leaves_a_jog_supervised(spec, what: dict[str, Any]) -> None:
    told, plain = (
        Told(spec.made(), jogged_until(0.3, *then)) for then in ([(0.31, what)], list[tuple[float, Any]]())
    )
    found, expected = (simulate_control(KANG, one, 0.0, 0.8, rate=RATE) for one in (told, plain))
    assert told.refused == 1
    assert told.ticks[-1]["phase"] == "hold"
    xr.testing.assert_equal(found["drive_voltage"], expected["drive_voltage"])


@pytest.mark.parametrize("what", [{"do": "go", "to": 10e-6}, {"do": "steps", "count": 3}])
def test_another_command_ends_a_jog_first(spec, what: dict[str, Any]) -> None:
    told = Told(spec.made(), jogged_until(0.3, (0.31, what)))
    found = simulate_control(KANG, told, 0.0, 1.0, rate=RATE)
    assert told.ticks[-1]["phase"] == "hold"
    x = found["end_effector_position"].values
    if what["do"] == "go":
        assert x[-1] == pytest.approx(10e-6, abs=2e-9)
    else:
        made = told.ticks[-1]["steps"] - told.said[-1]["steps"]
        assert 3 <= made <= 6, "three, and those that bring the piezo back to mid-range"


# In every part of a step of 10 ms: slow rise, slip and rest; also before the first step.
@pytest.mark.parametrize("time", [0.015, 0.1503, 0.152, 0.154, 0.156, 0.158, 0.1581, 0.1583, 0.159, 0.1599])
def test_a_halt_ends_a_move_and_holds_there(spec, time: float) -> None:
    told = Told(spec.made(), [(0.0, {"do": "go", "to": 300e-6}), (time, {"do": "halt"})])
    found = simulate_control(KANG, told, 0.0, 0.5, rate=RATE)
    before, after = (told.ticks[round(t * RATE)]["steps"] for t in (time, 0.49))
    assert after - before <= 1
    assert told.ticks[-1]["phase"] == "hold"
    assert told.ticks[-1]["settled"]
    assert told.ticks[-1]["target"] == at(found, time)
    assert at(found, 0.49) == pytest.approx(at(found, time), abs=5e-9)


def test_a_halt_ends_a_scan_and_holds_there(spec) -> None:
    scan = {"do": "scan", "range": 4e-6, "frequency": 20.0, "cycles": 100}
    told = Told(spec.made(), [(0.0, {"do": "go", "to": 4e-6}), (0.1, scan), (0.28, {"do": "halt"})])
    found = simulate_control(KANG, told, 0.0, 0.5, rate=RATE)
    assert told.said[2]["phase"] == "follow"
    assert told.ticks[-1]["phase"] == "hold"
    assert told.ticks[-1]["settled"]
    assert told.ticks[-1]["target"] == told.said[2]["target"]
    assert at(found, 0.49) == pytest.approx(told.said[2]["target"], abs=2e-9)


def test_a_halt_before_a_command_is_executed_puts_nothing_out(spec) -> None:
    for first in ({"do": "go", "to": 9e-6}, {"do": "steps", "count": 3}, {"do": "jog", "way": 1}):
        made = spec.made()
        made.command(**first)
        made.command("halt")
        assert [made.step(0.0, 0.0, tick) for tick in range(2000)] == [0.0] * 2000


def test_a_scan_waits_for_a_command_that_was_just_given(spec) -> None:
    made, volts = spec.made(), 0.0
    made.command("go", to=4e-6)
    for tick in range(1000):
        volts = made.step(KANG.gain * volts, 0.0, tick)
    scan = {"range": 1e-6, "frequency": 10.0, "cycles": 1}
    for first in ({"do": "go", "to": 5e-6}, {"do": "steps", "count": 3}, {"do": "jog", "way": 1}):
        made.command(**first)
        with pytest.raises(QuantityError, match="go there first"):
            made.command("scan", **scan)
        made.command("halt")
    made.command("scan", **scan)
    made.step(KANG.gain * volts, 0.0, 1000)
    assert made.told()["phase"] == "follow"


def test_what_is_no_command(spec) -> None:
    made = spec.made()
    for what, words in (
        ({"do": "dance"}, "no command"),
        ({"do": "go", "to": "there"}, "to = 'there' must be a number in m"),
        ({"do": "steps", "count": 1.5}, "whole number"),
        ({"do": "jog", "way": 0.5}, "way = 0.5 must be 1, forward, or -1"),
        ({"do": "scan", "range": 1e-6, "frequency": 10.0, "cycles": 1}, "go there first"),
        ({"do": "scan", "range": -1e-6, "frequency": 10.0, "cycles": 1}, "above 0"),
    ):
        with pytest.raises(QuantityError, match=words):
            made.command(**what)
    made.command("go", to=4e-6)
    volts = 0.0
    for tick in range(1000):
        volts = made.step(KANG.gain * volts, 0.0, tick)
    assert made.mover.phase == "hold"
    for span, hertz, words in ((9e-6, 10.0, "more than the piezo has"), (4e-6, 2e3, "faster than")):
        with pytest.raises(QuantityError, match=words):
            made.command("scan", range=span, frequency=hertz, cycles=1)


def test_the_response_to_a_jump_is_that_of_the_loop() -> None:
    """The regulator and the held system, tick by tick, beside the closed loop's matrices."""
    loop = sampled_loop(KANG, RATE)
    pid = Pid(0.01 * RATE / KANG.gain, 0.1 / KANG.gain)
    made = Regulator(pid, RATE, min_voltage=-1e9, max_voltage=1e9)
    found = step_response(made, loop, 600)
    x, expected = np.zeros(loop.b.size), np.empty(600)
    for k in range(600):
        expected[k] = loop.c @ x
        x = loop.a @ x + loop.b * made.step(float(expected[k]), 1.0, k)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert expected[-1] == pytest.approx(1.0, abs=0.05)


def test_the_target_goes_along_with_steps_from_a_held_position(spec) -> None:
    """A target that stood still while the steps lead away from it would seem to be a fault of the sensor."""
    jog = [(0.3 + 0.05 * k, {"do": "jog", "way": -1}) for k in range(15)]
    told = Told(spec.made(), [(0.01, {"do": "go", "to": 20e-6}), *jog])
    found = simulate_control(KANG, told, 0.0, 1.6, rate=RATE)
    x = found["end_effector_position"].values
    count = min(x.size, len(told.ticks))
    target = np.array([one["target"] for one in told.ticks[:count]])
    assert np.ptp(x) > 150e-6
    assert np.max(np.abs(x[:count] - target)[round(0.25 * RATE) :]) < 15e-6
    assert target[-1] == pytest.approx(x[count - 1], abs=50e-9)
    assert told.made.mover.phase == "hold"
