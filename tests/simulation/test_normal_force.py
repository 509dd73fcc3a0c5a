"""The normal force along the stroke: against SciPy, closed forms, and what it is where it is constant."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plants
import stickslip as ss
from stickslip.friction import NormalForce
from stickslip.identify.results import model_numbers, model_of
from stickslip.parameters.writing import parameter_text
from stickslip.physics.contact import Mindlin
from stickslip.quantities.units import QuantityError
from stickslip.simulation import SimulationWarning
from stickslip.simulation.varied import with_values

KANG = ss.load_actuator("kang2007")
LAW = KANG.friction
WALK = ss.Sawtooth("65 V", "50 Hz", periods=4)
# Steep: a walk of some tens of micrometres feels it.
STEEP = NormalForce(slope=3e4)
ALL = NormalForce(
    slope=-1.5e4, power=-2.0, ripple=0.3, wavelength=2e-5, phase=0.5, origin=2e-6, stiffness_exponent=1 / 3
)
UNEVEN = NormalForce(asymmetry=0.1)


def test_constant_is_as_without_to_the_last_bit() -> None:
    plain, along = (ss.simulate(KANG.replace(normal_force=n), WALK) for n in (None, NormalForce()))
    np.testing.assert_array_equal(along["end_effector_position"], plain["end_effector_position"])
    assert along.attrs["steps"] == plain.attrs["steps"]


def followed_by_scipy(model: ss.Actuator, times: Any, volts: Any) -> Any:
    """Stage, slider and the bristle's own deflection z, whose force is σ₀ n^q z."""
    along = model.normal_force
    q, omega = along.stiffness_exponent, model.natural_frequency

    def rates(t: float, s: Any) -> list[float]:
        y, w, x, v, z = s
        n, steepness = (plants.shape_along(along, along.origin + x, order) for order in (0, 1))
        slides = w - v
        change = slides - abs(slides) * LAW.sigma_0 * n**q * z / (n * LAW.coulomb_force)
        force = LAW.sigma_0 * n**q * z + n * LAW.sigma_1 * change + n * LAW.sigma_2 * slides
        force += along.asymmetry * abs(force)
        stage = omega**2 * (model.gain * volts(t) - y) - 2 * model.damping_ratio * omega * w
        renewed = q * max(steepness * v, 0.0) / n * z
        of_stage = stage - force / model.stage_mass
        return [w, of_stage, v, force / model.end_effector_mass, change - renewed]

    rest = model.gain * volts(0.0)
    found = solve_ivp(
        rates, (0.0, times[-1]), [rest, 0.0, rest, 0.0, 0.0], "LSODA", times,
        rtol=1e-11, atol=[1e-15, 1e-12, 1e-15, 1e-12, 1e-17], max_step=1e-4,
    )  # fmt: skip
    return found.y[2]


@pytest.mark.parametrize("along", [STEEP, ALL, UNEVEN], ids=["linear", "everything", "uneven"])
def test_against_an_independent_solver(along: NormalForce) -> None:
    model, times = KANG.replace(normal_force=along), np.linspace(0.0, 0.06, 31)
    drive = ss.waveform.Multisine((40.0, 25.0), (50.0, 100.0), (0.0, 0.0), offset=60.0)
    angle = 2 * math.pi * 50.0

    def volts(t: float) -> float:
        return 60.0 + 40.0 * math.sin(angle * t) + 25.0 * math.sin(2 * angle * t)

    expected = followed_by_scipy(model, times, volts)
    found = ss.simulate(model, drive, times=times, tolerance=1e-10)["end_effector_position"].values
    assert np.ptp(expected) > 8e-6
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10)
    plain = ss.simulate(KANG, drive, times=times)["end_effector_position"].values
    assert np.abs(found - plain).max() > 5e-9  # which would be seen


def test_a_ball_is_stiffer_by_the_cube_root_of_its_load() -> None:
    """Under twice the load as Mindlin's ball under twice the force."""
    one, two = (Mindlin(force, 2e-3, 1e11, 8e10, 0.4) for force in (1.0, 2.0))
    ball = LAW._replace(sigma_0=one.tangential_stiffness, coulomb_force=0.4, stiction_force=0.4)
    follows = KANG.replace(friction=ball, normal_force=NormalForce(stiffness_exponent=1 / 3))
    step = ss.steady_step(follows, WALK, load=2.0)
    pressed = KANG.replace(friction=ball._replace(sigma_0=0.5 * two.tangential_stiffness))
    assert step == pytest.approx(ss.steady_step(pressed, WALK, load=2.0), abs=1e-13)
    assert abs(step - ss.steady_step(KANG.replace(friction=ball), WALK, load=2.0)) > 1e-8


def test_coulomb_friction_that_grows_along_the_way() -> None:
    """A mass let go by a spring: half a swing of the stiffness k + F_C s, then rest; the spring's energy is
    what friction has taken."""
    mass, stiffness, force, slope, pull = 0.1, 1e3, 0.5, 200.0, 1.2e-3
    slider = ss.physics.PulledSlider(
        mass, stiffness, 0.0, ss.Coulomb(force), normal_force=NormalForce(slope=slope)
    )
    drive = ss.Step(pull, unit="m")
    found = ss.simulate(slider, drive, times=[0.0, 0.01, 0.2], tolerance=1e-10)
    x = found["end_effector_position"].values
    whole = stiffness + force * slope
    middle = (stiffness * pull - force) / whole
    assert x[1] == pytest.approx(middle * (1 - math.cos(math.sqrt(whole / mass) * 0.01)), abs=1e-9)
    assert x[2] == pytest.approx(2 * middle, abs=1e-9)
    given = 0.5 * stiffness * (pull**2 - (pull - x[2]) ** 2)
    assert given == pytest.approx(force * (x[2] + 0.5 * slope * x[2] ** 2), rel=1e-6)
    assert abs(found["friction_force"].values[2]) == pytest.approx(stiffness * abs(pull - x[2]), rel=1e-9)


def test_rest_on_an_incline_hangs_on_the_place() -> None:
    """Where the contact can carry the weight it stays; where it cannot it slides."""
    tilted = KANG.replace(external_force=0.6 * LAW.coulomb_force)
    at_rest = ss.Constant("0 V")
    for origin, stays in (("0 mm", True), ("-0.6 mm", False)):
        along = NormalForce(slope="1 1/mm", origin=origin)
        found = ss.simulate(tilted.replace(normal_force=along), at_rest, "20 ms")
        moved = float(np.ptp(found["end_effector_position"].values))
        assert moved < 1e-12 if stays else moved > 1e-6


@pytest.mark.parametrize("wavelength", [5e-6, 0.3e-6])
def test_rest_is_in_balance_on_ripples_of_any_length(wavelength: float) -> None:
    """A short one was stepped over in turns, and the run began out of balance without a word."""
    ripple = NormalForce(ripple=0.3, wavelength=wavelength, phase=0.3)
    law = ss.LuGre(1.4e6, 35.0, 0.0, 1.5, 1.5)
    model = KANG.replace(friction=law, external_force=-1.45, normal_force=ripple)
    begun = ss.simulate(model, ss.Constant("0 V"), "1 ms").isel(time=0)
    force, place = float(begun["friction_force"]), float(begun["stage_position"])
    assert model.stage_stiffness * place == pytest.approx(-force, rel=1e-9)
    most = 1.5 * float(ripple.factor(float(begun["end_effector_position"])))
    assert force == pytest.approx(min(1.45, most), rel=1e-6)


def test_members_and_derivatives() -> None:
    model = KANG.replace(normal_force=ALL)
    stiffness = LAW.sigma_0 * np.array([1.0, 1.0 + 1e-4, 1.0 - 1e-4])
    members = ss.simulate_ensemble(model, WALK, parameters={"sigma_0": stiffness}, tolerance=1e-12)
    one = ss.simulate(model, WALK, tolerance=1e-12)["end_effector_position"].values[-1]
    assert members["net_displacement"].values[0] == pytest.approx(one, abs=1e-12)
    by = ss.simulation.sensitivities(model, WALK, parameters=["sigma_0"], tolerance=1e-11)
    difference = (members["net_displacement"].values[1] - members["net_displacement"].values[2]) / 2e-4
    assert by["derivative"].values[0, -1] * LAW.sigma_0 == pytest.approx(difference, rel=1e-4)


def test_its_numbers_vary_by_name() -> None:
    """In members, derivatives and records, from a model that has a normal force or none."""
    uneven = np.array([0.05, 0.05 + 1e-5, 0.05 - 1e-5])
    vary = {"normal_force_asymmetry": uneven, "normal_force_slope": np.full(3, 2e3)}
    members = ss.simulate_ensemble(KANG, WALK, parameters=vary, tolerance=1e-12)["net_displacement"].values
    model = KANG.replace(normal_force=NormalForce(slope=2e3, asymmetry=0.05))
    one = ss.simulate(model, WALK, tolerance=1e-12)["end_effector_position"].values[-1]
    assert members[0] == pytest.approx(one, abs=1e-12)
    by = ss.simulation.sensitivities(model, WALK, parameters=[*vary], tolerance=1e-11)["derivative"].values
    assert by[0, -1] == pytest.approx((members[1] - members[2]) / 2e-5, rel=1e-3)
    assert with_values(KANG, {name: float(column[0]) for name, column in vary.items()}) == model
    plain = ss.simulation.sensitivities(KANG, WALK, parameters=["normal_force_asymmetry"], tolerance=1e-11)
    assert abs(plain["derivative"].values[0, -1]) > 1e-6  # m, of a model that has none itself


def test_contact_that_lifts_off_is_named() -> None:
    with pytest.warns(SimulationWarning, match="the contact lifts off at 20"):
        found = ss.simulate(
            KANG.replace(normal_force=NormalForce(slope=-5e4)), ss.Sawtooth("65 V", "50 Hz"), 0.2
        )
    assert found["end_effector_position"].values[-1] < 20e-6
    with pytest.raises(QuantityError, match=r"at -0\.02 m the contact has lifted off"):
        NormalForce(slope="0.1 1/mm").factor([0.0, -0.02])


def test_what_has_no_place_is_refused() -> None:
    model = KANG.replace(normal_force=STEEP)
    for ask in (
        lambda: ss.steady_step(model, WALK),
        lambda: ss.steady_steps(model, WALK, parameters={"amplitude": [50.0, 60.0]}),
        lambda: ss.step_map(model, WALK),
    ):
        with pytest.raises(QuantityError, match="changes along the stroke, and so does the step"):
            ask()
    with pytest.raises(ss.export.ExportError, match="normal_force to None"):
        ss.export.export_c(model, "nowhere")
    with pytest.raises(QuantityError, match="must be NormalForce or None"):
        KANG.replace(normal_force=1.5)
    with pytest.raises(QuantityError, match="Coulomb has none"):
        KANG.replace(friction=ss.Coulomb(0.5), normal_force=NormalForce(stiffness_exponent=0.5))
    with pytest.raises(QuantityError, match="the same is an external_force"):
        KANG.replace(friction=ss.Coulomb(0.5), normal_force=UNEVEN)


def test_files_keep_it(tmp_path: Path) -> None:
    model = KANG.replace(normal_force=ALL)
    file = tmp_path / "own.toml"
    file.write_text(parameter_text(model, "own", "made"))
    np.testing.assert_allclose(ss.load_actuator(file).normal_force, ALL, rtol=1e-15)
    numbers = model_numbers(model)
    assert model_of(numbers).normal_force == ALL
    file.write_text(file.read_text().replace("[normal_force.ripple]", "[normal_force.ripples]"))
    with pytest.raises(QuantityError, match=r"own.toml.*\[ripples\] is unknown .did you mean 'ripple'"):
        ss.load_actuator(file)


def test_a_rig_feels_the_place_that_it_has_come_to() -> None:
    """Two thirds of the friction: it records what a contact records that has as much everywhere."""
    along, bench = NormalForce(slope=-1.0 / 3e-3), ss.rig.load_bench("kang2007-bench")

    channels = {"end_effector_position": ss.rig.Channel("ideal")}
    capture = ss.rig.Capture(length="50 ms", interval="0.5 ms")
    less = {name: 2.0 / 3.0 * getattr(LAW, name) for name in ("sigma_0", "sigma_1", "coulomb_force")}
    weaker = LAW._replace(**less, stiction_force=less["coulomb_force"])
    walked = []
    for model in (KANG.replace(normal_force=along), KANG.replace(friction=weaker), KANG):
        rig = ss.rig.VirtualRig(model, bench, seed=1)
        rig.origin = 1e-3
        recording = ss.rig.measure(rig, WALK, channels, capture, ss.rig.Limits(max_voltage="100 V"))
        walked.append(float(np.ptp(recording["end_effector_position"].values)))
    assert walked[0] == pytest.approx(walked[1], rel=2e-3)
    assert abs(walked[2] - walked[1]) > 0.02 * walked[1]


def test_a_load_that_is_a_force_says_what_a_load_is() -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 20.0)
    with pytest.raises(QuantityError, match=r"load = '1 N'.*over its reference.*external_force"):
        ss.simulate(model, drive, 0.01, load="1 N")  # type: ignore[arg-type]


def test_times_may_say_their_unit() -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 20.0)
    found = ss.simulate(model, drive, times=["0 ms", "5 ms"])
    np.testing.assert_array_equal(found.time, [0.0, 5e-3])
    with pytest.raises(QuantityError, match="times = '5 mm'"):
        ss.simulate(model, drive, times=["0 ms", "5 mm"])
