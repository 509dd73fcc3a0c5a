"""Sampled elements: when they are due, and what a tick changes."""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest

from stickslip._jit import compiled
from stickslip.friction import register
from stickslip.plant import generated
from stickslip.plant.system import Element, Mode, Plant


class Counter(NamedTuple):
    """Adds what it sees, `gain` times, at each tick."""

    gain: float
    period: float


def counting(law, v, z):
    return z, 0.0


def counted(law, v, z):
    return z + law.gain * v


register(Counter, counting, tick=counted, smooth=True)

PLANT = Plant(
    (Mode(1e6, 10.0, 0.0, 0.0), Mode(2e6, 10.0, 0.0, 0.0)),
    (
        Element(Counter(2.0, 0.01), (3.0, 0.5), (None, None), drive=0.5, position=(-7.0, 1.5)),
        Element(Counter(-1.0, 0.004), (None, None), (1.0, None), drive_rate=0.25),
    ),
    1e3,
)
Q, U = (0.2, 0.3, 0.7, -0.4, 10.0, 20.0), (4.0, 6.0, 0.0, 0.0)


@compiled
def next_tick(plant, t):
    return generated.next_tick(plant, t)


@compiled
def ticked(plant, q, u, t):
    return generated.ticked(plant, q, u, t)


@compiled
def sampled(plant):
    return generated.sampled(plant), generated.moves_freely(plant)


@pytest.mark.parametrize(
    ("t", "at"), [(0.0, 0.004), (0.004, 0.008), (0.008, 0.01), (0.0099, 0.01), (0.01, 0.012), (0.0163, 0.02)]
)
def test_the_next_tick_is_that_of_the_first_that_is_due(t: float, at: float) -> None:
    assert next_tick(PLANT, t) == pytest.approx(at, rel=1e-12)


def test_only_what_is_due_ticks() -> None:
    first = 10.0 + 2.0 * (3.0 * 0.3 - 0.5 * 0.4 - 7.0 * 0.2 + 1.5 * 0.7 + 0.5 * 4.0)
    second = 20.0 - 0.25 * 6.0
    assert ticked(PLANT, Q, U, 0.0) == pytest.approx((*Q[:4], first, second))
    assert ticked(PLANT, Q, U, 0.01) == pytest.approx((*Q[:4], first, 20.0))
    assert ticked(PLANT, Q, U, 0.012) == pytest.approx((*Q[:4], 10.0, second))
    assert ticked(PLANT, Q, U, 0.013) == Q
    assert ticked(PLANT, Q, U, 0.02) == pytest.approx((*Q[:4], first, second))


def test_a_plant_without_ticks() -> None:
    plant = PLANT._replace(elements=())
    assert next_tick(plant, 0.3) == math.inf
    assert ticked(plant, Q[:4], U, 0.0) == Q[:4]
    assert sampled(plant) == (False, False)
    assert sampled(PLANT) == (True, False)
    assert sampled(Plant((Mode(0.0, 0.0, 0.0, 0.0),), (), 1.0)) == (False, True)
    # A sampled controller may look where the body is: nothing repeats further on.
    assert sampled(
        Plant((Mode(0.0, 0.0, 0.0, 0.0),), (Element(Counter(1.0, 1.0), (1.0,), (1.0,)),), 1.0)
    ) == (True, False)
