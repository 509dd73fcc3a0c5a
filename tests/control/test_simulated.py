"""What a simulated closed loop refuses, and from where it counts."""

from __future__ import annotations

import math
from typing import Any

import pytest

import stickslip as ss
from stickslip.control import simulate_control
from stickslip.units import QuantityError
from stickslip.waveform import Ramp as Line

KANG = ss.load_actuator("kang2007")


class Ramp:
    """A voltage that grows by 10 mV a tick."""

    def step(self, measured: float, target: float, tick: int) -> float:
        return 0.01 * tick


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"delay": -1}, "delay = -1"),
        ({"delay": 1.5}, "delay = 1.5"),
        ({"noise": "-1 nm"}, "noise = -1e-09 m"),
        ({"tolerance": 0.0}, "tolerance = 0 m"),
        ({"rate": math.inf}, "rate = inf Hz"),
        ({"duration": math.nan}, "duration = nan s"),
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
