"""Static stages: their bristles turn again and again within rounding of rest, and they follow no jump."""

from __future__ import annotations

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.simulation.ticks import Motion

STATIC = ss.Actuator(
    gain=1.5e-8,
    natural_frequency=math.inf,
    damping_ratio=0.0,
    stage_mass=0.01,
    end_effector_mass=0.00986,
    friction=ss.LuGre(2.35e5, 49.8, 24.1, 0.392, 0.392),
    external_force=-0.1333,
)
TIMES = (0.0, 0.00304, 0.00726, 0.01328)


@pytest.mark.parametrize("tolerance", [1e-9])
@pytest.mark.parametrize("volts", [75.24, 75.0])
def test_a_contact_that_comes_to_rest_within_rounding_goes_on(tolerance: float, volts: float) -> None:
    """After a reversal the speed was 2e-21 m/s on the wrong side, and the step turned there for ever."""
    drive = ss.PeriodicKnots(TIMES, (48.33, volts, 56.1, 13.58), 0.0384, periods=4)
    found = ss.simulate(STATIC, drive, 0.15, tolerance=tolerance, max_steps=20_000)
    assert found.attrs["outcome"] == "complete"
    assert found.attrs["error_estimate"] <= tolerance


def test_random_static_stages_are_followed() -> None:
    random = np.random.default_rng(2)
    for _ in range(8):
        coulomb = random.uniform(0.2, 0.6)
        law = ss.LuGre(10 ** random.uniform(5, 6.5), random.uniform(5.0, 60.0), 0.0, coulomb, 1.2 * coulomb)
        load = random.uniform(-0.5, 0.5) * coulomb
        model = STATIC.replace(friction=law, external_force=load)
        drive = ss.PeriodicKnots(TIMES, tuple(random.uniform(0.0, 80.0, 4)), 0.02, periods=2)
        found = ss.simulate(model, drive, 0.045, tolerance=1e-9, max_steps=20_000)
        assert found.attrs["outcome"] == "complete"


JUMPS = ss.Sawtooth(65.0, 5.0)
CALLS = {
    "simulate": lambda: ss.simulate(STATIC, JUMPS, 0.5),
    "ensemble": lambda: ss.simulate_ensemble(STATIC, JUMPS, 0.5, parameters={"gain": [1e-8]}),
    "steady step": lambda: ss.steady_step(STATIC, JUMPS),
    "tick": lambda: Motion(STATIC).hold(1.0, 1e-4),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_jump_is_refused_for_the_same_reason_by_all(call: str) -> None:
    with pytest.raises(QuantityError, match=r"a static stage jumps with the voltage.*: give the stage a nat"):
        CALLS[call]()


def test_a_law_without_bristles_slides_under_a_jump_in_a_run_as_from_tick_to_tick() -> None:
    """Its end-effector stays behind: no time passes for a force to move it."""
    model = STATIC.replace(friction=ss.Coulomb(0.4), external_force=0.0)
    motion = Motion(model)
    motion.hold(20.0, 1e-3)
    times = [0.0, 1e-3]
    whole = ss.simulate(model, ss.Step(20.0), times=times)["end_effector_position"].values
    assert motion.position == pytest.approx(whole[-1], abs=1e-9)
    assert abs(motion.position) < 1e-9
