"""The equations behind the observer's gain, of all states at once, against SciPy's and closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import LinAlgWarning, solve_discrete_are, solve_discrete_lyapunov

import stickslip as ss
from stickslip.export import ExportError, export_c
from stickslip.export.gain import kalman_gains, observer_gain, stationary_errors

KANG = ss.load_actuator("kang2007")


def stacked(size: int, growth: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random matrices whose errors grow by so much a step, what is seen, and a covariance."""
    random = np.random.default_rng(size)
    steps = random.normal(size=(len(growth), size, size))
    radii = np.max(np.abs(np.linalg.eigvals(steps)), axis=1)
    noise = random.normal(size=(size, size))
    return steps * (growth / radii)[:, None, None], random.normal(size=size), noise @ noise.T


@pytest.mark.parametrize("size", [1, 2, 5, 11])
def test_errors_are_scipys(size: int) -> None:
    """Of no gain and of some, in states that forget at once and hardly ever."""
    steps, seen, noises = stacked(size, (0.0, 0.3, 0.9, 0.999, 0.999999))
    random = np.random.default_rng(size + 1)
    gains = 0.05 * np.array([np.zeros(size), *random.normal(size=(3, size))])
    found = stationary_errors(steps, seen, noises, gains)
    assert np.count_nonzero(np.isfinite(found)) > 8
    for i, k in enumerate(gains):
        left = np.eye(size) - np.outer(k, seen)
        for j, step in enumerate(steps):
            if np.max(np.abs(np.linalg.eigvals(left @ step))) >= 1.0:
                assert found[i, j] == math.inf
                continue
            p = solve_discrete_lyapunov(left @ step, left @ noises @ left.T + np.outer(k, k))
            assert found[i, j] == pytest.approx(math.sqrt(seen @ p @ seen), rel=1e-7)


def test_an_error_that_grows_or_stays_is_infinite() -> None:
    steps, seen, noises = stacked(3, (0.5, 1.0, 1.5, 1e200))
    gains = np.array([np.zeros(3), np.full(3, np.nan)])
    assert np.isfinite(stationary_errors(steps, seen, noises, gains)).tolist() == [
        [True, False, False, False],
        [False] * 4,
    ]


@pytest.mark.filterwarnings("error")
def test_an_error_thrown_up_far_before_it_falls_has_its_closed_form() -> None:
    """A matrix a I + b N: as a system of equations too ill-conditioned for SciPy."""
    a, b = 0.5, 1e9
    step, seen = np.array([[a, b], [0.0, a]]), np.array([1.0, 0.0])
    speed = 1.0 / (1.0 - a**2)
    both = a * b * speed / (1.0 - a**2)
    position = (1.0 + 2.0 * a * b * both + b**2 * speed) / (1.0 - a**2)
    found = stationary_errors(step[None], seen, np.eye(2), np.zeros((1, 2)))
    assert found[0, 0] == pytest.approx(math.sqrt(position), rel=1e-12)
    with pytest.raises(LinAlgWarning):
        solve_discrete_lyapunov(step, np.eye(2), method="direct")


@pytest.mark.parametrize("size", [1, 2, 5, 11])
def test_gains_are_scipys(size: int) -> None:
    steps, seen, noises = stacked(size, (0.0, 0.9, 1.0, 1.3))
    found = kalman_gains(steps, seen, noises)
    for gain, step in zip(found, steps, strict=True):
        p = solve_discrete_are(step.T, seen[:, None], noises + 1e-8 * np.eye(size), np.eye(1))
        assert gain == pytest.approx(p @ seen / (seen @ p @ seen + 1.0), rel=1e-8, abs=1e-10)


def test_what_is_not_seen_and_grows_has_no_gain_and_spoils_no_other() -> None:
    hidden, known = np.diag([0.5, 1.2]), np.diag([0.5, 0.7])
    huge = np.array([[1.0, 1e200], [1e200, 1.0]])
    seen = np.array([1.0, 0.0])
    found = kalman_gains(np.array([hidden, known, huge]), seen, np.eye(2))
    assert np.isnan(found[[0, 2]]).all()
    # p = a^2 p/(1 + p) + q, of a part alone
    b, q = 1.0 - 0.25 - (1.0 + 1e-8), 1.0 + 1e-8
    p = (-b + math.sqrt(b**2 + 4.0 * q)) / 2.0
    assert found[1] == pytest.approx([p / (1.0 + p), 0.0], rel=1e-12)


def test_a_noise_far_below_all_others_takes_the_sample_as_it_is(tmp_path: Any) -> None:
    found = observer_gain(KANG, 20e-6, 1e-30)
    assert found is not None
    assert found[2] == pytest.approx(1.0, rel=1e-12)
    export_c(KANG, tmp_path / "c", measurement_noise=1e-30)


def test_what_a_float_does_not_hold_has_no_gain(tmp_path: Any) -> None:
    """A contact too stiff for the mass: an error of its bristle is a speed of 2^24 noises per step."""
    with pytest.raises(ExportError, match=r"no gain at step = 2e-05 s .*: step = 3\.125e-07 s does"):
        export_c(KANG.replace(end_effector_mass=1e-12), tmp_path / "c")
    export_c(KANG.replace(end_effector_mass=1e-12), tmp_path / "c", step=3.125e-7)
