"""Frequency responses of filters whose response SciPy knows, and how far their deviations can be trusted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from stickslip.identify.frequency.response import (
    ResponseError,
    frequency_response,
    ratio_of,
    units_of,
    welch_frequency_response,
)
from stickslip.quantities.units import QuantityError

RATE = 1000.0
# (outputs, inputs) of digital filters: numerator, denominator.
FILTERS = [
    [signal.butter(2, 0.3), ([0.5, 0.2], [1.0, -0.4])],
    [([0.0, 0.0, 1.0], [1.0]), signal.iirpeak(0.2, 5)],
]


def filtered(drive: np.ndarray) -> np.ndarray:
    """(samples, 2, ...) through the filters, from rest."""
    rows = [sum(signal.lfilter(*f, drive[:, i], axis=0) for i, f in enumerate(row)) for row in FILTERS]
    return np.stack(rows, axis=1)


def true_response(frequency: np.ndarray) -> np.ndarray:
    rows = [[signal.freqz(*f, worN=frequency, fs=RATE)[1] for f in row] for row in FILTERS]
    return np.moveaxis(np.array(rows), -1, 0)


def periodic(rng: np.random.Generator, realisations: int, periods: int = 2, samples: int = 512):
    """Drive and steady response (samples, 2, realisations, periods)."""
    spectrum = np.zeros((samples // 2 + 1, 2, realisations), dtype=complex)
    spectrum[3:200] = np.exp(2j * np.pi * rng.random((197, 2, realisations)))
    one = np.fft.irfft(spectrum, samples, axis=0) * np.sqrt(samples)
    whole = filtered(np.concatenate([one] * (periods + 4)))[4 * samples :]
    response = np.moveaxis(whole.reshape(periods, samples, 2, realisations), 0, -1)
    return np.repeat(one[..., None], periods, axis=-1), response


def test_periodic_response_is_exact_without_noise() -> None:
    found = frequency_response(*periodic(np.random.default_rng(1), 5), RATE)
    assert found.sizes == {"frequency": 197, "output": 2, "input": 2}
    assert found["frequency"].values == pytest.approx(np.arange(3, 200) * RATE / 512)
    assert found["response"].values == pytest.approx(true_response(found["frequency"].values), rel=1e-9)
    assert found["response"].attrs["units"] == "m/V"
    assert np.all(found["coherence"] > 1 - 1e-12)
    band = frequency_response(*periodic(np.random.default_rng(1), 5), RATE, band=(50, 100))
    assert 50 <= band["frequency"].min() <= band["frequency"].max() <= 100


def test_responses_in_other_units_become_si() -> None:
    drive, response = periodic(np.random.default_rng(1), 5)
    found = frequency_response(drive, response, RATE)
    same = frequency_response(1e3 * drive, 1e6 * response, RATE, units=("mV", "um"))
    for name in ("response", "deviation", "noise_deviation"):
        assert same[name].values == pytest.approx(found[name].values, rel=1e-9, abs=1e-12)
        assert same[name].attrs["units"] == "m/V"
    assert float(same["drive_rms"]) == pytest.approx(float(found["drive_rms"]))
    u, y = drive[:, :, 0, 0], 1e3 * response[:, :, 0, 0]
    welch = welch_frequency_response(u, y, RATE, segment=64, units=("A", "mrad"))
    expected = welch_frequency_response(u, 1e-3 * y, RATE, segment=64)
    assert welch["response"].values == pytest.approx(expected["response"].values)
    assert (welch["response"].attrs["units"], welch["drive_rms"].attrs["units"]) == ("rad/A", "A")
    with pytest.raises(QuantityError, match="the unit 'gizmos' is not known"):
        frequency_response(drive, response, RATE, units=("V", "gizmos"))


@pytest.mark.parametrize("units", [("V", "m"), ("A", "rad"), ("V", "m/s"), ("V", ""), ("", "m"), ("", "")])
def test_units_of_a_response_and_its_drive(units: tuple[str, str]) -> None:
    drive, response = periodic(np.random.default_rng(1), 5)
    found = frequency_response(drive, response, RATE, units=units)
    assert units_of(found) == units_of(found.drop_vars("drive_rms")) == units
    assert found["response"].attrs["units"] == ratio_of(units)


def test_deviations_are_those_of_repeated_experiments() -> None:
    rng = np.random.default_rng(2)
    drive, clean = periodic(rng, 5)
    found = [
        frequency_response(drive, clean + 0.05 * rng.standard_normal(clean.shape), RATE) for _ in range(40)
    ]
    responses = np.array([f["response"].values for f in found])
    scatter = np.sqrt(np.mean(np.abs(responses - true_response(found[0]["frequency"].values)) ** 2, axis=0))
    for name in ("deviation", "noise_deviation"):
        predicted = np.sqrt(np.mean([f[name].values ** 2 for f in found], axis=0))
        ratio = predicted / scatter
        assert np.median(ratio) == pytest.approx(1, abs=0.02)
        assert np.mean(np.abs(ratio - 1) < 0.3) > 0.97


def test_distortion_shows_between_realisations_and_not_between_periods() -> None:
    rng = np.random.default_rng(3)
    drive, clean = periodic(rng, 6)
    distorted = clean + 0.02 * clean**3
    noisy = frequency_response(drive, clean + 0.001 * rng.standard_normal(clean.shape), RATE)
    bent = frequency_response(drive, distorted + 0.001 * rng.standard_normal(clean.shape), RATE)
    assert (bent["deviation"] / bent["noise_deviation"]).median() > 10
    assert (noisy["deviation"] / noisy["noise_deviation"]).median() == pytest.approx(1, abs=0.1)
    assert bent["coherence"].mean() < noisy["coherence"].mean()


def test_coherence_is_the_share_of_the_power_explained() -> None:
    rng = np.random.default_rng(4)
    drive, clean = periodic(rng, 40, periods=1)
    noise = clean.std(axis=(0, 2, 3), keepdims=True) * rng.standard_normal(clean.shape)
    found = frequency_response(drive, clean + noise, RATE)
    lines = np.fft.rfft(clean[..., 0], axis=0)[3:200]
    signal_power = np.mean(np.abs(lines) ** 2, axis=2)
    noise_power = (clean.std(axis=(0, 2, 3)) ** 2) * 512
    expected = signal_power / (signal_power + noise_power)
    error = found["coherence"].values - expected
    assert np.mean(error) == pytest.approx(0, abs=0.02)
    assert np.std(error) < 0.1  # one line has forty realisations


def test_single_recording_without_repetition_has_no_deviation() -> None:
    drive, response = periodic(np.random.default_rng(5), 1, periods=1)
    drive[:, 1] = 0
    alone = np.convolve(np.tile(drive[:, 0, 0, 0], 3), [0.5, 0.5])[512:1024]
    found = frequency_response(drive[:, 0, 0, 0], alone, RATE)
    expected = signal.freqz([0.5, 0.5], worN=found["frequency"].values, fs=RATE)[1]
    assert found["response"].values[:, 0, 0] == pytest.approx(expected, rel=1e-9)
    assert np.all(np.isnan(found["deviation"]))
    with pytest.raises(ResponseError, match="2 inputs need as many realisations; there are 1"):
        frequency_response(drive, response, RATE)


def test_as_many_realisations_as_inputs_leave_the_noise_as_deviation() -> None:
    rng = np.random.default_rng(6)
    drive, clean = periodic(rng, 2)
    found = frequency_response(drive, clean + 0.01 * rng.standard_normal(clean.shape), RATE)
    assert np.array_equal(found["deviation"], found["noise_deviation"])


def test_refusals() -> None:
    drive, response = periodic(np.random.default_rng(7), 4)
    for u, y, said in (
        (drive, response[..., :1], "differ in samples"),
        (np.repeat(drive[:, :1], 2, axis=1), response, "do not distinguish the inputs"),
        (np.where(drive > 2, np.nan, drive), response, "drive .* not finite"),
        (drive[..., None], response, "5 axes"),
    ):
        with pytest.raises(ResponseError, match=said):
            frequency_response(u, y, RATE)
    for length, segment, said in ((512, 400, "too few"), (500, 64, "512 and 500")):
        with pytest.raises(ResponseError, match=said):
            welch_frequency_response(drive[:, :, 0, 0], response[:length, :, 0, 0], RATE, segment=segment)


def test_welch_response_of_noise_its_deviation_and_coherence() -> None:
    rng = np.random.default_rng(8)
    errors, predicted = [], []
    for _ in range(20):
        drive = rng.standard_normal((8192, 2))
        response = filtered(drive) + 0.3 * rng.standard_normal((8192, 2))
        found = welch_frequency_response(drive, response, RATE, segment=256, band=(20, 450))
        errors.append(found["response"].values - true_response(found["frequency"].values))
        predicted.append(found["deviation"].values)
    scatter = np.sqrt(np.mean(np.abs(errors) ** 2, axis=0))
    ratio = np.sqrt(np.mean(np.square(predicted), axis=0)) / scatter
    assert np.median(ratio) == pytest.approx(1, abs=0.1)
    # No bias beyond the scatter of the mean of twenty experiments.
    assert np.median(np.abs(np.mean(errors, axis=0)) / scatter) < 2 / np.sqrt(20)
    true = np.abs(true_response(found["frequency"].values)) ** 2
    expected = true.sum(axis=2) / (true.sum(axis=2) + 0.09)
    assert np.mean(found["coherence"].values - expected) == pytest.approx(0, abs=0.03)
    # With few segments it matters that the response was fitted to them.
    errors, predicted = [], []
    for _ in range(100):
        drive = rng.standard_normal((1280, 2))
        response = filtered(drive) + 0.3 * rng.standard_normal((1280, 2))
        few = welch_frequency_response(drive, response, RATE, segment=256, band=(20, 450))
        errors.append(few["response"].values - true_response(few["frequency"].values))
        predicted.append(few["deviation"].values)
    scatter = np.median(np.abs(errors), axis=0)
    assert np.median(np.median(predicted, axis=0) / scatter) == pytest.approx(1 / np.sqrt(np.log(2)), rel=0.1)
