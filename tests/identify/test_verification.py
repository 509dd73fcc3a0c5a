"""Verification: figures of merit by hand."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.result import Fit
from stickslip.identify.verification import Requirement, net_step, verify
from stickslip.identify.walk.prediction import Predictor
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError, make_recording
from stickslip.recording.chain import Chain
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest, Step


def line(slope: float, n: int, title: str) -> xr.Dataset:
    t = np.arange(float(n))
    return make_recording(t, {"position": slope * t}, title=title)


def fitted() -> Fit:
    t = np.arange(20.0)
    fit = fit_least_squares(
        [Residuals(lambda v: v["slope"] * t - 2.0 * t)], [Parameter("slope", 1.0, 0.1, 10.0, "m/s")]
    )
    return replace(
        fit,
        observed="position",
        predict=lambda r, drive=None: fit.values["slope"] * r["time"].values + (drive or 0.0),
    )


def test_figures_of_merit() -> None:
    v = verify(fitted(), [line(2.0, 12, "same"), line(3.0, 15, "steeper")])
    t, u = np.arange(12.0), np.arange(15.0)
    sse, sst = np.sum(u**2), [np.sum((2 * t - 11) ** 2), np.sum((3 * u - 21) ** 2)]
    assert v.r_squared == pytest.approx(1 - sse / sum(sst), rel=1e-6)
    assert v.rmse == pytest.approx(np.sqrt(sse / 27), rel=1e-6)
    assert v.table["r_squared"].values == pytest.approx([1.0, 1 - sse / sst[1]])
    assert v.table["rmse"].attrs["units"] == "m"
    assert v.table["largest_error"].values == pytest.approx([0.0, 14.0], abs=1e-6)
    assert list(v.table["recording"].values) == ["same", "steeper"]
    np.testing.assert_allclose(v.predictions[1]["residual"], -u, atol=1e-6)
    np.testing.assert_allclose(v.predictions[1]["measured"], 3 * u)
    assert v.predictions[1]["predicted"].attrs["units"] == "m"


def test_report_and_dictionary() -> None:
    v = verify(fitted(), [line(2.0, 12, "same"), line(3.0, 15, "steeper")])
    lines = v.report().splitlines()
    assert lines[0] == "prediction of position [m]"
    assert [words.split()[0] for words in lines[1:5]] == ["recording", "same", "steeper", "all"]
    assert lines[2].split()[3] == "-"  # the noise is not known
    (remark,) = lines[5:]  # neither rests nor repeats
    assert remark.startswith("what is left of steeper is ")
    assert "the white noise of its positions" in remark
    found = json.loads(json.dumps(v.to_dict(), allow_nan=False))
    assert found["recordings"]["steeper"]["n_data"] == 15
    level = verify(fitted(), line(0.0, 12, "level"))  # r^2 has no meaning for a constant
    assert level.to_dict()["r_squared"] is None
    assert "all" not in level.report()


def test_what_cannot_be_verified_is_refused() -> None:
    with pytest.raises(ValueError, match="no model"):
        verify(replace(fitted(), predict=None), line(2.0, 12, "same"))
    with pytest.raises(RecordingError, match=r"steep has no position \[m\]"):
        verify(fitted(), line(2.0, 12, "steep").rename(position="force"))
    lost = replace(fitted(), predict=lambda r: np.full(r["time"].size, np.nan))
    with pytest.raises(RecordingError, match=r"cannot predict position \[m\] of same"):
        verify(lost, line(2.0, 12, "same"))
    with pytest.raises(ValueError, match=r"Actuator is no fit: .* Predictor\(actuator\)"):
        verify(load_actuator("kang2007"), line(2.0, 12, "same"))  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match="there are 2 drives for 1 recordings"):
        verify(fitted(), line(2.0, 12, "same"), drive=[1.0, 2.0])


def test_a_recording_in_another_unit_than_the_fits_is_refused() -> None:
    fit = fitted()
    (good,) = fit.recordings
    fit = replace(fit, recordings=(good._replace(unit="m"),))
    turning = line(1.0, 20, "turning")
    turning["position"].attrs["units"] = "rad"
    with pytest.raises(RecordingError, match="position of turning is in rad, but was in m for the fit"):
        verify(fit, turning)


def walk(step: float, n_periods: int = 4, rate: int = 50) -> xr.Dataset:
    """A sawtooth of a metre that moves on by `step` in each period of 1 s, after a second at rest."""
    t = np.arange((n_periods + 1) * rate) / rate
    k, phase = np.divmod(t - 1.0, 1.0)
    return make_recording(t, {"position": np.where(t < 1.0, 0.0, step * k + phase)}, title=f"{step:g} m")


def test_net_step_is_that_of_the_periods() -> None:
    drive = Sequence(Rest(1.0), Sawtooth(10.0, 1.0, periods=4))
    recording = walk(0.3)
    time, x = recording["time"].values, recording["position"].values
    assert net_step(time, x, drive) == pytest.approx(0.3, rel=1e-9)
    from_rest = np.where(time < 2.0, x - 0.2, x)  # the first period is like no other
    assert net_step(time, from_rest, drive) == pytest.approx(0.3, rel=1e-9)
    assert math.isnan(net_step(time, x, Step(10.0)))
    assert math.isnan(net_step(time, x, None))
    assert math.isnan(net_step(time[:80], x[:80], drive))  # less than two periods
    fit = replace(fitted(), predict=lambda r, drive: 1.02 * r["position"].values)
    found = verify(fit, [recording, line(2.0, 12, "no walk")], drive=[drive, Step(10.0)])
    assert found.table["net_step"].values[0] == pytest.approx(0.3)
    assert found.table["net_step_error"].values[0] == pytest.approx(0.02)
    assert "2 %" in found.report()
    assert found.unmet([Requirement.parse("net_step_error < 3 %")]) == []
    (said,) = found.unmet([Requirement.parse("net_step_error < 1%")])
    assert said == "0.3 m: net_step_error is 2 %, which is not < 1 %"


def test_a_residual_that_is_mostly_an_offset_is_said_to_be() -> None:
    """Of a walk that began before its recording, or another zero of the position: no fault of the model's."""
    model, drive = load_actuator("kang2007"), Sequence(Rest(0.05), Sawtooth(65.0, 20.0, periods=3))
    walk = simulate(model, drive, drive.duration, sample_rate=5e3)
    noise = 2e-8 * np.random.default_rng(2).standard_normal(walk.sizes["time"])
    for offset, off in ((3e-6, "an offset of 3 µm"), (-2e-6, "an offset of -2 µm"), (0.0, "")):
        position = walk["end_effector_position"].values + noise + offset
        recorded = make_recording(walk["time"].values, {"end_effector_position": position}, title="moved")
        found = verify(Predictor(model), recorded, drive=drive)
        assert [said for said in found.remarks if "offset" in said] == [
            said
            for said in found.remarks
            if off and said.startswith(f"most of what is left of moved is {off}")
        ]
        assert any("offset" in said for said in found.remarks) == bool(off)
    wrong = model.replace(friction=model.friction._replace(coulomb_force=0.3, stiction_force=0.3))
    assert not any("offset" in said for said in verify(Predictor(wrong), recorded, drive=drive).remarks)


def test_requirements() -> None:
    found = verify(fitted(), [line(2.0, 12, "same"), line(3.0, 15, "steeper")])
    wanted = [Requirement.parse(text) for text in ("r_squared > 0.9", "rmse <= 100 mm", "rmse < 10 m")]
    assert wanted[1:] == [Requirement("rmse", "<=", 0.1, "m"), Requirement("rmse", "<", 10.0, "m")]
    assert [s.split(" is ")[0] for s in found.unmet(wanted)] == ["steeper: r_squared", "steeper: rmse"]
    assert Requirement.parse("r_squared > 0.9999999").broken(0.9999959) == (
        "r_squared is 0.9999959, which is not > 0.9999999"
    )
    assert Requirement.parse("net_step_error < 1 %").broken(0.010004) == (
        "net_step_error is 1.0004 %, which is not < 1 %"
    )
    assert Requirement.parse("rmse < 100 nm").broken(1e-7) == "rmse is 100 nm, which is not < 100 nm"
    (first, second) = found.unmet([Requirement.parse("net_step_error < 1 %")])
    assert "same: net_step_error does not exist; the drive" in first
    assert second.startswith("steeper")
    for text, words in (
        ("r_squared 0.9", "no requirement"),
        ("r_sqared > 0.9", "did you mean 'r_squared'"),
        ("rmse < 1 V", "no m"),
        ("rmse < 1 %", "no m"),
        ("rmse < 100", "'rmse < 100' has no unit: .* as in rmse < 100 nm"),
        ("largest_error <= 1e-6", "has no unit"),
    ):
        with pytest.raises(QuantityError, match=words):
            Requirement.parse(text)


def test_an_actuator_predicts_as_simulate_does(monkeypatch: pytest.MonkeyPatch) -> None:
    model = load_actuator("kang2007").replace(stage_reaction=False)
    drive = Sawtooth(amplitude=65.0, frequency=5.0, periods=3)
    recording = simulate(model, drive, sample_rate=1e3, tolerance=1e-11)
    found = verify(Predictor(model), recording, drive=drive)
    assert found.rmse < 1e-9
    later = verify(Predictor(model, Chain(delay=5e-3, offset=1e-6)), recording, drive=drive)
    delayed = np.interp(recording["time"] - 5e-3, recording["time"], recording["end_effector_position"])
    np.testing.assert_allclose(later.predictions[0]["predicted"], delayed + 1e-6, atol=1e-9)
    monkeypatch.setattr("stickslip.identify.walk.displacement.MAX_STEPS", 20)
    with pytest.raises(RecordingError, match="cannot predict end_effector_position"):
        verify(Predictor(model), recording, drive=drive)


def test_a_prediction_that_leaves_more_than_noise_says_so() -> None:
    """A stiffness that is off by a fifth rings otherwise: seen against the rest before, and by periods."""
    actuator = load_actuator("kang2007").replace(stage_reaction=False)
    drive = Sequence(Rest(0.05), Sawtooth(65.0, 20.0, periods=8))
    walk = simulate(actuator, drive, 0.45, sample_rate=4e3)[["end_effector_position"]]
    noise = 20e-9 * np.random.default_rng(0).standard_normal(walk["time"].size)
    walk["end_effector_position"] += noise
    right = verify(Predictor(actuator), walk, drive=drive)
    assert right.statements == ()
    ratio = right.table["residual_over_noise"].values[0]
    assert 0.9 < ratio < 1.2
    titles, values = (re.split(r" {2,}", line) for line in right.report().splitlines()[1:3])
    assert values[titles.index("residual/noise")] == f"{ratio:.3g}"
    assert [one["residual_over_noise"] for one in right.to_dict()["recordings"].values()] == [ratio]
    law = actuator.friction
    wrong = verify(
        Predictor(actuator.replace(friction=law._replace(sigma_0=0.8 * law.sigma_0))), walk, drive=drive
    )
    (said,) = wrong.statements
    assert "the model does not explain" in said
    assert "x the noise" in said
    assert said in wrong.report()
    assert "intervals" not in said
    assert wrong.unmet([Requirement.parse("residual_over_noise < 1.2")])
    assert not right.unmet([Requirement.parse("residual_over_noise < 1.2")])


KANG = load_actuator("kang2007").replace(stage_reaction=False)
LESS = 0.97 * KANG.friction.coulomb_force
WALK = Sequence(Rest(0.05), Sawtooth(65.0, 20.0, periods=8))


OTHERS: dict[str, tuple[Any, Any]] = {
    "gain 1 % off": (KANG.replace(gain=1.01 * KANG.gain), WALK),
    "Coulomb friction 3 % off": (KANG.replace(friction=KANG.friction._replace(coulomb_force=LESS)), WALK),
    "60 V for 65 V": (KANG, Sequence(Rest(0.05), Sawtooth(60.0, 20.0, periods=8))),
    "drive one period early": (KANG, Sawtooth(65.0, 20.0, periods=8)),
}


@pytest.mark.parametrize(("seed", "other"), [*enumerate(OTHERS)])
def test_what_adds_up_from_step_to_step_is_no_drift(seed: int, other: str) -> None:
    """Ten times the noise and more, which the sensor at rest shows no drift for."""
    model, drive = OTHERS[other]
    walk = simulate(KANG, WALK, 0.5, sample_rate=4e3)[["end_effector_position"]]
    walk["end_effector_position"] += 20e-9 * np.random.default_rng(seed).standard_normal(walk["time"].size)
    found = verify(Predictor(model), walk, drive=drive)
    (said,) = found.statements
    assert "with its drift" in said
    assert found.table["residual_over_noise"].values[0] == pytest.approx(found.rmse / 20e-9, rel=0.2)
