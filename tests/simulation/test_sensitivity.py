"""Derivatives of trajectories and of the steady step, against differences of simulations of their own."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from stickslip import simulation
from stickslip.friction import Coulomb, Dahl, Elastoplastic, LuGre, MaxwellSlip, ResetIntegrator
from stickslip.identify.walk.displacement import has_slopes
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.piezo import Creep, Piezo
from stickslip.quantities.units import QuantityError
from stickslip.simulation import (
    SimulationWarning,
    sensitivities,
    simulate,
    steady_step,
    steady_step_derivatives,
)
from stickslip.simulation.models import SLIDER
from stickslip.simulation.steady import refuse_unsettled
from stickslip.simulation.trajectory import follow_model
from stickslip.simulation.varied import with_values
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sampled import Sampled

LUGRE = LuGre(1.399e6, 34.9, 0.5, 0.5401, 0.65)
MODEL = Actuator(0.1057e-6, 3303.1, 0.524, 0.2, 0.1, LUGRE, external_force=0.05)
DRIVE = Sawtooth(65.0, 50.0)
TIMES = np.linspace(0.0, 0.1, 401)
CASES = {
    "LuGre": (
        LUGRE,
        ["sigma_0", "sigma_1", "sigma_2", "coulomb_force", "stiction_ratio", "stribeck_velocity"],
    ),
    "Dahl": (Dahl(1.399e6, 0.5401), ["sigma_0", "coulomb_force"]),
    "Elastoplastic": (Elastoplastic(1.399e6, 34.9, 0.0, 0.5401, 0.6, 2e-7), ["sigma_0", "breakaway_share"]),
}
SYSTEM = ["end_effector_mass", "natural_frequency", "damping_ratio", "gain", "external_force", "stage_mass"]


def value(model: Actuator, name: str) -> float:
    law = model.friction._asdict()
    if name == "stiction_ratio":
        return law["stiction_force"] / law["coulomb_force"]
    if name == "breakaway_share":
        return law["breakaway_deflection"] * law["sigma_0"] / law["coulomb_force"]
    return law[name] if name in law else getattr(model, name)


@pytest.mark.parametrize("law", CASES)
def test_derivatives_are_central_differences_of_simulations(law: str) -> None:
    friction, of_law = CASES[law]
    model = MODEL.replace(friction=friction)
    names = [*of_law, *SYSTEM]
    found = sensitivities(model, DRIVE, times=TIMES, parameters=names, tolerance=1e-11)
    for name in names:
        start = value(model, name)
        ends = [
            simulate(with_values(model, {name: start * (1 + h)}), DRIVE, times=TIMES, tolerance=1e-13)
            for h in (1e-4, -1e-4)
        ]
        up, down = (end["end_effector_position"].values for end in ends)
        expected = (up - down) / (2e-4 * start)
        derivative = found["derivative"].sel(parameter=name).values
        np.testing.assert_allclose(derivative, expected, rtol=0, atol=3e-3 * np.abs(expected).max())


def test_where_the_normal_force_jumps_what_is_new_carries_nothing() -> None:
    """Twice while the contact sticks: unloaded, the bristle keeps its deflection; loaded, its force."""
    load = Sampled([0.0, 0.031, 0.0632], [1.0, 0.5, 1.5], "hold")
    names = ["sigma_0", "coulomb_force", "end_effector_mass"]
    found = sensitivities(MODEL, DRIVE, times=TIMES, parameters=names, tolerance=1e-11, load=load)
    for name in names:
        start = value(MODEL, name)
        up, down = (
            simulate(
                with_values(MODEL, {name: start * (1 + h)}), DRIVE, times=TIMES, tolerance=1e-13, load=load
            )["end_effector_position"].values
            for h in (1e-4, -1e-4)
        )
        expected = (up - down) / (2e-4 * start)
        derivative = found["derivative"].sel(parameter=name).values
        np.testing.assert_allclose(derivative, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


def test_a_steady_motion_under_a_normal_force_that_jumps_is_stable() -> None:
    load = Sampled([0.0, 0.005, 0.013], [1.0, 0.5, 1.2], "hold", period=0.02)
    found = steady_step_derivatives(MODEL, DRIVE, parameters=["coulomb_force"], load=load)
    up, down = (
        steady_step(
            with_values(MODEL, {"coulomb_force": 0.5401 * (1 + h)}), DRIVE, tolerance=1e-12, load=load
        )
        for h in (1e-3, -1e-3)
    )
    assert found["coulomb_force"] == pytest.approx((up - down) / (2e-3 * 0.5401), rel=1e-3)


def test_derivatives_side_by_side_are_those_alone() -> None:
    """Five together, of which four take their steps in one loop and the fifth by itself."""
    model, names = MODEL, ["sigma_0", *SYSTEM[:4]]
    together = sensitivities(model, DRIVE, times=TIMES, parameters=names)["derivative"]
    for name in names:
        alone = sensitivities(model, DRIVE, times=TIMES, parameters=[name])["derivative"].values[0]
        found = together.sel(parameter=name).values
        np.testing.assert_allclose(found, alone, rtol=0, atol=1e-7 * np.abs(alone).max())


def test_the_position_is_that_of_the_simulation_and_units_are_told() -> None:
    found = sensitivities(MODEL, DRIVE, times=TIMES, parameters=["sigma_0", "initial_stage_velocity"])
    alone = follow_model(MODEL, DRIVE, TIMES, tolerance=1e-10).samples[:, SLIDER]  # where they settle
    # With neighbours it is other code: products and sums are not rounded alike in both.
    np.testing.assert_allclose(found["end_effector_position"], alone, rtol=0, atol=1e-13)
    assert found["unit"].values.tolist() == ["N/m", "m/s"]


def test_copied_periods_have_the_derivatives_of_periods_integrated() -> None:
    """The last of many periods, which were copied, against a tolerance at which hardly any is."""
    times = np.linspace(0.0, 0.4, 201)
    coarse = sensitivities(MODEL, DRIVE, times=times, parameters=["coulomb_force"], tolerance=1e-9)
    fine = sensitivities(MODEL, DRIVE, times=times, parameters=["coulomb_force"], tolerance=1e-13)
    expected = fine["derivative"].values
    np.testing.assert_allclose(coarse["derivative"], expected, rtol=0, atol=2e-4 * np.abs(expected).max())


STIFF = Actuator(
    4.31428928663444e-08,
    10140.637,
    0.562284797,
    0.0894361729,
    0.16737965,
    LuGre(3608586.34, 72.3515, 0.0, 0.062553, 0.062553),
)
KNOTS = PeriodicKnots(
    (0.0, 0.00097208, 0.00272691, 0.0069624, 0.01313294, 0.01384241),
    (63.8026, -9.5737, 9.6077, -28.5044, 59.8368, 28.7671),
    0.01394211,
)


@pytest.mark.parametrize("tolerance", [1e-9])
def test_rounding_does_not_grow_in_steps_beyond_a_reversal(tolerance: float) -> None:
    """With neighbours it is other code and rounds otherwise: it was wrong by a factor 37."""
    times = np.linspace(0.0, 3 * KNOTS.period, 41)
    found = sensitivities(STIFF, KNOTS, times=times, parameters=["sigma_1"], tolerance=tolerance)
    start = STIFF.friction.sigma_1
    up, down = (
        simulate(with_values(STIFF, {"sigma_1": start * (1 + h)}), KNOTS, times=times, tolerance=1e-12)
        for h in (1e-3, -1e-3)
    )
    expected = (up["end_effector_position"] - down["end_effector_position"]).values / (2e-3 * start)
    derivative = found["derivative"].sel(parameter="sigma_1").values
    np.testing.assert_allclose(derivative, expected, rtol=0, atol=0.02 * np.abs(expected).max())


def test_the_error_of_a_derivative_is_said() -> None:
    """A vibration that hardly decays: its phase is in the derivative, and not in the position's tolerance."""
    model = MODEL.replace(damping_ratio=0.01, natural_frequency=2e4, stage_reaction=True)
    names = ["sigma_0", "natural_frequency"]
    right = sensitivities(model, DRIVE, times=TIMES, parameters=names, tolerance=1e-13)["derivative"]
    for tolerance in (1e-7, 1e-9):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SimulationWarning)
            found = sensitivities(model, DRIVE, times=TIMES, parameters=names, tolerance=tolerance)
        wrong = np.abs(found["derivative"] - right).max("time")
        assert np.all(wrong <= 2.0 * found["derivative_error"])


def test_a_derivative_that_cannot_be_followed_is_said() -> None:
    """A contact as stiff as 4e11 N/m, where a search of a drifting walk once went."""
    law = LuGre(425807260462.28375, 0.03323179480471928, 0.0, 0.5505447091105381, 0.5505447091105381, 1e-3)
    model = load_actuator("kang2007").replace(
        gain=9.99e-8,
        natural_frequency=6000.39,
        damping_ratio=0.09961,
        stage_mass=0.05,
        end_effector_mass=0.1,
        friction=law,
    )
    drive = Sawtooth(50.0, 20.0, periods=6)
    with pytest.warns(SimulationWarning, match="derivative by sigma_0 cannot be followed to the end"):
        found = sensitivities(model, drive, 0.3, parameters=["sigma_0"], tolerance=1e-10, sample_rate=20e3)
    assert not np.all(np.isfinite(found["derivative"]))
    assert np.all(np.isfinite(found["end_effector_position"]))


def test_creep_is_cut_into_the_same_segments() -> None:
    """By the length of the run, which was another for the neighbours."""
    model = MODEL.replace(piezo=Piezo(None, Creep((0.02,), (0.03,))))
    names = ["gain", "amplitude"]
    found = sensitivities(model, DRIVE, 0.047, parameters=names, tolerance=1e-11)["derivative"].values
    for name, by in zip(names, found, strict=True):
        low, high = (
            simulate(
                with_values(model, {name: 0.1057e-6 * (1 + h)}) if name == "gain" else model,
                DRIVE if name == "gain" else Sawtooth(65.0 * (1 + h), 50.0),
                0.047,
                tolerance=1e-13,
            )["end_effector_position"].values
            for h in (-1e-4, 1e-4)
        )
        expected = (high - low) / (2e-4 * (0.1057e-6 if name == "gain" else 65.0))
        np.testing.assert_allclose(by, expected, rtol=0, atol=3e-3 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["initial_stage_position", "initial_end_effector_velocity"])
def test_a_disturbed_start_dies_out_as_the_model_says(name: str) -> None:
    """A linear check: with a stiff contact far from sliding, stage and end-effector are one oscillator."""
    friction = LuGre(1e9, 1e4, 0.0, 1e3, 1e3)
    model = MODEL.replace(friction=friction, external_force=0.0, stage_reaction=True)
    times = np.linspace(0.0, 5e-3, 101)
    drive = Sawtooth(1e-3, 10.0)
    by = sensitivities(model, drive, times=times, parameters=[name], tolerance=1e-13)["derivative"].values[0]
    m, m_e = model.stage_mass, model.end_effector_mass
    share = m / (m + m_e)
    wn = 3303.1 * np.sqrt(share)
    zeta = 0.524 * np.sqrt(share)
    wd = wn * np.sqrt(1 - zeta**2)
    decay = np.exp(-zeta * wn * times)
    if name == "initial_stage_position":  # the joined body starts off its rest by one unit
        expected = decay * (np.cos(wd * times) + zeta * wn / wd * np.sin(wd * times)) - 1.0
    else:  # the end-effector's momentum is shared
        expected = (1 - share) * decay * np.sin(wd * times) / wd
    scale = np.abs(expected).max()
    np.testing.assert_allclose(by, expected, rtol=0, atol=2e-2 * scale)


def test_derivatives_of_the_steady_step() -> None:
    names = ["sigma_0", "coulomb_force", "end_effector_mass", "gain", "external_force"]
    found = steady_step_derivatives(MODEL, DRIVE, parameters=names)
    for name in names:
        start = value(MODEL, name)
        up, down = (
            steady_step(with_values(MODEL, {name: start * (1 + h)}), DRIVE, tolerance=1e-13)
            for h in (1e-3, -1e-3)
        )
        assert found[name] == pytest.approx((up - down) / (2e-3 * start), rel=2e-3)


@pytest.mark.parametrize("of", [sensitivities, steady_step_derivatives])
@pytest.mark.parametrize("given", ["sigma_0", [3], None])
def test_what_is_no_list_of_names_is_refused(of, given) -> None:
    with pytest.raises(QuantityError, match="must be a list of names"):
        of(MODEL, DRIVE, parameters=given)


def test_refusals_name_what_is_wrong() -> None:
    with pytest.raises(QuantityError, match="no derivative by 'sigma_9'"):
        sensitivities(MODEL, DRIVE, 0.1, parameters=["sigma_9"])
    with pytest.raises(QuantityError, match="Coulomb has none"):
        sensitivities(MODEL.replace(friction=Coulomb(0.5)), DRIVE, 0.1, parameters=["coulomb_force"])
    with pytest.raises(QuantityError, match="does not depend on the initial state"):
        steady_step_derivatives(MODEL, DRIVE, parameters=["initial_stage_position"])


def test_the_steady_step_by_a_law_of_several_states() -> None:
    """Each spring's state is a row of the periodic state."""
    law = MaxwellSlip((1.0e6, 0.6e6), (0.25, 0.29))
    model, drive = MODEL.replace(friction=law), Sawtooth(65.0, 50.0, 0.95)
    found = steady_step_derivatives(model, drive, parameters=["strength_2"], tolerance=1e-12)["strength_2"]
    steps = [
        steady_step(model.replace(friction=law._replace(strength=(0.25, 0.29 + h))), drive, tolerance=1e-13)
        for h in (1e-5, -1e-5)
    ]
    assert found == pytest.approx((steps[0] - steps[1]) / 2e-5, rel=5e-3)


@pytest.mark.parametrize(
    "law",
    [
        ResetIntegrator(1.4e6, 4e-7, 0.0, 30.0),
        MaxwellSlip((1e6,), (0.5,), 0.0, 1.3),
        MaxwellSlip((1e6, 5e5), (0.3, 0.2), 0.0, 1.2),
    ],
    ids=["reset", "one element", "two elements"],
)
def test_no_derivatives_where_the_force_jumps(law: object) -> None:
    """A neighbour jumps at another time: derivatives were wrong by up to their sign."""
    model = MODEL.replace(friction=law)
    for ask in (
        lambda: sensitivities(model, DRIVE, 0.02, parameters=["gain"]),
        lambda: steady_step_derivatives(model, DRIVE, parameters=["gain"]),
    ):
        with pytest.raises(QuantityError, match="force does not jump at the start of sliding"):
            ask()
    assert not has_slopes(model)
    assert has_slopes(MODEL)
    assert has_slopes(MODEL.replace(friction=MaxwellSlip((1e6,), (0.5,))))


@pytest.mark.parametrize("ask", ["steady_step", "steady_steps", "steady_step_derivatives"])
def test_what_is_clamped_takes_no_steps(ask: str) -> None:
    """It was said to step by micrometres: where the stage is at the end of a period, from nought."""
    given = {"steady_steps": {"gain": [1e-7]}, "steady_step_derivatives": ["gain"]}
    options = {"parameters": given[ask]} if ask in given else {}
    with pytest.raises(QuantityError, match="clamped to the stage: it takes no steps"):
        getattr(simulation, ask)(MODEL.replace(clamped=True), DRIVE, **options)


@pytest.mark.parametrize("rotary", [False, True])
def test_no_derivatives_without_a_steady_step(rotary: bool) -> None:
    """With a force beyond friction it slides faster and faster: the last iterate has no derivatives."""
    model = MODEL.replace(external_force=1.0, rotary=rotary, friction=LUGRE._replace(sigma_2=0.0))
    unit = "rad" if rotary else "m"
    for ask in (
        lambda: simulation.steady_step(model, DRIVE),
        lambda: steady_step_derivatives(model, DRIVE, parameters=["gain"]),
    ):
        with pytest.raises(simulation.NotPeriodicError, match=rf"no motion .* [kM]?{unit} per"):
            ask()
    orbit = simulation.steady_orbit(MODEL, DRIVE)
    refuse_unsettled(orbit, MODEL)
    with pytest.raises(simulation.NotPeriodicError, match="is unstable"):
        refuse_unsettled(orbit._replace(multipliers=np.array([1.01])), MODEL)
