"""A search that explains little ends after its CPU budget, and says so; a right one does not depend on it."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.estimate import budget
from stickslip.estimate.budget import EvaluationBudget
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Problem, Residuals
from stickslip.recording import make_recording

TIME = np.linspace(0.0, 1.0, 400)


class Clock:
    """A CPU clock by which each evaluation takes a millisecond."""

    def __init__(self) -> None:
        self.now = 0.0

    def thread_time(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(budget, "time", made)
    return made


def fitted(measured: np.ndarray, noise: float, clock: Clock, starts: int = 5):
    """A sine of free amplitude and frequency."""

    def residuals(values):
        clock.now += 1e-3
        return values["a"] * np.sin(values["w"] * TIME) - measured

    found = EvaluationBudget.of([measured], [noise])
    parameters = [Parameter("a", 0.1, 1e-3, 10.0), Parameter("w", 9.0, 1.0, 40.0)]
    problem = Problem([Residuals(residuals, measured)], parameters)
    problem.budget = found
    return fit_least_squares(problem, starts=starts), found


def test_what_is_not_explained_ends_early_and_says_so(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    monkeypatch.setattr(budget, "SECONDS", 0.1)
    measured = np.cumsum(np.random.default_rng(0).standard_normal(400)) * (-1.0) ** np.arange(400)
    fit, found = fitted(measured, 0.0, clock, starts=40)
    assert found.over
    assert clock.now < 0.2
    assert not fit.converged
    assert any("stopped after 0.1 s of CPU, because the model explains only" in one for one in fit.failures)


@pytest.mark.parametrize("noise", [1e-3, 3.0])
def test_a_right_model_does_not_depend_on_the_budget(
    monkeypatch: pytest.MonkeyPatch, clock: Clock, noise: float
) -> None:
    """Also where noise is most of what is measured: the budget asks what is explained beyond it."""
    measured = np.sin(10.0 * TIME) + noise * np.random.default_rng(1).standard_normal(400)
    found = []
    for seconds in (1e9, 0.0):
        monkeypatch.setattr(budget, "SECONDS", seconds)
        found.append(fitted(measured, noise, clock)[0])
    assert found[0].values == found[1].values
    assert found[1].failures == found[0].failures


def test_a_walk_of_another_drive_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A position that swings with the mains, and has nothing of the drive: the screen lets it pass."""
    monkeypatch.setattr(budget, "SECONDS", 0.0)
    model, random = ss.load_actuator("kang2007").replace(stage_reaction=False), np.random.default_rng(0)
    drive, t = ss.Sawtooth(65.0, 10.0, periods=5), np.arange(1000) * 5e-4
    x = 3e-6 * np.sin(2.0 * np.pi * 53.0 * t) + 2e-8 * random.standard_normal(t.size)
    one = make_recording(t, {"end_effector_position": x})
    fit = ss.identify_friction([one], model, ["sigma_0", "sigma_1", "coulomb_force"], drive=drive)
    assert any("s of CPU, because the model explains only" in one for one in fit.failures)
