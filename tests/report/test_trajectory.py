"""The report of a simulation, from a real one."""

import math
import re

import pytest

from stickslip.physics.actuator import load_actuator
from stickslip.report import Document, Number
from stickslip.report.trajectory import trajectory_document
from stickslip.simulation import SimulationWarning, simulate, steady_step
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
    assert document.numbers["mean_velocity"].value == pytest.approx((x[-1] - x[50]) / 0.05)
    assert document.numbers["greatest_friction_force"].value == abs(trajectory["friction_force"]).max()
    assert document.numbers["steady_step"] == Number(3e-6, "m")
    assert ("steady step", Number(3e-6, "m")) in document.highlights
    assert document.summary.endswith("in 1 period of the drive, between equal phases.")


@pytest.mark.parametrize("hertz", [50.0, 60.0])  # at 60 Hz, no sample is at the end of the first period
def test_the_headline_does_not_count_the_stroke_that_is_taken_back(hertz: float) -> None:
    model = load_actuator("kang2007").replace(incline="5 deg", end_effector_mass="0.2 kg")
    drive = Sawtooth(65.0, hertz, periods=4)
    step = steady_step(model, drive)
    document = trajectory_document(model, drive, simulate(model, drive), Number(step, "m"))
    assert document.numbers["net_displacement"].value > 5 * step
    assert document.numbers["mean_velocity"].value == pytest.approx(hertz * step, rel=0.05)
    periods = 3 if hertz == 50.0 else 1
    said = re.fullmatch(rf"The end-effector moved by (\S+) µm in {periods} periods? .*", document.summary)
    assert said
    assert 1e-6 * float(said[1]) == pytest.approx(periods * step, rel=0.05)


def test_less_than_two_periods_have_no_mean_velocity() -> None:
    document = trajectory_document(MODEL, DRIVE, simulate(MODEL, DRIVE, 0.07))
    assert math.isnan(document.numbers["mean_velocity"].value)
    assert "two whole periods" in document.numbers["mean_velocity"].note
    assert document.summary.endswith("in 70 ms, from the first sample to the last.")


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
