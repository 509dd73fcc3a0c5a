"""`identify_piezo`: truths that are known, measured data, and what cannot be identified."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

import reference
import stickslip as ss
from datasets import DATASETS
from stickslip.estimate.problem import FitError
from stickslip.estimate.result import Fit
from stickslip.physics.piezo import Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError

from . import records
from .records import HIGH, RATE, Truth, drive, recording, truth

KNOWN = {"operators": records.PLAYS, "asymmetric": True, "creep": True}


def noise_of(of: Truth) -> float:
    """m: two parts in 10,000 of the stroke."""
    return 2e-4 * of.gain * HIGH


@pytest.fixture(scope="module")
def yan9a() -> dict[str, xr.Dataset]:
    """Voltage and displacement of a piezo stage [Aye & Ang, ICSTSD 2018; MIT]: see SOURCE.txt beside them."""
    found = {}
    for name, file in (("model", "Model_Vi_Do.dat"), ("test", "Test_Vi_Do_Di.dat")):
        columns = np.loadtxt(DATASETS / "yan9a-dbo" / file)
        channels = {"drive_voltage": (columns[:, 0], "V"), "stage_position": (columns[:, 4], "um")}
        found[name] = ss.make_recording(np.arange(len(columns)) / 200.0, channels)
    return found


@pytest.fixture(scope="module")
def model_fit(yan9a: dict[str, xr.Dataset]) -> Fit:
    return ss.identify_piezo([yan9a["model"]])


@pytest.mark.parametrize("seed", [1, 7])
def test_truth_is_found_and_predicts(seed: int) -> None:
    """The number of plays, asymmetry and creep chosen; then other motions, at another level of the sensor."""
    of = truth(seed)
    fit = ss.identify_piezo(recording(of, drive(seed), noise_of(of), seed))
    assert fit.values["gain"] == pytest.approx(of.gain, rel=3e-3)
    assert fit.values["creep"] == pytest.approx(of.creep, rel=0.05)
    assert fit.values["delay"] == pytest.approx(of.delay, abs=0.03 / RATE)
    assert fit.values["lag"] == pytest.approx(of.lag, rel=0.02)
    unseen = recording(of, drive(seed + 500), 0.0, level=-1e-6)
    error = fit.predict(unseen) - unseen.stage_position.values  # type: ignore[misc]
    assert np.sqrt(np.mean(error**2)) < 2.0 * noise_of(of)
    assert not fit.failures


def test_measured_piezo_predicts_another_recording(yan9a: dict[str, xr.Dataset], model_fit: Fit) -> None:
    """Fitted to a sine of 1 Hz, predicting other amplitudes and rests: the aim is 0.22 um rms."""
    error = model_fit.predict(yan9a["test"]) - yan9a["test"].stage_position.values  # type: ignore[misc]
    assert np.sqrt(np.mean(error**2)) < 0.21e-6
    assert model_fit.rmse < 0.12e-6  # 0.17 without a skew
    assert 0.01 < model_fit.values["creep"] < 0.03
    linear = ss.identify_piezo([yan9a["model"]], operators=1, asymmetric=False, creep=False)
    left = linear.predict(yan9a["test"]) - yan9a["test"].stage_position.values  # type: ignore[misc]
    assert np.sqrt(np.mean(left**2)) > 5.0 * np.sqrt(np.mean(error**2))
    assert any("edge" in remark for remark in model_fit.remarks)


def test_measured_piezo_predicts_without_an_edge(yan9a: dict[str, xr.Dataset]) -> None:
    """Fitted to periods of the sine alone, amid its motion: without a lag 0.68 um would be left."""
    sine = yan9a["model"].isel(time=slice(400, None))
    fit = ss.identify_piezo(sine)
    error = fit.predict(yan9a["test"]) - yan9a["test"].stage_position.values  # type: ignore[misc]
    assert np.sqrt(np.mean(error**2)) < 0.26e-6
    assert 0.012 < fit.values["lag"] < 0.02


def test_inverse_of_one_recording_tracks_by_the_model_of_the_other(
    yan9a: dict[str, xr.Dataset], model_fit: Fit
) -> None:
    other = ss.identify_piezo([yan9a["test"]])
    time = np.arange(0.0, 20.0, 0.005)
    middle = float(yan9a["test"].stage_position.mean())
    wanted = middle + 20e-6 * np.sin(2.0 * np.pi * time) * np.exp(-time / 15.0)
    drive = ss.inverse_drive(model_fit, time, wanted)
    shown = ss.make_recording(time, {"drive_voltage": (drive.values, "V"), "stage_position": (wanted, "m")})
    assert np.std(other.predict(shown) - wanted) < 0.14e-6  # type: ignore[misc]
    assert np.std(model_fit.predict(shown) - wanted) < 0.008e-6  # type: ignore[misc]
    expected = ss.identify.inverse_residual(model_fit, drive, wanted)
    assert 0.5 < np.std(other.predict(shown) - wanted) / expected < 1.5  # type: ignore[misc]
    with pytest.raises(QuantityError, match="positions"):
        ss.identify.inverse_residual(model_fit, drive, wanted[1:])


def test_inverse_drive_goes_where_it_shall() -> None:
    """By the truth, not by the fit: hysteresis, creep, delay and lag are undone."""
    of = truth(2)
    fit = ss.identify_piezo(recording(of, drive(2), noise_of(of), 2))
    time = np.arange(int(5.0 * RATE)) / RATE
    wanted = 3e-6 + of.gain * (45.0 + 25.0 * np.sin(2.0 * np.pi * time) * np.cos(0.7 * time))
    drive_ = ss.inverse_drive(fit, time, wanted)
    reached = recording(of, drive_.value(time), 0.0).stage_position.values
    assert np.std((reached - wanted)[200:]) < 2e-3 * np.ptp(wanted)
    straight = recording(of, np.interp(wanted, [wanted.min(), wanted.max()], [20.0, 70.0]), 0.0)
    assert np.std((straight.stage_position.values - wanted)[200:]) > 0.02 * np.ptp(wanted)


def test_the_error_of_an_inverse_drive_that_starts_from_a_given_rest() -> None:
    """The piezo rests at 20 V, far from the first position: no drive undoes the lag of that jump."""
    of = truth(2)
    fit = ss.identify_piezo(recording(of, drive(2), noise_of(of), 2))
    time = np.arange(int(5.0 * RATE)) / RATE
    wanted = 3e-6 + of.gain * (45.0 + 25.0 * np.sin(2.0 * np.pi * time) * np.cos(0.7 * time))
    found = ss.inverse_drive(fit, time, wanted, rest_voltage="20 V")
    volts = np.concatenate([[20.0, 20.0], found.values])
    times = np.concatenate([[0.0, 0.1 - 1e-7], 0.1 + time])  # the drive jumps to its first value
    shown = fit.predict(ss.make_recording(times, {"drive_voltage": volts}))  # type: ignore[misc]
    expected = np.hypot(fit.rmse, np.std(shown[2:] - wanted))
    error = ss.identify.inverse_residual(fit, found, wanted, rest_voltage="20 V")
    assert error == pytest.approx(expected, rel=0.05)
    assert expected > 1.5 * ss.identify.inverse_residual(fit, found, wanted)


def test_recordings_are_fitted_together() -> None:
    of = truth(4)
    both = [recording(of, drive(seed), noise_of(of), seed, level) for seed, level in ((4, 0.0), (9, 5e-6))]
    fit = ss.identify_piezo(both, **KNOWN)  # type: ignore[arg-type]
    assert fit.values["offset_2"] - fit.values["offset_1"] == pytest.approx(5e-6, abs=10.0 * noise_of(of))
    assert fit.values["gain"] == pytest.approx(of.gain, rel=3e-3)


def test_rest_before_the_recording_is_seen() -> None:
    """The record begins at 60 V, right after a rest at 0 V."""
    of = truth(6)
    volts = np.append(np.zeros(100), 60.0 + 40.0 * np.sin(2.0 * np.pi * np.arange(4000) / RATE))
    whole = recording(of, volts, noise_of(of), 6)
    cut = whole.isel(time=slice(100, None))
    fit = ss.identify_piezo(cut)
    wrong = ss.identify_piezo(cut, rest_voltage="60 V")
    with pytest.warns(ss.recording.RecordingWarning, match="0 V to 100 V; the fit is of .* 20 V to 100 V"):
        found, assumed = (
            np.sqrt(np.mean((one.predict(whole) - whole.stage_position.values)[120:] ** 2))  # type: ignore[misc]
            for one in (fit, wrong)
        )
    assert found < 4e-3 * of.gain * HIGH
    assert assumed > 1.5 * found


def test_it_goes_into_an_actuator_and_into_a_file(tmp_path: Path) -> None:
    of = truth(8)
    record = recording(of, drive(8), noise_of(of), 8)
    fit = ss.identify_piezo(record, ss.load_actuator("kang2007"), **KNOWN)  # type: ignore[arg-type]
    assert fit.model.gain == fit.values["gain"]
    assert isinstance(fit.model.piezo, Piezo)
    ss.save_fit(fit, tmp_path / "piezo.json")
    again = ss.load_fit(tmp_path / "piezo.json")
    np.testing.assert_array_equal(again.predict(record), fit.predict(record))  # type: ignore[misc]
    assert again.model == fit.model
    assert again.report() == fit.report()
    assert ss.verify(again, [record]).r_squared > 0.9999


def test_a_model_that_lacks_is_noticed() -> None:
    """By what repeats from period to period: a straight line always, the truth not."""
    time = np.arange(6000) / RATE
    volts = np.where(time >= 0.5, 50.0 - 50.0 * np.cos(2.0 * np.pi * (time - 0.5)), 0.0)
    for seed in range(1):
        of = truth(seed)._replace(delay=0.0, lag=1e-6)
        shown = recording(of, volts, noise_of(of), seed)
        assert not ss.identify_piezo(shown, **KNOWN).failures  # type: ignore[arg-type]
        linear = ss.identify_piezo(shown, operators=1, asymmetric=False, creep=False)
        assert any("does not explain recording 1" in said for said in linear.failures)


def test_time_constants_may_be_given() -> None:
    of = truth(3)
    shown = recording(of, drive(3), noise_of(of))
    fit = ss.identify_piezo(shown, creep=True, time_constants=["0.2 s", "1 s", "5 s"])
    assert fit.model.creep.time_constants == (0.2, 1.0, 5.0)
    assert fit.values["creep"] == pytest.approx(of.creep, rel=0.4)


def test_without_edges_a_lag_is_not_made_up() -> None:
    of = truth(2)._replace(lag=1e-6, delay=0.0)
    volts = 50.0 - 50.0 * np.cos(2.0 * np.pi * np.arange(3000) / RATE)
    fit = ss.identify_piezo(recording(of, volts, noise_of(of)))
    assert fit.values["lag"] == 0.0
    assert any("no edges" in remark for remark in fit.remarks)


def test_what_cannot_be_identified_is_refused_by_name() -> None:
    of = truth(1)
    rising = recording(of, np.linspace(0.0, HIGH, 600), noise_of(of))
    with pytest.raises(RecordingError, match=r"drive_voltage .V. of recording 1 has no reversal"):
        ss.identify_piezo(rising)
    short = recording(of, drive(1)[:600], noise_of(of))
    with pytest.raises(QuantityError, match=r"creep = True, but the recordings last 1\.2 s"):
        ss.identify_piezo(short, creep=True)
    assert any("creep is left out" in remark for remark in ss.identify_piezo(short).remarks)
    with pytest.raises(QuantityError, match=r"time_constants has 30 s, which recordings of 1\.2 s do not"):
        ss.identify_piezo(short, time_constants=["0.5 s", "30 s"])
    holed = short.copy(deep=True)
    holed["stage_position"][5] = np.nan
    with pytest.raises(RecordingError, match=r"stage_position .m. of recording 1 is not finite"):
        ss.identify_piezo(holed)
    mirrored = short.assign(stage_position=-short["stage_position"])
    with pytest.raises(
        RecordingError, match=r"stage_position .m. of recording 1 goes down where drive_voltage"
    ):
        ss.identify_piezo(mirrored)


@pytest.mark.parametrize("held", [False, True], ids=["sine", "held at its ends"])
def test_coarse_steps_are_not_taken_for_a_clipped_sensor(held: bool) -> None:
    """0.5 um of 36 um: they hide the turns of the stroke; what a fit finds is finer than they are."""
    of = Truth(
        Piezo(PrandtlIshlinskii((0.0, 10.0, 30.0, 60.0), (0.6, 0.15, 0.15, 0.1))), 0.13e-6, 0.0, 0.0, 0.0
    )
    t, step = np.arange(4000) / 1000.0, 0.5e-6
    volts = np.clip((200.0 if held else 150.0) * np.sin(2.0 * np.pi * t), -150.0, 150.0)
    stroke = of.gain * reference.prandtl_ishlinskii(of.piezo.hysteresis, volts, 0.0)

    def shown(position: NDArray[np.float64]) -> xr.Dataset:
        read = step * np.round(position / step)
        return ss.make_recording(t, {"drive_voltage": (volts, "V"), "stage_position": (read, "m")})

    fit = ss.identify_piezo([shown(stroke)])
    error = fit.predict(shown(stroke)) - stroke  # type: ignore[misc]
    assert float(np.std(error)) < 0.2 * step  # rounding alone leaves 0.29
    with pytest.raises(RecordingError, match=r"stage_position .m. of recording 1 is clipped"):
        ss.identify_piezo([shown(np.minimum(stroke, 15e-6))])


def test_inverse_says_where_it_does_not_hold() -> None:
    of = truth(1)
    fit = ss.identify_piezo(recording(of, drive(1), noise_of(of)), **KNOWN)  # type: ignore[arg-type]
    time = np.linspace(0.0, 1.0, 100)
    with pytest.warns(ss.recording.RecordingWarning, match="the fit is of recordings from"):
        ss.inverse_drive(fit, time, np.linspace(0.0, 200.0 * of.gain, 100))
    wide = ss.make_recording(time, {"drive_voltage": (np.linspace(0.0, 190.0, 100), "V")})
    with pytest.warns(
        ss.recording.RecordingWarning, match="from 0 V to 190 V; the fit is of recordings from"
    ):
        fit.predict(wide)  # type: ignore[misc]
    with pytest.raises(FitError, match="needs a fit of identify_piezo"):
        ss.inverse_drive(ss.load_actuator("kang2007"), time, np.zeros(100))  # type: ignore[arg-type]
    with pytest.raises(QuantityError, match="not finite at sample 3"):
        ss.inverse_drive(fit, time, np.where(np.arange(100) == 3, np.nan, 5e-6))


@pytest.mark.parametrize("creeps", [True, False])
def test_noise_does_not_hide_creep_from_the_choice(creeps: bool) -> None:
    """White noise of 1 % of the stroke is most of what every model leaves of the parts left out."""
    for seed in (3,):
        of = truth(seed) if creeps else truth(seed)._replace(creep=0.0)
        fit = ss.identify_piezo(recording(of, drive(seed), 1e-2 * of.gain * HIGH, seed))
        unseen = recording(of, drive(seed + 500), 0.0, level=-1e-6)
        error = fit.predict(unseen) - unseen.stage_position.values  # type: ignore[misc]
        assert np.sqrt(np.mean(error**2)) < 1e-3 * np.ptp(unseen.stage_position.values)
        assert "creep" in fit.values or not creeps
