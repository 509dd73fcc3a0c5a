"""Faults of instruments are found in residuals, with instants and sizes; noise of any colour has none."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.disturbances import Disturbance, disturbances
from stickslip.estimate.disturbed import with_disturbances
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.lack import KnownNoise
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals

from .test_lack import N, noise

INTERVAL = 5e-4
TIMES = INTERVAL * np.arange(N)
PERIOD = 100.0


def pink(random: np.random.Generator) -> np.ndarray:
    """Noise of power 1/f."""
    line = np.arange(N // 2 + 1)
    line[0] = 1
    made = np.fft.irfft(np.fft.rfft(random.standard_normal(N)) / np.sqrt(line), N)
    return made / made.std()


def walk(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a walk, and two columns that parameters move them by."""
    phase = np.arange(N) / PERIOD + random.uniform()
    ramp = phase % 1.0
    return 300.0 * (ramp + 0.2 * np.floor(phase)), np.column_stack([ramp, np.sin(2.0 * np.pi * phase)])


def found(y: np.ndarray, model: np.ndarray, columns: np.ndarray, **known: float) -> tuple[Disturbance, ...]:
    """Disturbances of what least squares leaves of a measured walk."""
    r = model - y
    r = r - columns @ np.linalg.lstsq(columns, r, rcond=None)[0]
    about = KnownNoise(period=(0.0, PERIOD, float(N)), **known)
    slope = np.gradient(model, TIMES)
    return disturbances(r, TIMES, slope=slope, measured=y, jacobian=columns, known=about)


@pytest.mark.parametrize("kind", ["white", "correlated", "filtered", "drifting", "rounded", "pink"])
def test_noise_has_no_faults(kind: str) -> None:
    random = np.random.default_rng(8)
    for _ in range(4):
        model, columns = walk(random)
        made = pink(random) if kind == "pink" else noise(kind, random)
        seen = found(model + made, model, columns, step=1.0 if kind == "rounded" else 0.0)
        assert {one.kind for one in seen} <= (
            {"drift"} if kind in ("pink", "drifting", "correlated") else set()
        )


@pytest.mark.parametrize("kind", ["filtered", "drifting"])
def test_jumps_are_dated_and_measured(kind: str) -> None:
    random = np.random.default_rng(9)
    for _ in range(2):
        model, columns = walk(random)
        at, size = (
            int(random.integers(N // 10, N - N // 10)),
            random.choice([-1.0, 1.0]) * random.uniform(10.0, 60.0),
        )
        y = model + noise(kind, random) + size * (np.arange(N) >= at)
        (one,) = (d for d in found(y, model, columns) if d.kind != "drift")
        assert one.kind == "jump"
        assert abs(one.when - TIMES[at]) <= 2.1 * INTERVAL
        assert one.size == pytest.approx(size, abs=1.5)
        assert f"jumps by {abs(one.size):.3g} m at {one.when:.4g} s" in one.sentence


def test_a_long_recording_is_looked_at_by_its_means() -> None:
    random, count = np.random.default_rng(13), 25_000
    r = random.standard_normal(count) + 4.0 * (np.arange(count) >= 9_000)
    (one,) = disturbances(r, INTERVAL * np.arange(count))
    assert one.kind == "jump"
    assert one.when == pytest.approx(9_000 * INTERVAL, abs=6 * INTERVAL)


def test_bursts_freezes_and_hum_are_named() -> None:
    random = np.random.default_rng(10)
    model, columns = walk(random)
    clean = model + noise("white", random)
    y = clean.copy()
    y[700:705] += 20.0
    (one,) = found(y, model, columns)
    assert (one.kind, one.samples) == ("burst", 5)
    assert one.size == pytest.approx(20.0, abs=2.0)
    y = clean.copy()
    y[830:860] = y[830]
    assert found(y, model, columns)[0][:4] == (
        "freeze",
        "the recording",
        TIMES[830],
        pytest.approx(30 * INTERVAL),
    )
    (one,) = found(clean + 3.0 * np.sin(2.0 * np.pi * 53.0 * TIMES + 1.0), model, columns)
    assert one.kind == "hum"
    assert one.frequency == pytest.approx(53.0, abs=0.1)
    assert one.size == pytest.approx(3.0, abs=0.3)


def test_jitter_is_told_from_a_model_that_is_late() -> None:
    random = np.random.default_rng(11)
    for _ in range(2):
        phase = np.arange(N) / PERIOD
        model = 200.0 * np.sin(2.0 * np.pi * phase) ** 5
        change = np.gradient(model)
        y = model + 0.2 * change * random.standard_normal(N) + noise("white", random)
        (one,) = found(y, model, np.ones((N, 1)))
        assert one.kind == "jitter"
        assert one.size == pytest.approx(0.2 * INTERVAL, rel=0.25)
        assert not [
            d
            for d in found(model + 0.2 * change + noise("white", random), model, np.ones((N, 1)))
            if d.kind == "jitter"
        ]


def test_a_fault_that_moves_a_value_is_a_failure() -> None:
    """A straight line through a jump, and through a spike that does nothing to it."""
    random = np.random.default_rng(12)
    parts = []
    for name, fault in (("a", 9.0 * (TIMES > 0.3)), ("b", np.where(np.arange(N) == 900, 40.0, 0.0))):
        y = 5.0 * TIMES + noise("white", random) + fault
        parts.append(
            Residuals(lambda v, y=y: v["slope"] * TIMES - y, y, None, name, "m", KnownNoise(), TIMES)
        )
    fit = with_disturbances(
        fit_least_squares(parts, [Parameter("slope", 1.0, -99.0, 99.0, "m/s", log=False)])
    )
    (failure,), (remark,) = fit.failures, fit.remarks
    assert failure.startswith("a jumps by ")
    assert "at 0.3005 s, which moves slope by" in failure
    assert "the intervals are not to be trusted: end the recording before it" in failure
    assert remark.startswith("b has a spike of ")
    assert failure in fit.report()
    assert with_disturbances(fit).failures == fit.failures
