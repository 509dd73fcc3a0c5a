"""Modal models against SciPy's polynomials, and found again in simulated experiments."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.problem import FitError
from stickslip.identify.frequency.modal import ModalModel, identify_frequency, modal_response, steady_response
from stickslip.identify.frequency.response import frequency_response

from . import modal_system as system

TRUE = ModalModel(system.OMEGA, system.ZETA, system.DELAY, system.GAIN, system.RATE_GAIN, system.REMAINDER)


def measured(rng: np.random.Generator, noise: float, realisations: int = 4, samples: int = 2000):
    drive = system.multisines(rng, samples, realisations)
    clean = system.steady(drive)
    return frequency_response(drive, clean + noise * rng.standard_normal(clean.shape), system.SAMPLE_RATE)


def test_response_of_a_modal_model() -> None:
    frequency = np.linspace(0, 1900, 200)
    assert modal_response(TRUE, frequency) == pytest.approx(system.response(frequency), rel=1e-12)


def test_steady_response_is_the_sum_of_sinusoids() -> None:
    drive = system.multisines(np.random.default_rng(1), 400, 3)
    expected = system.steady(drive)
    assert steady_response(TRUE, drive, system.SAMPLE_RATE) == pytest.approx(expected, abs=1e-16)


def test_modes_are_found_again_without_being_told_where() -> None:
    response = measured(np.random.default_rng(2), 1e-9)
    fit = identify_frequency(response, 3)
    model = fit.model
    assert fit.converged
    assert model.natural_frequency == pytest.approx(system.OMEGA, rel=1e-4)
    assert model.damping_ratio == pytest.approx(system.ZETA, rel=2e-3)
    assert model.delay == pytest.approx(system.DELAY, rel=1e-2)
    assert model.gain == pytest.approx(system.GAIN, abs=2e-9)
    assert model.rate_gain == pytest.approx(system.RATE_GAIN, abs=1e-8)
    assert model.remainder == pytest.approx(system.REMAINDER, abs=1e-8)
    assert fit.values["gain_2[1,2]"] == model.gain[1, 0, 1]
    assert fit.values["rate_gain_3[2,1]"] == model.rate_gain[2, 1, 0]
    assert fit.values["remainder[2,2]"] == model.remainder[1, 1]
    units = {p.name: p.unit for p in fit.parameters}
    assert units["natural_frequency_1"] == "rad/s"
    assert units["gain_1[1,1]"] == "m/V"
    assert fit.reduced_chi_squared == pytest.approx(1, abs=0.25)
    assert fit.undetermined == ()


def test_one_channel_of_one_real_mode() -> None:
    """The second-order stage of the thesis: no rate gain, no remainder."""
    model = ModalModel(
        np.array([3303.1]),
        np.array([0.524]),
        1e-4,
        np.full((1, 1, 1), 1.057e-7),
        np.zeros((1, 1, 1)),
        np.zeros((1, 1)),
    )
    rng = np.random.default_rng(4)
    drive = system.multisines(rng, 2000, 3)[:, :1]
    response = steady_response(model, drive, system.SAMPLE_RATE) + 1e-9 * rng.standard_normal(drive.shape)
    found = frequency_response(drive, response, system.SAMPLE_RATE).sel(output=1, input=1)
    seen: list[tuple[str, float]] = []
    fit = identify_frequency(
        found, [(300.0, 0.1)], complex_modes=False, remainder=False, progress=lambda *told: seen.append(told)
    )
    truth = {"natural_frequency_1": 3303.1, "damping_ratio_1": 0.524, "delay": 1e-4, "gain_1": 1.057e-7}
    assert list(fit.values) == list(truth)
    assert fit.values == pytest.approx(truth, rel=2e-3)
    for name, (low, high) in fit.confidence_intervals(0.999).items():
        assert low < truth[name] < high
    assert set(seen) == {("fitting", 0.0)}
    assert not fit.model.rate_gain.any()
    assert not fit.model.remainder.any()


def one_mode(delay: float, seed: int):
    """A response with a mode at 1250 Hz and 1 % of noise."""
    one = np.ones((1, 1, 1))
    model = ModalModel(
        np.array([2500.0 * np.pi]), np.array([0.0137]), delay, -5e-8 * one, 0 * one, 0 * one[0]
    )
    rng, rate = np.random.default_rng(seed), 25e3
    lines = np.where(np.fft.rfftfreq(1000, 1 / rate) < 6e3, 1.0, 0.0)[:, None]
    drive = np.fft.irfft(lines * np.exp(2j * np.pi * rng.random((501, 3))), 1000, axis=0)[:, None]
    shown = steady_response(model, drive, rate)
    noisy = shown[..., None] + 0.01 * shown.std() * rng.standard_normal((1000, 1, 3, 3))
    return frequency_response(np.repeat(drive[..., None], 3, axis=3), noisy, rate, band=(0.0, 6e3))


@pytest.mark.parametrize("delay", [2e-4, 8e-4])
def test_a_delay_of_any_part_of_the_period_is_found(delay: float) -> None:
    """Of half a period and more, the fit used to end at none, with another sign and damping, unsaid."""
    response = one_mode(delay, 0)
    fit = identify_frequency(response, complex_modes=False, remainder=False)
    truth = {"natural_frequency_1": 2500.0 * np.pi, "damping_ratio_1": 0.0137, "gain_1": -5e-8}
    for name, true in truth.items():
        assert fit.values[name] == pytest.approx(true, rel=2e-3), name
    assert fit.values["delay"] == pytest.approx(delay, abs=2e-7)
    assert not fit.failures
    wrong = identify_frequency(response, [(2500.0, 0.02)], complex_modes=False, remainder=False)
    assert wrong.reduced_chi_squared < 2.0 or "does not explain the responses" in wrong.failures[0]


def test_errors_are_those_of_a_search_over_everything() -> None:
    """The engine's differences on the bare model, against the derivatives and eliminated gains of the fit."""
    strong = TRUE._replace(rate_gain=2 * system.GAIN)
    rng = np.random.default_rng(8)
    drive = system.multisines(rng, 1000, 4)
    clean = steady_response(strong, drive, system.SAMPLE_RATE)
    noisy = clean + 1e-8 * rng.standard_normal(clean.shape)
    channel = frequency_response(drive, noisy, system.SAMPLE_RATE).sel(output=1, input=2)
    fit = identify_frequency(channel, list(zip(system.OMEGA / (2 * np.pi), system.ZETA, strict=True)))

    def residuals(values):
        poles, (delay, *gains) = np.split(np.array(list(values.values())), [6])
        one = np.reshape(gains, (7, 1, 1))
        model = ModalModel(poles[0::2], poles[1::2], delay, one[:3], one[3:6], one[6])
        error = modal_response(model, channel["frequency"].values)[:, 0, 0] - channel["response"].values
        return np.concatenate([error.real, error.imag]) / np.tile(channel["deviation"].values, 2)

    begin = [p._replace(start=fit.values[p.name]) for p in fit.parameters]
    full = fit_least_squares(residuals, begin)
    assert fit.values == pytest.approx(full.values, rel=1e-4, abs=1e-10)
    assert fit.standard_errors == pytest.approx(full.standard_errors, rel=1e-3)


def test_modes_are_numbered_by_frequency_and_may_be_given_in_any_order() -> None:
    response = measured(np.random.default_rng(5), 1e-9)
    fit = identify_frequency(response, [(650.0, 0.05), (130.0, 0.05), (450.0, 0.05)])
    assert fit.model.natural_frequency == pytest.approx(system.OMEGA, rel=1e-4)


def test_a_model_to_start_from_has_the_delay_as_well() -> None:
    """Modes in a row started without the delay end where another one turns the phases back."""
    response = measured(np.random.default_rng(9), 1e-9).sel(output=[2])
    fit = identify_frequency(response, TRUE)
    assert fit.model.delay == pytest.approx(system.DELAY, rel=1e-2)
    assert fit.model.gain[:, 0] == pytest.approx(system.GAIN[:, 1], abs=5e-9)


def test_known_noise_gives_the_chi_squared_its_meaning() -> None:
    response = measured(np.random.default_rng(6), 1e-8, realisations=12)
    fit = identify_frequency(response, 3, noise_known=True)
    assert fit.noise_known
    assert fit.reduced_chi_squared == pytest.approx(1, abs=0.1)
    poor = identify_frequency(response, 2, noise_known=True)
    assert poor.reduced_chi_squared > 10
    assert "does not explain response[1,1]" in poor.failures[0]
    assert "does not explain the responses: residual" in identify_frequency(response, 2).failures[0]


def test_needs_deviations() -> None:
    drive = system.multisines(np.random.default_rng(7), 400, 2)
    response = frequency_response(drive, system.steady(drive), system.SAMPLE_RATE)
    with pytest.raises(FitError, match="no deviations"):
        identify_frequency(response, 3)


@pytest.mark.parametrize(
    ("hertz", "damping", "noise"), [(800.0, 2e-5, 1e-9), (6e3, 0.02, 1e-10), (30.0, 0.02, 1e-10)]
)
def test_a_mode_beyond_where_it_is_searched_first(hertz: float, damping: float, noise: float) -> None:
    """Damped by less than 1e-4, or above twice or below half the frequencies of the response: there the ends
    of the first search were printed as ends of 95 % intervals."""
    frequency, omega = np.linspace(100.0, 2000.0, 800), 2 * np.pi * hertz
    s, rng = 2j * np.pi * frequency, np.random.default_rng(1)
    noises = noise * (rng.standard_normal(s.size) + 1j * rng.standard_normal(s.size)) / np.sqrt(2)
    found = 1e-7 * omega**2 / (s**2 + 2 * damping * omega * s + omega**2) + noises
    axes = "frequency", "output", "input"
    response = xr.Dataset(
        {
            "response": (axes, found[:, None, None], {"units": "m/V"}),
            "deviation": (axes, np.full((s.size, 1, 1), noise), {"units": "m/V"}),
        },
        coords={"frequency": ("frequency", frequency, {"units": "Hz"}), "output": [1], "input": [1]},
    )
    fit = identify_frequency(response, 1, noise_known=True)
    intervals = fit.confidence_intervals()
    for name, truth in (("natural_frequency_1", omega), ("damping_ratio_1", damping)):
        low, high = intervals[name]
        assert low <= truth <= high
    assert fit.converged
