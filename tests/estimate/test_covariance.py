"""Covariance of coordinates that the data hardly tell apart."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.covariance import LOSSES, NoiseLevel, covariance


@pytest.mark.parametrize("apart", [1e-3, 1e-12])
def test_nearly_alike_coordinates_under_correlated_noise(apart: float) -> None:
    """Along a + b and a - b the two are far apart: turned into these, the covariance is that of a problem
    with nothing alike."""
    rng = np.random.default_rng(0)
    common, other = rng.standard_normal((2, 400))
    residuals = np.convolve(rng.standard_normal(419), np.ones(20), mode="valid")
    noise = NoiseLevel(398, loss=LOSSES["linear"], correlated=[400])
    alike = covariance(np.column_stack([common + apart * other, common - apart * other]), residuals, noise)
    apart_from = covariance(np.column_stack([common, other]), residuals, noise)
    # a + b moves the residuals by `common`, (a - b) apart by `other`.
    assert np.all(np.diag(alike) > 0.0)
    difference = np.array([apart, -apart])
    assert difference @ alike @ difference == pytest.approx(apart_from[1, 1], rel=max(1e-9, 1e-15 / apart))
