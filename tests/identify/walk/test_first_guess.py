"""Where searches begin."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from benchmarks.coverage import (
    BOUNDS,
    FREE,
    LOW_PASS,
    PRE_TRIGGER,
    clean_chain,
    example,
    noisy,
    random_truth,
    truths,
)

from stickslip.identify.step.fit import identify_step
from stickslip.identify.walk.first_guess import APART, far
from stickslip.identify.walk.friction import identify_friction
from stickslip.recording import RecordingWarning


@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        (1.0, 0.9 * APART, False),
        (1.0, 1.1 * APART, True),
        (1.1 * APART, 1.0, True),
        (0.0, 1.0, True),
        (1.0, 0.0, True),
        (0.0, 0.0, False),
    ],
)
def test_points_are_far_from_each_other_by_any_value(one: float, other: float, apart: bool) -> None:
    """A value may be 0, where its bound is."""
    assert far({"a": 2.0, "b": one}, {"a": 2.0, "b": other}, ["a", "b"]) is apart


def test_a_fit_that_does_not_explain_its_walk_begins_again_from_everywhere() -> None:
    """All that describes the first periods best is of one kind: a slider that follows its stage late."""
    chain, random = clean_chain(random_truth(130)), np.random.default_rng(130)
    slew = chain.bench.amplifier.max_current / chain.bench.piezo_capacitance
    steps = [noisy(chain, one, 1, 0.2, random) for one in chain.steps]
    stage = identify_step(steps, example(), filter=LOW_PASS, slew_rate=slew)
    walk = noisy(chain, chain.walks[0], 20, PRE_TRIGGER, random)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        fit = identify_friction(walk, stage.model, FREE, slew_rate=slew, stage=stage, bounds=BOUNDS)
    assert not any(one.seen for one in fit.lack)
    assert fit.rmse < 1.3e-7  # 1.41e-7 at the other minima
    for name in ("sigma_0", "sigma_1", "coulomb_force"):
        low, high = fit.confidence_intervals()[name]
        assert low < truths(chain)[name] < high
