"""Where searches begin."""

from __future__ import annotations

import pytest

from stickslip.identify.walk.first_guess import VALLEY, far


@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        (1.0, 0.9 * VALLEY, False),
        (1.0, 1.1 * VALLEY, True),
        (1.1 * VALLEY, 1.0, True),
        (0.0, 1.0, True),
        (1.0, 0.0, True),
        (0.0, 0.0, False),
    ],
)
def test_points_are_far_from_each_other_by_any_value(one: float, other: float, apart: bool) -> None:
    """A value may be 0, where its bound is."""
    assert far({"a": 2.0, "b": one}, {"a": 2.0, "b": other}, ["a", "b"]) is apart
