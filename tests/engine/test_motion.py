"""Elements under a prescribed motion, one step and one interval at a time, against the pair written anew,
closed forms and NumPy's stop operators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.own import Own, own_rate
from stickslip.engine import law_of
from stickslip.engine.motion import follow_position, forces_at
from stickslip.friction import Coulomb, Dahl, LuGre, MaxwellSlip
from stickslip.friction import law as registered

SIGMA_0, F_C, V = 1e6, 0.5, -2e-5
DAHL = Dahl(SIGMA_0, F_C)
START, H = 1e-7, 2e-3


def advance(
    law: Any, v: float, z: float, duration: float, tolerance: float, before: float, after: float
) -> tuple[float, bool]:
    """The deflection after one interval, and whether it could be followed to its end."""
    time, position, load = np.array([0.0, duration]), np.array([0.0, v * duration]), np.array([before, after])
    state = np.array([z])
    reached = follow_position(law, time, position, load, state, tolerance, False, np.zeros((2, 2)))
    return float(state[0]), reached == 2


def slope(t: float, z: Any) -> Any:
    return V * (1.0 - SIGMA_0 * z / F_C * math.copysign(1.0, V))


def one_step(
    rate: Callable[[float, float], float], slope: float, by_time: float, h: float
) -> tuple[float, float]:
    """Deflection after one step of the exponential pair from `START`, and its estimate of the error, from
    rate(t, z) and its derivatives at the start."""
    x = h * slope
    phi_1 = math.expm1(x) / x
    phi_2 = (phi_1 - 1.0) / x
    phi_3 = (phi_2 - 0.5) / x
    first = rate(0.0, START)
    second = START + h * phi_1 * first + h**2 * phi_2 * by_time
    bends = rate(h, second) - first - slope * (second - START) - h * by_time
    return second + 2.0 * h * phi_3 * bends, abs(2.0 * h * phi_3 * bends)


@pytest.mark.parametrize("h", [H, 20.0 * H, 1000.0 * H])
def test_one_step_and_its_error_are_those_of_the_pair(h: float) -> None:
    """A tolerance just above the estimate lets the step pass, one just below does not."""
    law = Dahl(SIGMA_0, F_C, exponent=2.0)

    def rate(t: float, z: float) -> float:
        return V * (1.0 + SIGMA_0 * z / F_C) ** 2  # the motion goes to -x

    value, error = one_step(rate, 2.0 * V * SIGMA_0 / F_C * (1.0 + SIGMA_0 * START / F_C), 0.0, h)
    assert error > 1e-12
    z, reached = advance(law, V, START, h, 1.001 * error, 1.0, 1.0)
    assert reached is True
    assert z == pytest.approx(value, abs=1e-4 * error)
    halved, reached = advance(law, V, START, h, 0.999 * error, 1.0, 1.0)
    assert reached is True
    assert abs(halved - value) > 0.01 * error


@pytest.mark.parametrize("tolerance", [1e-9, 1e-11, 1e-13])
def test_many_steps_meet_the_closed_form(tolerance: float) -> None:
    z, reached = advance(DAHL, V, START, 0.5, tolerance, 1.0, 1.0)
    rest = math.copysign(F_C / SIGMA_0, V)
    assert reached is True
    assert z == pytest.approx(
        rest + (START - rest) * math.exp(-abs(V) * SIGMA_0 / F_C * 0.5), abs=20 * tolerance
    )


def test_what_cannot_be_followed_is_said() -> None:
    """No error at all is allowed: the steps shrink to nothing, and the deflection stays where it came to."""
    z, reached = advance(DAHL, V, START, H, 0.0, 1.0, 1.0)
    assert not reached
    assert z == pytest.approx(START, rel=1e-2)
    time, samples = np.linspace(0.0, 1.0, 5), np.zeros((5, 2))
    position = np.array([0.0, 1e-6, 2e-6, math.nan, 0.0])
    assert follow_position(DAHL, time, position, np.ones(5), np.zeros(1), 1e-12, True, samples) == 3


def test_elements_add_up_under_their_load() -> None:
    stiffness, strength, sigma_2 = np.array([3e6, 1e6]), np.array([0.4, 0.3]), 20.0
    time = np.cumsum([0.0, 0.1, 0.2, 0.1, 0.3, 0.2, 0.1])
    position = 1e-7 * np.array([0.0, 1.0, 2.5, 4.2, 2.0, -3.0, -2.0])
    load = np.linspace(0.7, 1.3, time.size)
    limit = strength / stiffness
    z, expected = np.array([0.5e-7, -1e-7]), []
    for k in range(time.size):
        ahead = max(k, 1)
        if k:
            z = np.clip(z + position[k] - position[k - 1], -limit, limit)
        v = (position[ahead] - position[ahead - 1]) / (time[ahead] - time[ahead - 1])
        expected.append([load[k] * (stiffness @ z + sigma_2 * v), *z])
    state, samples = np.array([0.5e-7, -1e-7]), np.zeros((time.size, 3))
    law = MaxwellSlip(tuple(stiffness), tuple(strength), sigma_2)
    assert follow_position(law, time, position, load, state, 1e-13, True, samples) == time.size
    np.testing.assert_allclose(samples, expected, rtol=1e-9, atol=1e-13)
    np.testing.assert_array_equal(state, samples[-1, 1:])


def test_a_bristle_starts_where_it_is_and_shows_the_force_of_the_interval_ahead() -> None:
    law, state, samples = LuGre(SIGMA_0, 30.0, 2.0, F_C, F_C), np.array([1e-7]), np.zeros((2, 2))
    follow_position(
        law, np.array([0.0, 1e-9]), np.array([0.0, 1e-12]), np.ones(2), state, 1e-13, True, samples
    )
    v = 1e-3
    rate = v - SIGMA_0 * v / F_C * 1e-7
    assert samples[0] == pytest.approx([SIGMA_0 * 1e-7 + 30.0 * rate + 2.0 * v, 1e-7], rel=1e-12)


def test_a_static_law_keeps_its_direction_while_the_motion_pauses() -> None:
    time, state, samples = np.arange(5.0), np.array([1.0]), np.zeros((5, 2))
    position = np.array([0.0, -1.0, -1.0, 2.0, 2.0])
    assert follow_position(Coulomb(0.3), time, position, np.full(5, 2.0), state, 1e-12, True, samples) == 5
    np.testing.assert_allclose(samples[:, 0], [-0.6, -0.6, -0.6, 0.6, 0.6])
    np.testing.assert_allclose(samples[:, 1], [-1.0, -1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize("normal", [(0.5, 0.9), (0.9, 0.5), (0.0, 0.8)])
def test_one_step_under_a_changing_normal_force(normal: tuple[float, float]) -> None:
    """What grows takes its share of the deflection away; what falls leaves it."""
    before, after = normal
    growth = (after - before) / H

    def renewed(t: float, z: Any) -> Any:
        n = before + growth * t
        if growth > 0.0 and n == 0.0:  # contact begins: z = t dz/dt
            return 0.5 * slope(t, z)
        return slope(t, z) - (growth / n * z if growth > 0.0 else 0.0)

    renews = growth / before if growth > 0.0 and before > 0.0 else 0.0
    by_z = -abs(V) * SIGMA_0 / F_C * (0.5 if before == 0.0 else 1.0) - renews
    value, error = one_step(renewed, by_z, renews**2 * START, H)
    z, reached = advance(DAHL, V, START, H, 1.001 * error + 1e-18, before, after)
    assert reached
    assert z == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("travel", [0.999, 1.0, 1.001])
def test_an_interval_of_the_presliding_length_is_not_one_step(travel: float) -> None:
    """There the pair's own estimate is zero, and 5 % of the deflection were lost."""
    length = F_C / SIGMA_0
    z, reached = advance(Dahl(SIGMA_0, F_C), travel * length, 0.0, 1.0, 1e-12, 1.0, 1.0)
    assert reached
    assert z == pytest.approx(length * -math.expm1(-travel), abs=5e-12)


def test_contact_that_begins_is_loaded_half() -> None:
    """The force grows with N: dF = k N/N_0 dx."""
    z, reached = advance(Dahl(SIGMA_0, 1e9), 1e-7, 0.0, 1.0, 1e-13, 0.0, 1.0)
    assert reached
    assert z == pytest.approx(0.5e-7, rel=1e-6)


def test_many_steps_under_a_growing_normal_force() -> None:
    """At rest z N stays."""
    creeping = -1e-9
    z, reached = advance(DAHL, creeping, START, 0.5, 1e-16, 0.4, 1.1)

    def renewed(t: float, z: Any) -> Any:
        return creeping * (1.0 + SIGMA_0 * z / F_C) - 1.4 / (0.4 + 1.4 * t) * z

    exact = solve_ivp(renewed, (0.0, 0.5), [START], rtol=1e-11, atol=1e-18).y[0, -1]
    assert reached
    assert z == pytest.approx(exact, rel=1e-7)
    assert exact == pytest.approx(START * 0.4 / 1.1, rel=0.02)


def test_each_interval_has_its_own_normal_forces() -> None:
    time, position = np.array([0.0, 0.1, 0.2, 0.3]), np.array([0.0, -1e-7, -1e-7, -3e-7])
    load, z, samples = np.array([1.0, 0.5, 2.0, 3.0]), np.array([START]), np.zeros((4, 2))
    assert follow_position(DAHL, time, position, load, z, 1e-14, False, samples) == 4
    expected = START
    for k in (1, 2, 3):
        v = (position[k] - position[k - 1]) / 0.1
        expected, _ = advance(DAHL, v, expected, 0.1, 1e-14, load[k - 1], load[k])
        assert samples[k].tolist() == pytest.approx([load[k] * SIGMA_0 * expected, expected], rel=1e-9)


def test_a_static_contact_that_was_lost_has_no_direction() -> None:
    time, position = np.arange(5.0), np.array([0.0, 1e-6, 1e-6, 1e-6, 1e-6])
    load, z, samples = np.array([1.0, 1.0, 1.0, 0.0, 1.0]), np.zeros(1), np.zeros((5, 2))
    follow_position(Coulomb(0.3), time, position, load, z, 1e-12, False, samples)
    assert samples[:, 0].tolist() == [0.3, 0.3, 0.3, 0.0, 0.0]


def test_forces_are_the_sum_over_the_elements() -> None:
    law, velocity = MaxwellSlip((3e6, 1e6), (0.4, 0.3), 20.0), np.array([1e-3, -2e-3])
    states, found = np.array([[1e-7, 2e-7], [-1e-7, 0.0]]), np.zeros(2)
    forces_at(law, velocity, states, found)
    np.testing.assert_allclose(found, [0.3 + 0.2 + 0.02, -0.3 - 0.04], rtol=1e-12)
    forces_at(Coulomb(0.3), velocity, np.array([[1.0], [-1.0]]), found)
    assert found.tolist() == [0.3, -0.3]


@pytest.mark.usefixtures("no_compiler")
def test_a_law_in_python_gives_the_same_and_what_it_raises_ends_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert law_of.law_of(Own(SIGMA_0, F_C)).how == "python"
    z, reached = advance(Own(SIGMA_0, F_C), V, START, 0.5, 1e-12, 1.0, 1.0)
    assert reached
    assert z == pytest.approx(advance(DAHL, V, START, 0.5, 1e-12, 1.0, 1.0)[0], rel=1e-12)
    calls = []

    def failing(law: Any, v: float, z: float) -> tuple[float, float]:
        calls.append(v)
        if len(calls) > 2:
            raise RuntimeError("no such contact")
        return own_rate(law, v, z)

    made = registered._IMPLEMENTATIONS[Own]._replace(rate=failing)
    monkeypatch.setitem(registered._IMPLEMENTATIONS, Own, made)
    with pytest.raises(RuntimeError, match="no such contact"):
        advance(Own(SIGMA_0, F_C), V, START, 0.5, 1e-12, 1.0, 1.0)
    assert len(calls) == 3


def test_what_does_not_fit_is_named() -> None:
    two, one = np.arange(2.0), np.zeros(1)
    with pytest.raises(ValueError, match="load has 3 numbers; the engine needs 2"):
        follow_position(DAHL, two, two, np.ones(3), np.zeros(1), 1e-12, True, np.zeros((2, 2)))
    with pytest.raises(ValueError, match="a motion has two samples at least, not 1"):
        follow_position(DAHL, one, one, one, np.zeros(1), 1e-12, True, np.zeros((1, 2)))
