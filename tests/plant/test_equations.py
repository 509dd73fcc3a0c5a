"""Generated equations against slow, obvious ones, term by term from the docstring of `plant.system`."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

import plants
import reference
from plants import (
    MM_S,
    UM,
    Lag,
    by_time,
    entries,
    input_of,
    jacobian,
    law_at,
    load_of,
    motion,
    scale_of,
    states_of,
    weights_and_rates,
)
from stickslip._jit import compiled
from stickslip.friction import MaxwellSlip
from stickslip.plant import generated
from stickslip.plant.dynamics import factor
from stickslip.plant.system import Element, Mode, Plant, layout_of, state_size, values_of

from .layouts import CASES, COULOMB, ELASTOPLASTIC, LUGRE, MAXWELL, PER_G, RATE, RISING, STAGE, Case, U

Array = NDArray[np.float64]

# Compiled, a few layouts are enough: the text is the same.
COMPILED = ("a rising load", "held in a chain", "elements without a kink")
NAMES = tuple(CASES) if numba.config.DISABLE_JIT else COMPILED  # type: ignore[attr-defined]


def state_of(case: Case) -> Array:
    return scale_of(case.plant) * np.array([*case.motion, *case.inside])


def sides_of(case: Case, way: float = 1.0) -> tuple[float, ...]:
    """As the contacts slide, or the other `way`; of what is no contact the side does not count."""
    bodies, inside = np.split(state_of(case), [2 * len(case.plant.modes)])
    sides = []
    for e, element in enumerate(case.plant.elements):
        z, inside = np.split(inside, [plants.states_of(element.law)])
        speed = way * input_of(element, bodies, U, [0.0] * e)
        sides.append(0.0 if e in case.held else branched_side(element.law, speed, z))
    return tuple(sides) or (0.0,)


def branched_side(law: Any, speed: float, z: Array) -> float:
    """With the branches of Maxwell elements: 2 where one slides above its strength."""
    size = 1.0
    if isinstance(law, MaxwellSlip):
        curve = 1.0 + (law.stiction_ratio - 1.0) * math.exp(-((speed / law.stribeck_velocity) ** 2))
        limit = np.array(law.strength) * curve / np.array(law.stiffness)
        size += 2.0 * float(np.sum(4.0 ** np.flatnonzero(z * np.sign(speed) > limit)))
    return math.copysign(size, speed)


# What only kernels call has no way in from Python; these have.
@compiled
def slope(plant, sides, q, u, normal):
    return generated.slope(plant, sides, q, u, normal)


@compiled
def factor_and_solved(plant, sides, q, u, normal, per_g, r):
    w, by_time, weights, fast = generated.factor(plant, sides, q, u, normal, per_g)
    return generated.solved(plant, sides, w, r), by_time, weights, fast


@compiled
def inputs(plant, q, u):
    return generated.speeds(plant, q, u), generated.relative_speeds(plant, q)


@compiled
def size(plant, r, weights):
    return generated.size(plant, r, weights)


@compiled
def settled(plant, q, u, local):
    return generated.settled(plant, q, u, local)


@compiled
def kinks(plant, q, beyond):
    return generated.kinks(plant, q, beyond)


@compiled
def brought(plant, q, u, e, speed):
    return generated.brought(plant, q, u, e, speed)


@compiled
def riding(plant, sides, q, u, begun, u_begun):
    return generated.riding(plant, sides, q, u, begun, u_begun)


@compiled
def differences(plant, q, other, apart):
    return generated.drift_apart(plant, q, other), generated.gone(plant, q, other, apart)


@compiled
def unloaded(plant, q, ratio):
    return generated.unloaded(plant, q, ratio)


@compiled
def state_from(plant, values):
    return generated.state_of(plant, values)


@compiled
def branches(plant, sides, q, v, dv):
    return (
        generated.branched(plant),
        generated.on_branches(plant, sides, q, v, dv),
        generated.branches_hold(plant, sides, q, v, dv),
    )


@compiled
def described(plant, q, normal):
    return (
        (generated.breakaways(plant, q, normal), generated.statics(plant), generated.contacts(plant)),
        (generated.drive_rates(plant), generated.no_sides(plant)),
        (generated.follows_drive(plant), generated.moves_freely(plant)),
    )


@compiled
def unrest(plant, dq, u):
    return generated.unrest(plant, dq, u)


@compiled
def jolt(plant, u):
    return generated.jolt(plant, u)


@compiled
def with_values(plant, values):
    return generated.with_values(plant, values)


@compiled
def arithmetic(p, a, k, i, value):
    return generated.plus(p, a, k), generated.times(a, k), generated.replaced(p, i, value)


@pytest.fixture(params=NAMES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def test_slope_and_outputs(case: Case) -> None:
    q, sides = state_of(case), sides_of(case)
    dq, outputs = slope(case.plant, sides, tuple(q), U, case.normal)
    expected, forces = motion(case.plant, sides, q, U, case.normal)
    np.testing.assert_allclose(dq, expected, rtol=1e-9)
    if case is CASES["held twice over"]:  # of what holds, only what it does to the bodies is determined
        push = np.array([element.push for element in case.plant.elements])
        outputs, forces = np.array(outputs) @ push, forces @ push
    np.testing.assert_allclose(outputs, forces if forces.size else [0.0], rtol=1e-9)


def test_slope_beyond_a_reversal(case: Case) -> None:
    q, sides = state_of(case), sides_of(case, -1.0)
    found = slope(case.plant, sides, tuple(q), U, case.normal)[0]
    np.testing.assert_allclose(found, motion(case.plant, sides, q, U, case.normal)[0], rtol=1e-9)


@pytest.mark.parametrize("per_g", [PER_G, 0.2 * PER_G])
def test_linear_system_of_a_step(case: Case, per_g: float) -> None:
    """W = 1/per_g - J; each entry of the solution is as large as the others, so that each term counts."""
    plant, q, sides, scale = case.plant, state_of(case), sides_of(case), scale_of(case.plant)
    x = scale * np.cos(1.0 + 1.3 * np.arange(q.size))
    x[1 : 2 * len(plant.modes) : 2] *= UM / MM_S / PER_G
    r = x / per_g - jacobian(plant, sides, q, U, case.normal) @ x
    found = factor_and_solved(plant, sides, tuple(q), U, case.normal, per_g, tuple(r))[0]
    np.testing.assert_allclose(found, x, rtol=1e-5)


def test_partial_derivative_by_time(case: Case) -> None:
    plant, q, sides = case.plant, state_of(case), sides_of(case)
    found = factor_and_solved(plant, sides, tuple(q), U, case.normal, PER_G, tuple(q))[1]
    np.testing.assert_allclose(found, by_time(plant, sides, q, U, case.normal), rtol=1e-5)


def test_weights_and_how_fast_a_state_relaxes(case: Case) -> None:
    """An error of a deflection counts as what its force does to a position within 1/rate."""
    plant, q, sides = case.plant, state_of(case), sides_of(case)
    _, _, weights, fast = factor_and_solved(plant, sides, tuple(q), U, case.normal, PER_G, tuple(q))
    expected, rates = weights_and_rates(plant, sides, q, U, case.normal)
    np.testing.assert_allclose(weights, expected or [0.0], rtol=1e-5)
    np.testing.assert_allclose(fast, rates or [0.0], rtol=1e-5)


def test_inputs(case: Case) -> None:
    q, nothing = state_of(case), (0.0, 0.0)
    bodies = q[: 2 * len(case.plant.modes)]
    whole, relative = inputs(case.plant, tuple(q), U)
    expected = [input_of(e, bodies, U, [0.0] * i) for i, e in enumerate(case.plant.elements)]
    np.testing.assert_allclose(whole, expected or [0.0], rtol=1e-12)
    expected = [input_of(e, bodies, nothing, [0.0] * i) for i, e in enumerate(case.plant.elements)]
    np.testing.assert_allclose(relative, expected or [0.0], rtol=1e-12)


def test_size_of_an_error(case: Case) -> None:
    """Each entry in turn is the largest; one that is no number makes the whole none."""
    plant, n = case.plant, state_size(case.plant)
    bodies = 2 * len(plant.modes)
    weights = tuple(np.arange(2.0, 2.0 + max(n - bodies, 1)))
    for c in range(n):
        for sign in (1.0, -1.0):
            r = np.full(n, 1e-9)
            r[c] = sign * 1e-3
            factor = weights[c - bodies] if c >= bodies else 1.0 / RATE if c % 2 else 1.0
            assert size(plant, tuple(r), weights) == pytest.approx(1e-3 * factor, rel=1e-12)
        r[c] = math.nan
        assert math.isnan(size(plant, tuple(r), weights))


def test_kinks(case: Case) -> None:
    q, expected = state_of(case), []
    inside = q[2 * len(case.plant.modes) :]
    for element in case.plant.elements:
        z, inside = np.split(inside, [states_of(element.law)])
        there = z.size > 0 and not isinstance(element.law, Lag)
        sums = law_at(element.law, 2e-3, z)[1] + law_at(element.law, -2e-3, z)[1] if there else np.zeros(1)
        expected.append(np.abs(sums).max())
    np.testing.assert_allclose(kinks(case.plant, tuple(q), 2e-3), expected or [0.0], rtol=1e-12)


@pytest.mark.parametrize("speed", [0.0, -2e-3])
def test_contact_is_brought_to_a_speed_by_an_impulse_of_its_own(case: Case, speed: float) -> None:
    plant, q = case.plant, state_of(case)
    for e, element in enumerate(plant.elements):
        push, along = entries(element.push, len(plant.modes)), entries(element.velocity, len(plant.modes))
        after = np.array(brought(plant, tuple(q), U, e, speed))
        bodies = 2 * len(plant.modes)
        np.testing.assert_array_equal(after[:bodies:2], q[:bodies:2])
        np.testing.assert_array_equal(after[bodies:], q[bodies:])
        change = (after - q)[1:bodies:2]
        if isinstance(element.law, Lag) or not np.any(push * along):
            assert not np.any(change)
            continue
        assert input_of(element, after[:bodies], U, [0.0] * e) == pytest.approx(speed, abs=1e-12)
        impulse = change @ push / (push @ push)
        missing = speed - input_of(element, q[:bodies], U, [0.0] * e)
        assert push @ along * impulse == pytest.approx(missing, rel=1e-9)
        np.testing.assert_allclose(change, impulse * push, rtol=1e-9, atol=1e-15)


def test_bodies_of_held_contacts_ride_on_each_other(case: Case) -> None:
    q, sides, u_begun = state_of(case), sides_of(case), (25.0, 4e3)
    begun = q * np.cos(np.arange(q.size))
    found = riding(case.plant, sides, tuple(q), U, tuple(begun), u_begun)
    expected = plants.riding(case.plant, sides, q, U, begun, u_begun)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-18)


def test_sides_tell_the_branches_of_the_states(case: Case) -> None:
    """Of Maxwell elements that are drawn down to a strength that falls; of a held contact the side stays."""
    plant, q, sides = case.plant, state_of(case), sides_of(case)
    bodies = q[: 2 * len(plant.modes)]
    v = np.array([input_of(e, bodies, U, [0.0] * i) for i, e in enumerate(plant.elements)])
    of_maxwell = [isinstance(element.law, MaxwellSlip) for element in plant.elements]
    plain = tuple(
        math.copysign(1.0, s) if m else s for s, m in zip(sides, [*of_maxwell, False], strict=False)
    )
    faster = tuple(np.sign(v)) or (0.0,)
    has, found, holds = branches(plant, plain, tuple(q), tuple(v) or (0.0,), faster)
    assert has == any(of_maxwell)
    np.testing.assert_array_equal(found, sides)
    assert branches(plant, sides, tuple(q), tuple(v) or (0.0,), faster)[2]
    assert holds == (found == plain)  # what is over its strength sticks no longer


def test_rest_is_exact() -> None:
    """To the last bit, whatever the numbers."""
    case = CASES["held"]
    q = tuple(state_of(case))
    dq, _ = slope(case.plant, (0.0, 1.0), q, U, RISING)
    assert dq[1] == dq[3]
    after = brought(case.plant, q, U, 0, 0.0)
    assert after[1] == after[3]
    x = factor_and_solved(case.plant, (0.0, 1.0), q, U, RISING, PER_G, dq)[0]
    assert x[1] == x[3]
    ridden = riding(case.plant, (0.0, 1.0), q, U, after, U)
    assert ridden[1] == ridden[3]
    assert ridden[0] - ridden[2] == pytest.approx(after[0] - after[2], rel=1e-15)


def test_contact_that_moves_nothing_cannot_stop() -> None:
    weightless = Plant((STAGE,), (Element(LUGRE, (1.0,), (0.0,)),), RATE)
    q = (1e-6, 3e-3, 1e-7)
    assert brought(weightless, q, U, 0, 0.0) == q


@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("name", "e", "first"), [("three contacts", 0, 2), ("a rising load", 2, 7)])
def test_state_on_its_bound(name: str, e: int, first: int, side: float, towards: float) -> None:
    """Of a state within an error of a bound: on it, if it moves towards it; of one beyond it, always."""
    plant, q, local = CASES[name].plant, state_of(CASES[name]), 1e-9
    along = entries(plant.elements[e].velocity, len(plant.modes))
    q[1 : 2 * along.size : 2] = 3e-3 * towards * along
    bounds = side * reference.largest_deflection(MAXWELL)
    for off, stays in ((0.5, towards != side), (-0.5, False), (2.0, True)):
        q[first : first + 2] = bounds - side * off * local
        expected = q.copy()
        expected[first : first + 2] = q[first : first + 2] if stays else bounds
        np.testing.assert_allclose(settled(plant, tuple(q), U, local), expected, rtol=1e-13)


@pytest.mark.parametrize("slope", [1e3, -1e3])
def test_a_stop_moves_as_the_drive_says_too(slope: float) -> None:
    """With a body that stays, the drive's slope alone decides towards which bound."""
    stop = MaxwellSlip((0.2,), (2e-8,), 0.0, 1.0, 1.0, 1.0)
    plant = Plant((STAGE,), (Element(stop, (0.1,), (-1e7,), drive_rate=1e-7),), RATE)
    q, local = (0.0, 0.0, 1e-7 - 0.5e-12), 1e-12
    found = settled(plant, q, (0.0, slope, 0.0, 0.0), local)
    assert found[2] == (1e-7 if slope > 0.0 else q[2])


def test_states_without_a_bound_stay(case: Case) -> None:
    q = tuple(state_of(case))
    assert settled(case.plant, q, U, 1e-12) == q


def test_how_far_two_states_are_apart(case: Case) -> None:
    """Where nothing holds a body, its position does not count; it has gone."""
    plant, q = case.plant, state_of(case)
    bodies = 2 * len(plant.modes)
    free = [c < bodies and c % 2 == 0 and plant.modes[c // 2].stiffness == 0.0 for c in range(q.size)]
    for c in range(q.size):
        for by in (1e-3, -1e-3):
            other = q + by * np.eye(q.size)[c]
            far, gone = differences(plant, tuple(q), tuple(other), 0.5e-3)
            expected = 0.0 if free[c] else 1e-3 / RATE if c < bodies and c % 2 else 1e-3
            assert far == pytest.approx(expected, rel=1e-9)
            np.testing.assert_allclose(gone, -by * np.eye(q.size)[c] * free[c], rtol=1e-9)
            assert not np.any(differences(plant, tuple(q), tuple(other), 2e-3)[1])


def test_jump_of_the_load(case: Case) -> None:
    """To four times: force stays. To a quarter: deflection stays, and carries by its stiffness."""
    q, bodies = state_of(case), [1.0] * 2 * len(case.plant.modes)
    for ratio in (0.25, 4.0):
        factors = bodies.copy()
        for element in case.plant.elements:
            power = 1.0 if element.along is None else element.along.stiffness_exponent
            kept = 0.25 if ratio < 1.0 else 4.0 / 4.0**power
            factors += [kept if element.loaded is not None else 1.0] * states_of(element.law)
        np.testing.assert_allclose(unloaded(case.plant, tuple(q), ratio), q * factors, rtol=1e-15)


def test_state_from_an_array(case: Case) -> None:
    n = state_size(case.plant)
    assert n == len(case.motion) + len(case.inside)
    assert state_from(case.plant, np.arange(n + 3.0)) == tuple(np.arange(float(n)))


def test_what_is_said_of_the_elements(case: Case) -> None:
    q = state_of(case)
    forces, drives, flags = described(case.plant, tuple(q), case.normal)
    found, none = case.plant.elements, [0.0]
    static = [states_of(e.law) == 0 for e in found]
    loads = [load_of(e, q, case.normal)[0] for e in found]
    limits = [
        load * reference.largest_force_at_rest(e.law) if at_rest else math.inf
        for e, load, at_rest in zip(found, loads, static, strict=True)
    ]
    kinked = [not isinstance(e.law, Lag) for e in found]
    np.testing.assert_allclose(forces[0], limits or none, rtol=1e-12)
    np.testing.assert_array_equal(forces[1], static or none)
    np.testing.assert_array_equal(forces[2], kinked or none)
    np.testing.assert_array_equal(drives[0], [e.drive_rate or 0.0 for e in found] or none)
    np.testing.assert_array_equal(drives[1], [0.0] * len(found) or none)
    follows = any(e.drive_rate is not None and k for e, k in zip(found, kinked, strict=True))
    anywhere = any(mode.stiffness == 0.0 for mode in case.plant.modes)
    assert flags == (follows, anywhere and all(e.position is None and e.along is None for e in found))


def test_unrest(case: Case) -> None:
    dq = 1.0 + np.arange(float(state_size(case.plant)))
    for sign in (1.0, -1.0):
        accelerations = dq[1 : 2 * len(case.plant.modes) : 2]
        drives = max((abs(mode.drive) for mode in case.plant.modes), default=0.0)
        expected = max(accelerations, default=0.0) + drives * abs(U[1]) / RATE
        assert unrest(case.plant, tuple(sign * dq), (U[0], sign * U[1])) == pytest.approx(expected, rel=1e-12)


def test_jolt(case: Case) -> None:
    """What a jump, and one of each derivative, would add to an acceleration after 1/rate."""
    drives = max((abs(mode.drive) for mode in case.plant.modes), default=0.0)
    if any(e.drive_rate is not None for e in case.plant.elements):
        drives = math.inf
    for change in (U, (-U[0], U[1], -U[2], 0.0), (0.0, U[1], 0.0, 0.0)):
        expected = drives * (abs(change[0]) + abs(change[1]) / RATE + abs(change[2]) / RATE**2)
        assert jolt(case.plant, change) == pytest.approx(expected, rel=1e-12)


def test_numbers_of_a_plant(case: Case) -> None:
    numbers = values_of(case.plant)
    assert numbers.shape[0] == 1
    assert generated.with_values(case.plant, numbers[0]) == case.plant
    other = with_values(case.plant, 2.0 * numbers[0])
    np.testing.assert_array_equal(values_of(other), 2.0 * numbers)
    assert layout_of(other) == layout_of(case.plant)
    assert type(other) is Plant


def test_numbers_of_many_plants() -> None:
    rates = np.array([1.0, 2.0, 3.0])
    plant = CASES["stage and slider"].plant._replace(rate=rates)
    numbers = values_of(plant, 3)
    assert numbers.shape[0] == 3
    for row, rate in zip(numbers, rates, strict=True):
        assert generated.with_values(plant, row) == CASES["stage and slider"].plant._replace(rate=rate)


@pytest.mark.parametrize("name", CASES)
def test_layout_is_that_of_its_compiled_type(name: str) -> None:
    plant = CASES[name].plant
    assert layout_of(plant) == layout_of(numba.typeof(plant))


def test_layout_says_what_is_there() -> None:
    layout = layout_of(CASES["a rising load"].plant)
    assert layout.first == (6, 7, 7, 9, 10)
    assert [shape.states for shape in layout.elements] == [1, 0, 2, 1]
    assert layout.elements[1].velocity == (True, False, True)
    assert layout.elements[1].static
    assert not layout.elements[0].static


def test_text_is_there_to_be_read() -> None:
    text = generated.source("slope", CASES["no element"].plant)
    assert text.startswith("def slope(plant, sides, q, u, normal):")
    assert "plant.modes[0].stiffness * q[0]" in text


def test_force_that_holds_is_that_of_newtons_law() -> None:
    """M a = T u - c w - k y - F and m a = F + load, with one acceleration a; of the drive, C u''."""
    M, m, k, c, T, load = 0.1, 0.13, 1.1e6, 340.0, 0.11, 0.07
    y, w = 3.1e-6, 2.3e-3
    stage, slider = Mode(k / M, c / M, T / M, 0.0), Mode(0.0, 0.0, 0.0, load / m)
    contact = Element(COULOMB, (1.0, -1.0), (-1.0 / M, 1.0 / m))
    dq, (F,) = slope(Plant((stage, slider), (contact,), RATE), (0.0,), (y, w, y, w), U, RISING)
    assert dq[1] == pytest.approx(dq[3], rel=1e-12)
    assert M * dq[1] == pytest.approx(T * U[0] - c * w - k * y - F, rel=1e-9)
    assert m * dq[3] == pytest.approx(F + load, rel=1e-9)

    follows = Plant((slider,), (Element(COULOMB, (-1.0,), (1.0 / m,), drive_rate=1e-7),), RATE)
    dq, (F,) = slope(follows, (0.0,), (y, w), U, RISING)
    assert dq[1] == pytest.approx(1e-7 * U[2], rel=1e-12)
    assert pytest.approx(m * dq[1] - load, rel=1e-12) == F


def test_contact_without_a_load_carries_nothing() -> None:
    """Where the normal force rises from zero, its relative growth has no end: the term is left out."""
    case = CASES["stage and slider"]
    contact = case.plant.elements[0]._replace(loaded=1.0)
    plant, q = case.plant._replace(elements=(contact,)), tuple(state_of(case))
    dq, (F,) = slope(plant, (1.0,), q, U, (0.0, 5.0, 0.0, 0.0))
    assert F == 0.0
    assert dq[4] == pytest.approx(law_at(LUGRE, 2e-3, np.array(q[4:]))[1][0], rel=1e-12)
    _, by_time, _, _ = factor_and_solved(plant, (1.0,), q, U, (0.0, 5.0, 0.0, 0.0), PER_G, q)
    assert by_time[4] == 0.0


def test_rows_of_numbers() -> None:
    combined, scaled, replaced = arithmetic((1.0, 2.0, 3.0), -2.0, (10.0, 20.0, 40.0), 1, 7.0)
    assert combined == (-19.0, -38.0, -77.0)
    assert scaled == (-20.0, -40.0, -80.0)
    assert replaced == (1.0, 7.0, 3.0)


@compiled
def decay(plant, lasts):
    return generated.decay(plant, lasts)


def least_decay(bonds: list[tuple[float, float, float]], lasts: float) -> float:
    """Of contacts with a mobility [1/kg], a stiffness [N/m] and a damping [N s/m]."""
    made = [(math.sqrt(p * k), 0.5 * math.sqrt(p / k) * c) for p, k, c in bonds]
    return min([1.0, *(max(ratio, 1.0 / (omega * lasts)) for omega, ratio in made)])


@pytest.mark.parametrize("lasts", [1e-3, 1e3])
def test_vibrations_of_contacts_that_stick(lasts: float) -> None:
    bonds = {
        "stage and slider": [(17.7 * 1.3, 1.4e6, 35.7)],
        "two sliders": [(17.7, 1.4e6, 35.7), (21.0 * 0.7, 0.9e6, 0.0)],
    }
    for name, expected in bonds.items():
        assert decay(CASES[name].plant, lasts) == pytest.approx(least_decay(expected, lasts), rel=1e-4)
    assert decay(Plant((STAGE,), (Element(COULOMB, (1.0,), (-3.0,)),), RATE), lasts) == 1.0
    maxwell = Plant((STAGE,), (Element(MAXWELL, (1.0,), (-3.0,)),), RATE)
    assert decay(maxwell, lasts) == pytest.approx(least_decay([(3.0, 1.7e6, 4.0)], lasts), rel=1e-4)
    elastoplastic = Plant((STAGE,), (Element(ELASTOPLASTIC, (1.0,), (-3.0,)),), RATE)
    assert decay(elastoplastic, lasts) == pytest.approx(least_decay([(3.0, 1.4e6, 35.3)], lasts), rel=1e-4)


def test_a_place_that_another_element_pushes_is_refused() -> None:
    """A load along a mode is one more unknown of its element, in which the push of another is not."""
    plant = CASES["a load along the stroke"].plant
    first, second = plant.elements
    factor(layout_of(plant))
    both = second._replace(push=(1.0, -1.0, None), velocity=(-10.0, 7.7, None))
    with pytest.raises(ValueError, match="mode 1, along which a load changes, is pushed by another element"):
        factor(layout_of(plant._replace(elements=(first, both))))
