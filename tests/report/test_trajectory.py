"""The report of a simulation, from a real one."""

import pytest

from stickslip.physics.actuator import load_actuator
from stickslip.report import Document, Number
from stickslip.report.trajectory import trajectory_document
from stickslip.simulation import SimulationWarning, simulate
from stickslip.waveform.periodic import Sawtooth

MODEL = load_actuator("kang2007").replace(end_effector_mass="0.12 kg")
DRIVE = Sawtooth(amplitude="65 V", frequency="20 Hz", periods=2)


@pytest.fixture(scope="module")
def document() -> Document:
    return trajectory_document(MODEL, DRIVE, simulate(MODEL, DRIVE), Number(3e-6, "m"))


def test_results_are_those_of_the_samples(document: Document) -> None:
    trajectory = simulate(MODEL, DRIVE)
    x = trajectory["end_effector_position"].values
    assert document.numbers["net_displacement"] == Number(x[-1], "m")
    assert document.numbers["mean_velocity"].value == pytest.approx(x[-1] / 0.1)
    assert document.numbers["greatest_friction_force"].value == abs(trajectory["friction_force"]).max()
    assert document.numbers["steady_step"] == Number(3e-6, "m")
    assert ("steady step", Number(3e-6, "m")) in document.highlights
    assert "moved by" in document.summary


def test_every_parameter_is_told_with_unit_and_origin(document: Document) -> None:
    parameters, drive = document.tables()[1:]
    rows = {row[0]: row for row in parameters.rows}
    assert rows["gain"][1:] == ("C", "stroke per volt at rest", Number(1.057e-7, "m/V"), rows["gain"][4])
    assert "5.10" in rows["gain"][4]
    assert rows["end_effector_mass"][3:] == (Number(0.12, "kg"), "changed for this simulation")
    assert rows["min_voltage"][4] == "assumed"
    assert rows["incline"][4] == "default"
    assert rows["friction"][3] == "LuGre"
    assert rows["friction.sigma_0"][3] == Number(1.399e6, "N/m")
    assert rows["stage_reaction"][3] == "yes"
    assert {row[0]: row[3] for row in drive.rows}["frequency"] == Number(20.0, "Hz")
    assert document.numbers["parameters"]["friction.sigma_0"] == Number(1.399e6, "N/m")
    assert document.numbers["drive"]["shape"] == "Sawtooth"


def test_sources_and_assumptions_are_told(document: Document) -> None:
    assert "@mastersthesis{kang2007" in document.citations
    assumed = {assumption.partition(" = ")[0] for assumption in document.assumptions}
    assert "min_voltage" in assumed
    assert "end_effector_mass" not in assumed  # it was set for this simulation


def test_a_simulation_that_stopped_says_so_first() -> None:
    with pytest.warns(SimulationWarning):
        part = simulate(MODEL, DRIVE, max_steps=60)
    document = trajectory_document(MODEL, DRIVE, part)
    assert document.summary.startswith("The simulation stopped at t = ")
    assert document.numbers["duration"].value < 0.1
    assert "steady_step" not in document.numbers


def test_values_by_hand_have_no_source() -> None:
    model = MODEL.replace(name="")
    document = trajectory_document(model, DRIVE, simulate(model, DRIVE))
    assert document.title == "Simulation of Actuator"
    assert [column.name for column in document.tables()[1].columns][-1] == "value"
