"""Numbers that a controller, a shaper or a table of steps cannot be made with."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from stickslip.control import (
    Estimator,
    Learnt,
    Mover,
    NoiseShaped,
    Notch,
    Oscillation,
    Pid,
    PiezoInverse,
    Regulator,
    Relay,
    Shaper,
    Slip,
    StepModel,
    Stepping,
    StepSizes,
    settling,
    simulate_control,
)
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError

KANG, BENT = load_actuator("kang2007"), load_actuator("kang2007-hysteresis")
RATE = 20e3
MADE = Regulator(Pid(1e7), RATE)
UNLIMITED = Regulator(Pid(1e7), RATE, min_voltage=-math.inf, max_voltage=math.inf)
STEPS = StepModel(1e-6, 1e-6, scatter=1e-8)
TABLE = StepSizes((30.0, 65.0), (1e-6, 3e-6), (1e-6, 3e-6))


def relay(**how: Any) -> Relay:
    return Relay(**({"slope": 1e3, "rate": RATE, "voltage": 40.0} | how))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Learnt(MADE, 200, lead=2.5), "lead"),  # type: ignore[arg-type]
        (lambda: Learnt(MADE, 100, 0.5, taps=4), "taps"),
        (lambda: PiezoInverse(KANG, RATE), "no PrandtlIshlinskii"),
        (lambda: relay(periods=0), "periods"),
        (lambda: Oscillation(1e9, 300.0, 1e-7).pid(math.inf), "gain_margin"),
        (lambda: Shaper(500.0).shaped(np.zeros((3, 2)), RATE), r"shape \(3, 2\)"),
        (lambda: StepSizes((1.0, 2.0), (1e-6, 2e-6), (2e-6, 1e-6)), "backward"),
        (lambda: Mover(Stepping(), TABLE, MADE, KANG.gain, unit="mm"), "unit"),
        (lambda: Mover(Stepping(), TABLE, UNLIMITED, KANG.gain), "range is finite"),
        (
            lambda: Mover(Stepping(pause=1e-3), TABLE, MADE, KANG.gain, slip=Slip(2e-3)),
            "slip edge takes 40 ticks",
        ),
        (lambda: Regulator(Pid(1.0), RATE, notches=Notch(500.0)), "notches"),  # type: ignore[arg-type]
        (lambda: simulate_control(KANG, None, "1 um", "1 ms"), "must have step"),  # type: ignore[arg-type]
        (lambda: Estimator(STEPS).band("95 nm"), "level"),
        (lambda: PiezoInverse(BENT, RATE).follow(math.nan), "volts"),
        (lambda: settling(xr.Dataset({"drive_voltage": ("time", [0.0])}), 0.0), "no end_effector_position"),
    ],
)
def test_refused(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        make()


def test_whole_numbers_of_numpy_will_do() -> None:
    assert relay(periods=np.int64(3)) is not None
    assert Learnt(MADE, np.int64(200), lead=np.int64(2)) is not None  # type: ignore[arg-type]


@pytest.mark.parametrize("step", [0.07, 150.0 / 4096])
@pytest.mark.parametrize("wrapped", [False, True])
def test_rounding_does_not_pass_the_voltages_of_the_regulator(step: float, wrapped: bool) -> None:
    """150.01 V came of 150 V, and -20.02 V of -20 V, in steps of 70 mV; nothing is left over for later."""

    class Within:
        def __init__(self, controller: Regulator) -> None:
            self.controller = controller

        def step(self, measured: float, target: float, tick: int) -> float:
            return self.controller.step(measured, target, tick)

    own = Regulator(Pid(1e9), RATE, min_voltage=-20.0, max_voltage=150.0)
    made = NoiseShaped(Within(own) if wrapped else own, step)
    found = np.array([made.step(0.0, 50e-6 if tick < 5000 else -50e-6, tick) for tick in range(12_000)])
    assert -20.0 <= found.min() < -20.0 + step
    assert 150.0 - step < found.max() <= 150.0
    np.testing.assert_allclose(found / step, np.rint(found / step), atol=1e-9)
    alone = Regulator(Pid(1e9), RATE, min_voltage=-20.0, max_voltage=150.0)
    wanted = np.array([alone.step(0.0, 50e-6 if tick < 5000 else -50e-6, tick) for tick in range(12_000)])
    assert np.abs(found - wanted).max() <= step * (1.0 + 1e-9)


def test_a_drive_in_steps_is_one_that_the_actuator_takes() -> None:
    own = Regulator(Pid(1e9), RATE, max_voltage=150.0)
    found = simulate_control(KANG, NoiseShaped(own, "70 mV"), "50 um", "0.1 s", rate=RATE)
    assert found["drive_voltage"].values.max() == pytest.approx(2142 * 0.07)
