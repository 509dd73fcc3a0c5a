"""A sequence is its parts, one after the other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Chirp, Constant, Ramp, Rest, Step

PARTS = (
    Sawtooth(65, 5, periods=3),
    ReverseSawtooth(40, 7, 0.8, 2),
    Cycloid(10, 3, 0.7),
    Sine(5, 2, 1.0),
    Multisine([1, 2], [3, 4], duration=0.5),
    Chirp(3, 1, 9, 0.7),
    Step(4, 0.1),
    Ramp(9, 0.1, 0.2),
    Constant(3),
    Rest(0.2, 1),
    Sampled([0.1, 0.2, 0.5], [1, 4, 2]),
    Sequence(Rest(0.2), Sawtooth(8, 10, periods=2)),
)


@given(st.lists(st.tuples(st.sampled_from(PARTS), st.floats(0.01, 2)), min_size=1, max_size=6))
def test_concatenation(parts) -> None:
    w = Sequence(*parts)
    begin = 0.0
    for part, length in parts:
        inside = part.breaks(length)
        tau = np.linspace(0.001, 0.999, 57) * length
        tau = tau[
            np.abs(tau[:, None] - inside).min(axis=1) > 1e-9
        ]  # on which side of a jump, rounding decides
        np.testing.assert_allclose(w.value(begin + tau), part.value(tau), atol=1e-9)
        np.testing.assert_allclose(w.slope(begin + tau), part.slope(tau), atol=1e-7)
        found = w.breaks(begin + length)
        found = found[found >= begin * (1 - 1e-9)] - begin
        np.testing.assert_allclose(found, inside, atol=1e-9)
        begin += length
    assert w.duration == pytest.approx(begin)
    last, length = parts[-1]
    assert np.all(w.value([begin + 1e-6, begin + 100]) == last.value(length))
    assert np.all(w.slope([begin + 1e-6, begin + 100]) == 0)


def test_walk_there_and_back() -> None:
    w = Sequence(Sawtooth(65, 5, periods=8), Rest(0.5), ReverseSawtooth(65, 5, periods=8))
    assert (w.duration, w.range(), w.unit, w.period) == (pytest.approx(3.7), (0, 65), "V", None)
    breaks = w.breaks(5.0)
    expected = np.concatenate([np.arange(8) / 5, [1.6], 2.1 + np.arange(9) / 5])
    np.testing.assert_allclose(breaks, expected, rtol=1e-15)
    assert w == Sequence(Sawtooth(65, 5, periods=8), (Rest(0.5), 0.5), ReverseSawtooth(65, 5, periods=8))


def test_only_what_is_needed_is_tabulated() -> None:
    w = Sequence((Sawtooth(1, 10), 1.0), (Sawtooth(1, 1e9), 1e6))  # 1e15 periods fit into no memory
    assert len(w.breaks(1.0)) == 10
    assert len(w.breaks(1.0 + 5e-8)) == 60


def test_what_cannot_be_is_refused() -> None:
    for make, message in (
        (lambda: Sequence(), "no parts"),
        (lambda: Sequence(Rest(1), Sawtooth(65, 5)), r"parts\[1\] is an endless Sawtooth"),
        (lambda: Sequence((Sawtooth(65, 5), -1)), r"parts\[0\] duration = -1 s"),
        (lambda: Sequence((Sawtooth(65, 5), "1 V")), r"parts\[0\] duration = '1 V'.*expected s"),
        (lambda: Sequence(Rest(1), Rest(1, unit="m")), r"parts\[1\] is in m, the first part in V"),
        (lambda: Sequence(Rest(1), 0.5), r"parts\[1\] = 0.5 is neither"),  # type: ignore[arg-type]
        (lambda: Sequence((Rest(1), 1, 2)), r"is neither"),  # type: ignore[arg-type]
    ):
        with pytest.raises(QuantityError, match=message):
            make()
