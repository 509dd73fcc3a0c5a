"""Clients of a Red Pitaya and of PI's controllers against simulated ones; these kinds in experiment files."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.rig import LimitError, RigError
from stickslip.rig.devices.physik_instrumente import E871Client, PiRig
from stickslip.rig.devices.piezosystem_jena.twin import Nv200
from stickslip.rig.devices.red_pitaya import RedPitayaRig
from stickslip.rig.devices.scpi.twin_generator import GeneratorTwin
from stickslip.rig.devices.scpi.twin_oscilloscope import OscilloscopeTwin
from stickslip.rig.experiment import run_experiment
from stickslip.rig.hosted import stop_all
from stickslip.rig.positioner import wait
from stickslip.rig.twins import Stage
from stickslip.rig.variation import EXACT

from .serving import ACTUATOR, served
from .simulated import Board, PiezoController, StepController
from .wired import CAPTURE, CHANNELS, DRIVE, LIMITS, PLANT, deviation, experiment, wiring

BOARD: dict[str, Any] = {"gain": 100.0, "inputs": {"gauge": 1, "monitor": 2}, "rate": "10 kHz"}
POSITION = {
    "drive_voltage": ss.rig.Channel("drive"),
    "end_effector_position": ss.rig.Channel("position", zero=True),
}


def test_a_red_pitaya_records_what_the_plant_does() -> None:
    board = Board(wiring(100.0))
    with served(board) as port:
        rig = RedPitayaRig("127.0.0.1", port=port, timeout="30 s", **BOARD)
        recording = ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)
        assert deviation(recording) < 15e-9  # 12 nm of the jump, 2.4 nm of a step
        seen, asked = 100.0 * recording.monitor.values, recording.drive_voltage.values
        np.testing.assert_allclose(seen[1:], asked[:-1], atol=0.02)  # a sample is just before its update
        assert "REDPITAYA" in recording.attrs["device"]
        assert not board.on
        assert board.wiring.voltage == 0.0
        with pytest.raises(LimitError, match="above the greatest voltage of 100 V"):
            ss.rig.measure(rig, ss.Step("120 V"), CHANNELS, CAPTURE, LIMITS)
        with pytest.raises(RigError, match="have 16395 values; 16384 are possible"):
            rig.load(np.full(16384, 1.0))
        with pytest.raises(RigError, match=r'ACQ:DEC 0: -222,"Data out of range"'):
            rig._do("ACQ:DEC 0")
        rig.close()
        with pytest.raises(RigError, match="Red Pitaya at"):
            rig.load(np.zeros(5))
    with pytest.raises(QuantityError, match="rate = 1000 Hz must be 125 MHz by"):
        RedPitayaRig("127.0.0.1", **{**BOARD, "rate": "1 kHz"})


def at_zero(device: Any) -> None:
    """Wait for it."""
    end = time.monotonic() + 60.0
    while device.wiring.voltage != 0.0:
        assert time.monotonic() < end
        time.sleep(0.01)


def stopped_in_mid_run(rig: Any, device: Any, name: str, samples: int) -> float:
    """Stop at 80 V, at 400 V/s: the output goes to 0 V no sooner. Seconds that it took."""
    rig.load(np.append(np.linspace(0.0, 80.0, 100), np.full(samples - 100, 80.0)))
    rig.arm((name,), samples)
    rig.start()
    while device.wiring.voltage < 79.0:
        time.sleep(0.01)
    began = time.monotonic()
    rig.stop(400.0)
    took = time.monotonic() - began
    assert took >= 80.0 / 400.0
    at_zero(device)
    return took


def test_a_red_pitaya_stops_in_mid_run_and_tells_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    board = Board(wiring(100.0))
    with served(board) as port:
        rig = RedPitayaRig("127.0.0.1", port=port, timeout="30 s", **BOARD)
        assert stopped_in_mid_run(rig, board, "gauge", 9100) < 10.0
        rig.close()
        board.wiring.per_volt = 2e-6  # a sensor that leaves the range of the input
        rig = RedPitayaRig("127.0.0.1", port=port, timeout="30 s", **BOARD)
        with pytest.raises(RigError, match="input 1 was beyond 1 V"):
            ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)
        ss.rig.interlock_of(rig).acknowledge("a test", "it was meant")
        monkeypatch.setattr(board, "_data", lambda channel, count: "{0.1,nonsense}")
        with pytest.raises(RigError, match=r"ACQ:SOUR2:DATA\? is answered by '\{0\.1,nonsense\}'"):
            ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)
        rig.close()
        board.identity = "Another,Board,1,2"
        with pytest.raises(RigError, match="says it is 'Another,Board,1,2', not a Red Pitaya"):
            RedPitayaRig("127.0.0.1", port=port, **BOARD)


def test_a_controller_of_pi_records_what_the_plant_does(monkeypatch: pytest.MonkeyPatch) -> None:
    controller = PiezoController(wiring(1.0))
    with served(controller) as port:
        rig = PiRig("127.0.0.1", port=port, timeout="30 s")
        recording = ss.rig.measure(rig, DRIVE, POSITION, CAPTURE, LIMITS)
        assert deviation(recording) < 13e-9
        assert float(recording.drive_voltage.max()) == pytest.approx(65.0, abs=0.2)
        assert "E-709.CRG" in recording.attrs["device"]
        assert controller.wiring.voltage == 0.0
        with pytest.raises(LimitError, match="above the greatest voltage of 100 V"):
            ss.rig.measure(rig, ss.Step("120 V"), POSITION, CAPTURE, LIMITS)
        with pytest.raises(RigError, match="SVA 1 500: error 17, parameter out of range"):
            rig._line.do("SVA 1 500")
        with pytest.raises(RigError, match="MVR 1 5: error 2, unknown command"):
            rig._line.do("MVR 1 5")
        stopped_in_mid_run(rig, controller, "position", 7000)
        controller._record = lambda given: ["# END_HEADER", "1.0 nonsense"]  # type: ignore[method-assign]
        controller.commands["DRR?"] = controller._record
        with pytest.raises(RigError, match=r"DRR\? 1 \d+ 1 2 is answered by no table: '1\.0 nonsense'"):
            ss.rig.measure(rig, DRIVE, POSITION, CAPTURE, LIMITS)
        rig.close()
        # one that is not understood is brought to 0 V all the same
        rig = PiRig("127.0.0.1", port=port, interval="4 ms", timeout="30 s")
        rig.load(np.append(np.linspace(0.0, 80.0, 100), np.full(8000, 80.0)))
        rig.arm(("position",), 8000)
        rig.start()
        while controller.wiring.voltage < 79.0:
            time.sleep(0.01)
        monkeypatch.setitem(controller.commands, "VOL?", lambda given: ["nonsense"])
        with pytest.raises(RigError, match=r"VOL\? 1 is answered by 'nonsense', no number"):
            rig.stop(400.0)
        end = time.monotonic() + 30.0  # before the end of the wave
        while controller.wiring.voltage != 0.0:
            assert time.monotonic() < end
            time.sleep(0.01)
        rig.close()
        with pytest.raises(QuantityError, match=r"interval = 0\.00015 s must be a multiple of 0\.0001 s"):
            PiRig("127.0.0.1", port=port, interval="150 us")
        controller.identity = "Another, Controller"
        with pytest.raises(RigError, match="says it is 'Another, Controller', not a controller of PI"):
            PiRig("127.0.0.1", port=port)


def test_a_controller_of_pi_ramps_to_rest_what_a_killed_program_left() -> None:
    controller = PiezoController(wiring())
    with served(controller) as port:
        PiRig("127.0.0.1", port=port, timeout="30 s").close()
        controller.execute("SVA 1 60")
        while controller.wiring.voltage < 59.9:
            time.sleep(0.01)
        assert controller.wiring.voltage == pytest.approx(60.0)
        began = time.monotonic()
        PiRig("127.0.0.1", port=port, ramp="200 V/s", timeout="30 s").close()
        assert time.monotonic() - began >= 60.0 / 200.0
        at_zero(controller)


def test_a_stick_slip_controller_of_pi_steps_and_goes() -> None:
    stages = [Stage(ACTUATOR, travel=4e-3, seed=4 + i) for i in range(2)]
    with served(StepController(stages)) as port:
        client = E871Client("127.0.0.1", port=port, timeout="30 s")
        assert client.ranges.axes == (1, 2)
        before, others = stages[1].position, stages[0].position
        client.step(2, 20, "40 V", "200 Hz")
        wait(client, 2)
        time.sleep(0.05)  # the last step has yet to slip
        seen = client.position(2)
        walked = stages[1].position - before
        assert 20 * 0.5e-6 < walked < 20 * 40 * 0.1275e-6
        assert seen == pytest.approx(walked, abs=1e-9)
        assert stages[0].position == others
        client.go(2, "60 um")
        wait(client, 2)
        assert client.position(2) == pytest.approx(60e-6, abs=6e-6)
        client.step(2, 1000, "40 V", "200 Hz")
        client.stop()
        wait(client, 2, "1 s")
        for values in ((2, 5, "200 V", "100 Hz"), (2, 5, "40 V", "1 MHz"), (9, 5, "40 V", "100 Hz")):
            with pytest.raises(QuantityError, match="PI E-871"):
                client.step(*values)
        with pytest.raises(RigError, match="only steps"):
            client.scan(2, "20 V")
        client._line.do("SVO 2 0")
        with pytest.raises(RigError, match="MOV 2 1: error 5, axis is not referenced, or its servo is off"):
            client._line.do("MOV 2 1")
        client.close()


@pytest.mark.parametrize("kind", ["nv200", "scpi", "redpitaya", "pi"])
def test_a_kind_of_rig_in_an_experiment_file(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STICKSLIP_RIGS", str(tmp_path / "rigs"))
    wires = wiring({"scpi": 15.0, "redpitaya": 100.0}.get(kind, 1.0))
    twins = {
        "nv200": lambda: [Nv200(Stage(PLANT, variation=EXACT.variation, seed=2), noise=0.0)],
        "scpi": lambda: [GeneratorTwin(wires), OscilloscopeTwin(wires)],
        "redpitaya": lambda: [Board(wires)],
        "pi": lambda: [PiezoController(wires)],
    }[kind]()
    with ExitStack() as stack:
        ports = [stack.enter_context(served(one)) for one in twins]
        options: dict[str, Any] = {"host": "127.0.0.1", "port": ports[0], "timeout": "30 s"}
        if kind == "scpi":
            places = {
                name: f"127.0.0.1:{port}"
                for name, port in zip(("generator", "oscilloscope"), ports, strict=True)
            }
            options = {**places, "gain": 15, "inputs": {"gauge": 2}, "rate": "10 kHz", "timeout": "30 s"}
        elif kind == "redpitaya":
            options |= {"gain": 100, "inputs": {"gauge": 1}, "rate": "10 kHz"}
        else:
            options["interval"] = "100 us"
        (tmp_path / "walk.yaml").write_text(yaml.safe_dump(experiment(tmp_path, kind, options)))
        run_experiment(tmp_path / "walk.yaml", tmp_path / "out")
        stop_all()
    recording = ss.open_recording(tmp_path / "out" / "walk.nc")
    assert recording.attrs["outcome"] == "complete"
    assert "device" in recording.attrs
    assert deviation(recording) < 0.1e-6  # the NV200 takes 50 us for the jump


def test_what_a_kind_of_rig_lacks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STICKSLIP_RIGS", str(tmp_path / "rigs"))
    path = tmp_path / "walk.yaml"
    options = {"device": "Dev1", "gain": 15, "inputs": {"gauge": "ai0"}, "rate": "20 kHz"}
    path.write_text(yaml.safe_dump(experiment(tmp_path, "daqmx", options)))
    with pytest.raises(RigError, match="needs nidaqmx: pip install nidaqmx"):
        run_experiment(path, tmp_path / "out")
    document = experiment(tmp_path, "scpi", {})
    document["rig"] = {"kind": "scpi", "resource": "TCPIP::127.0.0.1::5025::SOCKET"}  # as it was once
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(ValueError, match="resource"):
        run_experiment(path, tmp_path / "out")
