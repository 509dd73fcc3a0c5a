"""Every waveform against its formula, written a second time, and break points worked out by hand."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import signal
from scipy.interpolate import PchipInterpolator

from stickslip.waveform.drive import evaluate, segment_at, value_slope_curvature
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine, Triangle
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Chirp, Constant, Ramp, Rest, Step

END = 2.0  # s; all cases are looked at on [0, END)
RANDOM = np.sort(np.random.default_rng(1).uniform(0, END, 4000))
TAU = 2 * np.pi

SAMPLE_TIMES = np.array([0.1, 0.15, 0.4, 1.0, 1.7])
SAMPLES = np.array([3.0, -2.0, 5.0, 5.5, 1.0])
AMPLITUDES, FREQUENCIES, PHASES = (np.array(x) for x in ([3.0, -1.0, 2.0], [2.0, 5.0, 7.0], [0.3, 1.0, -2.0]))

KNOT_TIMES = np.array([0.05, 0.1, 0.25, 0.3, 0.4])
KNOTS = np.array([2.0, 3.0, 40.0, 40.0, -7.0])
PERIOD = 0.5
KNOT_BREAKS = np.sort(np.add.outer(np.arange(4) * PERIOD, [0.0, *KNOT_TIMES]).ravel())


class Case(NamedTuple):
    name: str
    waveform: Any
    formula: Callable[[Any], Any]  # for t >= 0, not at a break
    breaks: Any  # s, in [0, END)
    curvature: float  # bound of |d²u/dt²| between the breaks
    before: float = 0.0


def scipy_sawtooth(t, frequency, width, offset, amplitude):
    return offset + amplitude * (1 + signal.sawtooth(TAU * frequency * t, width)) / 2


def cycloid(p):
    return p - np.sin(TAU * p) / TAU


def asymmetric_cycloid(t):
    p = np.mod(3 * t, 1)
    u = np.where(p < 0.75, cycloid(p / 0.75), 1 - cycloid((p - 0.75) / 0.25))
    return np.where(t < 4 / 3, 5 + 40 * u, 5.0)


def multisine(t):
    sines = np.sin(TAU * np.multiply.outer(t, FREQUENCIES) + PHASES) @ AMPLITUDES
    return np.where(t < 1.5, 1 + sines, 1)


def monotone(t):
    around = np.concatenate([KNOT_TIMES + k * PERIOD for k in (-2, -1, 0, 1, 2)])
    return PchipInterpolator(around, np.tile(KNOTS, 5))(np.mod(t, PERIOD))


def counted(curve, periods):
    return lambda t: np.where(t < periods * PERIOD, curve(t), curve(0.0))


def wrapped(t):
    return np.interp(t, KNOT_TIMES, KNOTS, period=PERIOD)


def there_and_back(t):
    forward = 65 * np.mod(5 * t, 1)
    back = 65 * (1 - np.mod(5 * (t - 1.1), 1))
    return np.select([t < 0.8, t < 1.1, t < 1.7], [forward, 0.0, back], 0.0)


CASES = (
    Case("constant", Constant(12), lambda t: 12 + 0 * t, [0], 0, 12),
    Case("rest", Rest(0.5, 3), lambda t: 3 + 0 * t, [0], 0, 3),
    Case("step", Step(60, 0.2, 5), lambda t: 5 + 60 * np.heaviside(t - 0.2, 1), [0, 0.2], 0, 5),
    Case("step at once", Step(-60), lambda t: -60 + 0 * t, [0], 0),
    Case("ramp", Ramp(10, 0.3, 0.9, 1), lambda t: 1 + 10 * np.clip(t - 0.3, 0, 0.9), [0, 0.3, 1.2], 0, 1),
    Case("endless ramp", Ramp(-4, 0.5), lambda t: -4 * np.maximum(t - 0.5, 0), [0, 0.5], 0),
    Case("sawtooth", Sawtooth(65, 5), lambda t: 65 * np.mod(5 * t, 1), np.arange(10) / 5, 0),
    Case(
        "sawtooth with a slope down", Sawtooth(65, 4, rise_fraction=0.8, offset=-10, periods=6),
        lambda t: np.where(t < 1.5, scipy_sawtooth(t, 4, 0.8, -10, 65), -10),
        np.sort(np.concatenate([np.arange(7) / 4, (np.arange(6) + 0.8) / 4])), 0, -10,
    ),
    Case("reverse", ReverseSawtooth(65, 5), lambda t: 65 * (1 - np.mod(5 * t, 1)), np.arange(10) / 5, 0),
    Case(
        "reverse with a slope up", ReverseSawtooth(-20, 3, fall_fraction=0.7, offset=4, periods=2),
        lambda t: np.where(t < 2 / 3, scipy_sawtooth(t, 3, 0.3, 4, -20), 4),
        np.array([0, 0.3, 1, 1.3, 2]) / 3, 0, 4,
    ),
    Case(
        "triangle", Triangle(30, 2, offset=1), lambda t: scipy_sawtooth(t, 2, 0.5, 1, 30), np.arange(8) / 4,
        0, 1,
    ),
    Case(
        "cycloid", Cycloid(80, 4), lambda t: 80 * cycloid(np.mod(4 * t, 1)), np.arange(8) / 4,
        80 * TAU * 4**2,
    ),
    Case(
        "asymmetric cycloid", Cycloid(40, 3, rise_fraction=0.75, offset=5, periods=4), asymmetric_cycloid,
        np.sort(np.concatenate([np.arange(5) / 3, (np.arange(4) + 0.75) / 3])), 40 * TAU * 12**2, 5,
    ),
    Case("sine", Sine(9, 3, offset=2), lambda t: 2 + 9 * np.sin(TAU * 3 * t), [0], 9 * (TAU * 3) ** 2, 2),
    Case(
        "burst", Sine(9, 4, phase="90 deg", periods=5),
        lambda t: np.where(t < 1.25, 9 * np.cos(TAU * 4 * t), 0), [0, 1.25], 9 * (TAU * 4) ** 2,
    ),
    Case(
        "multisine", Multisine(AMPLITUDES, FREQUENCIES, PHASES, offset=1, duration=1.5),
        multisine, [0, 1.5], 6 * (TAU * 7) ** 2, 1,
    ),
    Case(
        "chirp", Chirp(7, 1, 12, 1.6, offset=-1),
        lambda t: np.where(t < 1.6, -1 + 7 * signal.chirp(t, 1, 1.6, 12, phi=-90), -1), [0, 1.6],
        7 * (TAU * 12) ** 2 + 7 * TAU * 11 / 1.6, -1,
    ),
    Case(
        "sampled", Sampled(SAMPLE_TIMES, SAMPLES), lambda t: np.interp(t, SAMPLE_TIMES, SAMPLES),
        [0, *SAMPLE_TIMES], 0, 3,
    ),
    Case(
        "held", Sampled(SAMPLE_TIMES, SAMPLES, "hold"),
        lambda t: SAMPLES[np.maximum(np.searchsorted(SAMPLE_TIMES, t, side="right") - 1, 0)],
        [0, *SAMPLE_TIMES[1:]], 0, 3,  # the first sample is held before its time too
    ),
    Case("knots", PeriodicKnots(KNOT_TIMES, KNOTS, PERIOD), wrapped, KNOT_BREAKS, 0, wrapped(0)),
    Case(
        "smooth knots", PeriodicKnots(KNOT_TIMES, KNOTS, PERIOD, smooth=True, periods=3),
        counted(monotone, 3), KNOT_BREAKS[:19], 6e4, float(monotone(0)),
    ),
    Case("periodic samples", Sampled(KNOT_TIMES, KNOTS, period=PERIOD), wrapped, KNOT_BREAKS, 0, wrapped(0)),
    Case(
        "samples with a jump", Sampled([0, 0.2], [-5, 65], period=0.2), lambda t: -5 + 70 * np.mod(5 * t, 1),
        np.arange(10) / 5, 0, -5,
    ),
    Case(
        "held for ever", Sampled(KNOT_TIMES, KNOTS, "hold", period=PERIOD),
        lambda t: KNOTS[np.searchsorted(KNOT_TIMES, np.mod(t, PERIOD), side="right") - 1],
        np.delete(KNOT_BREAKS, [4, 10, 16, 22]), 0, -7,  # where nothing changes
    ),
    Case(
        "there and back", Sequence(Sawtooth(65, 5, periods=4), Rest(0.3), ReverseSawtooth(65, 5, periods=3)),
        there_and_back, [0, 0.2, 0.4, 0.6, 0.8, 1.1, 1.3, 1.5, 1.7], 0,
    ),
)  # fmt: skip

every = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name.replace(" ", "_"))
curved = [case for case in CASES if case.name in ("chirp", "multisine", "cycloid", "ramp", "smooth knots")]


def away_from_breaks(case: Case, t: np.ndarray, distance: float) -> np.ndarray:
    gaps = np.abs(t[:, None] - np.append(np.asarray(case.breaks, dtype=float), END))
    return t[gaps.min(axis=1) > distance]


@every
def test_values_follow_the_formula(case: Case) -> None:
    t = away_from_breaks(case, RANDOM, 1e-9)
    np.testing.assert_allclose(case.waveform.value(t), case.formula(t), rtol=0, atol=1e-10)


@every
def test_slopes_are_the_differences_of_values(case: Case) -> None:
    h = 1e-5
    t = away_from_breaks(case, RANDOM, 2 * h)
    difference = (case.formula(t + h) - case.formula(t - h)) / (2 * h)
    atol = 1e-6 + 1e-8 * case.curvature  # rounding, and h² u'''/6
    np.testing.assert_allclose(case.waveform.slope(t), difference, rtol=0, atol=atol)


@pytest.mark.parametrize("case", curved, ids=lambda case: case.name)
def test_curvature_is_the_difference_of_slopes(case: Case) -> None:
    h = 1e-6
    t = away_from_breaks(case, RANDOM[::100], 2 * h)
    drive = case.waveform.drive(END)
    segments = segment_at(drive, t)
    seen = [value_slope_curvature(drive, i, s)[2] for i, s in zip(segments, t, strict=True)]
    difference = (case.waveform.slope(t + h) - case.waveform.slope(t - h)) / (2 * h)
    np.testing.assert_allclose(seen, difference, rtol=1e-5, atol=1e-5 * (1 + case.curvature))


@every
def test_breaks_are_those_worked_out_by_hand(case: Case) -> None:
    np.testing.assert_allclose(case.waveform.breaks(END), case.breaks, rtol=1e-15, atol=0)


@every
def test_a_dense_scan_finds_no_other_jump_or_kink(case: Case) -> None:
    h = 1e-4
    t = h * (np.arange(round(END / h) - 1) + 0.4321)
    u = case.formula(t)
    kinked = np.abs(u[2:] - 2 * u[1:-1] + u[:-2]) > 1.1 * case.curvature * h**2 + 1e-9
    breaks = case.waveform.breaks(END)
    last_break = breaks[np.searchsorted(breaks, t[2:][kinked], side="right") - 1]
    assert np.all(last_break >= t[:-2][kinked])  # it lies between the three points that show a kink
    if len(case.breaks) > 2 and not case.curvature:
        assert np.count_nonzero(kinked) >= len(case.breaks) - 2  # the scan sees something


@every
def test_values_at_breaks_before_the_start_of_any_shape_and_sent_to_another_process(case: Case) -> None:
    waveform = case.waveform
    breaks = np.array(case.breaks, dtype=float)
    after = case.formula(breaks + 1e-9)
    np.testing.assert_allclose(waveform.value(breaks), after, rtol=0, atol=1e-5)
    np.testing.assert_allclose(waveform.value(breaks[-1]), after[-1], rtol=0, atol=1e-5)
    assert waveform.value(-0.1) == pytest.approx(case.before, rel=1e-14, abs=0)
    assert waveform.slope(-0.1) == 0
    t = RANDOM[:6]
    assert np.array_equal(waveform.value(t.reshape(2, 3)), waveform.value(t).reshape(2, 3))
    assert np.ndim(waveform.value(0.7)) == 0
    assert waveform.slope(t[:0]).shape == (0,)
    assert np.array_equal(pickle.loads(pickle.dumps(waveform)).value(RANDOM), waveform.value(RANDOM))


@every
def test_range_is_tight(case: Case) -> None:
    low, high = case.waveform.range()
    if case.name == "endless ramp":
        assert (low, high) == (-np.inf, 0)
        return
    t = np.linspace(1e-9, END, 200_003)
    values = np.append(case.formula(t), case.before)
    # the scan may stop one grid step short of a crest or of a jump
    assert low - 1e-9 <= values.min() <= low + 0.01
    assert high + 1e-9 >= values.max() >= high - 0.01


@every
def test_a_drive_shows_the_same_for_any_duration(case: Case) -> None:
    for duration in (0.0, 0.13, 0.8, 1.1):
        t = RANDOM[duration > RANDOM]
        drive = case.waveform.drive(duration)
        assert drive.before == pytest.approx(case.before, rel=1e-14, abs=0)
        assert drive.start[0] == 0
        assert np.array_equal(evaluate(drive, t)[0], case.waveform.value(t))
