"""Overdamped stages seen through a lag: nothing tells which of three real poles is the lag's."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss

GAIN, VOLTS, HERTZ = 2e-8, 60.0, 5e3


def step(seed: int, level: float = 0.0) -> tuple[ss.Fit, dict[str, float]]:
    """The fit of a step to a stage with two real poles, and the truth; a converter's level is a share of the
    stroke."""
    random = np.random.default_rng(seed)
    zeta, omega, lag = random.uniform(1.05, 2.0), 2.0 * np.pi * HERTZ, random.uniform(0.3, 1.2) / 3e4
    root = np.sqrt(zeta**2 - 1.0)
    poles = np.array([omega * (zeta - root), omega * (zeta + root), 1.0 / lag])
    time = np.arange(2000) / (60.0 * HERTZ)
    since = np.clip(time - time[300] - 7.3e-6, 0.0, None)
    shares = [np.prod([q / (q - p) for q in poles if q != p]) for p in poles]
    response = 1.0 - sum(c * np.exp(-p * since) for c, p in zip(shares, poles, strict=True))
    position = GAIN * VOLTS * (response + 2e-4 * random.standard_normal(time.size) * (level == 0.0))
    if level:
        position = np.round(position / (level * GAIN * VOLTS)) * level * GAIN * VOLTS
    drive = np.where(np.arange(time.size) >= 300, VOLTS, 0.0)
    fit = ss.identify_step(
        ss.make_recording(time, {"end_effector_position": position, "drive_voltage": drive})
    )
    return fit, {"damping_ratio": zeta, "natural_frequency": omega, "lag": lag, "delay": 7.3e-6 + lag}


def test_the_intervals_hold_all_that_the_same_response_may_be() -> None:
    """Before, they held the lag's pole alone where the search had put it: 36 of 40 missed."""
    missed = 0
    for seed in range(3):
        fit, true = step(seed)
        ends = fit.confidence_intervals()
        missed += sum(not ends[name][0] <= value <= ends[name][1] for name, value in true.items())
        assert "fit as well" in fit.other_minima or "fits as well" in fit.other_minima
        assert not fit.doubt
    assert missed <= 1  # of 12


@pytest.mark.parametrize("level", [0.01, 0.05])
def test_a_stage_that_settles_at_a_converters_level_is_not_taken_for_a_clipped_sensor(level: float) -> None:
    for seed in range(1):
        assert step(seed, level)[0].values["gain"] == pytest.approx(GAIN, rel=level)
