"""Drive and load in the engine, at the nodes of a step, against the table's own values, differenced."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from engine.inner import Inner
from engine.test_step import Rodas
from stickslip.engine.binding import DriveTable
from stickslip.waveform.drive import Drive, evaluate

Array = NDArray[np.float64]
STARTS = np.array([0.0, 1e-3, 2e-3])
POLYNOMIALS = np.array([[1.0, 2.0, 3.0, 4.0], [10.0, 4e3, -2e6, 3e9], [5.0, 6.0, 7.0, 8.0]])
SMOOTH = Drive(0.0, STARTS, POLYNOMIALS, np.array([0, 0, 0, 0]), np.zeros((0, 4)))
HARMONICS = np.array([[9.0, 1e3, 0.1, 0.0], [3.0, 9e3, 0.4, 1e7], [-2.0, 2e4, 1.4, -3e7]])
WAVY = Drive(0.0, STARTS, POLYNOMIALS, np.array([0, 1, 3, 3]), HARMONICS)
WAVY_LATER = Drive(0.0, STARTS, POLYNOMIALS, np.array([0, 0, 3, 3]), HARMONICS)
T, H = 1.2e-3, 2e-5


def at(inner: Inner, drive: Drive, t: float) -> tuple[Array, Array]:
    """Value and derivatives of the second segment, and those at the nodes of a step."""
    found, nodes = np.zeros(4), np.zeros((7, 4))
    inner.plain("table", DriveTable(drive), 1, t, H, found, nodes)
    return found, nodes


@pytest.mark.parametrize("drive", [SMOOTH, WAVY])
def test_value_and_derivatives(inner: Inner, drive: Drive) -> None:
    """Each is the central difference of the one before."""
    dt = 1e-9
    found, ahead, behind = (at(inner, drive, t)[0] for t in (T, T + dt, T - dt))
    assert found[0] == pytest.approx(evaluate(drive, np.array([T]))[0][0], rel=1e-12)
    assert found[1] == pytest.approx(evaluate(drive, np.array([T]))[1][0], rel=1e-12)
    np.testing.assert_allclose(found[1:], (ahead[:3] - behind[:3]) / (2 * dt), rtol=1e-5)


@pytest.mark.parametrize("drive", [SMOOTH, WAVY, WAVY_LATER])
def test_nodes_of_a_step_and_its_middle(inner: Inner, drive: Drive) -> None:
    times = T + H * Rodas(inner).nodes
    expected = [at(inner, drive, t)[0] for t in times]
    np.testing.assert_allclose(at(inner, drive, T)[1], expected, rtol=1e-12)
