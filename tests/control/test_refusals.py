"""Numbers that a controller, a shaper or a table of steps cannot be made with."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from stickslip.actuator import load_actuator
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
    check_margins,
    settling,
    simulate_control,
    tune,
)
from stickslip.units import QuantityError

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
        (lambda: Learnt(MADE, 200, math.nan), "gain = nan"),
        (lambda: Learnt(MADE, 200, 5.0), "gain = 5 is out of range"),
        (lambda: Learnt(MADE, 200, -0.1), "gain"),
        (lambda: Learnt(MADE, 200, lead=2.5), r"lead = 2\.5: it must be a whole number"),  # type: ignore[arg-type]
        (lambda: Learnt(MADE, 200, lead=-1), "lead = -1: it must be a whole number"),
        (lambda: Learnt(MADE, 200.5), r"ticks = 200\.5"),  # type: ignore[arg-type]
        (lambda: PiezoInverse(BENT, -1.0), "rate = -1 Hz is out of range"),
        (lambda: PiezoInverse(BENT, 0.0), "rate = 0 Hz is out of range"),
        (lambda: PiezoInverse(BENT, RATE, math.nan), "voltage = nan V is not finite"),
        (lambda: relay(rate=-5.0), "rate = -5 Hz is out of range"),
        (lambda: relay(periods=1.5), r"periods = 1\.5"),
        (lambda: relay(periods=0), "periods = 0"),
        (lambda: relay(slope=math.nan), "slope = nan V/s"),
        (lambda: relay(voltage=math.inf), "voltage = inf V is not finite"),
        (lambda: relay(band=-1e-9), "band"),
        (lambda: relay(reach=0.0), "reach = 0 V"),
        (lambda: Oscillation(1e9, 300.0, 1e-7).pid(math.inf), "gain_margin = inf"),
        (lambda: Shaper(500.0).shaped([], RATE), r"shape \(0,\)"),
        (lambda: Shaper(500.0).shaped(np.zeros((3, 2)), RATE), r"shape \(3, 2\)"),
        (lambda: Shaper(500.0).shaped(1.0, RATE), r"shape \(\)"),
        (lambda: Slip.within(math.inf, "1 uF", "65 V"), "current = inf A"),
        (lambda: StepSizes((1.0, 2.0), (-1e-6, 2e-6), (1e-6, 2e-6)), r"StepSizes\.forward\[0\]"),
        (lambda: StepSizes((1.0, 2.0), (1e-6, 2e-6), (2e-6, 1e-6)), r"StepSizes\.backward \[m\] must not"),
        (lambda: Mover(Stepping(), TABLE, MADE, KANG.gain, unit="mm"), r"Mover\.unit = 'mm'"),
        (lambda: NoiseShaped(MADE, math.inf), "step = inf V is not finite"),
        (lambda: NoiseShaped(MADE, math.nan), "step = nan V is not finite"),
        (lambda: tune(KANG, RATE, {"phase_margin": 1.0}), "requirement = .* must be Requirement"),  # type: ignore[arg-type]
        (lambda: check_margins(5.0, KANG), r"regulator = 5\.0 must be Regulator"),  # type: ignore[arg-type]
        (lambda: check_margins(MADE, KANG, 5.0), r"requirement = 5\.0 must be Requirement"),  # type: ignore[arg-type]
        (lambda: Regulator(5.0, RATE), r"Regulator\.pid = 5\.0 must be Pid"),  # type: ignore[arg-type]
        (lambda: Regulator(Pid(1.0), RATE, notches=Notch(500.0)), r"notches\[0\] = 500\.0 must be Notch"),  # type: ignore[arg-type]
        (lambda: Regulator(Pid(1.0), RATE, notches=500.0), r"notches = 500\.0 must be tuple or list"),  # type: ignore[arg-type]
        (lambda: Regulator(Pid(1.0), RATE, low_pass=500.0), r"low_pass = 500\.0 must be LowPass or None"),  # type: ignore[arg-type]
        (lambda: Mover(65.0, TABLE, MADE, KANG.gain), r"Mover\.walk = 65\.0 must be Stepping"),  # type: ignore[arg-type]
        (lambda: Mover(Stepping(), [1.0], MADE, KANG.gain), r"Mover\.table = \[1\.0\] must be StepSizes"),  # type: ignore[arg-type]
        (
            lambda: Mover(Stepping(), TABLE, tune(KANG, RATE), KANG.gain),
            r"Mover\.regulator = .*\n?.* must be Regulator",
        ),  # type: ignore[arg-type]
        (lambda: Mover(Stepping(), TABLE, MADE, KANG.gain, slip=3), r"Mover\.slip = 3 must be Slip or None"),  # type: ignore[arg-type]
        (
            lambda: Mover(Stepping(), TABLE, UNLIMITED, KANG.gain),
            "from -inf V to inf V: the piezo's range is finite",
        ),
        (lambda: simulate_control(KANG, None, "1 um", "1 ms"), "controller = None must have step"),  # type: ignore[arg-type]
        (
            lambda: simulate_control(KANG, MADE, "1 um", "1e12 s"),
            r"duration = 1e.12 s at rate = 20000 Hz: .* at most 20,000,000\. Ask for fewer",
        ),
        (lambda: Estimator(KANG), r"Estimator\.model = .* must be StepModel"),  # type: ignore[arg-type]
        (lambda: Estimator(STEPS).band("95 nm"), "level = '95 nm' has the unit 'nm'"),
        (lambda: Learnt(5, 100), r"Learnt\.regulator = 5 must be Regulator"),  # type: ignore[arg-type]
        (lambda: PiezoInverse(BENT, RATE).follow(math.nan), "volts = nan V is not finite"),
        (
            lambda: settling(xr.Dataset({"drive_voltage": ("time", [0.0])}), 0.0),
            "no end_effector_position; it has drive",
        ),
    ],
)
def test_refused(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        make()


def test_a_probability_in_percent_will_do() -> None:
    one = Estimator(STEPS)
    one.stepped(1, 100)
    assert one.band("95 %") == one.band(0.95) != one.band(0.9)


def test_whole_numbers_of_numpy_will_do() -> None:
    assert relay(periods=np.int64(3)) is not None
    assert Learnt(MADE, np.int64(200), lead=np.int64(2)) is not None  # type: ignore[arg-type]


@pytest.mark.parametrize("step", [0.07, 0.08, 150.0 / 4096])
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
