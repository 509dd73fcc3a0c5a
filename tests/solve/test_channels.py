"""Drive and load at the nodes of a step against the table's own values, differenced."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip._jit import compiled
from stickslip.solve import channels, rodas5p
from stickslip.waveform.drive import Drive, evaluate

STARTS = np.array([0.0, 1e-3, 2e-3])
POLYNOMIALS = np.array([[1.0, 2.0, 3.0, 4.0], [10.0, 4e3, -2e6, 3e9], [5.0, 6.0, 7.0, 8.0]])
SMOOTH = Drive(0.0, STARTS, POLYNOMIALS, np.array([0, 0, 0, 0]), np.zeros((0, 4)))
HARMONICS = np.array([[9.0, 1e3, 0.1, 0.0], [3.0, 9e3, 0.4, 1e7], [-2.0, 2e4, 1.4, -3e7]])
WAVY = Drive(0.0, STARTS, POLYNOMIALS, np.array([0, 1, 3, 3]), HARMONICS)
WAVY_LATER = Drive(0.0, STARTS, POLYNOMIALS, np.array([0, 0, 3, 3]), HARMONICS)
T, H = 1.2e-3, 2e-5


# What only kernels call has no way in from Python; these have.
@compiled
def at(drive, i, t):
    return channels.at(drive, i, t)


@compiled
def at_nodes(drive, i, t, h):
    return channels.at_nodes(drive, i, t, h)


@compiled
def segments(drive, t, i, t_end):
    return channels.segment_of(drive, t), channels.next_break(drive, i, t_end)


@pytest.mark.parametrize("drive", [SMOOTH, WAVY])
def test_value_and_derivatives(drive: Drive) -> None:
    """Each is the central difference of the one before."""
    dt = 1e-9
    found, ahead, behind = at(drive, 1, T), at(drive, 1, T + dt), at(drive, 1, T - dt)
    assert found[0] == pytest.approx(evaluate(drive, np.array([T]))[0][0], rel=1e-12)
    assert found[1] == pytest.approx(evaluate(drive, np.array([T]))[1][0], rel=1e-12)
    np.testing.assert_allclose(found[1:], (np.array(ahead[:3]) - behind[:3]) / (2 * dt), rtol=1e-5)


@pytest.mark.parametrize("drive", [SMOOTH, WAVY, WAVY_LATER])
def test_nodes_of_a_step_and_its_middle(drive: Drive) -> None:
    expected = [at(drive, 1, T + c * H) for c in (*rodas5p.NODES, 0.5)]
    np.testing.assert_allclose(at_nodes(drive, 1, T, H), expected, rtol=1e-12)


def test_segments() -> None:
    """At a break point the later one counts; the last goes on for ever."""
    assert segments(SMOOTH, 0.0, 0, 5.0) == (0, 1e-3)
    assert segments(SMOOTH, 0.9e-3, 0, 0.5e-3) == (0, 0.5e-3)
    assert segments(SMOOTH, 1e-3, 1, 5.0) == (1, 2e-3)
    assert segments(SMOOTH, 1.5e-3, 1, 1.8e-3) == (1, 1.8e-3)
    assert segments(SMOOTH, 7.0, 2, 8.0) == (2, 8.0)
