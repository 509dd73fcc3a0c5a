"""The table that a timer plays: each of its lines within the tolerance, and none that could go on."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from stickslip import load_actuator
from stickslip.export import export_c
from stickslip.export.table import _lines, played
from stickslip.quantities.units import QuantityError
from stickslip.waveform import Chirp, PeriodicKnots, Sampled, Sawtooth, Sequence, Sine, Waveform
from stickslip.waveform.drive import evaluate

H = 1e-4
RANDOM = np.random.default_rng(5)
NOISE = RANDOM.normal(size=60).cumsum()
WAVEFORMS: dict[str, Waveform] = {
    "sawtooth": Sawtooth(65.0, 21.3, 0.9, periods=4),
    "sine": Sine(30.0, 13.0, offset=30.0, periods=2),
    "trapezoid": PeriodicKnots((0.0, 5e-3, 25e-3, 30e-3), (0.0, 8.0, 8.0, 0.0), 50e-3),
    "chirp": Chirp(1.0, 2.0, 90.0, 0.08, offset=3.0),
    "linear samples": Sampled(np.arange(60) * 3.7e-4, NOISE),
    "held samples": Sampled(np.arange(60) * 4e-4, np.round(NOISE), "hold"),
    "a motion of nanometres": Sine(1e-9, 40.0, offset=5e-6, periods=2, unit="m"),
    "a sequence": Sequence(Sawtooth(5.0, 100.0, 1.0, periods=2), Sine(1.0, 60.0, periods=1)),
}


def values(waveform: Waveform, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each step, at its begin and its end."""
    table, at = waveform.drive(count * H), np.arange(count + 1) * H
    return evaluate(table, at[:-1] + 1e-11)[0], evaluate(table, at[1:] - 1e-11)[0]


def off(begin: np.ndarray, end: np.ndarray) -> float:
    """How far one line is from the values of its steps, by definition."""
    line = begin[0] + np.arange(begin.size + 1) / begin.size * (end[-1] - begin[0])
    return float(max(np.max(np.abs(line[:-1] - begin)), np.max(np.abs(line[1:] - end))))


@pytest.mark.parametrize("share", [1e-5, 2e-2])
@pytest.mark.parametrize("case", WAVEFORMS)
def test_a_line_is_near_to_all_its_steps_and_no_longer_one_is(case: str, share: float) -> None:
    """All longer ones are tried, one by one."""
    low, high = WAVEFORMS[case].range()
    tolerance = share * (high - low)
    begin, end = values(WAVEFORMS[case], 300)
    first = 0
    for line in _lines(begin, end, tolerance):
        last = first + line.steps
        assert (line.begin, line.end) == (begin[first], end[last - 1])
        assert off(begin[first:last], end[first:last]) <= tolerance * (1.0 + 1e-9)
        longer = [off(begin[first:other], end[first:other]) for other in range(last + 1, begin.size + 1)]
        assert not longer or min(longer) > tolerance * (1.0 - 1e-9)
        first = last
    assert first == begin.size


def test_a_long_line_is_one() -> None:
    """Longer than the parts in which it is looked for; up to a steep step."""
    count = 300_000
    value = np.arange(count + 1) * 1e-3
    assert _lines(value[:-1], value[1:], 1e-6) == [(count, 0.0, value[-1])]
    value[200_001:] += 10.0
    assert [line.steps for line in _lines(value[:-1], value[1:], 1e-6)] == [200_000, 1, 99_999]


def test_a_constant_is_one_line() -> None:
    assert played(Sine(0.0, 5.0, offset=30.0, periods=1), H, None).lines == [(2000, 30.0, 30.0)]


def test_too_many_lines_are_refused_before_all_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    monkeypatch.setattr(
        "stickslip.export.table.TableLine",
        lambda *line: made.append(line) or type("", (), {"steps": line[0]}),
    )
    noise = Sampled(np.arange(200_001) * H, RANDOM.normal(size=200_001))
    with pytest.raises(QuantityError, match=r"motion = .* more than 20000 lines .* 2\.\d+ s of 20 s: give"):
        played(noise, H, None, name="motion")
    assert len(made) < 30_000


@pytest.mark.parametrize("h", [1e-6, 13.7e-6, 1e-4 / 7.0, 1.0 / 30030.0, 1.1e-3, 0.3, 1.0])
def test_the_default_motion_fits_any_step(h: float, tmp_path: Any) -> None:
    """One period of about 0.1 s in whole steps, where four that do not repeat would be too many lines."""
    export_c(load_actuator("kang2007"), tmp_path / "c", step=h, duration=3.0)
    text = (tmp_path / "c" / "stickslip_motion.h").read_text()
    steps = sum(int(number) for number in re.findall(r"\{(\d+)L,", text))
    assert "REPEATS 4L" in text
    assert steps == max(round(0.1 / h), 20)
