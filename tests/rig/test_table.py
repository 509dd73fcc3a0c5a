"""Tables that begin and end at 0 V, their fading out, and what oscilloscopes' preambles mean."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip.quantities.units import QuantityError
from stickslip.rig import Capabilities, RigError
from stickslip.rig.devices.scpi.oscilloscopes import INFINIIVISION, RIGOL, TEKTRONIX, Preamble
from stickslip.rig.table import (
    check_inputs,
    check_positive,
    check_ready,
    fade_out,
    held,
    with_ramp,
    within,
)

CAN = Capabilities("it", 1e3, 1e3, -10.0, 10.0, 0.1, 100, {"drive": "V"})


WFMO = ("WFMO:XIN?", "WFMO:XZE?", "WFMO:YMU?", "WFMO:YOF?", "WFMO:YZE?")


class Time:
    """Time that goes on by sleeping."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now += seconds


def test_a_table_begins_and_ends_at_zero() -> None:
    table = with_ramp(np.array([5.0, 10.0]), 1000.0, 1000.0)
    np.testing.assert_allclose(table, [0, 5, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0], atol=1e-12)
    assert with_ramp(np.array([-3.0]), 1e9, 1000.0).tolist() == [0.0, -3.0, 0.0]


@pytest.mark.parametrize(
    ("greatest", "slew", "takes"), [(80.0, 400.0, 0.2), (80.0, 1.0, 10.0), (-0.0, 5.0, 0.0)]
)
def test_the_amplitude_goes_down_evenly_at_that_slew(
    greatest: float, slew: float, takes: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, shares = Time(), list[float]()
    monkeypatch.setattr("stickslip.rig.table.time", clock)
    fade_out(shares.append, greatest, slew, ends=1000.0)
    assert clock.now - 100.0 == pytest.approx(takes)
    assert shares[-1] == 0.0
    assert np.diff([1.0, *shares]) == pytest.approx(-1.0 / len(shares))
    assert len(shares) == min(max(round(takes / 0.02), 1), 100)


@pytest.mark.parametrize(("ends", "waits"), [(100.1, 0.1), (90.0, 0.0)])
def test_a_table_that_is_at_its_ramp_or_over_is_left_alone(
    ends: float, waits: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, shares = Time(), list[float]()
    monkeypatch.setattr("stickslip.rig.table.time", clock)
    fade_out(shares.append, 80.0, 400.0, ends)
    assert shares == []
    assert clock.now - 100.0 == pytest.approx(waits)


def test_what_cannot_be_put_out_or_recorded() -> None:
    within("it", np.array([-10.0, 10.0]), -10.0, 10.0, 2)
    for values, low, high, points in (([11.0], -10, 10, 9), ([-11.0], -10, 10, 9), ([np.nan], -10, 10, 9)):
        with pytest.raises(RigError, match="finite and within -10 to 10 V"):
            within("it", np.array(values), low, high, points)
    with pytest.raises(RigError, match="have 3 values; 2 are possible"):
        within("it", np.zeros(3), -10.0, 10.0, 2)
    check_inputs(CAN, ("drive",), 100)
    with pytest.raises(RigError, match="no input 'nose'; there are drive"):
        check_inputs(CAN, ("nose",), 100)
    for samples in (0, 101):
        with pytest.raises(RigError, match=f"{samples} samples are not 1 to 100"):
            check_inputs(CAN, ("drive",), samples)


class Link:
    """Answers as a guide's examples do."""

    name = "it"

    def __init__(self, answers: dict[str, str]) -> None:
        self.answers = answers

    def ask(self, query: str) -> str:
        return self.answers[query]

    def number(self, query: str) -> float:
        return float(self.answers[query])


@pytest.mark.parametrize(
    ("table", "answers", "number", "volts", "begin"),
    [
        # V = (number - yreference) yincrement + yorigin; t = (i - xreference) xincrement + xorigin
        (INFINIIVISION, {":WAV:PRE?": "1,0,5,1,1e-3,0.25,2,0.01,1.5,100"}, 130.0, 1.8, 0.248),
        # V = (number - yorigin - yreference) yincrement; t as above
        (RIGOL, {":WAV:PRE?": "0,0,5,1,1e-3,0.25,2,0.01,15,100"}, 130.0, 0.15, 0.248),
        # V = (number - YOFF) YMULT + YZERO; t = XZERO + i XINCR
        (
            TEKTRONIX,
            dict(zip(WFMO, ("1e-3", "0.25", "0.01", "100", "1.5"), strict=True)),
            130.0, 1.8, 0.25,
        ),
    ],
)  # fmt: skip
def test_numbers_become_volts_as_the_guides_say(
    table: Any, answers: dict[str, str], number: float, volts: float, begin: float
) -> None:
    found: Preamble = table.preamble(Link(answers))
    assert found.zero + found.unit * number == pytest.approx(volts)
    assert found.begin == pytest.approx(begin)
    assert found.tick == 1e-3


def test_a_drive_is_held_at_its_last_value() -> None:
    assert held(np.array([1.0, 2.0, 3.0]), 5).tolist() == [1.0, 2.0, 3.0, 3.0, 3.0]
    assert held(np.array([1.0, 2.0, 3.0]), 2).tolist() == [1.0, 2.0]


def test_a_run_needs_a_drive_and_inputs() -> None:
    check_ready(CAN, np.ones(2), 1)
    for volts, samples in ((np.zeros(0), 1), (np.ones(2), 0)):
        with pytest.raises(RigError, match="it: start needs a drive"):
            check_ready(CAN, volts, samples)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_options_are_above_zero(wrong: float) -> None:
    check_positive(gain=1e-9)
    with pytest.raises(QuantityError, match=f"rate = {wrong} must be > 0"):
        check_positive(gain=1.0, rate=wrong)
