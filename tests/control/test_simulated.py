"""What a simulated closed loop refuses, and from where it counts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.control import (
    Learnt,
    Mover,
    NoiseShaped,
    Pid,
    Regulator,
    Shaper,
    Shaping,
    Stepping,
    StepSizes,
    simulate_control,
)
from stickslip.quantities.units import QuantityError
from stickslip.rig import Controller
from stickslip.waveform import Ramp as Line

KANG = ss.load_actuator("kang2007")


class Ramp:
    """A voltage that grows by 10 mV a tick."""

    def step(self, measured: float, target: float, tick: int) -> float:
        return 0.01 * tick


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"delay": 1.5}, "delay = 1.5"),
        ({"noise": "-1 nm"}, "noise = -1e-09 m"),
        ({"seed": -1}, "seed = -1"),
        ({"target": math.nan}, "target = nan is not finite"),
        ({"model": KANG.replace(natural_frequency=math.inf)}, "a static stage jumps"),
    ],
)
def test_refusals_name_what_is_wrong(how: dict[str, Any], said: str) -> None:
    given = {"model": KANG, "target": 0.0, "duration": 0.01} | how
    with pytest.raises(QuantityError, match=said):
        simulate_control(given.pop("model"), Ramp(), given.pop("target"), given.pop("duration"), **given)


def test_positions_count_from_where_it_rests() -> None:
    """On a slope the end-effector has crept down by its bristle before."""
    found = simulate_control(KANG.replace(incline=0.05), Ramp(), 0.0, 0.01)
    whole = ss.simulate(KANG.replace(incline=0.05), Line("200 V/s", rise_time="10 ms"), 0.01, sample_rate=1e4)
    moved = whole.end_effector_position.values
    assert found.end_effector_position.values[0] == 0.0
    assert moved[0] < -1e-8
    assert found.end_effector_position.values[-1] == pytest.approx(moved[-1] - moved[0], rel=0.02)


MADE = Regulator(Pid(1e7), 20e3)
TABLE = StepSizes((30.0, 65.0), (1e-6, 3e-6), (1e-6, 3e-6))


class Holding(Ramp):
    """Another controller within, and one that holds itself."""

    def __init__(self, controller: Controller | None = None) -> None:
        self.controller = self if controller is None else controller


@pytest.mark.parametrize(
    ("controller", "who"),
    [
        (MADE, "Regulator"),
        (Mover(Stepping(), TABLE, MADE, KANG.gain), "Regulator"),
        (NoiseShaped(Mover(Stepping(), TABLE, MADE, KANG.gain), 0.01), "Regulator"),
        (Learnt(MADE, 200), "Regulator"),
        (Shaping(Ramp(), Shaper(500.0), 20e3), "Shaping"),
        (Shaping(MADE, Shaper(500.0), 2e3), "Regulator"),
    ],
)
def test_a_controller_runs_at_the_rate_that_it_is_made_for(controller: Controller, who: str) -> None:
    said = f"rate = 2000 Hz: the controller's {who} is made for 20000 Hz"
    with pytest.raises(QuantityError, match=said):
        simulate_control(KANG, controller, 0.0, 0.01, rate=2e3)


def test_the_same_rate_to_a_millionth_and_none_at_all_will_do() -> None:
    for controller in (Regulator(Pid(1e7), 20e3 * (1.0 + 5e-7)), Holding(MADE), Holding()):
        assert simulate_control(KANG, controller, 0.0, 1e-3, rate=20e3).sizes["time"] == 20
    with pytest.raises(QuantityError, match=r"rate = 20000 Hz: .* is made for 20000\.1 Hz"):
        simulate_control(KANG, Regulator(Pid(1e7), 20000.1), 0.0, 1e-3, rate=20e3)


@pytest.mark.parametrize(
    ("answer", "shown"),
    [
        ("x", "'x'"),
        (None, "None"),
        (np.array([1.0, 2.0]), r"array\(\[1., 2.\]\)"),
    ],
)
def test_an_answer_that_is_no_number_names_its_tick(answer: Any, shown: str) -> None:
    class Failing(Ramp):
        def step(self, measured: float, target: float, tick: int) -> Any:
            return answer if tick == 3 else np.float32(0.0)

    with pytest.raises(QuantityError, match=rf"returned at tick 3 = {shown} is not a number"):
        simulate_control(KANG, Failing(), 0.0, 0.01)
