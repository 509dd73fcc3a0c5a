"""Derivatives by the fields of a waveform against differences of whole simulations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.simulation.varied import put_in, record_value

KANG = ss.load_actuator("kang2007")
OTHER = ss.Actuator(
    gain=0.9e-7,
    natural_frequency=2 * math.pi * 1400.0,
    damping_ratio=0.08,
    stage_mass=0.06,
    end_effector_mass=0.02,
    friction=ss.Elastoplastic(2e6, 60.0, 0.5, 0.3, 0.4, 0.6e-7),
    external_force=0.05,
)
KNOTS = ss.PeriodicKnots((0.0, 8e-3, 20e-3, 23e-3), (0.0, 20.0, 70.0, 30.0), 25e-3)
CASES: dict[str, tuple[Any, Any, list[str]]] = {
    "sawtooth": (
        KANG,
        ss.Sawtooth(65.0, 20.0, 0.9, 2.0),
        ["amplitude", "frequency", "rise_fraction", "offset"],
    ),
    "a jump": (KANG, ss.Sawtooth(60.0, 25.0), ["amplitude", "frequency"]),
    "sine": (OTHER, ss.Sine(30.0, 140.0, 0.3, 60.0), ["amplitude", "frequency", "phase", "offset"]),
    "cycloid": (OTHER, ss.waveform.Cycloid(70.0, 60.0, 0.8), ["amplitude", "frequency", "rise_fraction"]),
}

# As plain Python the others show no other lines of the solver.


def with_field(waveform: Any, name: str, value: float) -> Any:
    return type(waveform)(**put_in(waveform, {name: value}))


def differences(model: Any, waveform: Any, name: str, times: np.ndarray, load: Any = 1.0) -> np.ndarray:
    """Of two simulations at a fine tolerance, each with its own steps."""
    value = record_value(waveform, name)
    h = 1e-4 * (abs(value) or 1.0)
    ends = [
        ss.simulate(model, with_field(waveform, name, value + s * h), times=times, tolerance=1e-13, load=load)
        for s in (1.0, -1.0)
    ]
    return (ends[0].end_effector_position.values - ends[1].end_effector_position.values) / (2.0 * h)


@pytest.mark.filterwarnings("ignore::stickslip.simulation.SimulationWarning")
@pytest.mark.parametrize("name", CASES)
def test_of_a_trajectory(name: str) -> None:
    model, waveform, fields = CASES[name]
    times = np.linspace(0.0, 7.3 / waveform.frequency, 40)
    found = ss.simulation.sensitivities(
        model, waveform, times=times, parameters=[*fields, "coulomb_force"], tolerance=1e-12
    )
    for field in fields:
        expected = differences(model, waveform, field, times)
        near = np.abs(found.derivative.sel(parameter=field) - expected)
        assert float(near.max()) < 3e-3 * float(np.abs(expected).max()), field
    alone = ss.simulation.sensitivities(
        model, waveform, times=times, parameters=["coulomb_force"], tolerance=1e-12
    )
    # The same but for rounding: a drive that varies takes other code. 1e-12 m for 1 N is the tolerance.
    np.testing.assert_allclose(
        found.derivative.sel(parameter="coulomb_force"), alone.derivative[0], rtol=1e-6, atol=1e-12
    )


@pytest.mark.filterwarnings("ignore::stickslip.simulation.SimulationWarning")
def test_of_a_trajectory_whose_normal_force_jumps() -> None:
    """While the contact sticks, and while it slides: the jumps stay where they are when the drive moves."""
    waveform, times = ss.Sawtooth(65.0, 20.0, 0.9, 2.0), np.linspace(0.0, 0.23, 40)
    load = ss.Sampled([0.0, 0.031, 0.0965, 0.15], [1.0, 0.6, 1.4, 0.9], "hold")
    fields = ["amplitude", "frequency", "rise_fraction"]
    found = ss.simulation.sensitivities(
        KANG, waveform, times=times, parameters=fields, tolerance=1e-12, load=load
    )
    for field in fields:
        expected = differences(KANG, waveform, field, times, load)
        near = np.abs(found.derivative.sel(parameter=field) - expected)
        assert float(near.max()) < 3e-3 * float(np.abs(expected).max()), field


@pytest.mark.parametrize("name", CASES)
def test_of_the_steady_step(name: str) -> None:
    model, waveform, fields = CASES[name]
    found = ss.simulation.steady_step_derivatives(model, waveform, parameters=fields, tolerance=1e-12)
    for field in fields:
        value = record_value(waveform, field)
        h = 1e-4 * (abs(value) or 1.0)
        steps = [
            ss.steady_step(model, with_field(waveform, field, value + s * h), tolerance=1e-13)
            for s in (1.0, -1.0)
        ]
        assert found[field] == pytest.approx((steps[0] - steps[1]) / (2.0 * h), rel=3e-3, abs=2e-12), field


def test_by_every_knot() -> None:
    names = [f"value_{i}" for i in (2, 3, 4)] + [f"time_{i}" for i in (2, 3, 4)]
    found = ss.simulation.steady_step_derivatives(KANG, KNOTS, parameters=names, tolerance=1e-12)
    for name in names:
        value = record_value(KNOTS, name)
        steps = [
            ss.steady_step(KANG, with_field(KNOTS, name, value + h), tolerance=1e-13)
            for h in (1e-4 * value, -1e-4 * value)
        ]
        assert found[name] == pytest.approx((steps[0] - steps[1]) / (2e-4 * value), rel=5e-3), name


def test_units_are_those_of_the_waveform() -> None:
    found = ss.simulation.sensitivities(
        KANG, ss.Sawtooth(65.0, 20.0, 0.9), 0.1, parameters=["amplitude", "frequency"]
    )
    assert found.unit.values.tolist() == ["V", "Hz"]


def test_no_derivative_where_a_break_appears() -> None:
    with pytest.raises(ss.QuantityError, match="rise_fraction"):
        ss.simulation.sensitivities(KANG, ss.Sawtooth(65.0, 20.0), 0.1, parameters=["rise_fraction"])


def test_unknown_names_say_what_there_is() -> None:
    with pytest.raises(ss.QuantityError, match="amplitude"):
        ss.simulation.sensitivities(KANG, ss.Sawtooth(65.0, 20.0), 0.1, parameters=["amplitud"])
