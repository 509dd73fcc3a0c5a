"""The engine's equations against slow, obvious ones, term by term from the docstring of `plant.system`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import plants
import reference
from engine.inner import Inner
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
from simulation.plant.layouts import (
    CASES,
    COULOMB,
    ELASTOPLASTIC,
    LUGRE,
    MAXWELL,
    PER_G,
    RATE,
    RISING,
    STAGE,
    Case,
    U,
)
from stickslip.engine.binding import ComposedPlant
from stickslip.friction import MaxwellSlip
from stickslip.quantities.units import QuantityError
from stickslip.simulation.plant.system import Element, Mode, Plant

Array = NDArray[np.float64]


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def state_of(case: Case) -> Array:
    return scale_of(case.plant) * np.array([*case.motion, *case.inside])


def sides_of(case: Case, way: float = 1.0) -> tuple[Array, Array]:
    """Sides of the contacts as they slide, or the other `way`, and branches of the entries of the state."""
    plant, q = case.plant, state_of(case)
    branches, first = np.zeros(q.size), 2 * len(plant.modes)
    sides = np.zeros(len(plant.elements))
    for e, one in enumerate(plant.elements):
        part = slice(first, first + states_of(one.law))
        speed = way * input_of(one, q[: 2 * len(plant.modes)], U, [0.0] * e)
        sides[e] = 0.0 if e in case.held else math.copysign(1.0, speed)
        if isinstance(one.law, MaxwellSlip):
            branches[part] = above_strength(one.law, speed, q[part])
        first = part.stop
    return sides, branches


def above_strength(law: MaxwellSlip, speed: float, z: Array) -> Array:
    """2 for each Maxwell element that slides above its strength, the branch on which it is drawn down."""
    curve = 1.0 + (law.stiction_ratio - 1.0) * math.exp(-((speed / law.stribeck_velocity) ** 2))
    return 2.0 * (z * np.sign(speed) > np.array(law.strength) * curve / np.array(law.stiffness))


def coded(plant: Plant, sides: Array, branches: Array) -> tuple[float, ...]:
    """Sides as `plants` takes them: their size tells the branches, four to a state."""
    found, first = [], 2 * len(plant.modes)
    for side, one in zip(sides, plant.elements, strict=True):
        part = branches[first : first + states_of(one.law)]
        found.append(side * (1.0 + float(np.sum(part * 4.0 ** np.arange(part.size)))))
        first += part.size
    return tuple(found) or (0.0,)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_slope_and_outputs(inner: Inner, case: Case, way: float) -> None:
    """The other way: on the far side of a reversal."""
    q, (sides, branches) = state_of(case), sides_of(case, way)
    dq, outputs = inner.slope(case.plant, sides, branches, q, case.normal)
    expected, forces = motion(case.plant, coded(case.plant, sides, branches), q, U, case.normal)
    np.testing.assert_allclose(dq, expected, rtol=1e-9)
    if case is CASES["held twice over"]:  # of what holds, only what it does to the bodies is determined
        push = np.array([element.push for element in case.plant.elements])
        outputs, forces = outputs @ push, forces @ push
    np.testing.assert_allclose(outputs, forces, rtol=1e-9)


@pytest.mark.parametrize("per_g", [PER_G, 0.2 * PER_G])
def test_linear_system_of_a_step(inner: Inner, case: Case, per_g: float) -> None:
    """W = 1/per_g - J; each entry of the solution is as large as the others, so that each term counts."""
    plant, q, scale, (sides, branches) = case.plant, state_of(case), scale_of(case.plant), sides_of(case)
    x = scale * np.cos(1.0 + 1.3 * np.arange(q.size))
    x[1 : 2 * len(plant.modes) : 2] *= UM / MM_S / PER_G
    r = x / per_g - jacobian(plant, coded(plant, sides, branches), q, U, case.normal) @ x
    found = inner.solve(plant, sides, branches, q, case.normal, per_g, r)[0]
    np.testing.assert_allclose(found, x, rtol=1e-5)


def test_partial_derivative_by_time_weights_and_rates(inner: Inner, case: Case) -> None:
    """An error of a deflection counts as what its force does to a position within 1/rate."""
    plant, q, (sides, branches) = case.plant, state_of(case), sides_of(case)
    given = plant, coded(plant, sides, branches), q, U, case.normal
    _, t, weights, fast = inner.solve(plant, sides, branches, q, case.normal, PER_G, q)
    np.testing.assert_allclose(t, by_time(*given), rtol=1e-5)
    expected, rates = weights_and_rates(*given)
    np.testing.assert_allclose(weights, expected, rtol=1e-5)
    np.testing.assert_allclose(fast, rates, rtol=1e-5)


def test_inputs(inner: Inner, case: Case) -> None:
    q, elements = state_of(case), case.plant.elements
    whole, relative = np.zeros(len(elements)), np.zeros(len(elements))
    inner("inputs", case.plant, q, np.array(U), whole, relative)
    bodies = q[: 2 * len(case.plant.modes)]
    for found, u in ((whole, U), (relative, (0.0, 0.0))):
        expected = [input_of(e, bodies, u, [0.0] * i) for i, e in enumerate(elements)]
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_size_of_an_error(inner: Inner, case: Case) -> None:
    """Each entry in turn is the largest; one that is no number makes the whole none."""
    n, bodies = state_of(case).size, 2 * len(case.plant.modes)
    weights = 2.0 + np.arange(float(n))
    for c in range(n):
        for sign in (1.0, -1.0):
            r = np.full(n, 1e-9)
            r[c] = sign * 1e-3
            factor = weights[c] if c >= bodies else 1.0 / RATE if c % 2 else 1.0
            assert inner("size", case.plant, r, weights) == pytest.approx(1e-3 * factor, rel=1e-12)
        r[c] = math.nan
        assert math.isnan(inner("size", case.plant, r, weights))


def test_kinks(inner: Inner, case: Case) -> None:
    q, expected, found = state_of(case), [], np.zeros(len(case.plant.elements))
    inside = q[2 * len(case.plant.modes) :]
    for element in case.plant.elements:
        z, inside = np.split(inside, [states_of(element.law)])
        there = z.size > 0 and not isinstance(element.law, Lag)
        sums = law_at(element.law, 2e-3, z)[1] + law_at(element.law, -2e-3, z)[1] if there else np.zeros(1)
        expected.append(np.abs(sums).max())
    inner("kinks", case.plant, q, 2e-3, found)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("speed", [0.0, -2e-3])
def test_contact_is_brought_to_a_speed_by_an_impulse_of_its_own(
    inner: Inner, case: Case, speed: float
) -> None:
    plant, q, bodies = case.plant, state_of(case), 2 * len(case.plant.modes)
    for e, element in enumerate(plant.elements):
        push, along = entries(element.push, len(plant.modes)), entries(element.velocity, len(plant.modes))
        after = q.copy()
        inner("bring", plant, after, np.array(U), e, speed)
        np.testing.assert_array_equal(after[:bodies:2], q[:bodies:2])
        np.testing.assert_array_equal(after[bodies:], q[bodies:])
        change = (after - q)[1:bodies:2]
        if isinstance(element.law, Lag) or not np.any(push * along):
            assert not np.any(change)
            continue
        assert input_of(element, after[:bodies], U, [0.0] * e) == pytest.approx(speed, abs=1e-12)
        missing = speed - input_of(element, q[:bodies], U, [0.0] * e)
        impulse = change @ push / (push @ push)
        assert push @ along * impulse == pytest.approx(missing, rel=1e-9)
        np.testing.assert_allclose(change, impulse * push, rtol=1e-9, atol=1e-15)


def test_bodies_of_held_contacts_ride_on_each_other(inner: Inner, case: Case) -> None:
    q, (sides, branches), u_begun = state_of(case), sides_of(case), (25.0, 4e3)
    begun, found = q * np.cos(np.arange(q.size)), q.copy()
    inner("ride", case.plant, sides, found, np.array(U), begun, np.array(u_begun))
    expected = plants.riding(case.plant, coded(case.plant, sides, branches), q, U, begun, u_begun)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-18)


def test_rest_is_exact(inner: Inner) -> None:
    """To the last bit, whatever the numbers."""
    case = CASES["held"]
    plant, q, u, sides, branches = case.plant, state_of(case), np.array(U), np.array([0.0, 1.0]), np.zeros(5)
    dq, _ = inner.slope(plant, sides, branches, q, RISING)
    assert dq[1] == dq[3]
    after = q.copy()
    inner("bring", plant, after, u, 0, 0.0)
    assert after[1] == after[3]
    x = inner.solve(plant, sides, branches, q, RISING, PER_G, dq)[0]
    assert x[1] == x[3]
    ridden = q.copy()
    inner("ride", plant, sides, ridden, u, after, u)
    assert ridden[1] == ridden[3]
    assert ridden[0] - ridden[2] == pytest.approx(after[0] - after[2], rel=1e-15)


def test_contact_that_moves_nothing_cannot_stop(inner: Inner) -> None:
    weightless = Plant((STAGE,), (Element(LUGRE, (1.0,), (0.0,)),), RATE)
    q = np.array([1e-6, 3e-3, 1e-7])
    inner("bring", weightless, q, np.array(U), 0, 0.0)
    assert q.tolist() == [1e-6, 3e-3, 1e-7]


@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("name", "e", "first"), [("three contacts", 0, 2), ("a rising load", 2, 7)])
def test_state_on_its_bound(inner: Inner, name: str, e: int, first: int, side: float, towards: float) -> None:
    """A state within an error of a bound: on it, if it moves towards it. A state beyond it: always."""
    plant, q, local = CASES[name].plant, state_of(CASES[name]), 1e-9
    along = entries(plant.elements[e].velocity, len(plant.modes))
    q[1 : 2 * along.size : 2] = 3e-3 * towards * along
    bounds = side * reference.largest_deflection(MAXWELL)
    for off, stays in ((0.5, towards != side), (-0.5, False), (2.0, True)):
        q[first : first + 2] = bounds - side * off * local
        expected, found = q.copy(), q.copy()
        expected[first : first + 2] = q[first : first + 2] if stays else bounds
        inner("settle", plant, found, np.array(U), local)
        np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("slope", [1e3, -1e3])
def test_a_stop_moves_as_the_drive_says_too(inner: Inner, slope: float) -> None:
    """With a body that stays, the drive's slope alone decides towards which bound."""
    stop = MaxwellSlip((0.2,), (2e-8,), 0.0, 1.0, 1.0, 1.0)
    plant = Plant((STAGE,), (Element(stop, (0.1,), (-1e7,), drive_rate=1e-7),), RATE)
    q = np.array([0.0, 0.0, 1e-7 - 0.5e-12])
    found = q.copy()
    inner("settle", plant, found, np.array([0.0, slope, 0.0, 0.0]), 1e-12)
    assert found[2] == (1e-7 if slope > 0.0 else q[2])


def test_states_without_a_bound_stay(inner: Inner, case: Case) -> None:
    q = state_of(case)
    found = q.copy()
    inner("settle", case.plant, found, np.array(U), 1e-12)
    np.testing.assert_array_equal(found, q)


def test_how_far_two_states_are_apart(inner: Inner, case: Case) -> None:
    """Where nothing holds a body, its position does not count; it has gone."""
    plant, q = case.plant, state_of(case)
    bodies, gone = 2 * len(plant.modes), np.zeros(q.size)
    free = [c < bodies and c % 2 == 0 and plant.modes[c // 2].stiffness == 0.0 for c in range(q.size)]
    for c in range(q.size):
        for by in (1e-3, -1e-3):
            other = q + by * np.eye(q.size)[c]
            far = inner("apart", plant, q, other, 0.5e-3, gone)
            expected = 0.0 if free[c] else 1e-3 / RATE if c < bodies and c % 2 else 1e-3
            assert far == pytest.approx(expected, rel=1e-9)
            np.testing.assert_allclose(gone, -by * np.eye(q.size)[c] * free[c], rtol=1e-9)
            inner("apart", plant, q, other, 2e-3, gone)
            assert not np.any(gone)


def test_jump_of_the_load(inner: Inner, case: Case) -> None:
    """To four times: force stays. To a quarter: deflection stays, and carries by its stiffness."""
    q, bodies = state_of(case), [1.0] * 2 * len(case.plant.modes)
    for ratio in (0.25, 4.0):
        factors, found = bodies.copy(), q.copy()
        for element in case.plant.elements:
            power = 1.0 if element.along is None else element.along.stiffness_exponent
            kept = 0.25 if ratio < 1.0 else 4.0 / 4.0**power
            factors += [kept if element.loaded is not None else 1.0] * states_of(element.law)
        inner("unload", case.plant, found, ratio)
        np.testing.assert_allclose(found, q * factors, rtol=1e-15)


def test_largest_forces_at_rest(inner: Inner, case: Case) -> None:
    q, found, elements = state_of(case), np.zeros(len(case.plant.elements)), case.plant.elements
    inner("breakaway", case.plant, q, np.array(case.normal), found)
    expected = [
        load_of(e, q, case.normal)[0] * reference.largest_force_at_rest(e.law)
        if states_of(e.law) == 0
        else math.inf
        for e in elements
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_unrest_and_jolt(inner: Inner, case: Case) -> None:
    """What a jump of the drive, and one of each derivative, adds to an acceleration after 1/rate."""
    plant = case.plant
    dq, drives = 1.0 + np.arange(float(state_of(case).size)), [abs(mode.drive) for mode in plant.modes]
    most = max(drives, default=0.0)
    for sign in (1.0, -1.0):
        largest = max(dq[1 : 2 * len(plant.modes) : 2], default=0.0)
        found = inner("unrest", plant, sign * dq, np.array([U[0], sign * U[1]]))
        assert found == pytest.approx(largest + most * abs(U[1]) / RATE, rel=1e-12)
    if any(e.drive_rate is not None for e in plant.elements):
        most = math.inf
    for change in (U, (-U[0], U[1], -U[2], 0.0), (0.0, U[1], 0.0, 0.0)):
        expected = most * (abs(change[0]) + abs(change[1]) / RATE + abs(change[2]) / RATE**2)
        assert inner("jolt", plant, np.array(change)) == pytest.approx(expected, rel=1e-12)


def test_force_that_holds_is_that_of_newtons_law(inner: Inner) -> None:
    """M a = T u - c w - k y - F and m a = F + load, with one acceleration a; of the drive, C u''."""
    M, m, k, c, T, load = 0.1, 0.13, 1.1e6, 340.0, 0.11, 0.07
    y, w = 3.1e-6, 2.3e-3
    stage, slider, held = Mode(k / M, c / M, T / M, 0.0), Mode(0.0, 0.0, 0.0, load / m), np.zeros(1)
    contact = Element(COULOMB, (1.0, -1.0), (-1.0 / M, 1.0 / m))
    plant = Plant((stage, slider), (contact,), RATE)
    dq, (F,) = inner.slope(plant, held, np.zeros(4), np.array([y, w, y, w]), RISING)
    assert dq[1] == pytest.approx(dq[3], rel=1e-12)
    assert M * dq[1] == pytest.approx(T * U[0] - c * w - k * y - F, rel=1e-9)
    assert m * dq[3] == pytest.approx(F + load, rel=1e-9)

    follows = Plant((slider,), (Element(COULOMB, (-1.0,), (1.0 / m,), drive_rate=1e-7),), RATE)
    dq, (F,) = inner.slope(follows, held, np.zeros(2), np.array([y, w]), RISING)
    assert dq[1] == pytest.approx(1e-7 * U[2], rel=1e-12)
    assert pytest.approx(m * dq[1] - load, rel=1e-12) == F


def test_contact_without_a_load_carries_nothing(inner: Inner) -> None:
    """Where the normal force rises from zero, its relative growth has no end: the term is left out."""
    case, none = CASES["stage and slider"], (0.0, 5.0, 0.0, 0.0)
    contact = case.plant.elements[0]._replace(loaded=1.0)
    plant, q, side = case.plant._replace(elements=(contact,)), state_of(case), np.ones(1)
    dq, (F,) = inner.slope(plant, side, np.zeros(5), q, none)
    assert F == 0.0
    assert dq[4] == pytest.approx(law_at(LUGRE, 2e-3, q[4:])[1][0], rel=1e-12)
    assert inner.solve(plant, side, np.zeros(5), q, none, PER_G, q)[1][4] == 0.0


def least_decay(bonds: list[tuple[float, float, float]], lasts: float) -> float:
    """Return the decay of contacts with a mobility [1/kg], a stiffness [N/m] and a damping [N s/m]."""
    made = [(math.sqrt(p * k), 0.5 * math.sqrt(p / k) * c) for p, k, c in bonds]
    return min([1.0, *(max(ratio, 1.0 / (omega * lasts)) for omega, ratio in made)])


@pytest.mark.parametrize("lasts", [1e-3, 1e3])
def test_vibrations_of_contacts_that_stick(inner: Inner, lasts: float) -> None:
    def one(law: Any) -> Plant:
        return Plant((STAGE,), (Element(law, (1.0,), (-3.0,)),), RATE)

    bonds: list[tuple[Plant, list[tuple[float, float, float]]]] = [
        (CASES["stage and slider"].plant, [(17.7 * 1.3, 1.4e6, 35.7)]),
        (CASES["two sliders"].plant, [(17.7, 1.4e6, 35.7), (21.0 * 0.7, 0.9e6, 0.0)]),
        (one(MAXWELL), [(3.0, 1.7e6, 4.0)]),
        (one(ELASTOPLASTIC), [(3.0, 1.4e6, 35.3)]),
        (one(COULOMB), []),
    ]
    for plant, expected in bonds:
        assert inner("decay", plant, lasts) == pytest.approx(least_decay(expected, lasts), rel=1e-4)


def test_a_place_that_another_element_pushes_is_refused() -> None:
    plant = CASES["a load along the stroke"].plant
    first, second = plant.elements
    both = second._replace(push=(1.0, -1.0, None), velocity=(-10.0, 7.7, None))
    ComposedPlant(plant)
    with pytest.raises(QuantityError, match="element 0 changes along mode 1, which element 1 pushes too"):
        ComposedPlant(plant._replace(elements=(first, both)))
    nowhere = first._replace(push=(None, None, None))
    with pytest.raises(QuantityError, match="element 0 pushes no mode along which"):
        ComposedPlant(plant._replace(elements=(nowhere, second)))
