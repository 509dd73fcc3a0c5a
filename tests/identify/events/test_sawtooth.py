"""Features of walks: drawn staircases of known steps, and what may be wrong with them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from stickslip.identify.events.sawtooth import sawtooth_features
from stickslip.recording import RecordingError, make_recording

UP, DOWN, PERIOD, DELAY, START = 6.6e-6, 4.3e-6, 0.2, 3e-3, 0.21


def walk(
    noise: float = 0.0,
    jitter: float = 0.0,
    missing: tuple[int, ...] = (),
    sign: float = 1.0,
    vibration: float = 0.0,
    interval: float = 1e-3,
    drive: bool = True,
    seed: int = 0,
):
    """Eight periods up, and eight down after a pause: rises in lines of UP, falls at once by DOWN."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 4.2, interval)
    x, u = np.zeros(t.size), np.zeros(t.size)
    for begin, way in ((START, 1.0), (START + 2.1, -1.0)):
        slips = begin + PERIOD * (np.arange(8) + (way > 0)) + jitter * random.uniform(-1, 1, 8)
        edges = np.concatenate([[begin], slips]) if way > 0 else np.append(slips, begin + 8 * PERIOD)
        for k, (a, b) in enumerate(pairwise(edges)):
            skipped = k in missing
            for times, signal, rise, fall in ((t, u, 65.0, 65.0), (t - DELAY, x, UP, DOWN)):
                part = 0.0 if skipped else np.clip((times - a) / (b - a), 0.0, 1.0)
                after = times >= (b if way > 0 else a)
                signal += way * rise * part - (0.0 if skipped else way * fall * after)
            if vibration and not skipped:
                since = t - DELAY - (b if way > 0 else a)
                ring = np.exp(-300.0 * np.maximum(since, 0.0)) * np.cos(2 * math.pi * 400.0 * since)
                x += np.where(since >= 0.0, -way * vibration * ring, 0.0)
    channels = {"end_effector_position": sign * x + noise * random.standard_normal(t.size)}
    return make_recording(t, channels | ({"drive_voltage": u} if drive else {}), title="walk")


@pytest.mark.parametrize("drive", [True, False], ids=["with drive", "position alone"])
def test_a_clean_staircase(drive: bool) -> None:
    found = sawtooth_features(walk(noise=1e-9, drive=drive))
    assert found.attrs["period"] == pytest.approx(PERIOD, abs=2e-3)
    np.testing.assert_array_equal(found["direction"], [1.0, -1.0])
    np.testing.assert_array_equal(found["n_slips"], [8, 8])
    np.testing.assert_array_equal(found["missing"], [0, 0])
    np.testing.assert_allclose(found["net_step"], UP - DOWN, rtol=2e-3)
    np.testing.assert_allclose(found["up"], UP, rtol=0.02)
    np.testing.assert_allclose(found["down"], DOWN, rtol=0.03)
    np.testing.assert_allclose(found["start"], [START + DELAY, START + 2.1 + DELAY], atol=3e-3)
    assert found.attrs["asymmetry"] == pytest.approx(0.0, abs=2e-3)
    if drive:
        assert found.attrs["delay"] == pytest.approx(DELAY, abs=1e-3)
    else:
        assert math.isnan(found.attrs["delay"])


@pytest.mark.parametrize("drive", [True, False], ids=["with drive", "position alone"])
@pytest.mark.parametrize(
    "trouble",
    [
        {"noise": 1.2e-6},
        {"noise": 0.12e-6, "jitter": 0.01, "missing": (3,)},
        {"noise": 0.12e-6, "sign": -1.0},
        {"noise": 0.12e-6, "interval": 5e-3},
    ],
    ids=["noise", "jitter and missing", "inverted", "coarse"],
)
def test_troubled_staircases(drive: bool, trouble: dict) -> None:
    """Ten times the noise of the thesis's bench, jitter, a missing period, an inverted sensor."""
    found = sawtooth_features(walk(**trouble, drive=drive, seed=3))
    assert found.sizes["walk"] == 2
    np.testing.assert_allclose(found["net_step"], UP - DOWN, rtol=0.1)
    np.testing.assert_array_less(
        np.abs(found["net_step"] - (UP - DOWN)), 5 * found["net_step_error"] + 0.02 * UP
    )
    np.testing.assert_allclose(found["up"], UP, rtol=0.15)
    np.testing.assert_array_equal(found["missing"], len(trouble.get("missing", ())))
    np.testing.assert_array_equal(found["direction"], np.array([1, -1]) * trouble.get("sign", 1.0))
    assert found.attrs["inverted"] == int(drive and "sign" in trouble)
    if "jitter" in trouble and drive:
        assert float(found["jitter"][0]) == pytest.approx(0.008, rel=0.5)


def test_vibration_after_slips() -> None:
    """A decaying cosine of known amplitude, frequency and decay; none where there is none."""
    found = sawtooth_features(walk(0.05e-6, vibration=0.8e-6, interval=2.5e-4))
    assert found.attrs["vibration_frequency"] == pytest.approx(400.0, rel=0.02)
    assert found.attrs["vibration_decay"] == pytest.approx(300.0, rel=0.2)
    assert found.attrs["vibration_amplitude"] == pytest.approx(0.8e-6, rel=0.35)
    assert float(found["spectrum"].idxmax("frequency")) == pytest.approx(400.0, abs=25.0)
    assert math.isnan(sawtooth_features(walk(0.05e-6)).attrs["vibration_frequency"])


def test_scatter_drift_and_smoothing() -> None:
    recording = walk(noise=0.12e-6)
    plain, smooth = sawtooth_features(recording), sawtooth_features(recording, smoothing=3)
    np.testing.assert_allclose(smooth["net_step"], plain["net_step"], rtol=0.02)
    # Steps are differences of two lines' ends, each of noise * about 2 / sqrt(64 samples).
    assert np.all(plain["scatter"] < 0.12e-6)
    assert np.all(np.abs(plain["drift"]) < 5e-8)


def test_refusals() -> None:
    recording = walk(noise=1e-8)
    position = recording["end_effector_position"]
    for changed, message in (
        (recording[["drive_voltage"]], "has no end_effector_position"),
        (recording.assign(end_effector_position=0 * position), "is not finite|throughout"),
        (recording.assign(end_effector_position=position.clip(max=9e-6)), "is clipped"),
        (recording.isel(time=slice(0, 8)), "has 8 samples"),
        (recording.isel(time=slice(0, 150)), "jumps 0 times"),
        (recording.isel(time=slice(None, None, 25)), "too coarsely sampled"),
    ):
        with pytest.raises(RecordingError, match=message):
            sawtooth_features(changed)
    noise = make_recording(
        recording["time"].values, {"end_effector_position": np.random.default_rng(0).standard_normal(4200)}
    )
    with pytest.raises(RecordingError, match="no slips exceed the noise"):
        sawtooth_features(noise)
