"""FMUs: valid, built again from their sources, with the solver's motion, for both versions of FMI."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.build import build_platform_binary
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from export.building import packaged_fmu
from stickslip import MaxwellSlip, load_actuator, simulate
from stickslip.export import export_fmu
from stickslip.friction import Coulomb
from stickslip.physics import PulledSlider
from stickslip.recording.chain import Chain
from stickslip.waveform.periodic import Sawtooth

KANG = load_actuator("kang2007")
STEP = 20e-6


def sawtooth(volts: float, hertz: float, end: float) -> np.ndarray:
    """Samples of the sawtooth as FMPy wants them."""
    t = np.arange(round(end / STEP) + 1) * STEP
    u = volts * ((t * hertz + 1e-9) % 1.0)
    return np.array(list(zip(t, u, strict=True)), dtype=[("time", float), ("voltage", float)])


@pytest.mark.parametrize("fmi", [2, 3])
def test_walk(fmi, tmp_path) -> None:
    fmu = packaged_fmu(fmi)
    assert validate_fmu(fmu) == []
    end = 0.09
    how: dict[str, Any] = dict(
        stop_time=end, output_interval=STEP, input=sawtooth(65, 20, end), output=["end_effector_position"]
    )
    found = fmpy.simulate_fmu(str(fmu), **how)
    truth = simulate(KANG, Sawtooth(65, 20), times=[0.0, 0.04, 0.07, end], tolerance=1e-11)
    positions = np.interp(truth["time"].values, found["time"], found["end_effector_position"])
    # The input is held over a step, half a step late on the ramps: 65 V * 20 Hz * 10 us * gain is 1.4 nm.
    assert positions == pytest.approx(truth["end_effector_position"].values, abs=15e-9)
    sources = Path(fmpy.extract(export_fmu("kang2007", tmp_path / "bare", fmi=fmi, compiler="")))
    (tmp_path / "build").mkdir()
    build_platform_binary(sources, tmp_path / "build")
    again = fmpy.simulate_fmu(str(sources), **how)
    assert again["end_effector_position"] == pytest.approx(found["end_effector_position"], abs=1e-12)
    changed = fmpy.simulate_fmu(
        str(fmu), start_values={"friction.coulomb_force": 0.4, "friction.stiction_force": 0.4}, **how
    )
    law = KANG.friction._replace(coulomb_force=0.4, stiction_force=0.4)
    other = simulate(KANG.replace(friction=law), Sawtooth(65, 20), times=[0.0, end], tolerance=1e-11)
    assert changed["end_effector_position"][-1] == pytest.approx(
        other["end_effector_position"].values[-1], abs=15e-9
    )


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("mode", ["plant", "observer", "feedforward"])
def test_valid_in_every_mode(fmi, mode, tmp_path) -> None:
    model = KANG.replace(friction=MaxwellSlip((1e6, 4e5), (0.3, 0.24)), natural_frequency=math.inf)
    chain = Chain(slew_rate=1e5)  # without one a static stage would jump
    fmu = (
        export_fmu(model, tmp_path / "fmu", fmi=fmi, chain=chain)
        if mode == "plant"
        else packaged_fmu(fmi, mode)
    )
    assert validate_fmu(fmu) == []
    names = zipfile.ZipFile(fmu).namelist()
    assert "documentation/licenses/license.txt" in names
    assert any(name.endswith(".so") for name in names)
    description = fmpy.read_model_description(fmu)
    parameters = {v.name: v for v in description.modelVariables if v.causality == "parameter"}
    assert parameters["gain"].unit == "m/V"
    assert "5.10" in parameters["gain"].description
    assert float(parameters["gain"].start) == KANG.gain


def instance(fmu, folder, fmi: int, messages: list[str]):
    """A running instance, whose messages are collected."""
    description = fmpy.read_model_description(fmu)
    library = fmpy.extract(fmu, folder)
    kind = FMU2Slave if fmi == 2 else FMU3Slave
    made = kind(
        guid=description.guid,
        unzipDirectory=library,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    references = {v.name: v.valueReference for v in description.modelVariables}
    if fmi == 2:
        callbacks = fmpy.fmi2.fmi2CallbackFunctions()

        def log(environment, name, status, category, message) -> None:
            messages.append(message.decode())

        callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(log)
        callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.fmi2.calloc)
        callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.fmi2.free)
        made.instantiate(callbacks=callbacks)
        made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
    else:
        made.instantiate(
            logMessage=lambda environment, status, category, message: messages.append(message.decode())
        )
        made.enterInitializationMode(startTime=0.0)
    put, got = (made.setReal, made.getReal) if fmi == 2 else (made.setFloat64, made.getFloat64)
    return (
        made,
        lambda name, value: put([references[name]], [value]),
        lambda name: got([references[name]])[0],
    )


def step(made, fmi: int, k: int) -> None:
    made.doStep(currentCommunicationPoint=k * 1e-4, communicationStepSize=1e-4)


@pytest.mark.parametrize("fmi", [2, 3])
def test_state_is_kept_and_serialised(fmi, tmp_path) -> None:
    made, put, got = instance(packaged_fmu(fmi), tmp_path / "unzipped", fmi, [])
    made.exitInitializationMode()
    put("voltage", 60.0)
    for k in range(5):
        step(made, fmi, k)
    get_state, set_state, serialize, deserialize = (
        (made.getFMUstate, made.setFMUstate, made.serializeFMUstate, made.deSerializeFMUstate)
        if fmi == 2
        else (made.getFMUState, made.setFMUState, made.serializeFMUState, made.deserializeFMUState)
    )
    kept = get_state()
    written = serialize(kept)
    later = []
    for _ in range(2):
        for k in range(5, 15):
            step(made, fmi, k)
        later.append(got("end_effector_position"))
        set_state(kept)
    restored = deserialize(written)
    set_state(restored)
    for k in range(5, 15):
        step(made, fmi, k)
    assert later == [got("end_effector_position")] * 2
    assert abs(later[0]) > 1e-6


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("friction.sigma_0", -1.0, "LuGre.sigma_0 is out of range"),
        ("friction.stiction_force", 0.1, "stiction must be >= coulomb_force"),
        ("gain", math.nan, "Actuator.gain is out of range"),
        ("max_voltage", -5.0, "min_voltage is out of range"),
        ("step", 5.0, "the step h [s] is out of range"),
    ],
)
def test_bad_parameters_are_said(fmi, name, value, said, tmp_path) -> None:
    messages: list[str] = []
    made, put, _ = instance(packaged_fmu(fmi), tmp_path / "unzipped", fmi, messages)
    put(name, value)
    with pytest.raises(Exception, match=r"failed|error|status"):
        made.exitInitializationMode()
    assert any(said in message for message in messages), messages


def test_observer_and_feedforward(tmp_path) -> None:
    """The observer begins wrong and finds the plant; the feedforward's voltage moves it as wanted."""
    made, put, got = instance(packaged_fmu(2, "feedforward"), tmp_path / "unzipped", 2, [])
    put("wanted_position", 3e-6)
    put("wanted_velocity", 1e-4)
    put("wanted_acceleration", 0.5)
    made.exitInitializationMode()
    a, f = KANG, 0.5 * KANG.end_effector_mass
    y = 3e-6 + f / a.friction.sigma_0
    total = a.stage_mass + a.end_effector_mass
    expected = (total * 0.5 + a.stage_damping * 1e-4 + a.stage_stiffness * y) / a.drive_force_per_volt
    assert got("voltage") == pytest.approx(expected, rel=1e-12)

    fmu = export_fmu(KANG.replace(friction=Coulomb(0.54)), tmp_path / "observer", mode="observer", step=1e-4)
    made, put, got = instance(fmu, tmp_path / "unzipped2", 2, [])
    made.exitInitializationMode()
    put("measured_position", 1e-6)
    for k in range(3000):
        step(made, 2, k)
    assert got("end_effector_position") == pytest.approx(1e-6, rel=1e-3)


def test_pulled_slider_in_metres(tmp_path) -> None:
    fmu = export_fmu(PulledSlider(0.1, 200.0, 0.5, Coulomb(0.2)), tmp_path / "fmu")
    assert validate_fmu(fmu) == []
    units = {v.name: v.unit for v in fmpy.read_model_description(fmu).modelVariables}
    assert units["spring_end"] == "m"
