"""Effect of a prior on a fit, against the closed form of a Gaussian mean."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.estimate import Parameter, Residuals, fit_least_squares, prior_influence

NOISE, COUNT = 0.5, 25
DATA = 3.0 + NOISE * np.random.default_rng(0).standard_normal(COUNT)
ALONE, ERROR = float(DATA.mean()), NOISE / math.sqrt(COUNT)


def fits(prior, log=False):
    made = []
    for known in (None, prior):
        parameter = Parameter("mean", 2.0, 1e-3, 1e3, "N", log=log, prior=known)
        residuals = Residuals(lambda p: np.full(COUNT, p["mean"]) - DATA, DATA, noise=NOISE)
        made.append(fit_least_squares([residuals], [parameter], noise_known=True))
    return made


@pytest.mark.parametrize(("expected", "spread"), [(3.2, 0.2), (4.0, 0.3), (3.0, 0.02)])
def test_against_the_closed_form(expected: float, spread: float) -> None:
    (found,) = prior_influence(*fits((expected, spread)))
    weight = 1.0 / spread**2 + 1.0 / ERROR**2
    together = (expected / spread**2 + ALONE / ERROR**2) / weight
    off = (ALONE - expected) / math.hypot(spread, ERROR)
    assert found.alone == pytest.approx(ALONE, rel=1e-6)
    assert found.together == pytest.approx(together, rel=1e-6)
    assert found.moved == pytest.approx((together - ALONE) / ERROR, rel=1e-3, abs=1e-5)
    assert found.off == pytest.approx(off, rel=1e-3, abs=1e-5)
    assert found.narrowed == pytest.approx(1.0 / (math.sqrt(weight) * ERROR), rel=1e-3)
    assert found.open == (spread < ERROR)
    assert found.disagrees == (abs(off) > 1.96)
    said = "disagree" if found.disagrees else "say less than the prior" if found.open else "moved it from"
    assert said in found.sentence


def test_a_factor_on_a_logarithmic_scale() -> None:
    (found,) = prior_influence(*fits((6.0, 6.0 * math.log(1.3)), log=True))
    expected = math.log(ALONE / 6.0) / math.hypot(math.log(1.3), ERROR / ALONE)
    assert found.off == pytest.approx(expected, rel=1e-2)
    assert found.disagrees
    assert "2.9" in found.sentence
    assert "6 N of the prior" in found.sentence


def test_no_prior_nothing_to_tell() -> None:
    alone = fits(None)[0]
    assert prior_influence(alone, alone) == ()
