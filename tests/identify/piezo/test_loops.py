"""`identify_piezo` on loops of other models: how well it follows them, however they begin."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

import stickslip as ss
from stickslip.identify.piezo.timing import _spread
from stickslip.physics.piezo import Creep

from . import records
from .loops import RATE, STROKE, bouc_wen, preisach, record, sine

BEFORE = 2.0  # s, for which those that begin amid a motion have moved


def cut(drive: NDArray[np.float64], shape: NDArray[np.float64]) -> xr.Dataset:
    first = round(BEFORE * RATE)
    return record(drive[first:], shape[first:])


def loops() -> dict[str, xr.Dataset]:
    found = {}
    for name, drive in (("0", sine(4.0)), ("mid", sine(4.0, phase=2.5))):
        found[f"Bouc-Wen from {name}"] = record(drive, bouc_wen(drive))
    for name, middle, phase in (("falling", 0.0, 2.5),):
        drive = sine(4.0 + BEFORE, middle, phase, -BEFORE)
        found[f"Bouc-Wen amid its motion, {name}"] = cut(drive, bouc_wen(drive))
    drive = sine(4.0)
    for lean in (-0.8,):
        found[f"Preisach leaning {lean}"] = record(drive, preisach(drive, lean))
    found["Preisach, late"] = record(drive, preisach(drive, 0.3, 0.01))
    return found


@pytest.mark.parametrize(("name", "shown"), loops().items(), ids=loops())
def test_loops_of_other_models_are_followed(name: str, shown: xr.Dataset) -> None:
    """Within 0.6 % of the stroke with the first curve, 0.25 % in the loops after it; rms."""
    fit = ss.identify_piezo(shown)
    left = fit.predict(shown) - shown.stage_position.values  # type: ignore[misc]
    later = left[round(RATE) :]
    assert np.sqrt(np.mean(left**2)) < 0.006 * STROKE
    assert later.std() < 0.0025 * STROKE
    if "amid" in name:  # a rest would leave at least four times the noise
        assert np.sqrt(np.mean(left**2)) < 0.0006 * STROKE


def test_a_skew_is_found() -> None:
    """Of plays as the fit has them: its value within 10 %, and loops wider where it is."""
    zones = 100.0 * np.arange(8) / 8
    skew = 4e-3  # 1/V: at 100 V plays see the voltage 1.8 times as steep as at 0 V
    of = records.truth(5)
    law = of.piezo.hysteresis._replace(
        thresholds=(0.0, 17.67, 35.33, 53.0),  # of the 141 V that plays see
        dead_zones=tuple(zones),
        slopes=(0.0,) * 8,
        skews=(25.0 * skew,) * 8,
    )
    of = of._replace(piezo=of.piezo._replace(hysteresis=law), lag=1e-6, delay=0.0)
    drive = 50.0 - 50.0 * np.cos(2.0 * np.pi * np.arange(4000) / 400) * np.linspace(1.0, 0.2, 4000)
    fit = ss.identify_piezo(records.recording(of, drive, 1e-4 * of.gain * 100.0), operators=4, creep=True)
    assert fit.values["skew"] == pytest.approx(skew, rel=0.1)
    again = ss.identify_piezo(records.recording(of, drive, 0.0), asymmetric=False)
    assert "skew" not in again.values


def test_a_lag_that_no_edge_shows_is_found_where_it_predicts_better() -> None:
    drive = sine(4.0)
    fit = ss.identify_piezo(record(drive, preisach(drive, 0.3, 0.01)))
    assert fit.values["lag"] == pytest.approx(0.01, rel=0.3)
    assert any("may be hysteresis" in said for said in fit.remarks)
    assert ss.identify_piezo(record(drive, preisach(drive, 0.3))).values["lag"] == 0.0


@pytest.mark.parametrize(("seconds", "every"), [(1.0, 10), (0.6, 1)])
def test_little_is_enough_for_a_fit(seconds: float, every: int) -> None:
    """One loop, 20 samples of it, or the first curve and a way back."""
    drive = sine(seconds)
    shown = record(drive, bouc_wen(drive)).isel(time=slice(None, None, every))
    fit = ss.identify_piezo(shown)
    left = fit.predict(shown) - shown.stage_position.values  # type: ignore[misc]
    assert left.std() < 0.02 * STROKE
    assert any("creep is left out" in said for said in fit.remarks)
    assert not isinstance(fit.model.creep, Creep)


def test_creep_of_a_voltage_that_never_rests_is_not_trusted() -> None:
    """Loops that shrink, of a piezo that does not creep: what their own shape leaves looks like creep."""
    shrinking = sine(5.0) * np.linspace(1.0, 0.3, round(5.0 * RATE))
    fit = ss.identify_piezo(record(shrinking, bouc_wen(shrinking)))
    assert "creep" in fit.values
    assert any("never rests" in said for said in fit.remarks)
    assert any("the piezo has another form" in said for said in fit.remarks)
    held = np.concatenate([shrinking, np.full(round(5.0 * RATE), shrinking[-1])])
    with_rest = ss.identify_piezo(record(held, bouc_wen(held)))
    assert not any("never rests" in said for said in with_rest.remarks)


def test_a_delay_and_a_lag_of_nearly_nothing_have_errors() -> None:
    """The misfit is that of their sizes: across zero its difference is none, and they were off by seconds."""
    noise = 1e-9 * np.random.default_rng(0).standard_normal(200)
    shapes = np.random.default_rng(1).standard_normal((200, 2)) * 1e-3
    found = _spread(lambda x: noise + shapes @ np.abs(x), np.array([1e-9, 0.0]), 1e-3)
    assert found.delay == pytest.approx(1e-6 / np.sqrt(200.0), rel=0.2)
    assert found.lag == pytest.approx(1e-6 / np.sqrt(200.0), rel=0.2)
