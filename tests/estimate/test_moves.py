"""What a fit took as known moves its estimate, against SciPy's own fits: priors hold it, noise weighs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg, optimize

from stickslip.estimate.coloured import Coloured, inflation, with_coloured_noise, with_inherited
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.moves import moves
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.result import Fit

SIZES, LEVELS = (40, 25), (0.3, 1.1)
NOISE = np.repeat(LEVELS, SIZES)


class Case:
    """Two recordings with noises of their own, of a product, a curve and what is taken as known; a prior of
    `scale` or none."""

    def __init__(self, seed: int, prior: bool) -> None:
        random = np.random.default_rng(seed)
        self.columns = random.standard_normal((sum(SIZES), 3))
        # Nearly as the curve: the data hardly tell both.
        self.columns[:, 1] = self.columns[:, 0] + 0.1 * self.columns[:, 1]
        self.known = random.uniform(0.5, 2.0)
        self.prior = (random.uniform(1.5, 2.5), random.uniform(0.02, 0.1)) if prior else None
        self.measured = self.model([2.0, 1.0], self.known) + NOISE * random.standard_normal(NOISE.size)

    def model(self, values, known: float) -> np.ndarray:
        scale, bend = values
        return scale * self.columns[:, 0] + bend * self.columns[:, 1] + known * self.columns[:, 2]

    def fit(self) -> Fit:
        ends = np.cumsum(SIZES)[:-1]
        parts = [
            Residuals(
                lambda v, i=i: np.split(
                    self.model([v["scale"], v["bend"]], self.known) - self.measured, ends
                )[i],
                np.split(self.measured, ends)[i],
                LEVELS[i],
            )
            for i in range(2)
        ]
        free = [
            Parameter("scale", 1.8, 0.01, 50.0, prior=self.prior),
            Parameter("bend", 1.0, -50.0, 50.0, log=False),
        ]
        return fit_least_squares(parts, free, noise_known=True)

    def independent(self, known: float) -> np.ndarray:
        """SciPy's estimate of log scale and bend."""

        def residuals(q):
            rows = (self.model([np.exp(q[0]), q[1]], known) - self.measured) / NOISE
            if self.prior is None:
                return rows
            value, deviation = self.prior
            return np.append(rows, (q[0] - np.log(value)) / (deviation / value))

        return optimize.least_squares(residuals, [0.6, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-15).x


@pytest.mark.parametrize("prior", [True, False], ids=["prior", "none"])
@pytest.mark.parametrize("seed", range(2))
def test_an_error_of_what_was_taken_as_known_moves_the_estimate_as_another_fit_says(
    seed: int, prior: bool
) -> None:
    case, deviation, h = Case(seed, prior), 0.4, 1e-3
    fit = case.fit()
    by = (case.independent(case.known + h) - case.independent(case.known - h)) / (2.0 * h)
    assert moves(fit, case.columns[:, 2:])[:, 0] == pytest.approx(by, rel=1e-2)  # residuals bend
    wider = with_inherited(fit, case.columns[:, 2:], np.array([[deviation**2]]))
    added = wider.uncertainty.covariance - fit.uncertainty.covariance
    assert added == pytest.approx(deviation**2 * np.outer(by, by), rel=2e-2)


def test_with_a_prior_the_interval_is_hardly_wider_than_that_alone() -> None:
    for seed in range(2):
        case = Case(seed, prior=True)
        assert case.prior is not None
        wider = with_inherited(case.fit(), case.columns[:, 2:], np.array([[1.0]]))
        free = with_inherited(Case(seed, prior=False).fit(), case.columns[:, 2:], np.array([[1.0]]))
        assert wider.standard_errors["scale"] < 1.05 * case.prior[1]
        assert free.standard_errors["scale"] > 3.0 * case.prior[1]


@pytest.mark.parametrize("prior", [True, False], ids=["prior", "none"])
def test_coloured_noise_beside_a_prior(prior: bool) -> None:
    """The sandwich by whole matrices."""
    case, memory = Case(5, prior), 0.7
    fit = case.fit()
    assert fit.jacobian is not None
    lags = memory ** np.arange(max(SIZES))
    sigma = linalg.block_diag(*(linalg.toeplitz(lags[:n]) for n in SIZES))
    j, known = fit.jacobian / NOISE[:, None], np.zeros((2, 2))
    if case.prior is not None:
        known[0, 0] = (case.prior[0] / case.prior[1]) ** 2
    inverse = np.linalg.inv(j.T @ j + known)
    grown = NOISE.size / fit.degrees_of_freedom
    within = grown * (j / NOISE[:, None]).T @ sigma @ (j / NOISE[:, None]) + known
    found = with_coloured_noise(fit, Coloured(lags))
    assert found.uncertainty.covariance == pytest.approx(inverse @ within @ inverse, rel=1e-6)
    for place in range(2):
        raised = found.uncertainty.covariance[place, place] / inverse[place, place]
        assert inflation(found, place) == pytest.approx(max(1.0, raised), rel=1e-6)
    assert inflation(replace(found, correlated=False), 0) == 1.0
