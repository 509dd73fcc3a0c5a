"""Reaction on the stage: what fits without it say of recordings with it and without."""

from typing import Any

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.estimate.result import Fit
from stickslip.friction import LuGre
from stickslip.identify.walk.reaction import with_reaction, with_reaction_asked
from stickslip.recording import make_recording

KANG = ss.load_actuator("kang2007")
START = LuGre(1e6, 30.0, 0.0, 0.8, 0.8)
FREE = ["sigma_0", "sigma_1", "coulomb_force"]


def walk(hidden: ss.Actuator, noise: float, seed: int) -> tuple[xr.Dataset, ss.waveform.Sequence]:
    time = np.arange(0.0, 1.0, 1e-3)
    drive = ss.waveform.Sequence(ss.waveform.Rest(0.1), ss.Sawtooth(65.0, 5.0, periods=4))
    moved = ss.simulate(hidden, drive, times=time)
    position = moved["end_effector_position"].values
    position = position + noise * np.random.default_rng(seed).standard_normal(time.size)
    return make_recording(time, {"end_effector_position": position}, title="walk"), drive


def fitted(hidden: ss.Actuator, noise: float, model: ss.Actuator, seed: int = 3, **options: Any) -> Fit:
    recording, drive = walk(hidden, noise, seed)
    return ss.identify_friction(recording, model, FREE, drive=drive, **options)


def test_a_fit_without_the_reaction_that_is_there_is_not_trusted() -> None:
    model = KANG.replace(stage_reaction=False, friction=START)
    fit = fitted(KANG, 50e-9, model)
    _, high = fit.confidence_intervals()["coulomb_force"]
    assert high < 0.8 * KANG.friction.coulomb_force  # it is wrong, and sure of it
    (said,) = (one for one in fit.failures if "stage_reaction: true" in one)
    assert "explained better where friction acts back" in said
    # What it says the force is then, is what it is.
    told = float(said.split("coulomb_force = ")[1].split(" N")[0])
    assert told == pytest.approx(KANG.friction.coulomb_force, rel=0.1)
    assert "stage_reaction" not in fitted(KANG, 50e-9, model.replace(stage_reaction=True)).summary


def test_nothing_is_said_where_the_recordings_show_that_there_is_none() -> None:
    hidden = KANG.replace(stage_reaction=False)
    assert "stage_reaction" not in fitted(hidden, 20e-9, hidden.replace(friction=START)).summary


def test_what_noise_hides_is_a_remark() -> None:
    hidden = KANG.replace(stage_reaction=False)
    fit = fitted(hidden, 0.5e-6, hidden.replace(friction=START), seed=0)
    assert not any("stage_reaction" in one for one in fit.failures)
    (said,) = (one for one in fit.remarks if "stage_reaction" in one)
    assert said.startswith("the recordings do not tell whether friction acts back on the stage")


def test_what_is_given_at_a_mean_is_compared_where_it_is_at_its_best() -> None:
    """The sum of squares at the mean is higher, here by more than what makes a model the better one."""
    hidden = KANG.replace(stage_reaction=False)
    fit = fitted(hidden, 2e-6, hidden.replace(friction=START), seed=1)
    assert "at its mean over all that fits" in fit.message
    assert not any("stage_reaction" in one for one in fit.failures)


@pytest.mark.parametrize("change", [{"natural_frequency": np.inf}, {"clamped": True}])
def test_a_stage_that_no_force_moves_is_not_asked_for(change: dict[str, Any]) -> None:
    class Refuses:
        model = KANG.replace(stage_reaction=False, **change)

    fit = fitted(KANG, 50e-9, KANG.replace(friction=START), hops=0)
    assert with_reaction(fit, Refuses(), 10) is None  # type: ignore[arg-type]
    assert with_reaction_asked(fit, None) is fit


def test_a_search_with_the_reaction_goes_to_its_end() -> None:
    """After twelve evaluations it describes this walk far worse than the fit without; at its end, better."""
    hidden = KANG.replace(
        gain=116.44e-9,
        natural_frequency=4099.0,
        damping_ratio=0.766,
        friction=LuGre(3.5375e6, 88.04, 0.0, 0.35752, 0.35752),
        stage_reaction=True,
    )
    time, drive = np.arange(1600) * 1e-3, ss.Sawtooth(65.0, 5.0)
    position = ss.simulate(hidden, drive, times=time)["end_effector_position"].values
    noise = 5e-9 * np.random.default_rng(0).standard_normal(time.size)
    recording = make_recording(time, {"end_effector_position": position + noise})
    fit = ss.identify_friction(recording, hidden.replace(stage_reaction=False), FREE, drive=drive)
    assert any("explained better where friction acts back" in one for one in fit.failures)
