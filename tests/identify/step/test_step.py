"""Step responses: the printed formulas, the full fit, and how far the formulas are off."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import signal

from identify.step_system import START, TRUTH, step_recording
from stickslip.estimate.coloured import Coloured, autoregression, coloured, scores, with_inherited
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.identify.step import fit as step_fit
from stickslip.identify.step.fit import identify_step, step_formula_errors
from stickslip.identify.step.formulas import Timing, classical, step_features
from stickslip.identify.step.linear import filter_zeros_poles, second_order_poles, step_response
from stickslip.identify.step.recorded_step import StepTest, step_tests
from stickslip.physics.actuator import load_actuator
from stickslip.physics.electronics import Filter
from stickslip.recording import RecordingError, make_recording

VOLTS = (60.0, 70.0, 80.0)
# A fit's delay is that of the sensor in all.
EXPECTED = {**TRUTH, "delay": TRUTH["delay"] + TRUTH["lag"]}


def test_formulas_without_sensor() -> None:
    """Of an exact response the formulas give the truth, but for the onset, which is found to some 20 us."""
    found = step_features([step_recording(v, lag=1e-9) for v in VOLTS])
    np.testing.assert_allclose(found["voltage"], VOLTS)
    np.testing.assert_allclose(found["delay"], TRUTH["delay"], atol=3e-5)
    overshoot = math.exp(-math.pi * 0.524 / math.sqrt(1 - 0.524**2))
    np.testing.assert_allclose(found["overshoot"], overshoot, atol=2e-3)
    np.testing.assert_allclose(found["peak_time"], math.pi / 3303.1 / math.sqrt(1 - 0.524**2), atol=6e-5)
    assert found.attrs["damping_ratio"] == pytest.approx(0.524, abs=3e-3)
    assert found.attrs["natural_frequency"] == pytest.approx(3303.1, rel=0.05)
    assert found.attrs["gain"] == pytest.approx(0.1057e-6, rel=1e-3)
    assert found.attrs["r_squared"] > 0.998
    given = step_features([step_recording(v, lag=1e-9) for v in VOLTS], delay=TRUTH["delay"])
    assert given.attrs["natural_frequency"] == pytest.approx(3303.1, rel=0.03)


def test_fit_is_exact_without_noise() -> None:
    model = load_actuator("kang2007")
    fit = identify_step([step_recording(v) for v in VOLTS], model)
    for name, true in EXPECTED.items():
        assert fit.values[name] == pytest.approx(true, rel=5e-3), name
    assert fit.r_squared > 0.999999
    assert fit.model.natural_frequency == fit.values["natural_frequency"]
    assert fit.model.friction == model.friction


def test_truth_lies_in_the_intervals_of_a_noisy_fit_and_not_at_the_formulas() -> None:
    recordings = [step_recording(v, 0.125e-6, seed) for seed, v in enumerate(VOLTS)]
    fit = identify_step(recordings)
    assert fit.converged
    for name, (low, high) in fit.confidence_intervals(0.99).items():
        assert low < EXPECTED.get(name, 0.0) < high, name
    assert 0.99 < fit.r_squared < 1.0
    assert fit.rmse == pytest.approx(0.125e-6, rel=0.15)
    assert "residuals are correlated" not in fit.report()
    errors = step_formula_errors(fit, recordings, n=40).sel(parameter="natural_frequency")
    said = step_features(recordings).attrs["natural_frequency"]
    expected = float(errors["fitted"] + errors["by_sensor"] + errors["by_noise"])
    assert abs(said - expected) < 3 * float(errors["scatter"])
    # The lag of 60 us alone makes the peak come late: by about that, of 1117 us.
    assert -0.12 < float(errors["by_sensor"]) / TRUTH["natural_frequency"] < -0.01
    assert float(errors["by_noise"]) < 0.0


def test_repetitions_without_a_peak_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise may bring the greatest sample too early, which the formulas refuse: here every tenth time."""
    recordings = [step_recording(v, 0.125e-6, seed) for seed, v in enumerate(VOLTS)]
    fit, calls = identify_step(recordings), itertools.count()

    def sometimes(test: StepTest, timing: Timing) -> dict[str, float]:
        if next(calls) % 10 == 9:
            raise RecordingError("too coarsely sampled")
        return classical(test, timing)

    monkeypatch.setattr(step_fit, "classical", sometimes)
    errors = step_formula_errors(fit, recordings, n=40)
    assert np.all(np.isfinite(errors["by_noise"]))
    assert np.all(errors["scatter"] > 0.0)


def test_known_slew_and_filter_are_no_lag() -> None:
    slew = 60.0 / 2e-4
    fit = identify_step([step_recording(v, rise=v / slew) for v in VOLTS], slew_rate=slew)
    for name, true in EXPECTED.items():
        assert fit.values[name] == pytest.approx(true, rel=5e-3), name
    ignored = identify_step([step_recording(v, rise=v / slew) for v in VOLTS])
    assert ignored.values["delay"] > EXPECTED["delay"] + 5e-5


@pytest.mark.parametrize("family", ["bessel", "elliptic"])
def test_step_response_against_scipy(family) -> None:
    """Zeros, double poles and a ramp included."""
    low = Filter(3, 2e3, family)
    zeros, poles = filter_zeros_poles(low)
    poles = [*poles, *second_order_poles(1.0, 3000.0)]
    gain = float(np.real(np.prod([-p for p in poles]) / np.prod([-z for z in zeros])))
    t = np.linspace(0.0, 4e-3, 81)
    expected = signal.step(signal.ZerosPolesGain(zeros, poles, gain), T=t)[1]
    np.testing.assert_allclose(step_response(t, poles, zeros), expected, atol=2e-5)
    fine = np.linspace(0.0, 4e-3, 8001)
    ramp = signal.lsim(signal.ZerosPolesGain(zeros, poles, gain), np.clip(fine / 5e-4, 0, 1), fine)[1]
    np.testing.assert_allclose(step_response(t, poles, zeros, 5e-4), ramp[::100], atol=2e-5)


def test_autoregression_and_random_walk_are_found_in_noise() -> None:
    random = np.random.default_rng(0)
    x = signal.lfilter([1.0], [1.0, -1.2, 0.5], random.standard_normal(20_000))
    a, variance = autoregression([x[:8000], x[8000:]])
    np.testing.assert_allclose(a[:3], [1.0, -1.2, 0.5], atol=0.03)
    assert variance == pytest.approx(1.0, rel=0.03)
    assert coloured([x], walks=False).autocovariance[1] == pytest.approx(np.mean(x[1:] * x[:-1]), rel=0.02)
    white = random.standard_normal(4000)
    walk = 0.02 * np.cumsum(random.standard_normal(4000))
    assert coloured([white], walks=True).walk == 0.0
    both = coloured([white + walk, white[::-1] + walk], walks=True)
    assert both.walk == pytest.approx(0.02**2, rel=0.7)
    assert both.autocovariance[0] == pytest.approx(1.0, rel=0.05)
    assert coloured([white]).autocovariance == pytest.approx([np.mean(white**2)], rel=1e-3)
    assert coloured([np.zeros(50)], walks=True) == (pytest.approx([0.0]), 0.0)


def test_scores_against_the_full_matrix() -> None:
    random = np.random.default_rng(1)
    pieces = [random.standard_normal((n, 3)) for n in (40, 25)]
    lags = np.array([2.0, 0.7, -0.3])
    expected = np.zeros((3, 3))
    for j in pieces:
        i = np.arange(len(j))
        apart = np.abs(i[:, None] - i)
        sigma = np.where(apart < 3, lags[np.minimum(apart, 2)], 0.0) + 0.1 * np.minimum(i[:, None], i)
        expected += j.T @ sigma @ j
    np.testing.assert_allclose(scores(pieces, Coloured(np.pad(lags, (0, 60)), 0.1)), expected)


def test_uncertainty_of_what_was_taken_as_known_is_passed_on() -> None:
    """y = a t + b, b known to 0.3 only: a moves by -b sum(t) / sum(t^2)."""
    t = np.linspace(0.0, 2.0, 50)
    y = 3.0 * t + 1.0 + 0.01 * np.random.default_rng(0).standard_normal(50)
    slope = Parameter("a", 1.0, -10.0, 10.0, log=False)
    fit = fit_least_squares([Residuals(lambda v: v["a"] * t + 1.0 - y, y)], [slope])
    wider = with_inherited(fit, np.ones((50, 1)), np.array([[0.3**2]]))
    added = 0.3 * t.sum() / (t @ t)
    expected = math.hypot(fit.standard_errors["a"], added)
    assert wider.standard_errors["a"] == pytest.approx(expected, rel=1e-6)


def _clipped():
    recording = step_recording(60.0, 0.05e-6)
    position = np.minimum(recording["end_effector_position"], 6.2e-6)
    return recording.assign(end_effector_position=position)


def _driven(volts: np.ndarray):
    t = step_recording(60.0)["time"].values
    position = step_recording(60.0)["end_effector_position"].values
    return make_recording(t, {"drive_voltage": volts, "end_effector_position": position}, title="60 V")


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (lambda: step_recording(60.0)[["drive_voltage"]], r"has no end_effector_position \[m\]"),
        (lambda: _driven(np.full(1600, 60.0)), r"drive_voltage \[V\] of 60 V is 60 throughout"),
        (lambda: _driven(np.arange(1600) % 200 / 4.0), "is not one step"),
        (lambda: step_recording(60.0, 1e-6, gain=1e-9), "drowns in the noise"),
        (_clipped, "is clipped: it stays at its greatest value"),
        (lambda: step_recording(60.0).isel(time=slice(0, 630)), "after its step, amid its motion"),
        (lambda: step_recording(60.0).isel(time=slice(0, None, 8)), "too coarsely sampled"),
    ],
)
def test_refusals(recording, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        identify_step(recording())
    with pytest.raises(RecordingError, match="recordings is empty"):
        identify_step([])


@pytest.mark.parametrize("seed", [1, 4])
def test_the_output_of_an_amplifier_that_rises_over_several_samples_is_a_step(seed: int) -> None:
    random = np.random.default_rng([seed, 7])
    height, interval = float(random.choice([-1.0, 1.0]) * random.uniform(5.0, 90.0)), 50e-6
    rise, at = float(random.uniform(0.5, 30.0)) * interval, 0.02 + float(random.uniform(0.0, interval))
    t = np.arange(1600) * interval
    volts = 20.0 + height * np.clip((t - at) / rise, 0.0, 1.0)
    volts += 5e-5 * abs(height) * random.standard_normal(t.size)
    (test,) = step_tests(_driven(volts))
    assert -1.01 * interval < t[0] - test.time[0] - at < 1.01 * interval
    if rise > 3.0 * interval:
        assert t[0] - test.time[0] == pytest.approx(at, abs=0.05 * interval)
    assert test.voltage == pytest.approx(height, rel=2e-4)
    assert test.rest == pytest.approx(20.0, abs=0.01)


def test_steps_without_drive_channel_and_downwards() -> None:
    down = step_recording(-60.0)[["end_effector_position"]]
    fit = identify_step(down, voltages=[-60.0], start=START)
    assert fit.values["gain"] == pytest.approx(TRUTH["gain"], rel=2e-3)
    assert fit.values["damping_ratio"] == pytest.approx(TRUTH["damping_ratio"], rel=5e-3)
    with pytest.raises(RecordingError, match="not within the recording"):
        identify_step(down, voltages=[-60.0], start=1.0)


def test_a_given_instant_counts_also_where_the_height_comes_from_the_drive() -> None:
    recording = step_recording(60.0)
    time = recording["time"].values
    (test,) = step_tests(recording, start=f"{START - 1e-3} s")
    assert time - test.time == pytest.approx(START - 1e-3, abs=1e-12)
    assert (test.voltage, test.rest) == (60.0, 0.0)
    fit = identify_step(recording, start=START - 1e-3)
    assert fit.values["delay"] == pytest.approx(EXPECTED["delay"] + 1e-3, abs=5e-6)
    with pytest.raises(RecordingError, match="not within the recording"):
        step_tests(recording, start=1.0)


def test_steps_of_different_heights_without_drive_channel_are_predicted_with_their_own() -> None:
    heights = [-60.0, 30.0]
    steps = [step_recording(volts, 1e-9, seed) for seed, volts in enumerate(heights)]
    bare = [one[["end_effector_position"]] for one in steps]
    fit = identify_step(bare, voltages=heights, start=START)
    assert fit.predict is not None
    for full, alone, volts in zip(steps, bare, heights, strict=True):
        for predicted in (fit.predict(full), fit.predict(alone, volts)):
            left = predicted - full["end_effector_position"].values
            assert np.std(left) < 0.01 * abs(volts) * TRUTH["gain"]
        with pytest.raises(RecordingError, match="drive_voltage"):
            fit.predict(alone)
    errors = step_formula_errors(fit, bare, voltages=heights, start=START, n=5)
    assert abs(float(errors.by_sensor.sel(parameter="gain"))) < 0.02 * TRUTH["gain"]


def test_an_inverted_sensor_has_a_negative_gain() -> None:
    """The peak is the lowest sample then."""
    recordings = [step_recording(v, 0.05e-6, seed, gain=-TRUTH["gain"]) for seed, v in enumerate(VOLTS)]
    fit = identify_step(recordings)
    assert fit.values["gain"] == pytest.approx(-TRUTH["gain"], rel=5e-3)
    assert fit.values["natural_frequency"] == pytest.approx(TRUTH["natural_frequency"], rel=0.02)
    assert step_features(recordings).attrs["damping_ratio"] == pytest.approx(0.524, rel=0.1)


def test_a_delay_beyond_the_steady_value_is_found_or_said() -> None:
    late = step_recording(60.0, 1e-9, delay=6e-3)
    for timing in (None, Timing(steady_after=12e-3), Timing(rise_at=6e-3)):
        fit = identify_step(late, timing=timing)
        assert fit.values["delay"] == pytest.approx(6e-3 + TRUTH["lag"], rel=5e-3)
    with pytest.raises(RecordingError, match="steady_after of the timing must be longer than delay"):
        identify_step(late, timing=Timing())


def test_three_milliseconds_after_the_step_are_enough() -> None:
    """Two peak times after the rise: what settles later follows from the model."""
    fit = identify_step(step_recording(60.0, 1e-9).isel(time=slice(0, 660)))
    for name, (low, high) in fit.confidence_intervals(0.999).items():
        assert low <= EXPECTED.get(name, 0.0) <= high or name.startswith("offset"), name


def test_overdamped_steps() -> None:
    fit = identify_step([step_recording(v, damping_ratio=1.4, lag=1e-9) for v in VOLTS], lag=False)
    assert fit.values["damping_ratio"] == pytest.approx(1.4, rel=5e-3)
    assert fit.values["natural_frequency"] == pytest.approx(3303.1, rel=5e-3)


def test_a_gain_that_no_stage_has_is_said() -> None:
    recordings = [step_recording(voltage) for voltage in (60.0, 70.0)]
    right = identify_step(recordings)
    assert not any("mirror" in one or "units" in one for one in right.remarks)
    for factor, said in ((-1.0, "falls where the voltage rises: mirror"), (1e6, "are the units right?")):
        turned = [
            make_recording(
                r["time"].values,
                {
                    "drive_voltage": r["drive_voltage"].values,
                    "end_effector_position": factor * r["end_effector_position"].values,
                },
            )
            for r in recordings
        ]
        assert any(said in one for one in identify_step(turned).remarks)


def test_a_recording_counts_once() -> None:
    one = step_recording(60.0)
    with pytest.raises(RecordingError, match="recordings 1 and 2 are the same: it would count twice"):
        identify_step([one, one.copy(deep=True)])
