"""Open drivers of instruments, unmodified, move the simulated ones that our clients are tested on."""

from __future__ import annotations

import pytest

from stickslip.rig.devices.scpi.twin_generator import GeneratorTwin
from stickslip.rig.devices.scpi.twin_oscilloscope import OscilloscopeTwin
from stickslip.rig.twins import Stage

from .serving import ACTUATOR, drive, served
from .simulated import Board, PiezoController, StepController
from .wired import PER_VOLT, wiring


def test_pymeasure_drives_the_generator_and_the_oscilloscope() -> None:
    wires = wiring()
    generator, oscilloscope = GeneratorTwin(wires), OscilloscopeTwin(wires)
    with served(generator) as first, served(oscilloscope) as second:
        said = drive("pair_pymeasure.py", first, second)
    assert "33522B" in said["generator"]
    assert "DSO-X" in said["oscilloscope"]
    assert said["rate"] == 10e3
    assert said["points"] == 5000
    assert said["tick"] == pytest.approx(1e-5)
    assert said["begin"] == pytest.approx(0.0, abs=1e-9)
    assert said["volts"] == pytest.approx([0.0, 4.0], abs=16.0 / 4096)
    walked = said["walked"] * PER_VOLT
    assert 2e-6 < walked < 2 * 60 * 0.1057e-6  # two steps of 4 V by the amplifier of 15
    assert said["errors"] == []
    assert "Undefined header" in said["error"]


def test_pymeasure_reads_the_red_pitaya() -> None:
    with served(Board(wiring(100.0))) as port:
        said = drive("redpitaya_pymeasure.py", port)
    assert said["id"].startswith("REDPITAYA")
    assert (said["buffer"], said["decimation"], said["delay"]) == (16384, 4096, 8192)
    assert (said["before"], said["after"]) == (False, True)
    assert said["samples"] == 4000
    assert said["volts"] == pytest.approx([0.0, 0.6], abs=1e-3)
    assert 2e-6 < said["walked"] * PER_VOLT < 2 * 60 * 0.1057e-6


def test_the_maker_s_pipython_moves_both_controllers_of_pi() -> None:
    stage = Stage(ACTUATOR, travel=4e-3, seed=4)
    with served(PiezoController(wiring(1.0))) as first, served(StepController([stage])) as second:
        said = drive("pi_pipython.py", first, second)
    assert (said["model"], said["stepper"]) == ("E-709.CRG", "E-871.1A1")
    assert said["axes"] == ["1"]
    assert not said["servo"]
    assert said["sample_time"] == 1e-4
    assert said["samples"] == 401
    assert said["volts"] == pytest.approx([0.0, 59.7], abs=0.1)
    assert 2.0 < said["walked"] < 2 * 60 * 0.1057  # um
    assert said["at_20"] - said["at_0"] == pytest.approx(20 * 0.1057, rel=0.3)  # um: it sticks to the stage
    assert said["error"] == 17  # parameter out of range
    assert 20 * 0.5e-3 < said["stepped"] < 20 * 48 * 0.1275e-3  # mm
    assert said["at"] == pytest.approx(0.05, abs=0.006)
    assert said["stopped"] == 10  # the error that a stop leaves
