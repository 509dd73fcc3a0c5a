"""Where a contact turns within a step, in the engine: against the roots of polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from engine.inner import Inner
from stickslip.engine.binding import DriveTable
from stickslip.friction import LuGre
from stickslip.simulation.plant.system import Element, Mode, Plant
from stickslip.waveform.drive import Drive, evaluate

Array = NDArray[np.float64]
CONTACT = Element(LuGre(1e6, 30.0, 1.0, 0.5, 0.5), (1.0, -1.0), (-10.0, 10.0))
STAGE, SLIDER = Mode(1e7, 3e3, 1.0, 0.0), Mode(0.0, 0.0, 0.0, 0.0)
PLANTS = {
    "bodies only": Plant((STAGE, SLIDER), (CONTACT,), 3e3),
    "the drive too": Plant((STAGE, SLIDER), (CONTACT._replace(drive_rate=1e-7),), 3e3),
}
CUBIC = Drive(0.0, np.zeros(1), np.array([[10.0, 4e3, -2e6, 3e9]]), np.array([0, 0]), np.zeros((0, 4)))
SINE = CUBIC._replace(first=np.array([0, 1]), harmonic=np.array([[5.0, 2e4, 0.7, 0.0]]))
START, LENGTH = 2e-4, 3e-5


@pytest.mark.parametrize(
    ("drive", "fractions"), [(CUBIC, (0.0, 0.3, 0.5, 0.8, 1.0)), (SINE, (0.0, 0.5, 1.0))]
)
@pytest.mark.parametrize("name", PLANTS)
def test_speed_within_a_step_is_a_polynomial(
    inner: Inner, name: str, drive: Drive, fractions: tuple[float, ...]
) -> None:
    """Of a sine it is that through start, middle and end."""
    rng = np.random.default_rng(1)
    plant, scale = PLANTS[name], np.array([1e-6, 1e-3, 1e-6, 1e-3, 1e-7])
    q, new, *rows = scale * rng.normal(size=(5, 5))
    table, a, start = DriveTable(drive), np.zeros(5), np.array(q)
    inner("polynomial", plant, table, START, LENGTH, start, np.array(new), np.array(rows), a)
    for theta in fractions:
        r = rows[0] + theta * (rows[1] + theta * rows[2])
        within = (1.0 - theta) * start + theta * (new + (1.0 - theta) * r)
        u = np.array([channel[0] for channel in evaluate(drive, np.array([START + theta * LENGTH]))[:2]])
        speed = np.zeros(1)
        inner("inputs", plant, within, u, speed, np.zeros(1))
        assert inner.plain("speed_at", theta, a) == pytest.approx(speed[0], rel=1e-9)


def coefficients(slope: list[float], begun: float, side: float) -> Array:
    """Return the polynomial with this value at 0, and these roots of its slope."""
    found = Polynomial.fromroots(slope).integ(k=begun)
    return side * np.pad(np.asarray(found.coef, dtype=float), (0, 5 - found.coef.size))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("slope", "lowest", "highest"),
    [
        ([0.2], 0.2, 0.0),
        ([0.8], 0.8, 0.0),
        ([0.3, -2.0, -3.0], 0.3, 0.0),
        ([0.1, 0.7], 0.7, 0.1),
        ([0.3, 2.0], 1.0, 0.3),
        ([-1.0], 1.0, 0.0),
        ([2.0], 1.0, 0.0),
    ],
)
def test_where_the_speed_is_least_and_most(
    inner: Inner, slope: list[float], lowest: float, highest: float, side: float
) -> None:
    """0 and 1: nowhere within the step. Of the case with both the least follows the most."""
    a = coefficients(slope, 0.5, side)
    assert inner.plain("least", side, a) == (pytest.approx(lowest, abs=2e-4) if lowest < 1.0 else 1.0)
    assert inner.plain("most", side, a) == (pytest.approx(highest, abs=2e-4) if highest > 0.0 else 0.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("root", [0.03, 0.4, 0.97])
def test_where_the_speed_has_fallen_to_a_value(inner: Inner, root: float, side: float) -> None:
    falling = -Polynomial.fromroots([root, -0.7, 1.6, 2.1]) + 0.25
    assert falling(0.0) > 0.25 > falling(1.0)
    a = side * np.asarray(falling.coef, dtype=float)
    assert inner.plain("reached", 0.25, 0.0, 1.0, side, a) == pytest.approx(root, abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_root_that_newtons_method_overshoots(inner: Inner, side: float) -> None:
    """Nearly flat in the middle of that half, and beyond it another root."""
    falling = -Polynomial.fromroots([0.4]) * (Polynomial.fromroots([0.745] * 3) + 0.008)
    a = side * np.asarray(falling.coef, dtype=float)
    assert inner.plain("reached", 0.0, 0.5, 1.0, side, a) == pytest.approx(0.545, abs=1e-12)


def test_a_slope_of_zero_is_no_division(inner: Inner) -> None:
    flat = 0.1 - Polynomial.fromroots([0.5] * 3)
    assert inner.plain("reached", 0.0, 0.0, 1.0, 1.0, np.array([*flat.coef, 0.0])) == pytest.approx(
        0.5 + 0.1 ** (1 / 3), abs=1e-12
    )
    assert inner.plain("reached", 0.0, 0.0, 1.0, 1.0, np.zeros(5)) == pytest.approx(0.0, abs=1e-8)
