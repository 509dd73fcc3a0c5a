"""The equations of motion against Newton's law, written with masses, stiffnesses and forces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.actuator import Actuator, PulledSlider
from stickslip.friction import LuGre, force
from stickslip.mechanism import (
    FIRST_BRISTLE,
    SLIDER,
    SLIDER_VELOCITY,
    STAGE,
    STAGE_VELOCITY,
    holding_force,
    joined,
    slider_acceleration,
    stage_acceleration,
    with_coefficients,
)
from stickslip.simulation.models import mechanism, resting_state

M, K, C, T = 0.0998, 1.1e6, 340.0, 0.11  # kg, N/m, N s/m, N/V
M_E, LOAD, SLOPE = 0.13, 0.07, 0.2  # kg, N, rad
STAGE_LOAD = -0.6  # N, on the stage; no actuator has one yet, the equations do
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
# Drive, its second derivative, position and velocity of stage and slider, friction: effects of like size.
U, DDU, Y, W, X, S, F = 61.0, -4e7, 3.1e-6, 2.3e-3, 1.7e-6, -1.9e-3, 0.43


def state(y: float = Y, w: float = W, x: float = X, s: float = S) -> np.ndarray:
    q = np.zeros(FIRST_BRISTLE + 1)
    q[[STAGE, STAGE_VELOCITY, SLIDER, SLIDER_VELOCITY]] = y, w, x, s
    return q


@pytest.mark.parametrize("reaction", [True, False])
def test_stage(reaction: bool) -> None:
    mech = mechanism(ACTUATOR.replace(stage_reaction=reaction))._replace(stage_acceleration=STAGE_LOAD / M)
    newton = T * U - C * W - K * Y + STAGE_LOAD - (F if reaction else 0.0)
    assert M * stage_acceleration(mech, U, Y, W, F) == pytest.approx(newton, rel=1e-12)


def test_end_effector() -> None:
    assert M_E * slider_acceleration(mechanism(ACTUATOR), U, X, S, F) == pytest.approx(F + AXIAL, rel=1e-12)


def test_pulled_slider() -> None:
    mech = mechanism(SLIDER_PULLED)
    drive = 2e-5  # m
    newton = 3e4 * (drive - X) - 5.0 * S + 0.3 + F
    assert 2.0 * slider_acceleration(mech, drive, X, S, F) == pytest.approx(newton, rel=1e-12)
    ground = resting_state(LAW, mech, 0.0)
    assert ground[STAGE] == ground[STAGE_VELOCITY] == stage_acceleration(mech, drive, 0.0, 0.0, F) == 0.0


def test_force_that_holds_the_end_effector_on_the_stage() -> None:
    # Unknown: the common acceleration and the force, from both equations of motion.
    _, held = np.linalg.solve([[M, 1.0], [M_E, -1.0]], [T * U - C * W - K * Y, AXIAL])
    assert holding_force(mechanism(ACTUATOR), U, DDU, state()) == pytest.approx(held, rel=1e-12)


def test_force_that_holds_the_end_effector_on_a_static_stage() -> None:
    mech = mechanism(ACTUATOR.replace(natural_frequency=math.inf))
    assert holding_force(mech, U, DDU, state()) == pytest.approx(M_E * T / K * DDU - AXIAL, rel=1e-12)


def test_joined_bodies() -> None:
    # An end-effector with a spring, a damper and a drive of its own shows every coefficient.
    offset, k, c, b = -0.6e-6, 2e5, 90.0, 0.05
    own = {"slider_stiffness": k / M_E, "slider_damping": c / M_E, "slider_drive": b / M_E}
    mech = mechanism(ACTUATOR)._replace(stage_acceleration=STAGE_LOAD / M, **own)
    newton = (T + b) * U - (C + c) * W - K * Y - k * (Y + offset) + AXIAL + STAGE_LOAD
    body = joined(mech, offset)
    assert (M + M_E) * stage_acceleration(body, U, Y, W, F) == pytest.approx(newton, rel=1e-12)


def test_joined_bodies_of_prescribed_motion_keep_the_stage() -> None:
    mech = mechanism(ACTUATOR)._replace(reaction=0.0, mobility=0.0)
    newton = T * U - C * W - K * Y
    assert M * stage_acceleration(joined(mech, 0.0), U, Y, W, F) == pytest.approx(newton, rel=1e-12)


def test_clamped_end_effector_is_part_of_the_stage() -> None:
    mech = mechanism(ACTUATOR.replace(clamped=True))
    assert mech.clamped
    newton = T * U - C * W - K * Y
    assert M * stage_acceleration(joined(mech, 0.0), U, Y, W, F) == pytest.approx(newton, rel=1e-12)


@pytest.mark.parametrize("slope", [SLOPE, -SLOPE])
def test_state_at_rest(slope: float) -> None:
    model = ACTUATOR.replace(incline=slope)
    mech = mechanism(model)
    q = resting_state(LAW, mech, U)
    carried = M_E * 9.80665 * math.sin(slope) - LOAD  # N, by friction
    assert force(LAW, 0.0, q[FIRST_BRISTLE:]) == pytest.approx(carried, rel=1e-9)
    assert q[STAGE] == pytest.approx((T * U - carried) / K, rel=1e-12)
    assert q[SLIDER] == q[STAGE]
    assert q[STAGE_VELOCITY] == q[SLIDER_VELOCITY] == 0.0


def test_state_at_rest_on_a_static_stage_and_on_a_spring() -> None:
    static = mechanism(ACTUATOR.replace(natural_frequency=math.inf))
    assert resting_state(LAW, static, U)[STAGE] == pytest.approx(T / K * U, rel=1e-12)
    pulled = resting_state(LAW, mechanism(SLIDER_PULLED), 1e-5)
    assert pulled[SLIDER] == pytest.approx(1e-5, rel=1e-12)


def test_mechanism_with_other_coefficients_keeps_its_flags() -> None:
    mech = mechanism(ACTUATOR.replace(clamped=True))
    other = with_coefficients(mech, np.arange(1.0, len(mech) + 1.0))
    assert isinstance(other, type(mech))
    assert tuple(other) == (mech.kinematic, mech.clamped, *np.arange(3.0, len(mech) + 1.0))
