"""What is read from a log of steps: samples, and the account against SciPy's quadrature of its terms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from plants import input_of, load_of, motion, riding, states_of
from stickslip._jit import compiled
from stickslip.friction import Coulomb, LuGre, ResetIntegrator
from stickslip.plant.system import Element, Mode, Plant
from stickslip.solve import log as reading
from stickslip.solve.log import TERMS
from stickslip.waveform.drive import Drive
from stickslip.waveform.pieces import Piece, assemble

Array = NDArray[np.float64]
LUGRE = LuGre(2e5, 30.0, 4.0, 0.5, 0.5)
STAGE, SLIDER, FREE = Mode(1.1e7, 3400.0, 1.1, 0.2), Mode(4e5, 120.0, 0.03, -0.5), Mode(0.0, 60.0, 0.2, 0.4)
RATE = 3303.0
# Three steps, the first two of which were cut, and at their ends the drive breaks; all is read MOVED s later.
BEGIN, MOVED = 0.013, 0.25
LENGTHS, ENDS = (4e-4, 5e-4, 6e-4), (BEGIN + 3e-4, BEGIN + 7e-4, BEGIN + 1.3e-3)
BREAKS, LAST = [ENDS[0] + MOVED, ENDS[1] + MOVED], ENDS[2] + MOVED
FORMULAS = (40.0, -90.0, 3e3), (-25.0, 7e3, 2e5), (30.0, -5e3, 3e5)
LOADS = (0.8, 0.9), (0.6, -30.0), (0.7, 25.0)
DRIVE, NORMAL = (
    assemble(1.0, [Piece(start, one) for start, one in zip((0.0, *BREAKS), pieces, strict=True)], 1.0)
    for pieces in (FORMULAS, LOADS)
)


class Case(NamedTuple):
    plant: Plant
    states: Array  # at the ends of the steps
    sides: tuple[tuple[float, ...], ...]
    bend: Array  # how far the state is off the line between them


CASES = {
    "bristles": Case(
        Plant(
            (STAGE, FREE, SLIDER),
            (
                Element(LUGRE, (1.0, -1.0, None), (-10.0, 7.7, None), 1.2, loaded=1.0),
                Element(LUGRE, (None, 0.8, -1.0), (None, -7.7, 5.0)),
                Element(LUGRE, (1.0, None, -0.9), (-9.0, None, 5.0), 0.7),
            ),
            RATE,
        ),
        np.array(
            [
                [3.1e-6, 2.3e-3, 1.7e-6, 1.3e-3, 0.4e-6, -0.9e-3, 0.9e-6, 0.5e-6, 0.3e-6],
                [3.9e-6, 3.6e-3, 1.2e-6, 1.1e-3, 0.2e-6, -0.2e-3, 1.4e-6, 0.7e-6, 0.6e-6],
                [4.2e-6, 2.6e-3, 1.3e-6, 1.9e-3, 0.1e-6, -0.8e-3, 1.1e-6, 0.3e-6, 0.9e-6],
                [4.6e-6, 2.9e-3, 1.2e-6, 1.8e-3, 0.5e-6, -0.6e-3, 1.3e-6, 0.1e-6, 0.8e-6],
            ]
        ),
        ((1.0, 1.0, 1.0),) * 3,
        np.array([3e-7, 2e-4, -2e-7, 1e-4, 3e-7, -1e-4, 1e-7, -2e-7, 1e-7]),
    ),
    "held, then sliding": Case(
        Plant(
            (STAGE, FREE),
            (
                Element(Coulomb(0.5), (1.0, -1.0), (-10.0, 7.7), 1.2, 1.0),
                Element(Coulomb(0.2), (None, 1.0), (None, -5.0)),
            ),
            RATE,
        ),
        np.array(
            [
                [3.1e-6, 2.3e-3, 1.7e-6, 2.1e-3],
                [3.9e-6, 3.6e-3, 1.2e-6, 3.2e-3],
                [4.2e-6, 2.6e-3, 1.3e-6, 1.9e-3],
                [4.9e-6, 2.2e-3, 1.9e-6, 1.4e-3],
            ]
        ),
        ((0.0, -1.0), (-1.0, 0.0), (0.0, -1.0)),
        np.array([3e-7, 2e-4, -2e-7, 1e-4]),
    ),
    "stage that follows the drive": Case(
        Plant((SLIDER,), (Element(Coulomb(0.5), (-1.0,), (7.7,), 1.2, 1.0, drive_rate=1e-6),), RATE),
        np.array([[1.7e-6, 2.1e-3], [1.2e-6, 3.2e-3], [1.3e-6, 1.9e-3], [1.8e-6, 1.5e-3]]),
        ((1.0,), (0.0,), (-1.0,)),
        np.array([-2e-7, 1e-4]),
    ),
}
NAMES = tuple(CASES) if numba.config.DISABLE_JIT else ("bristles",)  # type: ignore[attr-defined]


# What only kernels call has no way in from Python; these have.
@compiled
def add_work(plant, drive, i, load, j, log, row, shift, low, high, probe, work):
    reading._add_work(plant, drive, i, load, j, log, row, shift, low, high, probe, work)


@compiled
def read_account(plant, drive, load, log, rows, shift, times, k, t_end, probe, work, account):
    reading.read_account(plant, drive, load, log, rows, shift, times, k, t_end, probe, work, account)


@compiled
def read_samples(plant, drive, load, log, rows, shift, move, times, k, t_end, samples):
    return reading.read_samples(plant, drive, load, log, rows, shift, move, times, k, t_end, samples)


@compiled
def state_at(plant, log, row, theta, out):
    reading.state_at(plant, log, row, theta, out)


@compiled
def logged_step(plant, log, row):
    return reading.logged_step(plant, log, row)


@pytest.fixture(params=NAMES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def log_of(case: Case) -> Array:
    """Its bend is of second order in the time: what the quadrature takes exactly."""
    n, width = case.states.shape[1], len(case.sides[0])
    log, start = np.zeros((4, 4 + width + 5 * n)), BEGIN
    for row in range(3):
        ends = case.states[row], case.states[row + 1]
        log[row, :4] = start, LENGTHS[row], ENDS[row], (ENDS[row] - start) / LENGTHS[row]
        log[row, 4:] = np.concatenate([case.sides[row], *ends, case.bend, np.zeros(2 * n)])
        start = ENDS[row]
    return log


def test_a_step_is_read_as_it_was_logged(case: Case) -> None:
    log, n = log_of(case), case.states.shape[1]
    log[:3, -2 * n :] = np.random.default_rng(1).normal(size=(3, 2 * n))
    for row in range(3):
        before, after, extension = logged_step(case.plant, log, row)
        assert before == tuple(case.states[row])
        assert after == tuple(case.states[row + 1])
        assert extension == (tuple(case.bend), tuple(log[row, -2 * n : -n]), tuple(log[row, -n:]))


def row_at(t: float) -> int:
    """Of a time at which a step ends and the next one begins, the former."""
    return int(np.searchsorted(BREAKS, t))


def state_of(case: Case, t: float) -> tuple[Array, tuple[float, ...]]:
    """State and sides at a time after the log was moved."""
    row = row_at(t)
    s = (t - ((BEGIN, *ENDS)[row] + MOVED)) / LENGTHS[row]
    line = (1 - s) * case.states[row] + s * case.states[row + 1]
    return line + s * (1 - s) * case.bend, case.sides[row]


def derivatives_at(table: Any, row: int, t: float) -> tuple[float, ...]:
    polynomial = np.polynomial.Polynomial(table.polynomial[row])
    return tuple(float(polynomial.deriv(k)(t - table.start[row])) for k in range(4))


def powers(case: Case, t: float) -> list[float]:
    """What the account is the integral of."""
    q, sides = state_of(case, t)
    u, n = (derivatives_at(table, row_at(t), t) for table in (DRIVE, NORMAL))
    w, f = q[1 : 2 * len(case.plant.modes) : 2], motion(case.plant, sides, q, u, n)[1]
    bodies = q[: 2 * len(case.plant.modes)]
    s = [input_of(e, bodies, u, [0.0] * i) for i, e in enumerate(case.plant.elements)]
    return [
        sum(mode.drive * u[0] * one for mode, one in zip(case.plant.modes, w, strict=True)),
        sum(mode.damping * one**2 for mode, one in zip(case.plant.modes, w, strict=True)),
        sum(f * s),
        sum(f * w[-1]),
    ]


def integrals(power: Callable[[float], list[float]], start: float, end: float) -> list[float]:
    breaks = [t for t in BREAKS if start < t < end] or None
    return [
        quad(lambda t, c=c: power(t)[c], start, end, points=breaks, epsabs=0.0, epsrel=1e-10)[0]
        for c in range(TERMS)
    ]


@pytest.mark.parametrize("row", [0, 1, 2])
def test_work_of_a_part_of_a_step(case: Case, row: int) -> None:
    log, probe, work = log_of(case), np.zeros(case.states.shape[1]), np.arange(float(TERMS))
    add_work(case.plant, DRIVE, row, NORMAL, row, log, row, MOVED, 0.2, 0.6, probe, work)
    start = log[row, 0] + MOVED
    expected = integrals(lambda t: powers(case, t), start + 0.2 * LENGTHS[row], start + 0.6 * LENGTHS[row])
    np.testing.assert_allclose(work - np.arange(float(TERMS)), expected, rtol=1e-8)


def account(
    case: Case, times: Array, k: int, end: float, work: Array, drive: Drive = DRIVE, load: Drive = NORMAL
) -> Array:
    """Filled from sample k on."""
    found = np.full((times.size, TERMS), np.nan)
    probe = np.zeros(case.states.shape[1])
    read_account(case.plant, drive, load, log_of(case), 3, MOVED, times, k, end, probe, work, found)
    return found


def test_account_at_the_samples_and_work_as_far_as_asked(case: Case) -> None:
    """From sample to sample, over the cuts and the breaks of the drive."""
    start, end, work = BEGIN + MOVED, LAST - 2e-4, np.zeros(TERMS)
    inside = [start, start + 1e-4, start + 2e-4, BREAKS[0], BREAKS[0] + 1e-4, BREAKS[1] + 1e-4, end]
    found = account(case, np.array([start - 1e-3, *inside, end + 1e-4]), 1, end, work)
    for t, one in zip(inside, found[1:-1], strict=True):
        np.testing.assert_allclose(one, integrals(lambda t: powers(case, t), start, t), rtol=1e-8)
    np.testing.assert_allclose(work, integrals(lambda t: powers(case, t), start, end), rtol=1e-8)
    assert np.all(np.isnan(found[[0, -1]]))


@pytest.mark.parametrize("towards", [0.0, 1.0])
def test_a_step_belongs_to_the_segment_that_it_lies_in(case: Case, towards: float) -> None:
    """Though rounding puts its start, moved, before the break, or after it."""
    expected, work = np.zeros(TERMS), np.zeros(TERMS)
    account(case, np.zeros(0), 0, LAST, expected)
    starts = np.array([0.0, *np.nextafter(BREAKS, towards)])
    account(case, np.zeros(0), 0, LAST, work, DRIVE._replace(start=starts), NORMAL._replace(start=starts))
    np.testing.assert_allclose(work, expected, rtol=1e-9)


def test_no_sample_is_lost_at_the_end(case: Case) -> None:
    """Though rounding puts the end of the last step, moved, before it."""
    work, end = np.zeros(TERMS), np.nextafter(LAST, 1.0)
    found = account(case, np.array([end]), 0, end, work)
    np.testing.assert_array_equal(found[0], work)
    np.testing.assert_allclose(work, integrals(lambda t: powers(case, t), BEGIN + MOVED, end), rtol=1e-7)
    samples = read(case, np.array([end]), 0, end)[1]
    np.testing.assert_allclose(samples[0], read(case, np.array([LAST]), 0, end)[1][0], rtol=1e-9)


def test_work_goes_on_beyond_the_last_sample(case: Case) -> None:
    """And of what is asked for before the first step, there is none."""
    work = np.ones(TERMS)
    account(case, np.zeros(0), 0, LAST, work)
    account(case, np.zeros(0), 0, BEGIN + MOVED, work)
    expected = integrals(lambda t: powers(case, t), BEGIN + MOVED, LAST)
    np.testing.assert_allclose(work - 1.0, expected, rtol=1e-7, atol=1e-14)


def read(case: Case, times: Array, k: int, end: float) -> tuple[int, Array]:
    """The first sample not filled, and samples from k on; each entry of the state moved on by its number."""
    n = case.states.shape[1]
    samples = np.full((times.size, n + len(case.plant.elements)), np.nan)
    move = tuple(np.arange(float(n)))
    log = log_of(case)
    return read_samples(case.plant, DRIVE, NORMAL, log, 3, MOVED, move, times, k, end, samples), samples


def test_samples_are_states_moved_on_and_outputs(case: Case) -> None:
    n, end = case.states.shape[1], LAST - 2e-4
    inside = [BEGIN + MOVED + 1e-4, BREAKS[0] - 1e-5, BREAKS[0] + 1e-4, BREAKS[1] + 1e-4, end]
    filled, samples = read(case, np.array([BEGIN, *inside, end + 1e-4]), 1, end)
    assert filled == 6
    for t, found in zip(inside, samples[1:-1], strict=True):
        row = row_at(t)
        q, sides = state_of(case, t)
        u, u_begun = (derivatives_at(DRIVE, row, at) for at in (t, (BEGIN, *ENDS)[row] + MOVED))
        q = riding(case.plant, sides, q, u, case.states[row], u_begun)
        forces = motion(case.plant, sides, q, u, derivatives_at(NORMAL, row, t))[1]
        np.testing.assert_allclose(found[:n] - np.arange(n), q, rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(found[n:], forces, rtol=1e-9)
    assert np.all(np.isnan(samples[[0, -1]]))


def begun_at(case: Case, q: Array, u: Any, n: Any, held: tuple[bool, ...]) -> tuple[float, ...]:
    """Sides after a break: those of the speeds; who was held and does not slide, slides as it is pushed if
    that is more than it bears."""
    outputs, bodies = [0.0] * len(held), q[: 2 * len(case.plant.modes)]
    speeds = np.array([input_of(e, bodies, u, outputs[:i]) for i, e in enumerate(case.plant.elements)])
    sides = np.where(np.array(held) & (np.abs(speeds) < 1e-12), 0.0, np.sign(speeds))
    while True:
        forces = motion(case.plant, tuple(sides), q, u, n)[1]
        bears = [load_of(e, bodies, n)[0] * getattr(e.law, "coulomb_force", 0.0) for e in case.plant.elements]
        over = np.where(sides == 0.0, np.abs(forces) - bears, 0.0)
        if not np.any(over > 0.0):
            return tuple(sides)
        sides[np.argmax(over)] = np.sign(forces[np.argmax(over)])


def after_break(case: Case, row: int) -> tuple[Array, Array]:
    """State and outputs where a step ends at a break: a load that grew presses on contact without force."""
    t, n = BREAKS[row], case.states.shape[1]
    q, sides = state_of(case, t)
    u_begun = derivatives_at(DRIVE, row, (BEGIN, *ENDS)[row] + MOVED)
    q = riding(case.plant, sides, q, derivatives_at(DRIVE, row, t), case.states[row], u_begun)
    before, after = (derivatives_at(NORMAL, one, t) for one in (row, row + 1))
    entry = 2 * len(case.plant.modes)
    for element in case.plant.elements:
        inside = slice(entry, entry := entry + states_of(element.law))
        q[inside] *= min(before[0] / after[0], 1.0) if element.loaded is not None else 1.0
    u = derivatives_at(DRIVE, row + 1, t)
    held = tuple(side == 0.0 for side in sides)
    assert entry == n
    return q, motion(case.plant, begun_at(case, q, u, after, held), q, u, after)[1]


# One bristle that slides until new load presses on it.
LET_GO = Case(
    Plant((SLIDER,), (Element(ResetIntegrator(1e6, 9e-7, 0.3, 20.0), (-1.0,), (7.7,), 1.2, 1.0),), RATE),
    np.array(
        [
            [1.7e-6, -2.1e-3, 9e-7],
            [1.2e-6, -3.2e-3, 9e-7],
            [1.3e-6, -1.9e-3, 9e-7],
            [1.8e-6, -1.5e-3, 9e-7],
        ]
    ),
    ((2.0,),) * 3,
    np.array([-2e-7, 1e-4, 0.0]),
)


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("which", NAMES if len(NAMES) == 1 else (*NAMES, "let go"))
def test_a_sample_at_a_break_is_after_it(which: str, row: int) -> None:
    case = CASES.get(which, LET_GO)
    n = case.states.shape[1]
    state, outputs = after_break(case, row)
    samples = read(case, np.array([BREAKS[row]]), 0, LAST)[1][0]
    np.testing.assert_allclose(samples[:n] - np.arange(n), state, rtol=1e-6, atol=1e-14)
    np.testing.assert_allclose(samples[n:], outputs, rtol=1e-9)


def test_no_samples_ask_for_none(case: Case) -> None:
    assert read(case, np.zeros(0), 0, 1.0)[0] == 0


def test_state_within_a_step_is_its_continuous_extension(case: Case) -> None:
    log, n, first = log_of(case), case.states.shape[1], 4 + len(case.sides[0])
    rows = np.arange(1.0, 3.0 * n + 1.0).reshape(3, n) ** 2
    log[1, first + 2 * n :] = rows.ravel()
    out, s = np.zeros(n + 2), 0.3
    state_at(case.plant, log, 1, s, out)
    line = (1 - s) * case.states[1] + s * case.states[2]
    np.testing.assert_allclose(
        out[:n], line + s * (1 - s) * (rows[0] + s * rows[1] + s**2 * rows[2]), rtol=1e-12
    )
    assert np.all(out[n:] == 0.0)


def test_width_of_a_log() -> None:
    """Start, length, end, fraction; the sides; five rows of states. A plant of no element has one side."""
    assert reading.columns(8, 2) == 4 + 2 + 40
    assert reading.columns(2, 0) == 4 + 1 + 10
