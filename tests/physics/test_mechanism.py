"""The equations of motion against Newton's law, written with masses, stiffnesses and forces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.friction import Coulomb, LuGre, MaxwellSlip, NormalForce, force
from stickslip.physics.actuator import Actuator, PulledSlider
from stickslip.simulation.models import RelativeLoad, resting_state, system
from stickslip.waveform.drive import constant

M, K, C, T = 0.0998, 1.1e6, 340.0, 0.11  # kg, N/m, N s/m, N/V
M_E, LOAD, SLOPE = 0.13, 0.07, 0.2  # kg, N, rad
AXIAL = LOAD - M_E * 9.80665 * math.sin(SLOPE)  # N
LAW = LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401)
ACTUATOR = Actuator(
    gain=T / K,
    natural_frequency=math.sqrt(K / M),
    damping_ratio=C / (2.0 * math.sqrt(K * M)),
    stage_mass=M,
    end_effector_mass=M_E,
    friction=LAW,
    external_force=LOAD,
    incline=SLOPE,
)
SLIDER_PULLED = PulledSlider(2.0, 3e4, 5.0, LAW, external_force=0.3)
# Drive, position and velocity of stage and slider, friction: effects of like size.
U, Y, W, X, S, F = 61.0, 3.1e-6, 2.3e-3, 1.7e-6, -1.9e-3, 0.43


def accelerations(model: Actuator | PulledSlider, q: list[float], u: float, F: float) -> list[float]:
    """Of each body of the model's plant, from its numbers; its contact pushes with F."""
    plant = system(model).plant
    (contact,) = plant.elements or (None,)
    return [
        mode.drive * u
        + mode.acceleration
        - mode.damping * q[2 * m + 1]
        - mode.stiffness * q[2 * m]
        + (contact.push[m] * F if contact else 0.0)
        for m, mode in enumerate(plant.modes)
    ]


@pytest.mark.parametrize("reaction", [True, False])
def test_plant_of_an_actuator(reaction: bool) -> None:
    model = ACTUATOR.replace(stage_reaction=reaction)
    of = system(model)
    stage, slider = accelerations(model, [Y, W, X, S], U, F)
    assert M * stage == pytest.approx(T * U - C * W - K * Y - (F if reaction else 0.0), rel=1e-12)
    assert M_E * slider == pytest.approx(F + AXIAL, rel=1e-12)
    assert of.plant.elements[0].velocity == (1.0, -1.0)  # of the stage relative to the end-effector
    assert of.plant.rate == pytest.approx(math.sqrt(K / M), rel=1e-12)
    assert (of.stage, of.slider, of.internal, of.gain, of.clamped) == (0, 2, 1, 0.0, False)


def test_plant_of_a_static_stage() -> None:
    of = system(ACTUATOR.replace(natural_frequency=math.inf))
    (slider,), (contact,) = of.plant.modes, of.plant.elements
    assert slider.stiffness == slider.damping == slider.drive == 0.0
    assert M_E * (slider.acceleration + contact.push[0] * F) == pytest.approx(F + AXIAL, rel=1e-12)
    assert contact.velocity == (-1.0,)
    assert contact.drive_rate == of.gain == pytest.approx(T / K, rel=1e-12)
    assert (of.stage, of.slider, of.internal, of.clamped) == (None, 0, 1, False)


def test_plant_of_a_pulled_slider() -> None:
    drive = 2e-5  # m
    (slider,) = accelerations(SLIDER_PULLED, [X, S], drive, F)
    assert 2.0 * slider == pytest.approx(3e4 * (drive - X) - 5.0 * S + 0.3 + F, rel=1e-12)
    of = system(SLIDER_PULLED)
    assert of.plant.elements[0].velocity == (-1.0,)  # of the ground relative to the slider
    assert of.plant.rate == pytest.approx(math.sqrt(3e4 / 2.0), rel=1e-12)
    assert (of.stage, of.slider, of.gain) == (None, 0, 0.0)


def test_plant_of_a_clamped_end_effector() -> None:
    """One body, and no contact; what holds the end-effector is worked out afterwards."""
    model = ACTUATOR.replace(clamped=True)
    of = system(model)
    (body,) = accelerations(model, [Y, W], U, F)
    assert M * body == pytest.approx(T * U - C * W - K * Y, rel=1e-12)
    assert of.plant.elements == ()
    assert (of.stage, of.slider, of.clamped) == (0, 0, True)
    assert of.axial == pytest.approx(AXIAL, rel=1e-12)
    assert of.mass == pytest.approx(M_E, rel=1e-12)
    static = system(model.replace(natural_frequency=math.inf))
    assert static.gain == pytest.approx(T / K, rel=1e-12)
    assert static.stage is None


def test_normal_force_of_a_plant() -> None:
    plain, loaded = system(ACTUATOR), system(ACTUATOR, normal=1.3, loaded=True)
    assert (plain.plant.elements[0].normal, plain.plant.elements[0].loaded) == (1.0, None)
    assert (loaded.plant.elements[0].normal, loaded.plant.elements[0].loaded) == (1.3, 1.0)
    static = ACTUATOR.replace(natural_frequency=math.inf)
    contact = system(static, normal=1.3, loaded=True).plant.elements[0]
    assert (contact.normal, contact.loaded) == (1.3, 1.0)


def test_normal_force_of_a_run() -> None:
    assert RelativeLoad(1.3).system(ACTUATOR) == system(ACTUATOR, normal=1.3)
    assert RelativeLoad(1.3, constant(1.6)).system(ACTUATOR) == system(ACTUATOR, normal=1.3, loaded=True)
    of = system(ACTUATOR, normal=1.3)
    np.testing.assert_array_equal(RelativeLoad(1.3).rest(of, U), resting_state(of, U))
    np.testing.assert_array_equal(RelativeLoad(1.3, constant(1.6)).rest(of, U), resting_state(of, U, 1.6))


def test_no_plant_of_anything_else() -> None:
    with pytest.raises(TypeError, match="an Actuator or a PulledSlider, not LuGre"):
        system(LAW)


@pytest.mark.parametrize("slope", [SLOPE, -SLOPE])
@pytest.mark.parametrize("load", [1.0, 1.6])
def test_state_at_rest(slope: float, load: float) -> None:
    """The contact carries weight and load of the end-effector; with more normal force it deflects less."""
    q = resting_state(system(ACTUATOR.replace(incline=slope), normal=0.9), U, load)
    carried = M_E * 9.80665 * math.sin(slope) - LOAD  # N, by friction
    assert 0.9 * load * force(LAW, 0.0, q[4:]) == pytest.approx(carried, rel=1e-9)
    assert q[0] == pytest.approx((T * U - carried) / K, rel=1e-12)
    assert q[2] == q[0]
    assert q[1] == q[3] == 0.0


@pytest.mark.parametrize("slope", [SLOPE, -SLOPE])
def test_state_at_rest_where_the_normal_force_changes(slope: float) -> None:
    """It is that of the place, which follows from what the contact carries; of a static law, from what it
    can carry there."""
    along = NormalForce(slope=1e5, stiffness_exponent=0.4)
    tilted = ACTUATOR.replace(incline=slope, normal_force=along)
    q = resting_state(system(tilted, normal=0.9), U)
    carried = M_E * 9.80665 * math.sin(slope) - LOAD
    assert abs(1e5 * q[2]) > 0.05
    assert 0.9 * (1.0 + 1e5 * q[2]) * force(LAW, 0.0, q[4:]) == pytest.approx(carried, rel=1e-9)
    assert q[0] == pytest.approx((T * U - carried) / K, rel=1e-12)
    weak = tilted.replace(friction=Coulomb(0.1), normal_force=along._replace(stiffness_exponent=1.0))
    x = resting_state(system(weak), U)[2]
    holds = math.copysign(0.1, carried)  # N at x = 0, less than is to be carried
    assert x == pytest.approx((T * U - holds) / (K + 1e5 * holds), rel=1e-9)


def test_state_at_rest_of_a_stage_that_feels_no_friction() -> None:
    q = resting_state(system(ACTUATOR.replace(stage_reaction=False)), U)
    assert q[0] == q[2] == pytest.approx(T * U / K, rel=1e-12)


@pytest.mark.parametrize("slope", [1.2, -1.2])
def test_state_at_rest_of_what_cannot_rest(slope: float) -> None:
    """It begins at breakaway, from where it slides down; without a normal force nothing holds it."""
    of = system(ACTUATOR.replace(incline=slope))
    assert force(LAW, 0.0, resting_state(of, U)[4:]) == pytest.approx(math.copysign(0.5401, slope), rel=1e-6)
    static = system(ACTUATOR.replace(incline=slope, friction=Coulomb(0.5)), normal=0.8)
    assert resting_state(static, U)[0] == pytest.approx((T * U - math.copysign(0.4, slope)) / K, rel=1e-12)
    loose = resting_state(of, U, 0.0)
    assert loose[4] == 0.0
    assert loose[0] == pytest.approx(T * U / K, rel=1e-12)


def test_state_at_rest_of_static_friction() -> None:
    q = resting_state(system(ACTUATOR.replace(friction=Coulomb(0.5))), U)
    assert q[0] == q[2] == pytest.approx((T * U + AXIAL) / K, rel=1e-12)
    assert q.size == 4


def test_state_at_rest_of_many_elements() -> None:
    law = MaxwellSlip((1e6, 2e6), (0.3, 0.1))
    q = resting_state(system(ACTUATOR.replace(friction=law)), U)
    assert force(law, 0.0, q[4:]) == pytest.approx(-AXIAL, rel=1e-9)


def test_state_at_rest_on_a_static_stage_and_on_a_spring() -> None:
    static = resting_state(system(ACTUATOR.replace(natural_frequency=math.inf)), U)
    assert static[0] == pytest.approx(T / K * U, rel=1e-12)
    assert force(LAW, 0.0, static[2:]) == pytest.approx(-AXIAL, rel=1e-9)
    pulled = resting_state(system(SLIDER_PULLED), 1e-5)
    assert pulled[0] == pytest.approx(1e-5, rel=1e-12)
    assert force(LAW, 0.0, pulled[2:]) == pytest.approx(-0.3, rel=1e-9)


def test_state_at_rest_of_a_clamped_end_effector() -> None:
    q = resting_state(system(ACTUATOR.replace(clamped=True)), U)
    np.testing.assert_allclose(q, [T * U / K, 0.0], rtol=1e-12)
    static = system(ACTUATOR.replace(clamped=True, natural_frequency=math.inf))
    np.testing.assert_array_equal(resting_state(static, U)[1:], [0.0])
