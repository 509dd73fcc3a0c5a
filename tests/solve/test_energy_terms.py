"""The terms of the energy account over one step, against SciPy's quadrature of what they are called."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from stickslip.actuator import Actuator
from stickslip.friction import Coulomb, LuGre, elements
from stickslip.mechanism import FIRST_BRISTLE, SLIDER, SLIDER_VELOCITY, STAGE, STAGE_VELOCITY
from stickslip.simulation.models import mechanism
from stickslip.solve.energy import TERMS, add
from stickslip.waveform.pieces import Piece, assemble

M, K, C, T = 0.0998, 1.1e6, 340.0, 0.11  # kg, N/m, N s/m, N/V
M_E, LOAD = 0.13, 0.07  # kg, N
LUGRE = LuGre(2e5, 30.0, 4.0, 0.5, 0.5)
ACTUATOR = Actuator(
    gain=T / K,
    natural_frequency=math.sqrt(K / M),
    damping_ratio=C / (2.0 * math.sqrt(K * M)),
    stage_mass=M,
    end_effector_mass=M_E,
    friction=LUGRE,
    external_force=LOAD,
)
# The step begins at BEGIN and lasts H; the part of it from FIRST to LAST is accounted for.
BEGIN, H, FIRST, LAST = 0.013, 4e-4, 0.2, 0.7
U, DU, DDU = 40.0, -9e4, 3e8  # V, V/s, V/s²: of the drive at t = 0
DRIVE = assemble(0.0, [Piece(0.0, (U, DU, 0.5 * DDU))], 1.0)
NORMAL = assemble(1.0, [Piece(0.0, (0.8, 11.0))], 1.0)


def states(v: float) -> tuple[np.ndarray, np.ndarray]:
    """At both ends of the step; in between, all is linear. `v` is the sliding velocity at the begin."""
    q, new = np.zeros(FIRST_BRISTLE + 1), np.zeros(FIRST_BRISTLE + 1)
    w = [STAGE, STAGE_VELOCITY, SLIDER, SLIDER_VELOCITY, FIRST_BRISTLE]
    q[w] = 3.1e-6, 2.3e-3, 1.7e-6, 2.3e-3 - v, 0.9e-6
    new[w] = 3.9e-6, 3.6e-3, 1.2e-6, 1.1e-3, 1.4e-6
    return q, new


def account(law: object, model: Actuator, mode: int, v: float, first: float = FIRST, last: float = LAST):
    """The four sums: from 0, 1, 2 and 3, to which the part of the step is added."""
    q, new = states(v)
    if elements(law) == 0:
        q[FIRST_BRISTLE] = 1.0  # forwards; what stands there at the end is the next step's
    n, found = q.size, np.arange(float(TERMS))
    rows, probe = np.zeros((3, n)), np.zeros(n)
    drives = (DRIVE, 0, NORMAL, 0)
    add(law, mechanism(model), mode, *drives, BEGIN, H, 0.0, q, new, rows, n, first, last, probe, found)
    return found - np.arange(float(TERMS))


def expected(contact, stage=None, slider=None, v: float = 1e-3) -> list[float]:
    """Integrals over time of drive, damping and friction power; `contact` gives the force at (t, state)."""
    q, new = states(v)

    def state(t: float) -> np.ndarray:
        theta = (t - BEGIN) / H
        return (1.0 - theta) * q + theta * new

    def integral(power) -> float:
        return quad(power, BEGIN + FIRST * H, BEGIN + LAST * H, epsabs=0.0, epsrel=1e-10)[0]

    stage = stage or (lambda t: state(t)[STAGE_VELOCITY])
    slider = slider or (lambda t: state(t)[SLIDER_VELOCITY])
    return [
        integral(lambda t: T * volts(t) * stage(t)) / M,
        integral(lambda t: C * stage(t) ** 2) / M,
        integral(lambda t: contact(t, state(t)) * stage(t)),
        integral(lambda t: contact(t, state(t)) * slider(t)),
    ]


def volts(t: float) -> float:
    return U + DU * t + 0.5 * DDU * t * t


def test_sliding_under_a_varying_load() -> None:
    def contact(t: float, q: np.ndarray) -> float:
        v, z = q[STAGE_VELOCITY] - q[SLIDER_VELOCITY], q[FIRST_BRISTLE]
        return (0.8 + 11.0 * t) * (2e5 * z + 30.0 * (v - 2e5 * abs(v) / 0.5 * z) + 4.0 * v)

    np.testing.assert_allclose(account(LUGRE, ACTUATOR, 0, 1e-3), expected(contact), rtol=1e-8)


def test_a_law_without_states_keeps_its_direction() -> None:
    found = account(Coulomb(0.5), ACTUATOR.replace(friction=Coulomb(0.5)), 0, 1e-3)
    np.testing.assert_allclose(found, expected(lambda t, q: 0.5 * (0.8 + 11.0 * t)), rtol=1e-8)


def test_at_rest_the_contact_moves_the_end_effector_with_the_stage() -> None:
    """M a = T u - C w - K y - F and M_e a = F + load, with one acceleration a."""

    def contact(t: float, q: np.ndarray) -> float:
        on_stage = T * volts(t) - C * q[STAGE_VELOCITY] - K * q[STAGE]
        return (on_stage / M - LOAD / M_E) / (1.0 / M + 1.0 / M_E)

    whole = expected(contact)
    np.testing.assert_allclose(account(LUGRE, ACTUATOR, 1, 1e-3), [*whole[:3], whole[2]], rtol=1e-8)


def test_a_static_stage_has_the_velocity_of_the_drive() -> None:
    model = ACTUATOR.replace(natural_frequency=math.inf, friction=Coulomb(0.5))

    def stage(t: float) -> float:
        return T / K * (DU + DDU * t)

    def sliding(t: float, q: np.ndarray) -> float:
        return math.copysign(0.5 * (0.8 + 11.0 * t), stage(t) - q[SLIDER_VELOCITY])

    def at_rest(t: float, q: np.ndarray) -> float:
        return M_E * T / K * DDU - LOAD

    whole = expected(sliding, stage)
    np.testing.assert_allclose(account(model.friction, model, 0, 1e-3), [0.0, 0.0, *whole[2:]], rtol=1e-8)
    whole = expected(at_rest, stage, stage)
    np.testing.assert_allclose(account(model.friction, model, 1, 1e-3), [0.0, 0.0, *whole[2:]], rtol=1e-8)


@pytest.mark.parametrize("last", [FIRST, 0.5 * FIRST])
def test_an_empty_part_adds_nothing(last: float) -> None:
    assert np.all(account(LUGRE, ACTUATOR, 0, 1e-3, FIRST, last) == 0.0)
