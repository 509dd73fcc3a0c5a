"""Unmodified drivers by others move the twins: connect, configure, step, scan, read back, error, leave."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from stickslip.quantities.units import QuantityError
from stickslip.rig.twins import TwinTerminal

from .serving import drive, served, twin_of

GAIN = 0.1275e-6  # m/V of the actuator


def bent(scan: list[float], unit: float) -> None:
    """A scan up and down shows the stroke of the piezo, and its hysteresis."""
    up, down = np.array(scan[:5]) * unit, np.array(scan[4:])[::-1] * unit
    stroke = up[-1] - up[0]
    assert 0.55 * GAIN * 100 < stroke < GAIN * 100
    assert np.all(np.diff(up) > 0.0)
    assert np.all(np.diff(down) > 0.0)
    assert 0.02 * stroke < (down - up)[1:4].max() < 0.25 * stroke


def test_the_maker_s_library_moves_the_nv200() -> None:
    twin = twin_of("nv200", axes=1, travel=4e-3)
    with served(twin) as port:
        said = drive("nv200_maker.py", port)
    assert said["unit"] == "µm"
    assert said["range"] == [-20.0, 180.0]
    bent(said["scan"], 1e-6)
    walked = said["after"] - said["before"]
    assert 20 * 2.0 < walked < 20 * 0.08e6 * GAIN * 1e3  # um: some of the stroke of 80 V, 20 times
    assert said["samples"] == [4000, 4000]
    assert said["volts"] == [0.0, 80.0]
    assert said["recorded"][0] == pytest.approx(said["before"], abs=0.05)
    assert said["held"] == pytest.approx(said["target"], abs=0.1)
    assert said["error"] == 4  # admissible range exceeded


def test_pylablib_moves_the_kim101() -> None:
    twin = twin_of("kim101")
    stage = twin.channels[1].axis.stage
    before = stage.position
    with served(twin) as port:
        said = drive("kim101_pylablib.py", port)
    assert said["device"] == "KIM101"
    assert said["channels"] == [1, 2, 3, 4]
    assert said["drive"] == [110, 200, 10000]
    assert said["clipped"] == 125
    assert (said["before"], said["forward"], said["back"]) == (0, 40, 10)  # it counts steps
    assert said["moving"]
    assert said["jogging"]
    assert not said["stopped"]
    assert said["reference"] == 0
    assert "0x0081" in said["error"]
    assert said["after_error"] == 0
    moved = said["moved"]  # steps, net
    assert moved * 1e-6 < stage.position - before < moved * 110 * GAIN
    assert all(channel.axis.stage.voltage == 0.0 for channel in twin.channels[2:])


def test_pymeasure_moves_the_anc300() -> None:
    twin = twin_of("anc300")
    stage = twin.modules[1].axis.stage
    before, beside = stage.position, twin.modules[2].axis.stage.position
    with served(twin) as port:
        said = drive("anc300_pymeasure.py", port)
    assert "ANC300" in said["version"]
    assert said["set"] == [80.0, 200]
    assert said["offset"][0] == 50.0
    assert said["offset"][1] == pytest.approx(50.0)
    assert said["capacity"] == 1400.0
    assert "Axis not in stepping mode" in said["error"]
    assert said["mode"] == "gnd"
    assert 25 * 1e-6 < stage.position - before < 40 * 80 * GAIN  # 40 steps up, some of 10 down
    assert twin.modules[2].axis.stage.position == beside


def test_the_driver_of_bliss_moves_the_mcs2() -> None:
    twin = twin_of("mcs2")
    stage = twin.channels[1].axis.stage
    with served(twin) as port:
        said = drive("mcs2_bliss.py", port)
    assert said["channels"] == 3
    position, known = said["at_power_on"]
    assert abs(position) < 20_000  # pm: it reads 0 wherever it is
    assert not known
    assert said["still"]
    assert 20 * 2e6 < said["steps_up"] < 20 * 80 * GAIN * 1e12
    assert abs(said["steps_down"]) < 0.2 * said["steps_up"]
    bent(said["scan"], 1e-12)
    assert said["closed_loop"] == pytest.approx(50e6, abs=0.1e6)
    position, known = said["referenced"]
    assert known
    assert position == pytest.approx(0.0, abs=0.1e6)
    assert stage.position == pytest.approx(0.0, abs=0.1e-6)  # in the middle of the travel, in truth
    assert said["error"] == 'Error 19 on channel 1: "Invalid parameter"'
    assert said["channel_error"] == 'Error 34 on channel 7: "Invalid channel index"'
    assert not said["after"]


def test_serial_ports() -> None:
    """pylablib's driver of the ANC300, and our clients, through pseudo terminals."""
    kim101, anc300 = twin_of("kim101"), twin_of("anc300")
    motor, stage = kim101.channels[1].axis.stage, anc300.modules[1].axis.stage
    begin, before = motor.position, stage.position
    with TwinTerminal(kim101) as one, TwinTerminal(anc300) as other:
        threads = [threading.Thread(target=each.serve_forever, daemon=True) for each in (one, other)]
        for thread in threads:
            thread.start()
        said = drive("serial_ports.py", one.where, other.where)
        one.shutdown()
        other.shutdown()
        for thread in threads:
            thread.join()
    assert said == {"kim101": 30.0, "axes": [1, 2, 3], "voltage": 80.0, "anc300": -10.0}
    assert 30e-6 < motor.position - begin < 30 * 110 * GAIN
    assert 10e-6 < stage.position - before < 30 * 80 * GAIN  # 30 steps by pylablib, 10 back by ours
    with pytest.raises(QuantityError, match="Nv200 has no serial port"):
        TwinTerminal(twin_of("nv200", axes=1))
