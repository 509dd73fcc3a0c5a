"""Lack of fit where the drive is given as samples, and repeats nothing."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.recording import RecordingWarning

NOISE = 5e-9  # m
TRUTH = ss.load_actuator("kang2007").replace(stage_reaction=False)
TIMES = np.arange(0.0, 0.2, 2.5e-4)
REST = 0.05  # s


def recorded(model: ss.Actuator, seed: int, rest: float = REST) -> tuple[ss.Sampled, object]:
    """A drive of its own samples, and what the model does under it, with noise."""
    edges = np.array([0.0, 0.04, 0.0401, 0.09, 0.0901, 0.13])
    drive = ss.Sampled(
        np.append(0.0, rest + edges), [0.0, 0.0, 60.0, 0.0, 70.0, 0.0, 0.0], interpolation="linear"
    )
    position = ss.simulate(model, drive, times=TIMES, tolerance=1e-10)["end_effector_position"].values
    noise = NOISE * np.random.default_rng(seed).standard_normal(TIMES.size)
    return drive, ss.make_recording(TIMES, {"end_effector_position": position + noise})


@pytest.mark.parametrize("rest", [REST, 0.002])
def test_a_wrong_gain_is_said_and_a_right_one_not(rest: float) -> None:
    """By the rest before the drive moves, or else by the white noise of the samples."""
    said = "does not explain recording 1" if rest == REST else "the model does not explain it"
    for gain, wrong in ((1.0, False), (1.03, True)):
        drive, recording = recorded(TRUTH.replace(gain=gain * TRUTH.gain), 3, rest)
        fit = ss.identify_friction(
            recording, TRUTH, ["sigma_0", "coulomb_force"], drive=drive, hops=0, averaged=False
        )
        assert (said in fit.report()) is wrong
        found = ss.verify(ss.identify.Predictor(TRUTH), recording, drive=drive)
        assert (said in found.report()) is wrong
        assert np.isfinite(found.lacks[0].ratio) == (rest == REST)


def test_what_is_taken_of_a_recorded_drive_is_said_once() -> None:
    """Nothing was new the second time: the search for a start read the channel again."""
    forth, back = (kind(65.0, 5.0, periods=2) for kind in (ss.Sawtooth, ss.waveform.ReverseSawtooth))
    drive = ss.waveform.Sequence(forth, back)  # none of those that are recognised
    walk = ss.simulate(TRUTH, drive, times=np.arange(0.0, 0.8, 1e-3)).drop_attrs(deep=False)
    with pytest.warns(RecordingWarning, match="changes too fast for its samples") as said:
        ss.identify_friction(walk, TRUTH, ["coulomb_force"])
    assert len(said) == 1
