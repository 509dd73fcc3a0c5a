"""Moves on a twin with irregular steps: a small case of the study in `benchmarks.real_moves`."""

import numpy as np
import pytest
from benchmarks.real_moves import RANGE, SESSIONS, WAY, axis, irregular, move, off, proportion, scripted

from stickslip.rig import Irregularity


@pytest.mark.parametrize("number", range(3))
def test_a_move_of_10_um_says_arrived_truly_and_soon(number: int) -> None:
    random = np.random.default_rng([77, number])
    moved = move(axis(), off(axis(), random), irregular(random), WAY * (1 - 2 * (number % 2)), number)
    assert (moved.arrived, moved.why) == (True, "")
    assert moved.off <= RANGE
    assert moved.time < 0.6


def test_a_twin_that_is_driven_as_the_real_axis_was_is_as_far_off() -> None:
    found = scripted(Irregularity(), 110e-9, 16, 5)
    (low, high), (_, most), _, _ = SESSIONS[110]
    middle, wide, outside, _ = found.told(110.0)
    assert low < middle < high
    assert middle < wide < most
    assert outside < 15.0


def test_the_share_that_is_true_has_an_interval() -> None:
    assert proportion(300, 300) == pytest.approx(0.05 ** (1 / 300))  # none of n fails: the closed form
    assert proportion(295, 300) < 295 / 300
