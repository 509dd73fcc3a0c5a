"""Modal models that depend on the amplitude: found again in simulated experiments, written out by SciPy."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from scipy import signal

import stickslip as ss
from stickslip.estimate.problem import FitError
from stickslip.identify import at_amplitude, identify_frequency, identify_levels, predict_response
from stickslip.identify.frequency.amplitude import law, law_by_exponent
from stickslip.identify.frequency.in_time import held_response
from stickslip.identify.frequency.modal import modal_response
from stickslip.identify.frequency.response import frequency_response
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingWarning

from .modal_system import SAMPLE_RATE, multisines


class Truth(NamedTuple):
    """A plant at any amplitude, written down without the package: everything is a law of a/a_0."""

    omega: np.ndarray
    zeta: np.ndarray
    softening: np.ndarray
    loss: np.ndarray
    gain: np.ndarray  # (modes, outputs, inputs)
    growth: np.ndarray
    rate_gain: np.ndarray
    remainder: np.ndarray
    delay: float
    exponent: float
    amplitude: float

    def response(self, amplitude: float, frequency: np.ndarray) -> np.ndarray:
        """(frequencies, outputs, inputs)."""
        ratio, p = amplitude / self.amplitude, self.exponent
        x = np.log(ratio) if p == 0 else (ratio**p - 1) / p
        found = np.tile(self.remainder.astype(complex), (len(frequency), 1, 1))
        for m in range(len(self.omega)):
            w, z = self.omega[m] * np.exp(self.softening[m] * x), self.zeta[m] * np.exp(self.loss[m] * x)
            for o in range(found.shape[1]):
                for i in range(found.shape[2]):
                    a, b = self.gain[m, o, i] + self.growth[m, o, i] * x, self.rate_gain[m, o, i]
                    shape = signal.freqs([b * w, a * w**2], [1, 2 * z * w, w**2], 2 * np.pi * frequency)[1]
                    found[:, o, i] += shape
        return found * np.exp(-2j * np.pi * frequency * self.delay)[:, None, None]

    def steady(self, drive: np.ndarray) -> np.ndarray:
        """Each realisation (samples, inputs, realisations) at its own rms over time and inputs."""
        frequency = np.fft.rfftfreq(len(drive), 1 / SAMPLE_RATE)
        found = []
        for u in np.moveaxis(drive, -1, 0):
            rms = np.sqrt(np.mean((u - u.mean(axis=0)) ** 2))
            spectrum = np.array(
                [
                    g @ line
                    for g, line in zip(self.response(rms, frequency), np.fft.rfft(u, axis=0), strict=True)
                ]
            )
            found.append(np.fft.irfft(spectrum, len(u), axis=0))
        return np.stack(found, axis=-1)


def random_truth(rng: np.random.Generator) -> Truth:
    gain = 1e-6 * rng.uniform(0.5, 2.0, (3, 2, 2)) * rng.choice([-1.0, 1.0], (3, 2, 2))
    return Truth(
        omega=2 * np.pi * np.array([150.0, 420.0, 700.0]) * rng.uniform(0.9, 1.1, 3),
        zeta=rng.uniform(0.01, 0.05, 3),
        softening=-rng.uniform(0.005, 0.03, 3),
        loss=rng.uniform(-0.1, 0.3, 3),
        gain=gain,
        growth=gain * rng.uniform(0.02, 0.2, (3, 2, 2)),
        rate_gain=0.1 * gain[:, ::-1],
        remainder=1e-7 * rng.uniform(-1.0, 1.0, (2, 2)),
        delay=rng.uniform(0.0, 1e-3),
        exponent=rng.uniform(0.3, 1.5),
        amplitude=0.2,
    )


def drives(rng: np.random.Generator, rms: float, samples: int = 1000, realisations: int = 4) -> np.ndarray:
    drive = multisines(rng, samples, realisations)
    return drive * rms / np.sqrt(np.mean(drive**2))


def measured(
    truth: Truth, rng: np.random.Generator, levels: tuple[float, ...], noise: float = 1e-10
) -> list[xr.Dataset]:
    found = []
    for rms in levels:
        drive = drives(rng, rms)
        # One rms for all realisations, whatever theirs are: the level is what the law is about.
        clean = truth.steady(drive / np.sqrt(np.mean(drive**2, axis=(0, 1))) * rms)
        drive = drive / np.sqrt(np.mean(drive**2, axis=(0, 1))) * rms
        noisy = clean + noise * rng.standard_normal(clean.shape)
        found.append(frequency_response(drive, noisy, SAMPLE_RATE))
    return found


@pytest.mark.parametrize("seed", [0, 3])
def test_random_plants_are_found_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = random_truth(rng)
    levels = (0.05, 0.1, 0.2, 0.4)
    fit = identify_levels(measured(truth, rng, levels), 3)
    model = fit.model
    assert fit.converged
    assert fit.remarks == ()
    assert model.amplitude == pytest.approx(np.sqrt(0.05 * 0.4))
    assert (model.lowest, model.highest) == pytest.approx((0.05, 0.4))
    assert model.exponent == pytest.approx(truth.exponent, rel=5e-3)
    # Slopes are per relative change of the amplitude at the reference, here another one than the truth's.
    factor = (model.amplitude / truth.amplitude) ** truth.exponent
    assert model.slope.natural_frequency == pytest.approx(factor * truth.softening, rel=5e-3)
    assert model.slope.damping_ratio == pytest.approx(factor * truth.loss, abs=2e-3)
    assert model.slope.gain == pytest.approx(factor * truth.growth, abs=2e-9)
    assert fit.values["gain_slope_2[1,2]"] == model.slope.gain[1, 0, 1]
    assert fit.values["natural_frequency_slope_3"] == model.slope.natural_frequency[2]
    assert fit.values["remainder_slope[2,1]"] == model.slope.remainder[1, 0]
    frequency = np.linspace(5.0, 1800.0, 300)
    for amplitude in (0.05, 0.07, 0.3, 0.4):
        expected = truth.response(amplitude, frequency)
        error = modal_response(at_amplitude(model, amplitude), frequency) - expected
        assert np.abs(error).max() < 2e-3 * np.abs(expected).max()


def test_a_drive_is_predicted_at_its_own_amplitude() -> None:
    rng = np.random.default_rng(10)
    truth = random_truth(rng)
    model = identify_levels(measured(truth, rng, (0.1, 0.2, 0.3)), 3).model
    drive = np.concatenate([drives(rng, rms, realisations=1) for rms in (0.12, 0.25)], axis=2)
    expected = truth.steady(drive)
    found = predict_response(model, drive, "4 kHz")
    assert found.shape == (1000, 2, 2)
    assert found == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())
    assert predict_response(model, drive[..., 1], SAMPLE_RATE) == pytest.approx(found[..., 1], abs=1e-15)
    # A bias of the drive is no amplitude.
    biased = predict_response(model, drive + 5.0, SAMPLE_RATE)
    assert biased - biased.mean(axis=0) == pytest.approx(found - found.mean(axis=0), abs=1e-12)
    wrong = predict_response(model, drive, SAMPLE_RATE, amplitude="0.12 V")
    assert wrong[..., 0] == pytest.approx(found[..., 0], abs=1e-5 * np.abs(found).max())
    assert np.abs(wrong - found)[..., 1].max() > 0.02 * np.abs(found).max()
    at_rest = predict_response(model, drive[..., :1], SAMPLE_RATE, periodic=False)
    own = at_amplitude(model, float(np.std(drive[..., 0])))
    assert at_rest[..., 0] == pytest.approx(
        held_response(own, drive[..., 0], SAMPLE_RATE), rel=1e-3, abs=1e-9
    )


def test_one_channel_by_a_recording() -> None:
    rng = np.random.default_rng(11)
    responses = [r.sel(output=1, input=1) for r in measured(random_truth(rng), rng, (0.1, 0.3))]
    fit = identify_levels(responses, 3, exponent=0.8)
    assert fit.values["exponent"] == 0.8
    assert "gain_slope_1" in fit.values
    volts = 0.2 * rng.standard_normal(500)
    recording = ss.make_recording(np.arange(500) / SAMPLE_RATE, {"drive_voltage": volts})
    found = predict_response(fit.model, recording)
    assert found.shape == (500,)
    assert found == pytest.approx(predict_response(fit.model, volts[:, None], SAMPLE_RATE)[:, 0], rel=1e-9)
    with pytest.raises(FitError, match="sample_rate is missing"):
        predict_response(fit.model, volts)
    with pytest.raises(FitError, match=r"\(500, 2\), not \(samples, 1 inputs"):
        predict_response(fit.model, np.ones((500, 2)), SAMPLE_RATE)
    with pytest.raises(FitError, match="above 0 V"):
        predict_response(fit.model, np.ones(500), SAMPLE_RATE)


def test_modes_that_move_by_many_widths_are_followed() -> None:
    rng = np.random.default_rng(12)
    truth = random_truth(rng)._replace(
        zeta=np.full(3, 0.008), softening=np.array([-0.2, -0.205, -0.21]), loss=np.zeros(3), exponent=1.0
    )
    levels = (0.05, 0.1, 0.2, 0.4)
    fit = identify_levels(measured(truth, rng, levels), 3)
    for volts in levels:
        x = volts / truth.amplitude - 1
        expected = truth.omega * np.exp(truth.softening * x)
        assert at_amplitude(fit.model, volts).natural_frequency == pytest.approx(expected, rel=1e-4)


def test_a_linear_plant_has_no_slopes() -> None:
    rng = np.random.default_rng(15)
    truth = random_truth(rng)
    truth = truth._replace(softening=np.zeros(3), loss=np.zeros(3), growth=0 * truth.growth)
    responses = measured(truth, rng, (0.1, 0.2, 0.4), noise=1e-9)
    fit, alone = identify_levels(responses, 3, exponent=1.0), identify_frequency(responses[1], 3)
    for m in (1, 2, 3):
        low, high = fit.confidence_intervals(0.9999)[f"natural_frequency_slope_{m}"]
        assert low < 0.0 < high
        assert high - low < 1e-2
    assert at_amplitude(fit.model, 0.2).natural_frequency == pytest.approx(
        alone.model.natural_frequency, rel=1e-3
    )


def after_hysteresis(drive: np.ndarray, share: float, thresholds: np.ndarray) -> np.ndarray:
    """Play operators of equal weight on a periodic drive (samples, ...), in the steady state, one by one."""
    state, found = np.zeros((thresholds.size, *drive.shape[1:])), np.empty_like(drive)
    half = thresholds.reshape(-1, *(1,) * (drive.ndim - 1))
    for _ in range(2):
        for n, u in enumerate(drive):
            state = np.clip(state, u - half, u + half)
            found[n] = u + share * state.sum(axis=0)
    return found


def test_rayleigh_hysteresis_has_the_exponent_one() -> None:
    """Thresholds spread evenly beyond the drive: what hysteresis adds goes with the square of the drive,
    so the gain goes with the drive, and the natural frequencies behind it stay."""
    rng = np.random.default_rng(20)
    base = drives(rng, 1.0, samples=2000)
    truth = random_truth(rng)
    thresholds = np.linspace(0.0, 1.2 * np.ptp(base), 400)[1:]
    plant = truth._replace(softening=np.zeros(3), loss=np.zeros(3), growth=0 * truth.growth)
    responses = []
    for rms in (0.25, 0.5, 1.0):
        seen = plant.steady(after_hysteresis(rms * base, 0.002, thresholds))
        responses.append(frequency_response(rms * base, seen, SAMPLE_RATE, band=(20.0, 1000.0)))
    fit = identify_levels(responses, 3)
    assert fit.model.exponent == pytest.approx(1.0, abs=0.1)
    # More of the drive comes through at every amplitude: no mode loses gain, none moves by much.
    largest = np.abs(fit.model.reference.gain) > 0.5e-6
    growth = (fit.model.slope.gain / fit.model.reference.gain)[largest]
    assert np.all((growth > 0.02) & (growth < 0.08))
    assert fit.model.slope.natural_frequency == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("exponent", [-1.5, -1e-9, 0.0, 1e-3, 3.0])
def test_the_law_of_the_amplitude(exponent: float) -> None:
    ratio = np.geomspace(0.1, 10.0, 41)
    assert law(1.0, exponent) == 0.0
    # Its slope by the relative change of the amplitude at the reference is 1, whatever the exponent.
    assert (law(1 + 1e-6, exponent) - law(1 - 1e-6, exponent)) / 2e-6 == pytest.approx(1.0)
    if abs(exponent) > 1e-4:
        assert law(ratio, exponent) == pytest.approx((ratio**exponent - 1) / exponent, rel=1e-9)
    else:
        assert law(ratio, exponent) == pytest.approx(np.log(ratio), rel=1e-3)
    h = 1e-5
    difference = (law(ratio, exponent + h) - law(ratio, exponent - h)) / (2 * h)
    assert law_by_exponent(ratio, exponent) == pytest.approx(difference, rel=1e-5, abs=1e-7)


def test_two_levels_take_the_exponent_as_given() -> None:
    rng = np.random.default_rng(16)
    responses = measured(random_truth(rng), rng, (0.1, 0.2))
    fit = identify_levels(responses, 3)
    assert fit.model.exponent == 0.5
    assert any("two levels do not show the exponent" in said for said in fit.remarks)
    assert identify_levels(responses[::-1], 3).values == pytest.approx(fit.values)  # in any order
    assert identify_levels(responses, 3, ["100 mV", 0.2]).values == pytest.approx(fit.values, rel=1e-6)


def test_levels_of_a_current_are_in_amperes(tmp_path: Path) -> None:
    rng = np.random.default_rng(16)
    truth = random_truth(rng)
    poles = list(zip(truth.omega / (2 * np.pi), truth.zeta, strict=True))
    volts = measured(truth, rng, (0.1, 0.2))
    drive = drives(rng, 0.15)
    amperes = []
    for rms in (0.1, 0.2):
        one = drives(rng, rms)
        angle = truth.steady(one) + 1e-10 * rng.standard_normal(one.shape)
        amperes.append(frequency_response(1e3 * one, 1e3 * angle, SAMPLE_RATE, units=("mA", "mrad")))
    fit = identify_levels(amperes, poles, ["100 mA", "0.2 A"])
    assert {p.name: p.unit for p in fit.parameters}["gain_1[1,1]"] == "rad/A"
    assert fit.model.units == ("A", "rad")
    assert fit.model.amplitude == pytest.approx(np.sqrt(0.02))
    assert at_amplitude(fit.model, "150 mA").unit == "rad/A"
    ss.identify.save_fit(fit, tmp_path / "levels.json")
    assert ss.identify.load_fit(tmp_path / "levels.json").model.units == ("A", "rad")
    with pytest.raises(QuantityError, match="amplitude"):
        at_amplitude(fit.model, "0.15 V")
    with pytest.raises(QuantityError, match="amplitudes"):
        identify_levels(amperes, poles, ["100 mV", "0.2 V"])
    with pytest.warns(RecordingWarning, match=r"0\.3 A rms is outside of the levels .* to 0\.2 A rms"):
        predict_response(fit.model, drive, SAMPLE_RATE, amplitude="0.3 A")
    one_input = identify_frequency(amperes[0].isel(output=[0], input=[0]), poles).model
    recording = ss.make_recording(np.arange(1000) / SAMPLE_RATE, {"drive_voltage": drive[:, 0, 0]})
    with pytest.raises(FitError, match="the model's drive is in A, not V"):
        predict_response(one_input, recording)
    with pytest.raises(FitError, match="the levels differ in their units: rad/A and m/V"):
        identify_levels([amperes[0], volts[1]], poles)


def test_what_it_needs() -> None:
    rng = np.random.default_rng(17)
    low, high = measured(random_truth(rng), rng, (0.1, 0.2))
    with pytest.raises(FitError, match="one level does not show"):
        identify_levels([low], 3)
    with pytest.raises(FitError, match=r"alike, 0\.1 and 0\.1 V rms"):
        identify_levels([low, low], 3)
    with pytest.raises(FitError, match="differ in their inputs"):
        identify_levels([low, high.isel(input=[0])], 3)
    with pytest.raises(FitError, match="1 amplitudes for 2 responses"):
        identify_levels([low, high], 3, [0.1])
    with pytest.raises(FitError, match="response 2 has no drive_rms"):
        identify_levels([low, high.drop_vars("drive_rms")], 3)
    with pytest.raises(FitError, match="no deviations"):
        identify_levels([low, high.assign(deviation=0 * high["deviation"])], 3)


def test_a_warning_beyond_the_levels_and_a_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(18)
    fit = identify_levels(measured(random_truth(rng), rng, (0.1, 0.2)), 3)
    for amplitude in (0.09, "0.25 V"):
        with pytest.warns(RecordingWarning, match=r"outside of the levels .* 0\.1 to 0\.2 V rms"):
            at_amplitude(fit.model, amplitude)
    with pytest.warns(RecordingWarning, match="outside of the levels"):
        predict_response(fit.model, drives(rng, 0.5), SAMPLE_RATE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        at_amplitude(fit.model, 0.0995)  # levels differ by that from one realisation to another
    with pytest.raises(FitError, match="above 0 V"):
        at_amplitude(fit.model, 0.0)
    ss.identify.save_fit(fit, tmp_path / "levels.json")
    again = ss.identify.load_fit(tmp_path / "levels.json").model
    drive = drives(rng, 0.15)
    assert np.array_equal(predict_response(again, drive, 4e3), predict_response(fit.model, drive, 4e3))
