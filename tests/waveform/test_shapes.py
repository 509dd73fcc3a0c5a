"""Single-shot waveforms and multisines: what the contract over all waveforms does not show."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.shapes import Chirp, Constant, Ramp, Rest, Step


def test_durations() -> None:
    assert Constant(1).duration == Step(1).duration == Ramp(1).duration == np.inf
    assert Rest(0.5).duration == 0.5
    assert Ramp(1, delay=0.25, rise_time=0.5).duration == 0.75
    assert Chirp(1, 1, 2, 3).duration == 3
    endless = Constant(1), Step(1), Ramp(1), Rest(1), Chirp(1, 1, 2, 3)
    assert {one.period for one in endless} == {None}


def test_range_of_a_short_chirp() -> None:
    t = np.linspace(0, 1, 200_001)[:-1]
    for cycles in (0.1, 0.25, 0.4, 0.6, 0.75, 0.9, 1.1, 5.3):
        for amplitude in (4.0, -4.0):
            u = 1 + amplitude * np.sin(2 * np.pi * cycles * t**2)
            found = Chirp(amplitude, 0, 2 * cycles, 1.0, offset=1).range()
            assert found == pytest.approx((u.min(), u.max()), abs=1e-3)


def test_common_period_of_a_multisine() -> None:
    assert Multisine([1, 1], [2, 5]).period == pytest.approx(1)
    assert Multisine([1, 1, 1], [1.5, 2.5, 10]).period == pytest.approx(2)
    assert Multisine(np.ones(20), np.arange(1, 21) * 0.1).period == pytest.approx(10)  # 0.1 x 3 is not 0.3
    assert Multisine([1, 1], [1, 2**0.5]).period is None
    assert Multisine([1], [4]).period == 0.25


@given(
    st.lists(st.tuples(st.floats(-5, 5), st.integers(1, 12), st.floats(-4, 4)), min_size=1, max_size=6),
    st.floats(0.01, 1e3),
)
@example([(2.0, 4, 3.0), (3.0, 1, -2.0)], 1.0)  # the highest grid point lies beside the second-highest crest
def test_multisine_range_is_its_crest(components, base: float) -> None:
    a, n, phase = (np.array(x) for x in zip(*components, strict=True))
    low, high = Multisine(a, n * base, phase).range()
    p = np.linspace(0, 1, 20_001)[:, None]  # of a period
    u = np.append(np.sin(2 * np.pi * n * p + phase) @ a, 0.0)
    short = (
        np.sum(np.abs(a) * n**2) * (2 * np.pi / 20_000) ** 2 / 8 + 1e-9
    )  # the grid falls short by this at most
    assert u.max() - 1e-9 <= high <= u.max() + short
    assert u.min() + 1e-9 >= low >= u.min() - short


def test_multisine_without_a_period_has_the_safe_bound() -> None:
    assert Multisine([1, -2], [1, 2**0.5], offset=3).range() == (0, 6)
    low, high = Multisine([1, 1], [1, 2**0.5], [0, 0], duration=0.1).range()
    assert low == 0  # it ends before the first crest: looked at as far as it goes
    assert high == pytest.approx(np.sin(0.2 * np.pi) + np.sin(0.2 * np.pi * 2**0.5))


def test_schroeder_phases_lower_the_crest() -> None:
    k = np.arange(1, 65)
    w = Multisine(np.ones(64), k)
    t = np.arange(64 * 64) / (64 * 64)
    closed_form = np.cos(2 * np.pi * np.multiply.outer(t, k) - np.pi * k * (k - 1) / 64).sum(axis=1)
    np.testing.assert_allclose(w.value(t), closed_form, atol=1e-9)
    crest_factor = max(np.abs(w.range())) / np.sqrt(64 / 2)
    assert crest_factor < 1.8  # with equal phases: sqrt(2 x 64) = 11.3


def test_multisine_refuses() -> None:
    for make, message in (
        (lambda: Multisine([1, 2], [1]), "amplitudes has 2 numbers for 1 frequencies"),
        (lambda: Multisine([1], [1], [1, 2]), "phases has 2 numbers"),
        (lambda: Multisine([], []), "frequencies is empty"),
    ):
        with pytest.raises(QuantityError, match=message):
            make()
