"""Learning from repetition: it converges as the bound says, and not where that says so."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.control import Learnt, Regulator, simulate_control, tune
from stickslip.control.loops import Loop, sampled_loop
from stickslip.physics.actuator import load_actuator
from stickslip.waveform import Sampled

KANG, BENT = load_actuator("kang2007"), load_actuator("kang2007-hysteresis")
RATE = 20e3
N = 2000
SHARE = np.clip((np.arange(N) / RATE - 0.02) / 0.02, 0.0, 1.0)
TARGET = 1e-6 * SHARE**3 * (10.0 - 15.0 * SHARE + 6.0 * SHARE**2)


@pytest.fixture(scope="module")
def loop() -> Loop:
    return sampled_loop(KANG, RATE, delay=0)


@pytest.fixture(scope="module")
def regulator() -> Regulator:
    tuning = tune(KANG, RATE)
    return tuning.regulator(RATE, min_voltage=-100.0, max_voltage=100.0, lead=tuning.lag)


def errors(made: Learnt, loop: Loop, target: np.ndarray) -> np.ndarray:
    """What is left over a run of the linear loop, tick by tick."""
    x, left = np.zeros(loop.b.size), np.empty(target.size)
    for k in range(target.size):
        position = float(loop.c @ x)
        left[k] = target[k] - position
        x = loop.a @ x + loop.b * made.step(position, float(target[k]), k)
    return left


def test_each_run_is_better_by_the_bound_at_least(regulator: Regulator, loop: Loop) -> None:
    made = Learnt(regulator, N, 0.5, lead=8, taps=101)
    worst = made.contraction(loop).max()
    assert 0.5 < worst < 0.7
    for _ in range(6):
        regulator.begin(0.0, 0.0)
        errors(made, loop, TARGET)
        made.learn()
    history = np.array(made.history)
    assert history[0] > 0.5e-9
    assert np.all(history[1:] <= 1.05 * worst * history[:-1])
    assert history[-1] < worst**5 * history[0]


def test_it_diverges_where_the_bound_is_above_one(regulator: Regulator, loop: Loop) -> None:
    made = Learnt(regulator, N, 0.8, lead=0, taps=101)
    assert made.contraction(loop).max() > 1.9
    assert made.contraction(loop, [370.0])[0] > 1.9
    for _ in range(8):
        regulator.begin(0.0, 0.0)
        errors(made, loop, TARGET)
        made.learn()
    assert made.history[-1] > 5.0 * min(made.history)


def test_each_frequency_falls_by_its_own_contraction(regulator: Regulator, loop: Loop) -> None:
    """The change from run to run, line by line of a long motion: that of the response, filter and all."""
    size = 4000
    made = Learnt(regulator, size, 0.5, lead=8, taps=21)
    time = np.arange(size) / RATE
    at = np.array([100.0, 200.0, 300.0, 400.0])  # ten periods of the lowest: its line is its own
    target = 1e-7 * np.hanning(size) * sum(np.sin(2.0 * np.pi * f * time) for f in at)
    runs = []
    for _ in range(4):
        regulator.begin(0.0, 0.0)
        runs.append(errors(made, loop, target))
        made.learn()
    lines = np.abs(np.fft.rfft(np.diff(runs, axis=0), axis=1))[:, (at * size / RATE).astype(int)]
    expected = made.contraction(loop, at)
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(lines[1:] / lines[:-1], [expected, expected], rtol=0.03)


def test_a_scan_with_hysteresis_and_creep_is_learnt_in_ten_periods() -> None:
    """5 um at 10 Hz, feedforward by the gain alone, 1 nm of noise: first it is off by 2.8 % of the range."""
    times = np.arange(11 * N) / RATE
    begun = np.minimum(times / 0.05, 1.0)
    scan = 1e-6 * (5.0 - 2.5 * np.cos(20.0 * np.pi * times)) * begun**2 * (3.0 - 2.0 * begun)
    tuning = tune(BENT, RATE)
    made = Learnt(
        tuning.regulator(RATE, max_voltage=150.0, lead=tuning.lag), N, lead=8, taps=101, periodic=True
    )
    found = simulate_control(BENT, made, Sampled(times, scan, unit="m"), 1.1, rate=RATE, noise="1 nm")
    off = (found["end_effector_position"] - found["target_position"]).values.reshape(11, N)
    worst = np.abs(off).max(axis=1) / 5e-6
    assert worst[0] > 0.02
    assert worst[-1] < 0.0005


def test_the_filter_has_no_phase(regulator: Regulator) -> None:
    """What is learnt of an error at one tick: around the tick that it is due to, even, its sum the gain."""
    made = Learnt(regulator, 200, 0.5, lead=7, taps=21)
    regulator.begin(0.0, 0.0)
    for tick in range(200):
        made.step(-1e-6 * (tick == 100), 0.0, tick)
    made.learn()
    np.testing.assert_allclose(made.correction[93 - 20 : 93], made.correction[94 : 94 + 20][::-1], atol=1e-20)
    assert made.correction.argmax() == 93
    assert made.correction.sum() == pytest.approx(0.5e-6)
