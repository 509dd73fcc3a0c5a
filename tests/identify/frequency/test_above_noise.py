"""Responses without a mode: noise alone, or a constant gain with a delay; and tables without a deviation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from identify.frequency import modal_system as system
from stickslip.estimate.problem import FitError
from stickslip.identify.frequency.in_time import held_response, identify_in_time
from stickslip.identify.frequency.modal import ModalModel, identify_frequency

NOISE = 1e-9


def table(response: np.ndarray, frequency: np.ndarray, deviation: float | None = NOISE) -> xr.Dataset:
    over = ("frequency", "output", "input")
    data: dict[str, Any] = {"response": (over, response[:, None, None], {"units": "m/V"})}
    if deviation is not None:
        data["deviation"] = (over, np.full((frequency.size, 1, 1), deviation))
    return xr.Dataset(data, coords={"frequency": frequency, "output": [1], "input": [1]})


def noise(random: np.random.Generator, size: int) -> np.ndarray:
    return NOISE / np.sqrt(2.0) * (random.standard_normal(size) + 1j * random.standard_normal(size))


@pytest.mark.parametrize("gain", [0.0, 1e-7])
@pytest.mark.parametrize("modes", [1, 2])
def test_no_mode_is_found_where_none_is(gain: float, modes: int) -> None:
    """Of 1501 lines the last is not among those that the search takes."""
    for seed, size in enumerate((80, 300, 1501)[: 4 - modes]):
        random = np.random.default_rng(seed)
        frequency = np.linspace(random.uniform(1.0, 50.0), random.uniform(500.0, 5000.0), size)
        late = np.exp(-2j * np.pi * frequency * random.uniform(0.0, 3e-4))
        response = gain * late + noise(random, size)
        with pytest.raises(FitError, match="no mode above the noise"):
            identify_frequency(table(response, frequency), modes)


def test_a_mode_beside_noise_is_named() -> None:
    frequency = np.linspace(5.0, 1000.0, 300)
    response = system.response(frequency)[:, 0, 0] + noise(np.random.default_rng(4), 300)
    assert not any(
        "above the noise" in one for one in identify_frequency(table(response, frequency), 3).failures
    )
    more = identify_frequency(table(response, frequency), 4)
    assert any("does not stand above the noise" in one for one in more.failures)


def test_a_table_without_deviation_counts_all_lines_alike() -> None:
    frequency = np.linspace(5.0, 1000.0, 300)
    response = system.response(frequency)[:, 0, 0] + noise(np.random.default_rng(5), 300)
    equal, without = (identify_frequency(table(response, frequency, d), 3) for d in (NOISE, None))
    assert without.values["natural_frequency_1"] == pytest.approx(
        equal.values["natural_frequency_1"], rel=1e-6
    )
    assert without.standard_errors["gain_1"] == pytest.approx(equal.standard_errors["gain_1"], rel=1e-3)
    assert any("no `deviation`" in one for one in without.remarks)
    assert without.failures == equal.failures
    with pytest.raises(FitError, match="noise_known = True, but the response has no `deviation`: add it"):
        identify_frequency(table(response, frequency, None), 3, noise_known=True)


@pytest.mark.parametrize("moves", [False, True])
def test_modes_in_time_that_noise_makes_are_named(moves: bool) -> None:
    random = np.random.default_rng(6)
    drive, one = random.standard_normal((2000, 1, 1)), np.ones((1, 1, 1))
    start = ModalModel(np.array([2e3]), np.array([0.03]), 0.0, 1e-7 * one, 0.0 * one, 0.0 * one[0])
    response = 1e-8 * random.standard_normal((2000, 1, 1))
    if moves:
        response = response + held_response(start, drive, 4000.0)
    fit = identify_in_time(drive, response, 4000.0, start)
    assert moves != any("does not stand above the noise" in one for one in fit.failures)
