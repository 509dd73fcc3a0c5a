"""Sensors and filters: static curves, delay, and noise whose measured spectrum is the specified one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from stickslip.physics.electronics import (
    Filter,
    InductiveSensor,
    Interferometer,
    PositionSensor,
    StrainGauge,
    filtered,
)
from stickslip.physics.electronics.filters import first_order, sections
from stickslip.physics.electronics.noise import delayed, random_walk, white_noise
from stickslip.quantities.units import QuantityError

RATE = 100e3
GAPS = np.linspace(0.0, 1e-3, 11)
VOLTAGES = (0.003, 1.361, 2.855, 4.341, 5.689, 6.833, 7.768, 8.522, 9.125, 9.609, 10.0)
INDUCTIVE = InductiveSensor(
    gaps=GAPS, voltages=VOLTAGES, standoff="0.5 mm", bandwidth="10 kHz", delay="0.7 ms"
)
GAUGE = StrainGauge(sensitivity="-22.08 um/V", offset="0.0853 V", bandwidth="1 kHz")


def random(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_strain_gauge_is_the_inverse_of_equation_4_1() -> None:
    elongation = np.repeat(np.array([0.0, 5e-6, 17.4e-6]), 2000)
    volts = GAUGE.sense(elongation, RATE, random())[[1999, 3999, 5999]]
    np.testing.assert_allclose((volts + 0.0853) * -22.08, [0.0, 5.0, 17.4], atol=1e-6)


def test_inductive_sensor_meets_the_maker_s_table_and_ends_with_it() -> None:
    for gap, volts in zip(GAPS, VOLTAGES, strict=True):
        sensed = INDUCTIVE.sense(np.full(10, gap - 0.5e-3), RATE, random())
        np.testing.assert_allclose(sensed, volts, atol=1e-9)
    assert INDUCTIVE.sense(np.full(10, 5e-3), RATE, random())[0] == pytest.approx(10.0)
    fine = INDUCTIVE._replace(delay=0.0).sense(np.linspace(-0.5e-3, 0.5e-3, 2000), 1e-3, random())
    assert np.all(np.diff(fine) > 0.0)


def test_delay_is_seen_in_the_step() -> None:
    step = np.where(np.arange(1000) < 100, 0.0, 5e-6)
    sensor = INDUCTIVE._replace(bandwidth=np.inf)
    volts = sensor.sense(step, RATE, random())
    assert np.flatnonzero(volts > 0.5 * (volts[0] + volts[-1]))[0] == 100 + 70


def test_a_delay_between_samples() -> None:
    ramp = np.arange(50.0)
    np.testing.assert_allclose(delayed(ramp, 10.0, 0.25)[3:], ramp[3:] - 2.5)


@pytest.mark.parametrize("density", [26e-6, 1e-3])
def test_power_spectrum_of_the_noise_is_the_specified_one(density: float) -> None:
    sensor = INDUCTIVE._replace(noise_density=density, bandwidth=1e3)
    volts = sensor.sense(np.zeros(2**19), RATE, random()) - VOLTAGES[5]
    power = signal.welch(volts, RATE, nperseg=4096)[1][5:-5]
    assert np.mean(power) == pytest.approx(density**2, rel=0.01)
    assert np.std(power) / np.mean(power) == pytest.approx(np.sqrt(4096 / 2**19), rel=0.3)  # flat


def test_power_spectrum_of_the_drift_falls_with_the_square() -> None:
    drift, rate = 2e-3, 1e3
    walks = [random_walk(2**15, drift, rate, random(seed)) for seed in range(40)]
    at_end = np.array([walk[-1] for walk in walks])
    assert np.sqrt(np.mean(at_end**2)) == pytest.approx(drift * np.sqrt(2**15 / rate), rel=0.35)
    power = signal.welch(np.concatenate([np.diff(w) for w in walks]), rate, nperseg=1024)[1]
    assert np.mean(power[5:-5]) == pytest.approx(2 * (drift / rate) ** 2, rel=0.05)


def test_noise_comes_from_the_generator_that_is_given() -> None:
    sensor = GAUGE._replace(noise_density=1e-5, drift=1e-4)
    position = np.zeros(1000)
    same = [sensor.sense(position, RATE, random(7)) for _ in range(2)]
    np.testing.assert_array_equal(*same)
    assert np.all(sensor.sense(position, RATE, random(8)) != same[0])


def test_white_noise_has_the_variance_of_its_band() -> None:
    assert np.std(white_noise(10**6, 2e-6, 50e3, random())) == pytest.approx(2e-6 * np.sqrt(25e3), rel=0.01)


def test_interferometer_counts() -> None:
    sensor = Interferometer(resolution="0.3 nm")
    seen = sensor.sense(np.array([0.0, 0.14e-9, 0.16e-9, 1e-6]), RATE, random())
    np.testing.assert_allclose(seen, [0.0, 0.0, 0.3e-9, 3333 * 0.3e-9], atol=1e-20)
    np.testing.assert_array_equal(PositionSensor().sense(seen, RATE, random()), seen)


@pytest.mark.parametrize("family", ["butterworth", "bessel"])
@pytest.mark.parametrize("order", [1, 2, 5])
def test_corner_is_at_minus_3_db(family: str, order: int) -> None:
    made = sections(Filter(order, "2 kHz", family), 20e3)
    response = abs(signal.sosfreqz(made, [2e3, 1.0], fs=20e3)[1])
    assert 20 * np.log10(response[0]) == pytest.approx(-3.01, abs=0.02 if family == "butterworth" else 0.4)
    assert response[1] == pytest.approx(1.0, abs=1e-4)


def test_ripple_and_attenuation() -> None:
    made = sections(Filter(4, 2e3, "elliptic", ripple=1.0, attenuation=50.0), 20e3)
    f, response = signal.sosfreqz(made, 4096, fs=20e3)
    decibel = 20 * np.log10(np.maximum(abs(response), 1e-12))
    assert decibel[f <= 2e3].min() == pytest.approx(-1.0, abs=0.05)
    assert decibel[f > 4e3].max() < -49.9


def test_a_filter_begins_settled() -> None:
    np.testing.assert_allclose(filtered(Filter(4, 1e3), np.full(50, 3.0), 20e3), 3.0, atol=1e-9)


def test_one_pole_has_its_time_constant() -> None:
    step = np.where(np.arange(20000) < 100, 0.0, 1.0)
    out = first_order(step, 1e6, 1e3)
    assert np.interp(1 - np.exp(-1), out, np.arange(20000)) - 100 == pytest.approx(1e3 / (2 * np.pi), abs=1)


def test_refused() -> None:
    for make, message in (
        (lambda: sections(Filter(2, 10e3), 20e3), "below half the sample rate"),
        (lambda: Filter(2, 1e3, "brick"), "Filter.family"),
        (lambda: Filter(2, 1e3, "elliptic", 3.0, 2.0), "Filter.attenuation"),
        (lambda: INDUCTIVE._replace(voltages=VOLTAGES[::-1]), "voltages must ascend"),
        (lambda: INDUCTIVE._replace(gaps=(0.0, 1e-3)), "2 gaps"),
        (lambda: Filter(2.5, 1e3), "Filter.order"),
        (lambda: GAUGE._replace(sensitivity=0.0), "sensitivity"),
    ):
        with pytest.raises(QuantityError, match=message):
            make()
