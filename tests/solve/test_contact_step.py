"""One step in scalars, against the same method on arrays and against SciPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip._jit import compiled
from stickslip.friction import Dahl, Elastoplastic, LuGre, MaxwellSlip
from stickslip.friction.law import element, rate, register
from stickslip.mechanism import Mechanism
from stickslip.solve import bristle, rodas
from stickslip.solve import contact_step as steps
from stickslip.waveform.drive import Drive

LAWS = {
    "LuGre": LuGre(1.4e6, 35.0, 0.7, 0.54, 0.7, 1e-3),
    "Dahl": Dahl(1.4e6, 0.54),
    "Elastoplastic": Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7),
}
# Every coefficient at work: springs, dampers and drives on both bodies, reaction, constant forces.
MECH = Mechanism(
    False, False, 1e-7, 1.09e7, 3460.0, 1.15, 0.3, 5.0, 4e5, 120.0, 0.02, -0.7, 10.0, 3303.0
)  # fmt: skip
DRIVE = Drive(
    0.0,
    np.zeros(1),
    np.array([[10.0, 4e3, -2e6, 3e9]]),
    np.array([0, 1]),
    np.array([[3.0, 9e3, 0.4, 1e5]]),
)
LOAD = Drive(1.0, np.zeros(1), np.array([[1.1, 300.0, -4e4, 1e6]]), np.array([0, 0]), np.zeros((0, 4)))
T, H = 2e-4, 2e-5
STATES = {
    "forward": (np.array([1e-6, 3e-3, 2e-7, 1e-3, 2e-7]), 1.0),
    "backward": (np.array([-1e-6, -3e-3, 2e-7, 1e-3, -2e-7]), -1.0),
}


# What only kernels call has no way in from Python; these have.
@compiled
def at_nodes(drive, i, t, h):
    return bristle.at_nodes(drive, i, t, h)


@compiled
def contact_step(law, mech, side, h, q, u, du, normal, dnormal):
    return steps.contact_step(law, mech, side, h, q, u, du, normal, dnormal)


@compiled
def at(theta, q, new, rows):
    return steps.at(theta, q, new, rows)


@compiled
def smooth_rate(law, v, z, side):
    return steps.smooth_rate(law, v, z, side)


def step(law: object, q: np.ndarray, side: float):
    u, du = at_nodes(DRIVE, 0, T, H)
    normal, dnormal = at_nodes(LOAD, 0, T, H)
    return contact_step(law, MECH, side, H, tuple(q), u, du, normal, dnormal)


def exact(law: object, q: np.ndarray, times: list[float]) -> np.ndarray:
    m = MECH

    def slopes(t: float, s: np.ndarray) -> list[float]:
        y, w, x, v, z = s
        c = DRIVE.polynomial[0]
        u = c[0] + c[1] * t + c[2] * t**2 + c[3] * t**3 + 3.0 * np.sin(0.4 + 9e3 * t + 1e5 * t**2)
        n = 1.1 + 300.0 * t - 4e4 * t**2 + 1e6 * t**3
        force, dz = rate(law, w - v, z)
        stage = 1.15 * u + 0.3 - 3460.0 * w - 1.09e7 * y - 5.0 * n * force
        slider = 0.02 * u - 0.7 - 120.0 * v - 4e5 * x + 10.0 * n * force
        return [w, stage, v, slider, dz]

    assert (m.reaction, m.mobility) == (5.0, 10.0)
    scale = np.array([1e-6, 1e-3, 1e-6, 1e-3, 1e-7])
    found = solve_ivp(
        slopes,
        (T, T + H),
        q,
        method="DOP853",
        rtol=1e-12,
        atol=1e-13 * scale,
        t_eval=[T + s * H for s in times],
    )
    return found.y.T


@pytest.mark.parametrize("motion", STATES)
@pytest.mark.parametrize("name", LAWS)
def test_step_and_continuous_extension_are_the_solution(name: str, motion: str) -> None:
    q, side = STATES[motion]
    new, rows, error, stiffness = step(LAWS[name], q, side)
    middle, end = exact(LAWS[name], q, [0.3, 1.0])
    change = np.abs(end - q)
    np.testing.assert_array_less(np.abs(np.array(new) - end) / change, 3e-5)
    np.testing.assert_array_less(np.abs(np.array(at(0.3, tuple(q), new, rows)) - middle) / change, 3e-4)
    assert 0.0 < error < 1e-8
    v = abs(q[1] - q[3])
    if name == "Dahl":  # the bristle relaxes at sigma_0 |v| / F_C
        assert stiffness == pytest.approx(H * 1.4e6 * v / 0.54, rel=1e-5)


@pytest.mark.parametrize("motion", STATES)
@pytest.mark.parametrize("name", LAWS)
def test_it_is_the_method_on_arrays(name: str, motion: str) -> None:
    q, side = STATES[motion]
    new, rows, error, _ = step(LAWS[name], q, side)
    U, other, stage = np.zeros((8, 5)), np.zeros(5), np.zeros(5)
    slopes, sums, extension = np.zeros((3, 1)), np.zeros((5, 16)), np.zeros((3, 5))
    where = (LAWS[name], MECH, DRIVE, 0, LOAD, 0, T, H, q.copy())
    # The general engine is compiled as a whole; its step alone is plain Python.
    expected = getattr(rodas.step, "py_func", rodas.step)(
        *where, U, other, stage, slopes, extension, sums, 1.0
    )
    np.testing.assert_allclose(new, other, rtol=1e-11, atol=0)
    # Both difference the law: what rounding makes of that is left.
    np.testing.assert_allclose(rows, extension, rtol=1e-5, atol=1e-18)
    assert error == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_beyond_a_reversal_the_law_goes_on_smoothly(name: str, side: float) -> None:
    """Value and slope at v = 0 are those of the side; on the side itself it is the law."""
    law, z, h = LAWS[name], 1e-7 * side, 1e-7
    assert smooth_rate(law, 2e-3 * side, z, side) == tuple(rate(law, 2e-3 * side, z))
    inside, here, beyond = (np.array(smooth_rate(law, s * h * side, z, side)) for s in (1.0, 0.0, -1.0))
    np.testing.assert_allclose(here - beyond, inside - here, rtol=1e-9, atol=1e-25)
    far = np.array(smooth_rate(law, -2e-3 * side, z, side))
    mirrored = 2.0 * np.array(rate(law, 0.0, z)) - np.array(rate(law, 2e-3 * side, z))
    np.testing.assert_allclose(far, mirrored, rtol=1e-14)


class Relaxing(NamedTuple):
    """A bristle that also lets go at rest, as a user's law may."""

    stiffness: float
    rate: float


def relaxing(law, v, z):
    return law.stiffness * z, v - law.rate * z - 1e6 * abs(v) * z


register(Relaxing, relaxing)


def test_a_bristle_that_moves_at_rest_goes_on_smoothly_too() -> None:
    law, z = Relaxing(1e6, 50.0), 1e-7
    _, dz = smooth_rate(law, -2e-3, z, 1.0)
    assert dz == pytest.approx(2 * (-50.0 * z) - (2e-3 - 50.0 * z - 1e6 * 2e-3 * z), rel=1e-12)


def test_the_method_on_arrays_takes_two_elements() -> None:
    law, mech = MaxwellSlip((1e6, 4e5), (0.3, 0.24), 0.4), MECH
    q = np.array([1e-6, 3e-3, 2e-7, 1e-3, 2e-7, -1e-7])

    def slopes(t: float, s: np.ndarray) -> list[float]:
        c = DRIVE.polynomial[0]
        u = c[0] + c[1] * t + c[2] * t**2 + c[3] * t**3 + 3.0 * np.sin(0.4 + 9e3 * t + 1e5 * t**2)
        n = 1.1 + 300.0 * t - 4e4 * t**2 + 1e6 * t**3
        parts = [rate(element(law, e), s[1] - s[3], s[4 + e]) for e in range(2)]
        force = parts[0][0] + parts[1][0]
        stage = 1.15 * u + 0.3 - 3460.0 * s[1] - 1.09e7 * s[0] - 5.0 * n * force
        slider = 0.02 * u - 0.7 - 120.0 * s[3] - 4e5 * s[2] + 10.0 * n * force
        return [s[1], stage, s[3], slider, parts[0][1], parts[1][1]]

    end = solve_ivp(slopes, (T, T + H), q, method="DOP853", rtol=1e-12, atol=1e-20).y[:, -1]
    U, new, stage, sums = np.zeros((8, 6)), np.zeros(6), np.zeros(6), np.zeros((6, 16))
    work = (U, new, stage, np.zeros((3, 2)), np.zeros((3, 6)), sums)
    step_ = getattr(rodas.step, "py_func", rodas.step)
    assert 0.0 < step_(law, mech, DRIVE, 0, LOAD, 0, T, H, q.copy(), *work, 1.0) < 1e-8
    np.testing.assert_array_less(np.abs(new - end) / np.abs(end - q), 3e-5)
