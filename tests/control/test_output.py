"""Tables, loops and moves on one output stage: its updates, hold, steps, lag and slope."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip.control import (
    ControlWarning,
    Mover,
    Pid,
    Regulator,
    StepModel,
    Stepping,
    StepSizes,
    check_margins,
    simulate_control,
    tune,
)
from stickslip.control.loops import sampled_loop
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.electronics import Amplifier, OutputStage
from stickslip.quantities.units import QuantityError
from stickslip.simulation import steady_step
from stickslip.simulation.sticking import sticking
from stickslip.waveform import Sampled

KANG = load_actuator("kang2007")
RATE = 20e3


def stage(frequency: float, damping: float) -> Actuator:
    return KANG.replace(natural_frequency=2.0 * math.pi * frequency, damping_ratio=damping)


class Stepper:
    """Steps forward as a mover asks for them: up over 8 of 10 ms, back at once."""

    def __init__(self, amplitude: float) -> None:
        self.amplitude = amplitude

    def step(self, measured: float, target: float, tick: int) -> float:
        del measured, target
        count = tick % 200 + 1
        return self.amplitude * count / 160 if count <= 160 else 0.0


@pytest.mark.parametrize(("frequency", "damping"), [(525.0, 0.5), (20e3, 0.03)])
def test_a_step_is_that_of_the_voltages_held_for_a_tick(frequency: float, damping: float) -> None:
    """Against the same ticks one by one; at the update rate itself an ideal ramp is 60 % off."""
    model = stage(frequency, damping)
    table = StepSizes.of_model(model, RATE, "100 Hz", "100 V")
    run = simulate_control(model, Stepper(table.voltages[9]), 0.0, 0.12, rate=RATE)
    x = run["end_effector_position"].values
    assert table.forward[9] == pytest.approx(x[2200] - x[2000], rel=2e-3)
    ideal = StepSizes.of_model(model, OutputStage(), "100 Hz", "100 V")
    assert abs(ideal.forward[9] / table.forward[9] - 1.0) > (0.5 if frequency == RATE else 0.0)


def test_a_step_behind_a_slow_amplifier_is_shorter() -> None:
    """A slope of 200 kV/s takes 0.3 ms for 65 V, in which the contact sticks for longer."""
    fast = StepSizes.of_model(KANG, OutputStage(RATE), "100 Hz", "100 V")
    slow = StepSizes.of_model(KANG, OutputStage(RATE, slew_rate=200e3), "100 Hz", "100 V")
    assert np.interp(65.0, slow.voltages, slow.forward) < 0.93 * np.interp(65.0, fast.voltages, fast.forward)
    coarse = StepSizes.of_model(KANG, OutputStage(RATE, step="20 V"), "100 Hz", "100 V")
    assert len(set(coarse.forward)) < len(set(fast.forward))


@pytest.mark.parametrize("lag", [0.0, 0.2e-3])
def test_a_loop_has_the_lag_of_the_amplifier(lag: float) -> None:
    """The answer to one held tick against an integration of stage and amplifier."""
    bandwidth = 0.5 / (math.pi * lag) if lag else math.inf
    amplifier = Amplifier(1.0, 0.0, bandwidth, math.inf, math.inf, -200.0, 200.0)
    output = OutputStage.of_amplifier(amplifier, "1 uF")._replace(update_rate=RATE)
    assert output.lag == pytest.approx(lag)
    loop, own = sampled_loop(KANG, output, delay=0), sticking(KANG)

    def motion(t: float, state: np.ndarray) -> np.ndarray:
        asked = 1.0 if t < 1.0 / RATE else 0.0
        given = state[-1] if lag else asked
        return np.append(own.a @ state[:-1] + own.b * given, (asked - state[-1]) / lag if lag else 0.0)

    times = np.arange(40) / RATE
    exact = solve_ivp(
        motion, (0.0, times[-1]), np.zeros(own.b.size + 1), t_eval=times, rtol=1e-9, atol=1e-18, max_step=5e-6
    )
    state, found = loop.b, []
    for _ in range(1, 40):
        found.append(loop.c @ state)
        state = loop.a @ state
    swing = np.abs(own.c @ exact.y[:-1]).max()
    np.testing.assert_allclose(found, (own.c @ exact.y[:-1])[1:], atol=1e-4 * swing)


@pytest.mark.parametrize("share", [0.45, 1.0])
def test_a_mode_that_the_updates_do_not_resolve_is_said(share: float) -> None:
    model, slow = stage(share * RATE, 0.03), Regulator(Pid(1e6), RATE)
    with pytest.warns(ControlWarning, match=r"a mode of the stage at .* kHz is above 0\.4 of the"):
        found = check_margins(slow, model)
    assert found.aliased == pytest.approx(share * RATE, rel=0.05)
    assert "not to be believed" in found.report()
    with pytest.warns(ControlWarning, match="between updates"):
        assert tune(model, RATE).margins.aliased > 0.0


def test_a_mode_that_is_resolved_or_at_rest_at_the_next_update_is_not_said() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert tune(KANG, RATE).margins.aliased == 0.0
        assert check_margins(Regulator(Pid(1e6), RATE), stage(1.2 * RATE, 0.9)).aliased == 0.0


def test_a_table_of_another_output_than_the_mover_s_is_refused() -> None:
    table = StepSizes((30.0, 65.0), (1e-6, 3e-6), (1e-6, 3e-6), rate=1e4)
    with pytest.raises(QuantityError, match="made for 10000 updates a second, the regulator for 20000"):
        Mover(Stepping(), table, Regulator(Pid(1e6), RATE), KANG.gain)


def test_steps_that_are_counted_are_those_of_the_output_too() -> None:
    """Against the sawtooth's ticks, each held; its lines go 2.7 % farther."""
    model = stage(RATE, 0.03)
    ideal, held = (StepModel.of_model(model, one, 65.0, 100.0) for one in (OutputStage(), RATE))
    ticks = np.arange(200)
    exact = steady_step(model, Sampled(ticks / RATE, 65.0 * ticks / 200, "hold", period=200 / RATE))
    assert held.forward == pytest.approx(exact, rel=1e-9)
    assert ideal.forward > 1.02 * held.forward


def test_margins_of_another_output_than_the_regulator_s_are_refused() -> None:
    with pytest.raises(QuantityError, match="rate = 10000 Hz"):
        check_margins(Regulator(Pid(1e6), RATE), KANG, output=OutputStage(1e4))
