"""A plan as an experiment file: the virtual rig records it as it is, and its picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import stickslip as ss
from stickslip.design import Plan
from stickslip.design.candidates import there_and_back
from stickslip.quantities.input_file import InputFileError, load_yaml, yaml_text
from stickslip.quantities.units import QuantityError
from stickslip.recording.drive import named_drive
from stickslip.rig import Limits
from stickslip.rig.experiment import run_experiment
from stickslip.waveform import Sequence

mpl.use("agg")

ACTUATOR = ss.load_actuator("kang2007").replace(stage_reaction=False)
LIMITS = Limits(max_voltage=90.0, min_position=-100e-6, max_position=200e-6)
DRIVES = {
    "bursts of 97 Hz": there_and_back(80.0, 97.0, 0.9, 0.2),
    "one way": (ss.Sawtooth(65.0, 20.0)),
    "knots": ss.PeriodicKnots((0.0, 0.7), (0.0, 60.0), 25.0),
}


def planned(model: ss.Actuator = ACTUATOR, drives: Any = DRIVES, **how: Any) -> Plan:
    free = ["sigma_0", "coulomb_force"]
    given: dict[str, Any] = {
        "free": free,
        "noise": "120 nm",
        "limits": LIMITS,
        "duration": 0.2,
        "recordings": 2,
    }
    return ss.plan_experiment(model, drives, **(given | how))


def test_rig_records_a_plan_as_it_is(tmp_path: Path) -> None:
    """What comes is what the plan foresaw: the drive, its begin, the motion but for noise and sensor."""
    plan = planned()
    path = plan.save(tmp_path / "experiment.yaml", before="50 ms")
    assert path.is_file()
    recorded = run_experiment(path, tmp_path / "out")
    assert len(recorded) == sum(walk.repeats for walk in plan.recordings.values())
    drives = plan.drives("50 ms")
    walks = [walk for walk in plan.recordings.values() for _ in range(walk.repeats)]
    for one, drive, walk in zip(recorded, drives, walks, strict=True):
        found = ss.open_recording(one.path)
        assert found.attrs["notes"] in plan.recordings
        assert found.sizes["time"] == round((walk.duration + 0.05) * walk.sample_rate)
        own = named_drive(found)
        t = np.linspace(0.0, walk.duration - 1e-3, 997)
        assert own is not None
        assert ss.waveform.signal.value_at(own, t) == pytest.approx(
            ss.waveform.signal.value_at(walk.drive, t)
        )
        times = found["time"].values
        model = ss.simulate(ACTUATOR, drive, times=times).end_effector_position.values
        x = found["end_effector_position"].values
        assert np.corrcoef(model[:-2], x[2:])[0, 1] > 0.99  # the sensor's delay is 0.8 ms
        assert np.abs(x[times < 0.05]).max() < 1e-6


def test_repeats_are_asked_for_once(tmp_path: Path) -> None:
    plan = planned(drives={"one way": DRIVES["one way"]}, recordings=3)
    content = load_yaml(plan.save(tmp_path / "x.yaml"))
    assert [run["repeats"] for run in content["runs"]] == [3]
    assert content["limits"] == {
        "max_voltage": 90.0,
        "min_position": -100e-6,
        "max_position": 200e-6,
        "stop_slew": "1000 V/s",
        "min_voltage": 0.0,
        "max_duty": 1.0,
    }
    assert content["actuator"] == {"set": "kang2007", "change": {"stage_reaction": False}, "friction": {}}
    assert content["notes"].startswith("Planned for all parameters: these 3 recordings, 600 ms, will give")


def test_actuator_that_is_in_no_set_gets_one(tmp_path: Path) -> None:
    changed = ACTUATOR.replace(name="mine", gain=1.1e-7)
    path = planned(changed).save(tmp_path / "experiment.yaml")
    own = ss.load_actuator(tmp_path / load_yaml(path)["actuator"]["set"])
    assert own.replace(name="mine") == changed


def test_rig_of_another_file_is_kept(tmp_path: Path) -> None:
    example = load_yaml(planned().save(tmp_path / "first.yaml"))
    example |= {"rig": {"kind": "virtual", "bench": "kang2007-bench", "seed": 5}, "operator": "N. N."}
    example["channels"] = {"end_effector_position": {"input": "ideal"}, "drive_voltage": {"input": "drive"}}
    (tmp_path / "mine.yaml").write_text(yaml_text(example))
    plan = planned(recordings=1)
    path = plan.save(tmp_path / "second.yaml", like=tmp_path / "mine.yaml", before=0.0)
    content = load_yaml(path)
    assert content["rig"]["seed"] == 5
    assert content["channels"] == example["channels"]
    assert content["actuator"] == example["actuator"]
    (one,) = run_experiment(path, tmp_path / "out")
    found = ss.open_recording(one.path)
    model = ss.simulate(
        ACTUATOR, plan.drives(0.0)[0], times=found["time"].values
    ).end_effector_position.values
    assert np.std(found["end_effector_position"].values - model) < 0.02 * np.ptp(model)


def test_what_cannot_be_saved_says_why(tmp_path: Path) -> None:
    plan = planned()
    path = plan.save(tmp_path / "x.yaml")
    with pytest.raises(FileExistsError, match="exists"):
        plan.save(path)
    with pytest.raises(InputFileError, match="missing"):
        plan.save(tmp_path / "y.yaml", like=tmp_path / "missing.yaml")
    content = load_yaml(path)
    del content["channels"]["end_effector_position"]
    (tmp_path / "blind.yaml").write_text(yaml_text(content))
    with pytest.raises(QuantityError, match="no channel end_effector_position"):
        plan.save(tmp_path / "y.yaml", like=tmp_path / "blind.yaml")
    nested = Sequence(Sequence(ss.Sawtooth(65.0, 20.0, periods=2)), (ss.Sawtooth(65.0, 20.0), 0.1))
    with pytest.raises(QuantityError, match="only known waveforms, one after the other"):
        planned(drives=[nested]).save(tmp_path / "y.yaml")
    assert not (tmp_path / "y.yaml").exists()


def test_picture_shows_candidates_and_intervals() -> None:
    plan = planned()
    left, right = ss.plot(plan)
    drawn = np.concatenate([line.get_ydata() for line in left.get_lines()])
    assert set(plan.dataset["gain"].values) <= set(drawn.tolist())
    assert [t.get_text() for t in right.get_yticklabels()] == ["sigma 0", "coulomb force"]
    shown = np.concatenate([line.get_xdata() for line in right.get_lines()])
    for name in ("half_width", "default_half_width"):
        for value in 100.0 * plan.dataset[name].values:
            assert np.any(np.isclose(shown, value))
    left.figure.canvas.draw()
    with pytest.raises(QuantityError, match="1 axes are given, and 2 panels need 2"):
        ss.plot(plan, left)


def test_picture_of_waveforms_without_a_frequency() -> None:
    plan = planned(
        drives={"a": Sequence(ss.waveform.Rest(0.05), (ss.Sawtooth(65.0, 20.0), 0.15))}, recordings=1
    )
    assert ss.plot(plan)[0].get_xlabel() == "candidate"
