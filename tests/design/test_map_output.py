"""Maps of the step behind a converter and an amplifier: the same steps as a controller's table has."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip import design
from stickslip.control import StepSizes
from stickslip.control.steps import RISING
from stickslip.physics.actuator import Actuator
from stickslip.physics.electronics import Amplifier, OutputStage, Stack
from stickslip.quantities.units import QuantityError
from stickslip.simulation import steady_step

KANG = ss.load_actuator("kang2007")
RATE, HERTZ = 20e3, 100.0
TOLERANCE = 1e-10
AMPLIFIER = Amplifier(1.0, 0.0, 3e4, 1e6, 5.0, -200.0, 200.0)
EDGE = 1e-5  # share of a step that its fall takes, as in the tables without updates
STEPS = ss.PeriodicKnots((0.0, RISING / HERTZ, (RISING + EDGE) / HERTZ), (0.0, 1.0, 0.0), 1.0 / HERTZ)
STACK = Stack(1.8e-6, 0.02, 4.0, 150.0, 50.0, 2.0)


def stage(frequency: float, damping: float) -> Actuator:
    """An actuator whose range refuses no mirrored drive."""
    own = {"natural_frequency": 2.0 * math.pi * frequency, "damping_ratio": damping}
    return KANG.replace(**own, min_voltage=-math.inf, max_voltage=math.inf)


def some_actuator() -> Actuator:
    rng = np.random.default_rng(29)
    own = stage(float(rng.uniform(500.0, 3e3)), float(rng.uniform(0.1, 0.5)))
    return own.replace(
        end_effector_mass=float(rng.uniform(0.05, 0.2)), incline=float(rng.uniform(-0.05, 0.05))
    )


@pytest.mark.parametrize(
    "output",
    [
        OutputStage(),
        OutputStage(RATE, step=0.137),
        OutputStage(RATE, interpolation="linear"),
        OutputStage(slew_rate=300e3),
        OutputStage.of_amplifier(AMPLIFIER, "1 uF")._replace(update_rate=RATE),
    ],
)
def test_a_map_is_the_table_of_the_steps(output: OutputStage) -> None:
    model = stage(RATE, 0.03) if output.slew_rate == 300e3 else some_actuator()
    table = StepSizes.of_model(model, output, HERTZ, 80.0)
    found = ss.step_map(model, STEPS, voltage=table.voltages, direction=[1, -1], output=output).net_step
    forward, backward = found.sel(direction=1).values, -found.sel(direction=-1).values
    # The table never becomes less, and what does not walk is zero in it.
    np.testing.assert_allclose(
        np.maximum.accumulate(np.maximum(forward, 0.0)), table.forward, atol=3 * TOLERANCE
    )
    if not output.step:  # a step back begins at another voltage in the table, and is rounded from there
        np.testing.assert_allclose(
            np.maximum.accumulate(np.maximum(backward, 0.0)), table.backward, atol=3 * TOLERANCE
        )


def test_held_voltages_step_half_as_far_on_a_stage_that_rings_with_them() -> None:
    model, volts = stage(RATE, 0.03), [80.0, 100.0]
    ideal, held = (
        ss.step_map(model, STEPS, voltage=volts, output=o).net_step for o in (None, OutputStage(RATE))
    )
    assert np.all(held.values > 0.0)
    assert np.all(held.values < 0.6 * ideal.values)


@pytest.mark.parametrize("output", [OutputStage(RATE), OutputStage(RATE, slew_rate=300e3)])
def test_each_point_has_the_staircase_of_its_own_frequency(output: OutputStage, tmp_path: Path) -> None:
    model, saw = some_actuator(), ss.Sawtooth(60.0, HERTZ, rise_fraction=0.9)
    over: dict[str, Any] = {"voltage": [30.0, 60.0], "frequency": [70.0, 301.0, 1300.0], "load": [0.0, -0.03]}
    found = ss.step_map(model, saw, **over, output=output)
    for at in found.stack(point=("voltage", "frequency", "load")).transpose("point").point.values:
        volts, hertz, load = at
        one = found.sel(voltage=volts, frequency=hertz, load=load)
        drive: Any = output.behind(saw._replace(amplitude=volts, frequency=hertz))
        loaded = model.replace(external_force=model.external_force + load)
        assert float(one.net_step) == pytest.approx(steady_step(loaded, drive), abs=3 * TOLERANCE)
        assert float(one.speed) == pytest.approx(float(one.net_step) / drive.period, rel=1e-12)
        assert drive.period == pytest.approx(round(RATE / hertz) / RATE, rel=1e-12)
    stored = ss.step_map(model, saw, **over, output=output, store=tmp_path / "map", threads=1)
    np.testing.assert_array_equal(stored.net_step.values, found.net_step.values)
    loads = ss.step_map(model, saw, load=[0.0, -0.03], output=output)  # one drive for all points
    same = ss.step_map(model, saw, load=[0.0, -0.03], frequency=HERTZ, output=output)
    np.testing.assert_allclose(loads.net_step.values, same.net_step.values, atol=3 * TOLERANCE)
    np.testing.assert_allclose(loads.speed.values, same.speed.values, atol=3 * TOLERANCE * HERTZ)


def test_draws_of_a_fit_walk_behind_the_output_too() -> None:
    output, draws = OutputStage(RATE), {"coulomb_force": np.linspace(0.5, 0.58, 40)}
    found = ss.step_map(
        stage(RATE, 0.03), ss.Sawtooth(60.0, HERTZ), voltage=[60.0], output=output, fit=draws, draws=40
    )
    assert float(found.net_step_low[0]) < float(found.net_step[0]) < float(found.net_step_high[0])
    assert float(found.draws_converged[0]) == 40


def test_a_period_of_too_few_updates_or_too_many_is_refused_with_the_reason() -> None:
    found = ss.step_map(
        KANG, voltage=60.0, frequency=[10.0, 100.0, 6e3], output=OutputStage(RATE, points=1000)
    )
    assert found.status.values.tolist() == [4, 0, 4]
    assert "has 3 updates at 20000 Hz, and the output plays 4 to 1000" in str(found.reason.values[2])
    assert "has 2000 updates" in str(found.reason.values[0])
    with pytest.raises(QuantityError, match="3 updates"):
        ss.step_map(KANG, ss.Sawtooth(60.0, 6e3), load=[0.0], output=OutputStage(RATE))
    with pytest.raises(QuantityError, match=r"output = 20000.* must be OutputStage"):
        ss.step_map(KANG, voltage=60.0, frequency=[100.0], output=RATE)  # type: ignore[arg-type]


def test_current_is_that_of_the_amplifier_s_voltage() -> None:
    """Held voltages jump; an amplifier of 300 kV/s gives 0.54 A into 1.8 uF, at any frequency."""
    saw, over = ss.Sawtooth(60.0, HERTZ), {"voltage": 60.0, "frequency": [50.0, 200.0], "stack": STACK}
    with pytest.raises(QuantityError, match="infinite current"):
        ss.step_map(KANG, saw, **over, output=OutputStage(RATE))
    found = ss.step_map(KANG, saw, **over, output=OutputStage(RATE, slew_rate=300e3))
    np.testing.assert_allclose(found.peak_current.values, STACK.load * 300e3, rtol=1e-3)


@pytest.mark.parametrize("hertz", [200.0])
def test_motions_within_a_period_are_near_those_without_updates(hertz: float) -> None:
    """Many fine updates are the drive itself: its slip is still seen as one among the jumps."""
    over: dict[str, Any] = {"voltage": [60.0], "frequency": hertz}
    names = ("backlash", "ringing", "ripple")
    ideal, held = (
        ss.step_map(KANG, **over, quantities=names, output=one) for one in (None, OutputStage(50e3))
    )
    for name in names:
        assert np.all(np.isfinite(held[name].values))
        np.testing.assert_allclose(held[name].values, ideal[name].values, rtol=0.05, atol=5e-9, err_msg=name)
    coarse = ss.step_map(KANG, **over, quantities=names, output=OutputStage(50e3, step=5.0))
    assert np.all(np.isfinite(coarse.ringing.values))  # its first jump comes early in the period


def test_limits_of_stepping_are_those_behind_the_output() -> None:
    model, output = stage(RATE, 0.03), OutputStage(RATE)
    drive = ss.Sawtooth(60.0, HERTZ)
    volts = design.minimum_voltage(
        model, drive, step="1 um", max_voltage="80 V", output=output, tolerance=0.05
    )
    assert steady_step(model, output.behind(drive._replace(amplitude=volts))) >= 1e-6
    assert steady_step(model, output.behind(drive._replace(amplitude=volts - 0.05))) < 1e-6
    loaded = some_actuator()
    force = design.blocking_force(loaded, drive, output=output, tolerance=1e-3)
    walks, stops = (loaded.replace(external_force=loaded.external_force - f) for f in (force - 1e-3, force))
    assert steady_step(walks, output.behind(drive)) > 0.0 >= steady_step(stops, output.behind(drive))
