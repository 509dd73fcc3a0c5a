"""Loops with narrow resonances, long delays and slow ticks: margins against responses of one's own."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from scipy.linalg import expm

from stickslip.control import LowPass, MarginError, Notch, Pid, Regulator, Tuning, check_margins, tune
from stickslip.control.loops import OpenLoop, closed_loop, sampled_loop
from stickslip.control.tuning import margins
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.simulation.sticking import sticking

KANG = load_actuator("kang2007")
RATE = 20e3
LIGHT = KANG.replace(damping_ratio=0.002, friction=KANG.friction._replace(sigma_1=2.0))
WIDE = {"min_voltage": -1e9, "max_voltage": 1e9}


def truth(model: Actuator, regulator: Regulator, delay: int = 1) -> tuple[float, float]:
    """Greatest sensitivity and phase margin [rad]: 40 001 frequencies about each mode, and as many again
    where it is nearest to -1."""
    a, b, c = sticking(model)
    n = b.size
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a / RATE, b / RATE
    step = expm(whole)
    modes = [abs(p) / (2.0 * math.pi) for p in np.linalg.eigvals(a) if p.imag > 0.0]
    near = [f * (1.0 + np.linspace(-0.05, 0.05, 40_001)) for f in modes]
    f = np.sort(np.concatenate([np.geomspace(1.0, 9980.0, 20_000), *near]))

    def response(f: np.ndarray) -> np.ndarray:
        z = np.exp(2j * math.pi * f / RATE)
        into = step[:n, n].astype(complex)[:, None]
        inverse = np.linalg.solve(z[:, None, None] * np.eye(n) - step[:n, :n], into)
        return (inverse[:, :, 0] @ c) / z**delay * regulator.response(f)

    loop = response(f)
    crossed = np.flatnonzero(np.diff(np.sign(np.log(np.abs(loop)))))
    k = int(np.argmin(np.abs(1.0 + loop)))
    nearest = np.abs(1.0 + response(np.linspace(f[k - 1], f[k + 1], 40_001))).min()
    return float(1.0 / nearest), float(np.abs(np.angle(-loop[crossed])).min(initial=math.pi))


def test_a_narrow_resonance_is_not_missed() -> None:
    """Between two frequencies of a scale of 1200 lies all of it: 1.14 and 90 degrees were read there."""
    model = LIGHT.replace(natural_frequency=0.825 * KANG.natural_frequency)
    regulator = Regulator(Pid(4.03e7), RATE, **WIDE)
    with pytest.raises(MarginError, match=r"greatest sensitivity is .*phase margin is"):
        check_margins(regulator, model)
    found = margins(regulator, [sampled_loop(model, RATE)])
    sensitivity, phase = truth(model, regulator)
    assert sensitivity > 500.0
    assert found.sensitivity == pytest.approx(sensitivity, rel=0.01)
    assert found.phase_margin == pytest.approx(phase, abs=0.002)


@pytest.mark.parametrize("share", [0.8])
def test_a_tuned_loop_keeps_the_margins_that_it_tells(share: float) -> None:
    """Of a lightly damped stage: 38.7 degrees where 45.1 were told."""
    model = LIGHT.replace(natural_frequency=share * KANG.natural_frequency)
    made = tune(model, RATE)
    sensitivity, phase = truth(model, made.regulator(RATE))
    assert made.margins.sensitivity == pytest.approx(sensitivity, rel=1e-3)
    assert made.margins.phase_margin == pytest.approx(phase, abs=0.003)
    assert math.degrees(phase) > 44.8


def test_an_undamped_mode_has_margins_too() -> None:
    free = KANG.replace(damping_ratio=0.0, friction=KANG.friction._replace(sigma_1=0.0))
    found = margins(Regulator(Pid(1e7), RATE, **WIDE), [sampled_loop(free, RATE)])
    assert not found.stable  # an integrator alone sets it swinging
    assert math.isfinite(found.sensitivity)


def test_a_narrow_notch_of_the_regulator_is_not_missed() -> None:
    """It turns the phase by 90 degrees within 20 mHz, where the loop has a gain near 1."""
    model, narrow = KANG, Notch(80.0, 1e-4, 0.3)
    regulator = Regulator(Pid(5e9), RATE, notches=(narrow,), **WIDE)
    found = margins(regulator, [sampled_loop(model, RATE)])
    f = 80.0 * (1.0 + np.linspace(-0.01, 0.01, 40_001))
    loop = regulator.response(f) * sampled_loop(model, RATE).at(f)
    assert found.sensitivity >= float(np.max(1.0 / np.abs(1.0 + loop))) * (1.0 - 1e-3)


def test_the_turns_of_a_response_tell_what_the_poles_do() -> None:
    """By both, on two hundred loops: PID, filters, undamped modes, delays up to 30 ticks."""
    random = np.random.default_rng(0)
    pick, spread = random.choice, lambda low, high: math.exp(random.uniform(low, high))
    told = []
    for _ in range(60):
        model = KANG.replace(
            natural_frequency=KANG.natural_frequency * spread(-2, 2),
            damping_ratio=float(pick([0.0, 1e-4, 0.01, 0.5, 1.0])),
            friction=KANG.friction._replace(sigma_1=float(pick([0.0, 0.1, 30.0]))),
        )
        rate = float(pick([300.0, 2e3, 20e3]))
        loop = sampled_loop(model, rate, delay=int(random.integers(0, 30)))
        for _ in range(4):
            integral = spread(11, 25) * pick([0, 1], p=[0.1, 0.9])
            others = spread(10, 18) * pick([0, 1]), spread(3, 12) * pick([0, 1])
            pid = Pid(integral, *others, min(1e3, 0.3 * rate))
            if not any(pid[:3]):
                continue
            filters = {
                "notches": (Notch(0.1 * rate, 0.01),) if random.random() < 0.5 else (),
                "low_pass": LowPass(0.2 * rate) if random.random() < 0.5 else None,
            }
            opened = OpenLoop.of(Regulator(pid, rate, **filters), loop)
            told.append((opened.stable(), opened._turns(1.0)))
    assert all(by_poles == by_turns for by_poles, by_turns in told)
    assert 0.2 < np.mean(told) < 0.8, "both kinds are among them"


def test_a_proportional_regulator_can_be_stable() -> None:
    """Its integral, which nothing changes, is no pole of the loop."""
    found = check_margins(Regulator(Pid(0.0, 1e6), RATE, **WIDE), KANG)
    assert found.stable


@pytest.mark.parametrize("delay", [60, 300])
def test_a_long_delay_is_tuned(delay: int) -> None:
    """Against a plain delay, which it nearly is: the gain goes as one over it; and by its poles."""
    made = tune(KANG, RATE, delay=delay)
    assert made.margins.sensitivity == pytest.approx(1.7, rel=0.01)
    late = delay / RATE + 1.5 / (2.0 * KANG.natural_frequency)
    assert made.pid.integral * KANG.gain * late == pytest.approx(0.55, abs=0.1)
    regulator = made.regulator(RATE, **WIDE)
    opened = OpenLoop.of(regulator, sampled_loop(KANG, RATE, delay=delay))
    at = margins(regulator, [opened.loop]).gain_margin
    if delay == 60:
        for factor, stable in ((0.99 * at, True), (1.01 * at, False)):
            assert opened.stable(factor) == stable
            radius = np.abs(np.linalg.eigvals(closed(made.pid.integral * factor, made, delay))).max()
            assert (radius < 1.0) == stable


def closed(gain: float, made: Tuning, delay: int) -> np.ndarray:
    regulator = Regulator(Pid(gain), RATE, notches=made.notches, low_pass=made.low_pass, **WIDE)
    return closed_loop(regulator, sampled_loop(KANG, RATE, delay=delay))[0]


def test_a_loop_that_is_slow_against_its_stage_is_a_plain_integral() -> None:
    quick = partial(KANG.replace, natural_frequency="20 kHz", stage_mass=0.01, end_effector_mass=0.002)
    stiff = quick(friction=KANG.friction._replace(sigma_0=2e7, sigma_1=100.0))
    for model, rate in ((stiff, 5e3), (KANG, 200.0)):
        made = tune(model, rate)
        assert made.notches == ()
        assert made.low_pass is None
        # L = k / (z² - z) of a stage that follows within a tick; M_S of 1.7 at k = 0.35 to 0.4.
        assert made.pid.integral * model.gain / rate == pytest.approx(0.37, abs=0.05)
        assert check_margins(made.regulator(rate), model).stable


def test_ticks_without_a_delay_have_their_gain_margin_at_half_the_rate() -> None:
    """L = k / (z - 1) of a stage that follows at once is -k/2 there, and goes no further."""
    slow = 20.0
    gain = 0.5 * slow / KANG.gain
    found = margins(Regulator(Pid(gain), slow, **WIDE), [sampled_loop(KANG, slow, delay=0)])
    assert found.gain_margin == pytest.approx(4.0, rel=0.01)
    assert found.sensitivity == pytest.approx(1.0 / (1.0 - 0.25), rel=0.01)
