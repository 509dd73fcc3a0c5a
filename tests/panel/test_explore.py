"""The Explore page's answers: the same numbers as the package gives, the same as its Python lines, errors."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.panel import exploration
from stickslip.panel.exploration import SliderState, mean_speed, motion, python, sample_times, step_curves
from stickslip.panel.explore import field_of
from stickslip.panel.folder import Folder
from stickslip.panel.sets import Sets
from stickslip.panel.sliders import choices, law_types, shapes
from stickslip.parameters.writing import parameter_text, write_parameters
from stickslip.physics.piezo import BoucWen, Piezo

CHOICES = choices()


def state(name: str = "kang2007", law: str = "", shape: str = "Sawtooth", **changes: Any) -> SliderState:
    """The state that the page begins with, with changes such as ``waveform={"amplitude": 55.0}``."""
    found = CHOICES["sets"][name]
    law = law or found["law"]
    made: dict[str, Any] = {
        "set": name,
        "model": found["model"],
        "law": law,
        "friction": found["friction"][law],
        "shape": shape,
        "waveform": CHOICES["start"][shape],
        "duration": 1.0,
    }
    for section, change in changes.items():
        made[section] = made[section] | change if isinstance(change, dict) else change
    return SliderState.model_validate(json.loads(json.dumps(made)))


def test_choices_are_strict_json_and_name_every_law_and_field() -> None:
    text = json.dumps(CHOICES, allow_nan=False)
    assert len(text) < 30_000
    (kind,) = CHOICES["by_unit"].values()  # of the sets that come with the package, none turns
    assert set(kind["laws"]) == {law.__name__ for law in ss.LAWS}
    assert set(CHOICES["sets"]) == {"changli1999", "kang2007", "kang2007-hysteresis", "pohl1987"}
    for law in ss.LAWS:
        assert [field["name"] for field in kind["laws"][law.__name__]] == list(law._fields)
    for field in [*kind["model"], *(f for fields in CHOICES["shapes"].values() for f in fields)]:
        assert field["meaning"]
        assert field.get("switch") or field["low"] < field["high"]


@pytest.mark.parametrize("law", law_types())
def test_every_law_moves(law: str) -> None:
    moved = motion(state(law=law))
    assert moved.problem == ""
    period = moved.time[slice(*moved.loop)][[0, -1]]
    np.testing.assert_allclose(period, [0.8, 1.0], atol=1e-6)
    # Five periods forward, and never further than the stage's stroke times their number.
    net = float(moved.end_effector_position[-1])
    assert 0.0 < net < 5 * 65.0 * 0.1057e-6


@pytest.mark.parametrize("shape", shapes())
def test_every_waveform_moves(shape: str) -> None:
    moved = motion(state(shape=shape, duration=0.3))
    time = moved.time
    assert moved.problem == ""
    assert time[0] == 0.0
    assert time[-1] == pytest.approx(0.3)
    assert 0 <= moved.loop[0] < moved.loop[1] <= time.size


def test_samples_are_dense_after_each_fall_and_few_in_all() -> None:
    actuator, waveform, duration = state(waveform={"frequency": 20.0}).experiment()
    times, last = sample_times(actuator, waveform, duration)
    assert last == pytest.approx(0.95)
    assert times.size < 4500
    assert np.all(np.diff(times) > 0)
    for fall in np.arange(1, 20) / 20.0:
        ringing = (times >= fall) & (times < fall + 2 * math.pi / 3303.1)
        assert np.count_nonzero(ringing) >= 5  # of one period of the stage
    thousand, _ = sample_times(actuator, waveform._replace(frequency=1e3), duration)
    assert thousand.size < 4500


def test_motion_is_that_of_simulate() -> None:
    moved = motion(
        state(friction={"sigma_0": "2 N/um"}, waveform={"amplitude": "0.055 kV"}, duration="400 ms")
    )
    kang = ss.load_actuator("kang2007")
    actuator = kang.replace(friction=kang.friction._replace(sigma_0=2e6))
    expected = ss.simulate(actuator, ss.Sawtooth(55.0, 5.0), times=[0.0, 0.4], tolerance=1e-11)
    end = float(moved.end_effector_position[-1])
    assert end == pytest.approx(float(expected["end_effector_position"][-1]), abs=2e-9)


def test_steps_over_voltage_and_frequency(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exploration, "CURVE_SECONDS", math.inf)  # however slow the machine is
    # Pohl's model: the stage follows the voltage, so at a jump the end-effector keeps all of the stroke
    # but what it slides back meanwhile, which a static stage gives no time for [kang2007, eq. 1.1].
    still = state("pohl1987")
    curves = step_curves(still)
    gain = still.experiment()[0].gain
    np.testing.assert_allclose(curves["step_over_amplitude"], gain * curves["amplitude"], rtol=1e-3)
    np.testing.assert_allclose(curves["step"], [gain * 65.0], rtol=1e-3)
    kang = step_curves(state())
    assert kang["in_time"] == [1.0]
    assert kang["amplitude"][-1] == 150.0
    assert kang["amplitude"].size == kang["frequency"].size == 25
    assert np.all(np.diff(kang["step_over_amplitude"]) > 0)
    assert kang["frequency"][[0, -1]] == pytest.approx([1.0, 3303.1 / (2 * math.pi)])
    walk = ss.simulate(ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 5.0), 3.0)["end_effector_position"]
    # Waited for instead of solved for: the step of the last period.
    late = float(walk.sel(time=3.0, method="nearest") - walk.sel(time=2.8, method="nearest"))
    assert kang["step"][0] == pytest.approx(late, rel=2e-3)


def test_the_mean_speed_is_that_of_whole_periods() -> None:
    """However much of a period, which the contact takes back, the experiment has beside them."""
    speeds = [mean_speed(one, motion(one)) for one in (state(duration=2.0), state(duration=2.19))]
    step = step_curves(state(duration=1.0))["step"][0]
    assert speeds[0] == pytest.approx(5.0 * step, rel=0.02)
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-6)
    short = state(duration=0.3)
    assert mean_speed(short, motion(short)) is None


def test_a_drive_that_does_not_repeat_has_no_step() -> None:
    assert all(curve.size == 0 for curve in step_curves(state(shape="Step")).values())


def test_curves_that_take_too_long_end_early_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exploration, "CURVE_SECONDS", 0.0)
    curves = step_curves(state())
    assert curves["in_time"] == [0.0]
    assert np.isnan(curves["step_over_frequency"]).all()
    assert np.isfinite(curves["step"]).all()


def test_a_voltage_out_of_range_leaves_a_gap_in_the_curve() -> None:
    curves = step_curves(state(model={}, waveform={"offset": 0.0, "amplitude": 65.0}, shape="Sine"))
    assert np.all(np.isnan(curves["step_over_amplitude"]))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"law": "Elastoplastic"},
        {"law": "MaxwellSlip", "friction": {"strength_1": 0.3}},
        {"model": {"end_effector_mass": "50 g", "stage_reaction": False}, "duration": 0.37},
        {"friction": {"damping_velocity": 0.1}},
        {"name": "pohl1987", "model": {"natural_frequency": 5000.0}},
        {"model": {"hysteresis": 0.3, "creep": 0.02}, "duration": 0.3},
        {"name": "kang2007-hysteresis", "model": {"hysteresis": 0.1, "creep": 0.0}, "duration": 0.3},
        {"shape": "ReverseSawtooth", "waveform": {"fall_fraction": 0.9}},
        {"law": "Coulomb", "model": {"natural_frequency": "inf"}, "duration": 0.2},
    ],
    ids=lambda changes: "-".join(changes) or "as it begins",
)
def test_the_python_lines_give_the_same_numbers(changes: dict[str, Any]) -> None:
    here = state(**changes)
    moved = motion(here)
    names: dict[str, Any] = {}
    text = python(here)
    exec(text, names)
    theirs = names["trajectory"]
    assert len(text.splitlines()) < 16
    time = moved.time
    shared = np.isin(time, theirs["time"].values)
    assert np.count_nonzero(shared) >= 2
    mine = moved.end_effector_position[shared]
    np.testing.assert_allclose(
        theirs["end_effector_position"].sel(time=time[shared]).values, mine, rtol=0, atol=3e-9
    )
    if "step" in names:
        assert names["step"] == pytest.approx(float(step_curves(here)["step"][0]), abs=3e-9)


def test_sliders_of_the_piezo_bend_its_loop() -> None:
    """Of a set that has a model, and of one that has none; untouched, both stay as they are."""
    for name in ("kang2007", "kang2007-hysteresis"):
        own = ss.load_actuator(name).piezo
        assert state(name).actuator().piezo == own
        made = state(name, model={"hysteresis": 0.4, "creep": 0.03}).actuator().piezo
        law = made.hysteresis
        assert law.weights[0] == pytest.approx(0.6 * sum(law.weights))
        assert made.creep.per_decade == pytest.approx(0.03)
        if own is not None:
            assert law.thresholds == own.hysteresis.thresholds
            assert sum(law.weights) == pytest.approx(sum(own.hysteresis.weights))
    assert (
        state("kang2007-hysteresis", model={"hysteresis": 0.2, "creep": 0.0}).actuator().piezo.creep is None
    )
    assert state(model={"hysteresis": 0.0, "creep": 0.0}).actuator().piezo is None
    shown = motion(state("kang2007-hysteresis", waveform={"amplitude": 55.0})).drive_voltage
    assert shown.max() == pytest.approx(55.0, rel=1e-3)  # the voltage, not what the piezo makes of it


def test_hysteresis_that_is_not_made_of_plays_has_sliders_of_its_own(tmp_path: Path) -> None:
    bent = ss.load_actuator("kang2007").replace(piezo=Piezo(BoucWen(0.3, 0.01, 0.003)))
    write_parameters(tmp_path / "parameters" / "bent.toml", parameter_text(bent, "bent", "by hand"))
    saved, name = Sets(Folder(tmp_path)), "parameters/bent.toml"
    found = choices(saved)["sets"][name]
    json.dumps(found, allow_nan=False)
    sliders = {one["name"]: one for one in found["piezo"]}
    assert list(sliders) == ["piezo_alpha", "piezo_beta", "piezo_gamma"]
    for one in sliders.values():
        assert one["low"] < found["model"][one["name"]] < one["high"]
        assert one["meaning"]
    assert not any(one["piezo"] for one in CHOICES["sets"].values())

    here = state().model_copy(update={"set": name, "model": found["model"]})
    assert here.actuator(saved).piezo == bent.piezo
    wider = here.model_copy(update={"model": {**found["model"], "piezo_alpha": 0.4, "creep": 0.01}})
    piezo = wider.actuator(saved).piezo
    assert piezo.hysteresis == BoucWen(0.4, 0.01, 0.003)
    assert piezo.creep.per_decade == pytest.approx(0.01)
    moved = [motion(one, saved).stage_position.max() for one in (here, wider)]
    assert abs(moved[0] - moved[1]) > 1e-8
    assert "BoucWen(alpha=0.4" in python(wider, saved)
    wrong = here.model_copy(update={"model": {**found["model"], "piezo_beta": -1.0}})
    with pytest.raises(ss.QuantityError) as caught:
        motion(wrong, saved)
    assert field_of(str(caught.value)) == "model.piezo_beta"


def test_a_set_that_is_changed_by_nothing_is_written_in_one_line() -> None:
    assert 'actuator = ss.load_actuator("kang2007")\n' in python(state())


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"friction": {"sigma_0": -1.0}}, "friction.sigma_0", "must be > 0 N/m"),
        ({"friction": {"sigma_0": "65 V"}}, "friction.sigma_0", "no N/m"),
        ({"friction": {"coulomb_force": 10.0}}, "friction.stiction_force", "coulomb_force"),
        ({"law": "MaxwellSlip", "friction": {"strength_2": 0.0}}, "friction.strength_2", "> 0 N"),
        ({"model": {"stage_mass": "heavy"}}, "model.stage_mass", "kg"),
        ({"model": {"hysteresis": 1.0}}, "model.hysteresis", "< 1"),
        ({"model": {"creep": -0.01}}, "model.creep", ">= 0"),
        ({"waveform": {"rise_fraction": 2.0}}, "waveform.rise_fraction", "<= 1"),
        ({"waveform": {"amplitude": 160.0}}, "waveform.amplitude", "150 V"),
        ({"duration": 1e6}, "duration", "<= 100 s"),
        ({"duration": 50.0, "waveform": {"frequency": 2e3}}, "duration", "periods"),
        ({"law": "Magic"}, "law", "LuGre"),
        ({"set": "../../etc/passwd.toml"}, "set", "come with the package"),
    ],
)
def test_errors_name_the_field(changes: dict[str, Any], field: str, words: str) -> None:
    base = {key: value for key, value in changes.items() if key != "law" or value in law_types()}
    here = state(**base)
    here = here.model_copy(update={"law": changes.get("law", here.law)})
    with pytest.raises(ss.QuantityError) as caught:
        motion(here)
    assert field_of(str(caught.value)) == field
    assert words in str(caught.value)
