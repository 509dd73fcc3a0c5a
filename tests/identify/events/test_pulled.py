"""The spring-pulled slider: against the closed form of its period, and on the measured paper-on-paper
slider."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.datasets import DATASETS

from stickslip.estimate.problem import FitError
from stickslip.identify.events.pulled import (
    PulledRig,
    identify_pulled_slider,
    simulated_force,
    slider,
    slip_events,
)
from stickslip.recording import make_recording
from stickslip.recording.readers import read_recording
from stickslip.simulation import simulate
from stickslip.waveform.shapes import Ramp

MASS = 30.7e-3
FOLDER = DATASETS / "lyon-stickslip"


def measured(stiffness: int, speed: int):
    path = FOLDER / f"k{stiffness}Nm_v{speed}.mat"
    recording = read_recording(path, {"time": "t", "force_ratio": "Fnorm"}, {"time": "s"})
    return recording, PulledRig(MASS, float(stiffness), speed * 1e-6)


def period(rig: PulledRig, static: float, dynamic: float) -> float:
    """Rest until stiction, then half an ellipse of slip: the classical result for two friction
    coefficients."""
    w, a = rig.natural_frequency, 9.80665 * (static - dynamic)
    return 2.0 * a / (rig.speed * w**2) + 2.0 / w * (math.pi - math.atan(a / (rig.speed * w)))


@pytest.mark.parametrize("speed", [4300e-6, 200e-6])
def test_simulated_period_and_forces_are_the_closed_form(speed: float) -> None:
    rig, static, dynamic = PulledRig(MASS, 168.0, speed), 0.37, 0.33
    events = slip_events(simulated_force(slider(rig, static, dynamic), rig), rig)
    top, bottom, found = events.summary()[0]
    assert found == pytest.approx(period(rig, static, dynamic), rel=5e-3)
    # The force swings about dynamic friction like a pendulum that starts with the speed of the pull; the
    # median # filter takes up to 1 - cos(pi/16) = 2 % off the swing, in simulation and measurement alike.
    swing = math.hypot(static - dynamic, speed * rig.natural_frequency / 9.80665)
    assert top == pytest.approx(dynamic + swing, abs=0.025 * swing)
    assert bottom == pytest.approx(dynamic - swing, abs=0.025 * swing)


def test_one_speed_predicts_regime_and_period_at_others() -> None:
    """Fitted at 168 N/m and 1.1 mm/s; the rest is prediction."""
    recording, rig = measured(168, 1100)
    fit = identify_pulled_slider(recording, rig)
    dynamic = fit.values["dynamic_coefficient"]
    static = dynamic + fit.values["stiction_excess"]
    assert 0.30 < dynamic < 0.36
    assert 0.35 < static < 0.39
    for stiffness, speed, regime, within in (
        (168, 4300, "inertial", 0.15),
        (1002, 4300, "inertial", 0.3),
        (1002, 42, "stick-slip", 0.3),
        (168, 42, "stick-slip", 0.6),  # paper's stiction changes with the time at rest; no law here knows
    ):
        other, other_rig = measured(stiffness, speed)
        found = slip_events(other, other_rig)
        predicted = slip_events(simulated_force(slider(other_rig, static, dynamic), other_rig), other_rig)
        assert found.regime == predicted.regime == regime
        assert np.mean(predicted.period) == pytest.approx(np.mean(found.period), rel=within)


def test_regimes_are_told_by_the_free_period() -> None:
    """Seven free periods apart is no inertial motion, though the force climbs at 0.3 of the rate at rest."""
    rig = PulledRig(MASS, 2254.0, 42e-6)
    free = 2.0 * math.pi / rig.natural_frequency
    time = np.arange(0.0, 60.0 * free, free / 200.0)
    phase = time / (7.0 * free) % 1.0
    height = 0.3 * rig.loading_rate * 7.0 * free
    force = 0.05 + height * np.where(phase < 0.93, phase / 0.93, (1.0 - phase) / 0.07)
    events = slip_events(make_recording(time, {"force_ratio": (force, "")}), rig)
    assert events.sticking < 0.5
    assert np.mean(events.period) == pytest.approx(7.0 * free, rel=0.01)
    assert events.regime == "stick-slip"
    assert events.impossible == ""


def test_a_period_shorter_than_the_free_one_is_remarked() -> None:
    """At 1002 N/m and 4.3 mm/s events come every 28.6 ms; 30.7 g on that spring would swing in 34.8 ms."""
    said = slip_events(*measured(1002, 4300)).impossible
    assert "every 28.6 ms, quicker than the free period 34.8 ms" in said
    assert "mass" in said
    assert slip_events(*measured(1002, 1100)).impossible == ""
    assert slip_events(*measured(168, 4300)).impossible == ""
    rig = PulledRig(MASS, 168.0, 4300e-6)
    made = simulated_force(slider(rig, 0.37, 0.33), rig)
    assert slip_events(made, rig).impossible == ""
    assert slip_events(made, rig._replace(mass=1.3 * MASS)).impossible != ""


def test_recordings_without_events_are_refused() -> None:
    time = np.arange(0.0, 5.0, 5e-4)
    rig = PulledRig(MASS, 168.0, 1100e-6)
    flat = make_recording(time, {"force_ratio": (np.full(time.size, 0.3), "")})
    assert slip_events(flat, rig).regime == "steady"
    with pytest.raises(FitError, match="0 stick-slip events"):
        identify_pulled_slider(flat, rig)
    with pytest.raises(FitError, match="too coarse"):
        slip_events(flat.isel(time=slice(None, None, 50)), rig)
    with pytest.raises(FitError, match="no channel 'force'"):
        slip_events(flat, rig, "force")


def test_intervals_hold_and_a_right_model_lacks_nothing() -> None:
    """Noise lifts every top and lowers every bottom; taken for the truth it was 0.8 to 6.6 half widths."""
    rng = np.random.default_rng(0)
    mass, stiffness = float(rng.uniform(0.02, 0.3)), float(rng.uniform(100.0, 2000.0))
    dynamic = float(rng.uniform(0.1, 0.5))
    excess, w = dynamic * float(rng.uniform(0.1, 0.6)), math.sqrt(stiffness / mass)
    deflection = excess * mass * 9.80665 / stiffness
    rig = PulledRig(mass, stiffness, float(rng.uniform(0.01, 0.2)) * deflection * w)
    interval = 0.03 / w
    model, end = slider(rig, dynamic + excess, dynamic), 45.0 * period(rig, dynamic + excess, dynamic)
    made = simulate(model, Ramp(rate=rig.speed, unit="m"), end, sample_rate=1.0 / interval)
    late = made.sel(time=slice(end / 8.0 + dynamic / rig.loading_rate, None))
    noise = excess * float(rng.uniform(0.005, 0.03)) * rng.standard_normal(late.sizes["time"])
    ratio = late["spring_force"].values / rig.weight + noise
    fit = identify_pulled_slider(make_recording(late["time"].values, {"force_ratio": (ratio, "")}), rig)
    assert fit.failures == ()
    for name, true in (("dynamic_coefficient", dynamic), ("stiction_excess", excess)):
        low, high = fit.confidence_intervals(0.999)[name]
        assert low <= true <= high
        assert high - low < 0.03 * true
