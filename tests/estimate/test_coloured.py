"""Uncertainty under noise that remembers, and under noise that does not: neither may be made up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg, signal

from stickslip.estimate.coloured import coloured, inflation, with_coloured_noise
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.result import Fit

NAMES = ("ring", "turn", "drift")


def design(count: int) -> np.ndarray:
    """A decaying vibration by sine and cosine, and a straight line: [count, 3]."""
    t = np.linspace(0.0, 1.0, count)
    decay = np.exp(-3.0 * t)
    return np.column_stack([decay * np.cos(40.0 * t), decay * np.sin(40.0 * t), t - 0.5])


def true_errors(covariance: np.ndarray) -> np.ndarray:
    """Standard errors of least squares under noise of this covariance."""
    inverse = np.linalg.pinv(design(len(covariance)))
    return np.sqrt(np.diag(inverse @ covariance @ inverse.T))


def fitted(measured: np.ndarray, walks: bool) -> Fit:
    """A fit of the true values 0."""
    basis = design(measured.size)

    def residuals(values) -> np.ndarray:
        return basis @ np.array([values[n] for n in NAMES]) - measured

    free = [Parameter(n, 0.0, -100.0, 100.0, log=False) for n in NAMES]
    fit = fit_least_squares([Residuals(residuals, measured)], free)
    return with_coloured_noise(fit, coloured(fit.residuals, walks))


@pytest.mark.parametrize(
    ("count", "memory", "walks"), [(50, 0.0, True), (200, 0.6, False), (1000, 0.6, True)]
)
def test_standard_errors_are_those_of_the_noise(count: int, memory: float, walks: bool) -> None:
    random = np.random.default_rng(count)
    # Of x_k = memory x_(k-1) + e_k: the autocovariance is memory^lag / (1 - memory^2).
    expected = true_errors(linalg.toeplitz(memory ** np.arange(count) / (1.0 - memory**2)))
    ratio, inside, inflated = [], [], []
    for _ in range(120):
        noise = np.asarray(signal.lfilter([1.0], [1.0, -memory], random.standard_normal(count + 50)))[50:]
        fit = fitted(noise, walks)
        ratio.append(np.array([fit.standard_errors[n] for n in NAMES]) / expected)
        inside.append([low < 0.0 < high for low, high in fit.confidence_intervals().values()])
        inflated.append([inflation(fit, i) for i in range(3)])
    # What the fit takes up of slow noise is lost to the estimate: a share that falls with the length.
    lost = 0.02 + (13.0 if memory else 2.5) / count
    mean = np.mean(ratio, axis=0)
    assert np.all((1.0 - lost < mean) & (mean < 1.03)), mean
    assert np.mean(inside) > 0.95 - lost
    # Over what white noise of the same variance gives; a max(1, .) keeps it from falling below.
    factor = expected**2 / true_errors(np.eye(count) / (1.0 - memory**2)) ** 2
    share = np.mean(inflated, axis=0) / factor
    assert np.all((1.0 - 2.0 * lost < share) & (share < 1.05)), share


def test_a_walk_is_told_from_memory_that_ends() -> None:
    random = np.random.default_rng(3)
    steps = np.minimum.outer(np.arange(600), np.arange(600)) * 0.05**2
    expected = true_errors(np.eye(600) + steps)
    ratio = []
    for _ in range(30):
        fit = fitted(random.standard_normal(600) + 0.05 * np.cumsum(random.standard_normal(600)), True)
        ratio.append(np.array([fit.standard_errors[n] for n in NAMES]) / expected)
    mean = np.mean(ratio, axis=0)  # the drift takes up most of a walk
    assert np.all((mean > 0.75) & (mean < 1.1)), mean
