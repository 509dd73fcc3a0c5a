"""FMUs at the begin of their runs and in communication steps of many lengths."""

from __future__ import annotations

from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

import stickslip as ss
from export.building import packaged_fmu
from export.test_fmu import instance
from stickslip.export import export_fmu

KANG = ss.load_actuator("kang2007")
OUTPUTS = ("end_effector_position", "stage_position", "friction_force", "drive_voltage")


@pytest.mark.parametrize(
    ("fmi", "law"), [(2, KANG.friction), (3, ss.Coulomb(0.54))], ids=["LuGre", "Coulomb"]
)
def test_outputs_are_right_while_it_initialises(fmi: int, law: Any, tmp_path: Any) -> None:
    """They follow what is set, and stay as they are when the initialisation ends."""
    model = KANG.replace(friction=law, external_force=0.2, min_voltage=10.0)
    made, put, got = instance(export_fmu(model, tmp_path / "fmu", fmi=fmi), tmp_path / "at", fmi, [])
    for volts in (60.0, 40.0):
        put("voltage", volts)
        rest = ss.simulate(model, ss.Constant(volts), 1e-3, sample_rate=2e4)
        seen = [got(name) for name in OUTPUTS]
        assert seen == pytest.approx([float(rest[name][0]) for name in OUTPUTS], rel=1e-6)
    put("friction.coulomb_force" if law != KANG.friction else "friction.sigma_0", 0.3)
    changed = [got(name) for name in OUTPUTS]
    made.exitInitializationMode()
    assert [got(name) for name in OUTPUTS] == changed


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_voltage_of_a_feedforward_while_it_initialises(fmi: int, tmp_path: Any) -> None:
    made, put, got = instance(packaged_fmu(fmi, "feedforward"), tmp_path / "at", fmi, [])
    put("wanted_position", 3e-6)
    assert got("voltage") == pytest.approx(3e-6 / KANG.gain)
    made.exitInitializationMode()
    assert got("voltage") == pytest.approx(3e-6 / KANG.gain)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_wrong_parameter_is_said_where_an_output_is_read(fmi: int, tmp_path: Any) -> None:
    said: list[str] = []
    _, put, got = instance(packaged_fmu(fmi), tmp_path / "at", fmi, said)
    put("friction.sigma_0", -1.0)
    assert got("friction.sigma_0") == -1.0
    with pytest.raises(Exception, match=r"failed|error|status"):
        got("stage_position")
    assert any("LuGre.sigma_0 is out of range" in text for text in said)


def observed(fmu: Any, plant: Any, folder: Any, fmi: int, lengths: Any, said: list[str]) -> np.ndarray:
    """Errors of the estimate after communication steps of these lengths, m; the model is exact."""
    both = [instance(one, folder / f"{k}", fmi, said) for k, one in enumerate((fmu, plant))]
    random, t, errors = np.random.default_rng(7), 0.0, []
    both[1][1]("step", float(fmpy.read_model_description(fmu).defaultExperiment.stepSize))
    for made, _, _ in both:
        made.exitInitializationMode()
    (_, measure, estimate), (_, _, truth) = both
    for h in lengths:
        measure("measured_position", truth("end_effector_position") + 10e-9 * random.standard_normal())
        for made, put, _ in both:
            put("voltage", 65.0 * ((50.0 * t + 1e-9) % 1.0))
            made.doStep(currentCommunicationPoint=t, communicationStepSize=float(h))
        t += h
        errors.append(estimate("end_effector_position") - truth("end_effector_position"))
    return np.array(errors)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("h", [20e-6, 1e-3])
def test_an_observer_in_its_step(fmi: int, h: float, tmp_path: Any) -> None:
    """And in parts of it: the estimate is corrected once in each step."""
    plant = packaged_fmu(fmi)
    observer = packaged_fmu(fmi, "observer")  # in steps of 20 us
    if h != 20e-6:
        observer = export_fmu(KANG, tmp_path / "o", fmi=fmi, mode="observer", step=h)
    description = fmpy.read_model_description(observer)
    assert validate_fmu(observer) == []
    assert not description.coSimulation.canHandleVariableCommunicationStepSize
    assert float(description.defaultExperiment.stepSize) == h
    assert "step" not in [v.name for v in description.modelVariables]
    count, said = max(300, round(0.03 / h)), []
    errors = observed(observer, plant, tmp_path / "a", fmi, np.full(count, h), said)
    assert np.sqrt(np.mean(errors**2)) < (8e-9 if h < 50e-6 else 20e-9)  # a step ahead
    errors = observed(observer, plant, tmp_path / "b", fmi, np.full(4 * count, 0.25 * h), said)
    assert np.sqrt(np.mean(errors**2)) < (8e-9 if h < 50e-6 else 20e-9)  # a step ahead
    assert not said


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_observer_in_other_steps(fmi: int, tmp_path: Any) -> None:
    """A longer one is refused, one that leaves a longer time between corrections gives a warning."""
    observer, plant = packaged_fmu(fmi, "observer"), packaged_fmu(fmi)
    said: list[str] = []
    with pytest.raises(Exception, match=r"failed|error|status"):
        observed(observer, plant, tmp_path / "a", fmi, [30e-6], said)
    assert any("export the observer with the communication step as its step" in text for text in said)
    said.clear()
    observed(observer, plant, tmp_path / "b", fmi, [15e-6, 15e-6, 15e-6], said)
    assert [text for text in said if "since the last correction is longer" in text]


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_lost_estimate_is_a_warning(fmi: int, tmp_path: Any) -> None:
    said: list[str] = []
    made, put, got = instance(packaged_fmu(fmi, "observer"), tmp_path / "at", fmi, said)
    made.exitInitializationMode()
    for k, measured in enumerate((0.0, np.nan, 1e-6, 1e-3, 1e-3)):
        put("measured_position", measured)
        made.doStep(currentCommunicationPoint=k * 20e-6, communicationStepSize=20e-6)
    assert ["the estimate was lost" in text for text in said] == [True]
    assert got("end_effector_position") == pytest.approx(1e-3)


@pytest.mark.parametrize(("fmi", "delay"), [(2, 0.0), (3, 4e-6), (2, 30e-6), (3, 35e-6)])
def test_a_late_channel_in_steps_of_any_length(fmi: int, delay: float, tmp_path: Any) -> None:
    """Shorter and longer than the internal step, equal and not; within what a line between 10 us leaves."""
    chain = ss.recording.Chain(delay=delay, offset=1e-6, scale=1.02)
    fmu = export_fmu(KANG, tmp_path / "fmu", fmi=fmi, chain=chain)
    random = np.random.default_rng(3)
    for k, lengths in enumerate(
        (
            *(np.full(round(0.02 / h), h) for h in (1e-5, 20e-6, 60e-6)),
            np.full(2000, 1e-6),
            np.full(50, 1e-3),
            random.uniform(11e-6, 60e-6, 600),
            random.choice([3e-6, 20e-6, 90e-6], 600),
        )
    ):
        made, put, got = instance(fmu, tmp_path / f"{k}", fmi, [])
        made.exitInitializationMode()
        times, positions, seen = [0.0], [got("end_effector_position")], [got("sensor_output")]
        for h in lengths:
            put("voltage", 30.0 * (1.0 - np.cos(2.0 * np.pi * 20.0 * times[-1])))
            made.doStep(currentCommunicationPoint=times[-1], communicationStepSize=float(h))
            times.append(times[-1] + float(h))
            positions.append(got("end_effector_position"))
            seen.append(got("sensor_output"))
        expected = 1.02 * np.interp(np.array(times) - delay, times, positions) + 1e-6
        # In steps of 1 ms the delay is a part of one, and lines over them are not the motion.
        most = 0.5e-9 if np.max(lengths) < 1e-4 else 30e-9
        assert np.max(np.abs(np.array(seen) - expected)) < most
