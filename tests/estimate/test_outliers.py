"""Spikes are counted and said; noise of any kind, and slow misfit, are none."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.disturbed import with_disturbances
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.lack import KnownNoise
from stickslip.estimate.outliers import spikes as places
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals

from .test_lack import N, noise


@pytest.mark.parametrize("kind", ["white", "correlated", "filtered", "drifting", "rounded"])
def test_spikes_are_counted_in_noise_that_has_none(kind: str) -> None:
    random, step = np.random.default_rng(5), 1.0 if kind == "rounded" else 0.0
    for spikes in (0, 1, 7):
        for _ in range(5):
            r = noise(kind, random)
            apart = 20 * random.choice(N // 20, spikes, replace=False)
            r[apart] += 40.0 * random.choice([-1.0, 1.0], spikes)
            assert places(r, step).size == spikes


def test_slow_misfit_and_long_tails_are_no_spikes() -> None:
    random = np.random.default_rng(6)
    slow = noise("white", random) + 50.0 * np.sin(np.linspace(0.0, 60.0, N))
    assert places(slow).size == 0
    assert places(random.standard_t(1.0, N)).size == 0
    assert places(np.zeros(N)).size == 0


@pytest.mark.parametrize(("spikes", "said"), [([300], "a has a spike of"), ([300, 900], "a has 2 spikes of")])
def test_a_fit_says_which_recording_has_them(spikes: list[int], said: str) -> None:
    random = np.random.default_rng(7)
    clean, spiky = 3.0 + noise("white", random), 3.0 + noise("white", random)
    spiky[spikes] += 40.0
    time = np.arange(float(N))
    parts = [
        Residuals(lambda v, y=y: v["level"] - y, y, None, name, "m", KnownNoise(at_rest=200), time)
        for name, y in (("a", spiky), ("b", clean))
    ]
    fit = fit_least_squares(parts, [Parameter("level", 1.0, -9.0, 9.0, "m", log=False)])
    (sentence,) = (*(found := with_disturbances(fit)).doubts, *found.remarks)
    assert said in sentence
