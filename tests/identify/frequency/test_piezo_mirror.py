"""Three piezos of a steering mirror, measured: gain and resonances change with amplitude, and by how much.

Data: M. Floren et al., ISMA-USD 2024, pp. 2042-2052, CC BY 4.0; see SOURCE.txt beside them. Six realisations
of orthogonal random-phase multisines (two blocks of three) at each of three levels, two periods, 6400 Hz.
Models of them: `tests/jobs/analysis/test_mirror_analysis.py`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr

from datasets import DATASETS
from stickslip.identify.frequency.response import frequency_response

RATE, LEVELS = 6400.0, (100, 200, 300)


def mean_gain(response: xr.Dataset, band: tuple[float, float]) -> xr.Dataset:
    """Mean magnitude over a band [Hz] below the resonance, weighted by its deviations, with its error."""
    lines = response.sel(frequency=slice(*band))
    weights = lines["deviation"] ** -2
    gain = (abs(lines["response"]) * weights).sum("frequency") / weights.sum("frequency")
    # Half of the variance of a line turns its phase and leaves its magnitude alone.
    return xr.Dataset({"gain": gain, "standard_error": (2 * weights.sum("frequency")) ** -0.5})


@pytest.fixture(scope="module")
def levels() -> list[xr.Dataset]:
    """Responses at each level."""
    found = []
    for level in LEVELS:
        u, y = (np.load(DATASETS / "fsm-piezo-mirror" / f"{name}_{level}mV_train.npy") for name in "uy")
        found.append(frequency_response(u, y, RATE))
    return found


def test_distortion_is_the_uncertainty_and_grows_with_amplitude(levels: list[xr.Dataset]) -> None:
    """What noise leaves of the total variance: half at 100 mV, a hundredth above."""
    share = [float((data["noise_deviation"] ** 2 / data["deviation"] ** 2).mean()) for data in levels]
    assert share[0] > 0.3
    assert share[0] > 10 * share[1] > 10 * share[2]
    assert all((data["coherence"].mean("frequency") > 0.97).all() for data in levels)


def test_gain_rises_with_amplitude(levels: list[xr.Dataset]) -> None:
    gains = []
    for data in levels:
        found = mean_gain(data.sel(output=1, input=1), (5.0, 50.0))
        gains.append((float(found["gain"]), float(found["standard_error"])))
    assert [g for g, _ in gains] == pytest.approx([2.71e-6, 2.78e-6, 2.89e-6], rel=0.02)  # SOURCE.txt
    for (low, low_error), (high, high_error) in pairwise(gains):
        assert low + 1.96 * low_error < high - 1.96 * high_error
