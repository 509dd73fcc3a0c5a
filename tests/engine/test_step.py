"""One step of the engine against the method on arrays, written from its definition, and SciPy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from engine.inner import Inner
from plants import Lag, by_time, jacobian, motion, scale_of, weights_and_rates
from stickslip.engine.binding import DriveTable
from stickslip.friction import CoulombViscous, Dahl, Elastoplastic, LuGre, MaxwellSlip
from stickslip.simulation.plant.system import Element, Mode, Plant
from stickslip.waveform.drive import Drive

Array = NDArray[np.float64]
LAWS = {
    "LuGre": LuGre(1.4e6, 35.0, 0.7, 0.54, 0.7, 1e-3),
    "Dahl": Dahl(1.4e6, 0.54),
    "Elastoplastic": Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7),
    "MaxwellSlip": MaxwellSlip((1e6, 4e5), (0.3, 0.24), 0.4),
    "CoulombViscous": CoulombViscous(0.5, 6.0),
}
# Every coefficient at work: springs, dampers and drives on both bodies, reaction, constant forces.
STAGE, SLIDER = Mode(1.09e7, 3460.0, 1.15, 0.3), Mode(4e5, 120.0, 0.02, -0.7)
RATE = 3303.0
DRIVE = Drive(
    0.0,
    np.zeros(1),
    np.array([[10.0, 4e3, -2e6, 3e9]]),
    np.array([0, 1]),
    np.array([[3.0, 9e3, 0.4, 1e5]]),
)
LOAD = Drive(1.0, np.zeros(1), np.array([[1.1, 300.0, -4e4, 1e6]]), np.array([0, 0]), np.zeros((0, 4)))
T, H = 2e-4, 2e-5


class Case(NamedTuple):
    plant: Plant
    q: tuple[float, ...]
    sides: tuple[float, ...]


def on_stage(law: Any, side: float) -> Case:
    """A slider on a driven stage, its contact under a varying load."""
    inside = {"CoulombViscous": (), "MaxwellSlip": (2e-7, -1e-7)}.get(type(law).__name__, (2e-7,))
    contact = Element(law, (1.0, -1.0), (-5.0, 10.0), loaded=1.0)
    q = side * 1e-6, side * 3e-3, 2e-7, 1e-3, *(side * z for z in inside)
    return Case(Plant((STAGE, SLIDER), (contact,), RATE), q, (side,))


CASES = {
    **{f"{name} forward": on_stage(law, 1.0) for name, law in LAWS.items()},
    **{f"{name} backward": on_stage(law, -1.0) for name, law in LAWS.items()},
    # Its bristle relaxes many times within the step, so that the defect in the middle counts; it is larger.
    "stiff": Case(
        Plant(
            (STAGE, SLIDER),
            (Element(LuGre(2e8, 100.0, 0.7, 0.54, 0.7, 1e-3), (1.0, -1.0), (-5.0, 10.0), loaded=1.0),),
            RATE,
        ),
        (1e-6, 1e-2, 2e-7, 1e-3, 2.4e-9),
        (1.0,),
    ),
    "from the drive": Case(
        Plant((SLIDER,), (Element(LAWS["LuGre"], (-1.0,), (10.0,), drive_rate=1e-7),), RATE),
        (2e-7, 3e-3, -2e-7),
        (-1.0,),
    ),
    "held to the drive": Case(
        Plant((SLIDER,), (Element(LAWS["CoulombViscous"], (-1.0,), (10.0,), drive_rate=1e-6),), RATE),
        (2e-7, -1e-3),
        (0.0,),
    ),
    "lags": Case(
        Plant(
            (STAGE, SLIDER),
            (
                Element(Lag(5e3, 0.1, 0.2), (20.0, None), (None, None), position=(4e5, None)),
                Element(Lag(3e3, 0.2, 0.3), (None, None), (30.0, None), 0.9, None, 1e-5, 0.02, None, (0.7,)),
                Element(LAWS["LuGre"], (1.0, -1.0), (-5.0, 10.0)),
            ),
            RATE,
        ),
        (1e-6, 3e-3, 2e-7, 1e-3, 0.7, -0.4, 2e-7),
        (1.0, 1.0, 1.0),
    ),
}


class Rodas:
    """Coefficients of the method, as the engine has them."""

    def __init__(self, inner: Inner) -> None:
        self.A, self.C, self.D = np.zeros((6, 8)), np.zeros((8, 8)), np.zeros(5)
        self.H, self.nodes, self.gamma = np.zeros((3, 8)), np.zeros(7), np.zeros(1)
        inner.plain("coefficients", self.A, self.C, self.D, self.H, self.nodes, self.gamma)


def drive_at(t: float) -> tuple[float, ...]:
    """Drive and derivatives by time: a cubic, and the imaginary part of a turning number."""
    c0, c1, c2, c3 = DRIVE.polynomial[0]
    ((size, omega, phase, chirp),) = DRIVE.harmonic
    turn = size * np.exp(1j * (phase + omega * t + chirp * t**2))
    rate, more = 1j * (omega + 2.0 * chirp * t), 2j * chirp
    harmonic = turn, rate * turn, (more + rate**2) * turn, (3.0 * more * rate + rate**3) * turn
    cubic = c0 + c1 * t + c2 * t**2 + c3 * t**3, c1 + 2 * c2 * t + 3 * c3 * t**2, 2 * c2 + 6 * c3 * t, 6 * c3
    return tuple(float(a + b.imag) for a, b in zip(cubic, harmonic, strict=True))


def load_at(t: float) -> tuple[float, ...]:
    polynomial = np.polynomial.Polynomial(LOAD.polynomial[0])
    return tuple(float(polynomial.deriv(k)(t)) for k in range(4))


def exact(case: Case, times: list[float]) -> Array:
    scale = scale_of(case.plant)

    def slopes(t: float, scaled: Array) -> Array:
        return motion(case.plant, case.sides, scale * scaled, drive_at(t), load_at(t))[0] / scale

    at = [T + s * H for s in times]
    found = solve_ivp(
        slopes, (T, T + H), np.array(case.q) / scale, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=at
    )
    return scale * found.y.T


def rosenbrock(method: Rodas, case: Case, theta: float) -> tuple[Array, Array, float]:
    """The step, its extension at a fraction, and its error, from the definition of the method."""
    plant, sides, q = case.plant, case.sides, np.array(case.q)
    A, C, D, n = method.A, method.C, method.D, len(case.q)
    u, load = drive_at(T), load_at(T)
    W = np.eye(n) / (method.gamma[0] * H) - jacobian(plant, sides, q, u, load)
    by_t = by_time(plant, sides, q, u, load)

    def f(c: float, at: Array) -> Array:
        return motion(plant, sides, at, drive_at(T + c * H), load_at(T + c * H))[0]

    U: list[Array] = []
    at = q
    for i in range(8):
        if i < 6:
            at, c = q + sum((a * one for a, one in zip(A[i], U, strict=False)), np.zeros(n)), method.nodes[i]
        else:
            at, c = at + U[-1], 1.0
        known = sum((b * one for b, one in zip(C[i], U, strict=False)), np.zeros(n)) / H
        U.append(np.linalg.solve(W, f(c, at) + known + (H * D[i] * by_t if i < len(D) else 0.0)))
    new = at + U[-1]
    rows = method.H @ U

    def extension(s: float) -> Array:
        return (1 - s) * q + s * new + s * (1 - s) * (rows[0] + s * rows[1] + s**2 * rows[2])

    fractions = np.linspace(0.0, 1.0, 5)
    quartic = np.polynomial.Polynomial.fit
    turn = [
        quartic(fractions, column, 4).deriv()(0.5) for column in np.array([extension(s) for s in fractions]).T
    ]
    defect = np.linalg.solve(W, f(0.5, extension(0.5)) - np.array(turn) / H)
    of_elements, rates = weights_and_rates(plant, sides, q, u, load)
    weights = np.array([1.0, 1.0 / RATE] * len(plant.modes) + of_elements)
    errors = (U[-1], defect) if H * max(rates) >= 1.0 else U[-1:]
    return new, extension(theta), max(np.max(np.abs(e) * weights) for e in errors)


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def step(inner: Inner, case: Case, theta: float) -> tuple[Array, Array, float, Array]:
    q, fast = np.array(case.q), np.zeros(len(case.sides))
    new, within, sides = np.zeros(q.size), np.zeros(q.size), np.array(case.sides)
    tables = DriveTable(DRIVE), DriveTable(LOAD)
    error = inner("take", case.plant, sides, *tables, T, H, q, theta, new, within, fast)
    return new, within, error, fast


@pytest.mark.parametrize("name", [name for name in CASES if name != "stiff"])
def test_step_and_continuous_extension_are_the_solution(inner: Inner, name: str) -> None:
    case = CASES[name]
    new, middle, error, _ = step(inner, case, 0.3)
    expected, end = exact(case, [0.3, 1.0])
    change = np.abs(end - np.array(case.q))
    np.testing.assert_array_less(np.abs(np.array(new) - end) / change, 3e-5)
    np.testing.assert_array_less(np.abs(np.array(middle) - expected) / change, 3e-4)
    assert 0.0 < error < 1e-8


def test_it_is_the_method_on_arrays(inner: Inner, case: Case) -> None:
    new, middle, error, stiffness = step(inner, case, 0.3)
    expected = rosenbrock(Rodas(inner), case, 0.3)
    # The step differences the law on one side, a hundred-thousandth away: what is left of that.
    change = np.abs(expected[0] - np.array(case.q))
    np.testing.assert_array_less(np.abs(new - expected[0]) / change, 1e-7)
    np.testing.assert_array_less(np.abs(middle - expected[1]) / change, 1e-6)
    assert error == pytest.approx(expected[2], rel=1e-4)
    u, load = drive_at(T), load_at(T)
    rates = weights_and_rates(case.plant, case.sides, np.array(case.q), u, load)[1]
    # One-sided, a hundred-thousandth apart, where the expected rate is a central difference.
    np.testing.assert_allclose(stiffness, H * np.array(rates), rtol=1e-4)
