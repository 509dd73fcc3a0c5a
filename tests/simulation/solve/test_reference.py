"""The integrator against trajectories of an independent solver (SciPy's DOP853 at rtol 1e-13; see their
README)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.friction import LuGre
from stickslip.physics.actuator import Actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import SimulationWarning, simulate, steady_orbit, steady_step
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.shapes import Step

REFERENCE = (Path(__file__).parents[3] / ".." / "shared" / "reference").resolve()
DRIVE = Sawtooth(amplitude=65.0, frequency=5.0)


def actuator(law: LuGre) -> Actuator:
    return Actuator(
        gain=0.1057e-6,
        natural_frequency=3303.1,
        damping_ratio=0.524,
        stage_mass=0.0998,
        end_effector_mass=0.1,
        friction=law,
        stage_reaction=False,
    )


PROBLEMS = {
    "P1": actuator(LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401)),
    "P2": actuator(LuGre(1e8, 200.0, 0.0, 0.5401, 0.7, stribeck_velocity=1e-3)),
}
NET_STEP = {"P1": 2.672345e-6, "P2": 3.119194e-6}  # printed beside the trajectories


@pytest.mark.parametrize(
    "tolerance",
    [1e-8, 1e-9, 1e-10, 1e-11],
)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_error_stays_below_ten_tolerances(problem: str, tolerance: float) -> None:
    reference = np.load(REFERENCE / f"reference_{problem}.npz")
    found = simulate(PROBLEMS[problem], DRIVE, 1.6, sample_rate=1e3, tolerance=tolerance)
    np.testing.assert_allclose(found["time"], reference["t"], atol=1e-12)
    assert np.max(np.abs(found["end_effector_position"].values - reference["xe"])) < 10 * tolerance
    assert np.max(np.abs(found["stage_position"].values - reference["y"])) < 10 * tolerance


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_output_grid_does_not_change_the_solution(problem: str) -> None:
    coarse = simulate(PROBLEMS[problem], DRIVE, 0.4, sample_rate=1e3, tolerance=1e-10)
    fine = simulate(PROBLEMS[problem], DRIVE, 0.4, sample_rate=7919.0, tolerance=1e-10)
    joint = simulate(
        PROBLEMS[problem], DRIVE, 0.4, times=np.union1d(coarse["time"], fine["time"]), tolerance=1e-10
    )
    for one in (coarse, fine):
        same = joint.sel(time=one["time"].values)
        for name in ("end_effector_position", "stage_position"):
            assert np.max(np.abs(one[name].values - same[name].values)) < 1e-10


def test_samples_between_steps_are_as_good_as_the_steps() -> None:
    reference = simulate(PROBLEMS["P1"], DRIVE, 0.4, sample_rate=50e3, tolerance=1e-12)
    found = simulate(PROBLEMS["P1"], DRIVE, 0.4, sample_rate=50e3, tolerance=1e-9)
    for name in ("end_effector_position", "stage_position", "bristle_deflection"):
        assert np.max(np.abs(found[name].values - reference[name].values)) < 1e-8


def test_the_periodic_motion_is_what_a_short_trajectory_settles_to() -> None:
    drive = Sawtooth(amplitude=65.0, frequency=200.0, periods=12)
    settled = simulate(PROBLEMS["P1"], drive, sample_rate=200.0, tolerance=1e-10)[
        "end_effector_position"
    ].values
    assert steady_step(PROBLEMS["P1"], drive) == pytest.approx(settled[-1] - settled[-2], abs=1e-9)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_steady_step_is_that_of_the_settled_trajectory(problem: str) -> None:
    assert steady_step(PROBLEMS[problem], DRIVE, tolerance=1e-11) == pytest.approx(
        NET_STEP[problem], abs=1e-11
    )
    reference = np.load(REFERENCE / f"reference_{problem}.npz")
    settled = reference["xe"][-1] - reference["xe"][-201]
    assert steady_step(PROBLEMS[problem], DRIVE) == pytest.approx(settled, abs=2e-10)


def test_steady_step_backward_mirrors_forward() -> None:
    forward = steady_step(PROBLEMS["P1"], DRIVE)
    backward = steady_step(PROBLEMS["P1"], ReverseSawtooth(amplitude=65.0, frequency=5.0))
    assert backward == pytest.approx(-forward, abs=1e-10)


def test_steady_orbit_is_a_fixed_point_at_high_frequency() -> None:
    """At 2 kHz the transient outlasts many periods; the orbit must still repeat from period to period."""
    drive = Sawtooth(amplitude=20.0, frequency=2000.0)
    orbit = steady_orbit(PROBLEMS["P1"], drive)
    assert orbit.converged
    long = simulate(PROBLEMS["P1"], drive, 0.5, sample_rate=2000.0, tolerance=1e-11)
    last = np.diff(long["end_effector_position"].values)[-1]
    assert steady_step(PROBLEMS["P1"], drive) == pytest.approx(last, abs=1e-10)


@pytest.mark.parametrize("kilohertz", [15.0, 60.0])
def test_steady_step_is_right_where_transients_outlast_thousands_of_periods(kilohertz: float) -> None:
    """A multiplier of 0.999: what one period still changes says little about how far the orbit is."""
    model = PROBLEMS["P1"].replace(natural_frequency=2e3 * np.pi * kilohertz)
    drive = Sawtooth(amplitude=20.0 if kilohertz > 15.0 else 65.0, frequency=20e3)
    orbit = steady_orbit(model, drive, tolerance=1e-10)
    assert orbit.converged
    assert 0.99 < np.abs(orbit.multipliers).max() < 1.0
    times = np.array([0.0, 0.7, 0.8])
    with pytest.warns(SimulationWarning, match="not shown to hold"):  # after 16,000 periods
        waited = simulate(model, drive, times=times, tolerance=1e-11)["end_effector_position"].values
    assert orbit.step == pytest.approx((waited[2] - waited[1]) / 2000, abs=1e-10)


def test_a_trajectory_that_cannot_be_finished_comes_back_with_the_reason() -> None:
    whole = simulate(PROBLEMS["P1"], DRIVE, 1.6)
    with pytest.warns(SimulationWarning, match="stopped at"):
        part = simulate(PROBLEMS["P1"], DRIVE, 1.6, max_steps=100)
    n = part.sizes["time"]
    assert 2 < n < 1601
    assert "more than 100 steps" in part.attrs["outcome"]
    np.testing.assert_allclose(
        part["end_effector_position"], whole["end_effector_position"][:n], rtol=0, atol=1e-9
    )


def test_a_clamped_end_effector_gives_the_textbook_step_response() -> None:
    model = PROBLEMS["P1"].replace(clamped=True)
    found = simulate(model, Step(amplitude=60.0), 0.01, sample_rate=20e3, tolerance=1e-11)
    t, wn, zeta = found["time"].values, 3303.1, 0.524
    wd = wn * np.sqrt(1 - zeta**2)
    exact = 0.1057e-6 * 60 * (1 - np.exp(-zeta * wn * t) * (np.cos(wd * t) + zeta * wn / wd * np.sin(wd * t)))
    assert np.max(np.abs(found["stage_position"].values - exact)) < 1e-10
    np.testing.assert_array_equal(found["end_effector_position"], found["stage_position"])


def test_without_slip_the_end_effector_scans_with_the_stage() -> None:
    """Scanning mode: the same model, driven slowly, only bends the bristle: F = m_e a."""
    found = simulate(PROBLEMS["P1"], DRIVE, 0.19, tolerance=1e-11)
    late = found.sel(time=slice(0.1, None))
    assert np.max(np.abs(late["sliding_displacement"] - late["sliding_displacement"][0])) < 1e-10
    assert float(late["end_effector_velocity"][-1]) == pytest.approx(0.1057e-6 * 65 * 5, rel=1e-6)


def test_pohls_static_stage_steps_by_gain_times_voltage() -> None:
    from stickslip.friction import Coulomb

    pohl = PROBLEMS["P1"].replace(natural_frequency=np.inf, friction=Coulomb(0.5401))
    assert steady_step(pohl, DRIVE) == pytest.approx(0.1057e-6 * 65.0, rel=1e-9)
    with pytest.raises(QuantityError, match="rise_fraction"):
        steady_step(pohl.replace(friction=PROBLEMS["P1"].friction), DRIVE)


def test_times_and_tolerances_may_have_a_unit() -> None:
    found = simulate(PROBLEMS["P1"], DRIVE, "20 ms", sample_rate="2 kHz", tolerance="1 nm")
    same = simulate(PROBLEMS["P1"], DRIVE, 0.02, sample_rate=2000.0, tolerance=1e-9)
    for one in (found, same):
        del one.attrs["created"]  # to the second
    assert found.identical(same)
    with pytest.raises(QuantityError, match="duration = '20 mm'"):
        simulate(PROBLEMS["P1"], DRIVE, "20 mm")


def test_what_is_no_model_or_no_drive_is_said() -> None:
    wrong: Any = "kang2007"
    with pytest.raises(TypeError, match="a model is an Actuator or a PulledSlider, not str"):
        simulate(wrong, DRIVE, 0.01)
    with pytest.raises(TypeError, match=r"the drive is a waveform .* not a str"):
        simulate(PROBLEMS["P1"], wrong)


def test_wrong_drives_are_refused() -> None:
    limited = PROBLEMS["P1"].replace(min_voltage=0.0, max_voltage="60 V")
    with pytest.raises(QuantityError, match=r"65 V is out of range.*60 V"):
        simulate(limited, DRIVE, 1.0)
    with pytest.raises(QuantityError, match="not in m"):
        simulate(PROBLEMS["P1"], Sawtooth(amplitude=1e-6, frequency=5.0, unit="m"), 1.0)
    with pytest.raises(QuantityError, match="duration"):
        simulate(PROBLEMS["P1"], DRIVE)
    with pytest.raises(QuantityError, match="tolerance"):
        simulate(PROBLEMS["P1"], DRIVE, 1.0, tolerance=0.0)
