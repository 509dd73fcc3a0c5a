"""Mass and friction of a driven body, by simulated motion in open and in closed loop."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.loops.inertia import identify_inertia
from stickslip.recording import make_recording

TRUTH = {"mass": 2.0, "viscous": 5.0, "coulomb_force": 1.5, "offset": 0.3}


@cache
def driven(seed: int, closed: bool = False, noise: float = 1e-6, turns: bool = False):
    """By the midpoint rule: a body under a force of two sines, or of a controller that follows them."""
    random = np.random.default_rng(seed)
    h, rate, n = 4e-5, 25, 4000
    phase = random.uniform(0.0, 6.28, 2)

    def force_at(t: float, x: float, v: float) -> float:
        wanted = math.sin(6.0 * t + phase[0]) + 0.5 * math.sin(15.0 * t + phase[1])
        return 400.0 * (0.1 * wanted - x) - 20.0 * v if closed else 20.0 * wanted

    def acceleration(t: float, x: float, v: float) -> float:
        friction = TRUTH["viscous"] * v + math.copysign(TRUTH["coulomb_force"], v)
        return (force_at(t, x, v) - friction - TRUTH["offset"]) / TRUTH["mass"]

    x, v = 0.0, 0.0
    xs, fs = np.empty(n), np.empty(n)
    for i in range(n * rate):
        t = i * h
        if i % rate == 0:
            xs[i // rate], fs[i // rate] = x, force_at(t, x, v)
        middle = v + 0.5 * h * acceleration(t, x, v)
        x, v = x + h * middle, v + h * acceleration(t + 0.5 * h, x + 0.5 * h * v, middle)
    xs = xs + noise * random.standard_normal(n)
    fs = fs + 0.05 * random.standard_normal(n)
    time = np.arange(n) * h * rate
    position, force = ("angle", "torque") if turns else ("position", "force")
    channels = {position: (xs, "rad" if turns else "m"), force: (fs, "N m" if turns else "N")}
    return make_recording(time, channels, title=f"run {seed}")


@pytest.mark.parametrize("closed", [False, True], ids=["open loop", "closed loop"])
def test_values_and_their_intervals(closed: bool) -> None:
    inside = []
    for seed in range(2):
        fit = identify_inertia(driven(seed, closed), window=0.15)
        for name, true in TRUTH.items():
            low, high = fit.confidence_intervals()[name]
            inside.append(low < true < high)
            assert fit.values[name] == pytest.approx(true, rel=0.05, abs=0.03), name
    assert np.mean(inside) > 0.8


@pytest.mark.parametrize("window", [0.016, 0.03])
def test_where_the_body_is_makes_no_force_in_windows_of_few_samples(window: float) -> None:
    """Far from zero, sums of few samples told an offset of many newtons and a negative friction."""
    time = np.linspace(0.0, 2.0, 2001)
    phase = 10.0 * np.pi * time
    position = 1e-2 + 1e-4 * np.sin(phase) + 1e-8 * np.random.default_rng(0).standard_normal(time.size)
    force = -2.0 * (10.0 * np.pi) ** 2 * 1e-4 * np.sin(phase) + 5.0 * 1e-3 * np.pi * np.cos(phase) + 0.3
    tied = {"coulomb_force": "'0 N'"}
    fit = identify_inertia(
        make_recording(time, {"position": position, "force": force}), window=window, tied=tied
    )
    for name in ("mass", "viscous", "offset"):
        low, high = fit.confidence_intervals(0.99)[name]
        assert low < TRUTH[name] < high, name
    assert not fit.failures


def test_what_no_body_has_is_said() -> None:
    run = driven(0)
    (said,) = identify_inertia(run.assign(force=-run["force"]), window=0.15).failures
    assert "the mass is negative" in said
    late = run.isel(time=slice(60, None)).copy()
    late["position"] = ("time", run["position"].values[:-60])
    (said,) = identify_inertia(late, window=0.15).failures
    assert "viscous friction is negative: the position is late" in said
    assert not identify_inertia(run, window=0.15).failures


def test_what_the_body_is_not_is_remarked() -> None:
    """Friction that grows with the square of the speed, in the force: the noise of neither tells it."""
    for seed in range(1):
        run = driven(seed)
        assert not identify_inertia(run, window=0.15).remarks
        speed = np.gradient(run["position"].values, run["time"].values)
        other = run.assign(force=run["force"] + 3.0 * speed * np.abs(speed))
        (said,) = identify_inertia(other, window=0.15).remarks
        assert f"what is left of run {seed}" in said
        assert "another force acts" in said


def remarked(seeds: range, noise: float, wrong: str = "", tones: bool = True) -> int:
    """In how many random cases something is left: sines, exact but for white noise of the force and that of
    the position, in parts of its amplitude."""
    count = 0
    for seed in seeds:
        random = np.random.default_rng(seed)
        amplitude, mass, rate = 10.0 ** random.uniform([-5, -2, 2.5], [-2, 1, 2.9])  # rate: samples a period
        w = 2.0 * np.pi * 10.0 ** random.uniform(-0.3, 1.0)
        time = np.arange(int(8.3 * rate)) * 2.0 * np.pi / (w * rate)
        speeds, phase = np.array([[w], [2.3 * w]]), w * time + random.uniform(0.0, 6.28)
        sines = np.exp(1j * np.array([phase, 2.3 * phase])) * [[amplitude], [0.4 * amplitude * tones]]
        x, v, a = (np.sum(((1j * speeds) ** k * sines).imag, axis=0) for k in range(3))
        coulomb = mass * amplitude * w**2 * random.uniform(0.05, 1.0)
        force = mass * a + mass * w * random.uniform(0.05, 0.5) * v + coulomb * (np.sign(v) + 0.3)
        if wrong == "spring":
            force += 0.3 * mass * w**2 * x
        if wrong == "Stribeck":
            force += 0.6 * coulomb * np.sign(v) * np.exp(-((v / (0.2 * amplitude * w)) ** 2))
        force += coulomb * random.choice([0.005, 0.02]) * random.standard_normal(time.size)
        x += noise * amplitude * random.standard_normal(time.size)
        if wrong == "lag":
            force = np.roll(force, int(0.01 * rate))
        run = make_recording(time, {"position": x, "force": force})
        fit = identify_inertia(run, window=0.25 * 2.0 * np.pi / w / (2.3 if tones else 1.0))
        count += any("another force acts" in one for one in fit.remarks)
    return count


@pytest.mark.parametrize("tones", [False, True], ids=["a sine", "two sines"])
@pytest.mark.parametrize("noise", [0.0, 3e-5])
def test_noise_of_the_position_is_no_other_force(noise: float, tones: bool) -> None:
    """A sample at rest whose sign is wrong moves an average by many times what noise of the force does."""
    assert remarked(range(4), noise, tones=tones) == 0


@pytest.mark.parametrize("wrong", ["spring", "Stribeck", "lag"])
@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_a_wrong_form_is_seen_through_noise_of_the_position(wrong: str, noise: float) -> None:
    assert remarked(range(2), noise, wrong) == 2


def test_averages_whose_sign_is_not_sure_hide_no_misfit_of_the_others() -> None:
    """Averaged over all windows alike, they hid it in three of four."""
    assert remarked(range(5), 3e-4, "Stribeck", tones=False) >= 4


def test_what_turns_has_a_moment_of_inertia() -> None:
    fit = identify_inertia(driven(0, turns=True), window=0.15, position="angle", force="torque")
    units = {p.name: p.unit for p in fit.parameters}
    assert units == {"mass": "kg m^2", "viscous": "N m s/rad", "coulomb_force": "N m", "offset": "N m"}
    assert fit.values["mass"] == pytest.approx(2.0, rel=0.05)


def test_a_window_that_fits_no_recording_is_refused() -> None:
    with pytest.raises(ss.estimate.FitError, match=r"a window of 0\.005 s spans 5 of the"):
        identify_inertia(driven(0), window=0.005)
    with pytest.raises(ss.estimate.FitError, match="no more than there are"):
        identify_inertia(driven(0), window=50.0)
    run = driven(0)
    time = run["time"].values
    a_sample_too_long = time.size * (time[-1] - time[0]) / (time.size - 1)
    with pytest.raises(ss.estimate.FitError, match="no more than there are"):
        identify_inertia(run, window=a_sample_too_long)
