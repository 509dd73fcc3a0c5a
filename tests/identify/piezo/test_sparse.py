"""`identify_piezo` on recordings of few samples: lags, what is not explained, creep that goes on after."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy import signal

import stickslip as ss
from stickslip.recording import RecordingError

Array = NDArray[np.float64]

SAMPLES, LENGTH, STROKE = 800, 40.0, 1e-6
STEP = LENGTH / SAMPLES  # s
TIME = STEP * np.arange(SAMPLES)


def play(drive: Array, half_width: float) -> Array:
    """From rest at 0 V."""
    found, z = np.empty_like(drive), 0.0
    for i, u in enumerate(drive):
        z = min(max(z, u - half_width), u + half_width)
        found[i] = z
    return found


def lagged(values: Array, tau: float) -> Array:
    """A first-order lag of what is joined by lines, from rest at 0."""
    b, a, _ = signal.cont2discrete(([1.0], [tau, 1.0]), STEP, "foh")
    return signal.lfilter(np.ravel(b), a, values)


def drive(random: np.random.Generator) -> Array:
    """A rest, a sine, and one hold, V."""
    volts = 50.0 * (1.0 - np.cos(2.0 * np.pi * int(random.integers(2, 10)) * TIME / LENGTH))
    volts[TIME < 0.05 * LENGTH] = 0.0
    volts[(TIME > 0.5 * LENGTH) & (TIME < 0.56 * LENGTH)] = random.uniform(20.0, 95.0)
    return volts


def stroke(volts: Array, random: np.random.Generator) -> Array:
    """Of plays that the fit has too, m."""
    shares = random.uniform(0.0, 0.08, 7)
    beside = sum(w * play(volts, r) for w, r in zip(shares, 6.25 * np.arange(1, 8), strict=True))
    return STROKE / 100.0 * (volts + beside)


def shown(volts: Array, position: Array, noise: float = 1e-3 * STROKE, seed: int = 0) -> xr.Dataset:
    heard = noise * np.random.default_rng(seed).standard_normal(volts.size)
    return ss.make_recording(
        STEP * np.arange(volts.size), {"drive_voltage": volts, "stage_position": position + heard}
    )


@pytest.mark.parametrize("seed", [0, 5])
def test_no_lag_is_made_up(seed: int) -> None:
    """Windows after edges took most samples, and lags of 1 to 2 s left 14 to 30 % of the stroke."""
    random = np.random.default_rng(seed)
    volts = drive(random)
    position = stroke(volts, random)
    fit = ss.identify_piezo(shown(volts, position, seed=seed))
    assert fit.values["lag"] + fit.values["delay"] < 0.02 * STEP
    assert np.std(fit.predict(shown(volts, position, 0.0)) - position) < 1e-3 * STROKE  # type: ignore[misc]
    assert not fit.failures
    without = ss.identify_piezo(shown(volts, position, seed=seed), lag=0.0, delay=0.0)
    assert fit.rmse <= 1.01 * without.rmse


@pytest.mark.parametrize("seed", [1])
def test_a_lag_is_found_by_few_samples(seed: int) -> None:
    random = np.random.default_rng(100 + seed)
    volts, lag = drive(random), float(random.uniform(1.0, 5.0)) * STEP
    position = stroke(lagged(volts, lag), random)
    fit = ss.identify_piezo(shown(volts, position, seed=seed))
    assert fit.values["lag"] == pytest.approx(lag, rel=0.02)
    assert fit.values["delay"] == pytest.approx(0.0, abs=0.05 * STEP)
    assert np.std(fit.predict(shown(volts, position, 0.0)) - position) < 2e-3 * STROKE  # type: ignore[misc]


def test_what_the_model_does_not_explain_is_a_failure() -> None:
    """A fifth of the motion of another cause; loops of other models leave too little for that."""
    random = np.random.default_rng(3)
    volts = drive(random)
    other = 0.1 * STROKE * np.sin(2.0 * np.pi * TIME / 3.7)
    fit = ss.identify_piezo(shown(volts, stroke(volts, random) + other)[{"time": slice(60, None)}])
    assert any("does not explain recording 1: it leaves" in said for said in fit.failures)
    fine = ss.identify_piezo(shown(volts, stroke(volts, random))[{"time": slice(60, None)}])
    assert not fine.failures


def test_a_fit_that_is_no_piezo_names_the_recording() -> None:
    """A lag that is given as none. Of 0.5 s, it fits badly; of 1 s, what is left has no inverse."""
    random = np.random.default_rng(2)
    volts = drive(random)
    position = stroke(lagged(volts, 0.5), random)
    assert ss.identify_piezo(shown(volts, position), lag=0.0, delay=0.0).failures
    later = stroke(lagged(volts, 1.0), np.random.default_rng(2))
    with pytest.raises(RecordingError, match=r"stage_position of recording 1 .* leave delay and lag"):
        ss.identify_piezo(shown(volts, later), lag=0.0, delay=0.0)


@pytest.mark.parametrize(("ends", "found"), [(30.0, 30.0), (1e3, 300.0)], ids=["ends", "goes on"])
def test_creep_may_go_on_after_the_recording(ends: float, found: float) -> None:
    """Taken to end with it, that which goes on to 1,000 s was found greater by a sixth."""
    time = 0.01 * np.arange(3000)
    volts = 50.0 - 50.0 * (1.0 - time / 60.0) * np.cos(2.0 * np.pi * time / 3.0)
    volts[time < 2.0] = 0.0
    volts[(time > 9.0) & (time < 14.0)], volts[(time > 20.0) & (time < 25.0)] = 80.0, 20.0
    at_once = STROKE / 100.0 * (volts + 0.2 * play(volts, 12.5) + 0.2 * play(volts, 25.0))
    count = round(8.0 * np.log10(ends / 0.1))  # finer than the terms of the fit
    width = np.log10(ends / 0.1) / count
    creep = np.zeros(time.size)
    for tau in 0.1 * 10.0 ** (width * (np.arange(count) + 0.5)):
        b, a, _ = signal.cont2discrete(([1.0], [tau, 1.0]), 0.01, "foh")
        creep += 0.015 * width * signal.lfilter(np.ravel(b), a, at_once)
    position = at_once + creep + 5e-4 * STROKE * np.random.default_rng(1).standard_normal(time.size)
    channels = {"drive_voltage": volts, "stage_position": position}
    fit = ss.identify_piezo(ss.make_recording(time, channels), operators=4)
    assert fit.values["creep"] == pytest.approx(0.015, rel=0.03)
    assert fit.model.creep.per_decade == pytest.approx(fit.values["creep"])
    assert any(f"creep is by terms from 0.1 s to {found:g} s" in said for said in fit.remarks)
