"""Our own clients move the twins: one contract for all positioners, the NV200 as a rig, faults of each."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.quantities import registry
from stickslip.quantities.units import QuantityError
from stickslip.rig import RigError
from stickslip.rig.attached import probe
from stickslip.rig.devices.attocube import Anc300Client
from stickslip.rig.devices.piezosystem_jena.nv200 import Nv200Rig, loop_of
from stickslip.rig.devices.smaract import Mcs2Client
from stickslip.rig.devices.thorlabs import Kim101Client
from stickslip.rig.positioner import wait

from .serving import ACTUATOR, TestClock, served, twin_of


def client_of(name: str, port: int, timeout: float = 30.0):
    made = {"nv200": Nv200Rig, "mcs2": Mcs2Client, "anc300": Anc300Client, "kim101": Kim101Client}[name]
    return made("127.0.0.1", port=port, timeout=timeout)


def stage_of(name: str, twin, axis: int):
    return (twin.modules[axis] if name == "anc300" else twin.channels[axis - (name == "kim101")]).axis.stage


@pytest.mark.parametrize("name", ["mcs2", "anc300", "kim101"])
def test_a_positioner_steps_there_and_back(name: str) -> None:
    twin = twin_of(name, travel=4e-3)
    stage = stage_of(name, twin, 1)
    with served(twin) as port:
        client = client_of(name, port)
        assert 1 in client.ranges.axes
        begin, before = client.position(1), stage.position
        client.step(1, 30, "90 V", "200 Hz")
        wait(client, 1)
        time.sleep(0.05)  # the last step has yet to slip
        seen, there = client.position(1), stage.position
        assert 30 * 1e-6 < there - before < 30 * 90 * 0.1275e-6
        if client.ranges.sensor:
            assert seen - begin == pytest.approx(there - before, abs=50e-9)
        else:
            assert seen - begin == 30
        client.step(1, -30, "90 V", "200 Hz")
        wait(client, 1)
        assert abs(stage.position - before) < 0.2 * (there - before)
        for values in ((1, 5, "200 V", "100 Hz"), (1, 5, "90 V", "1 MHz"), (9, 5, "90 V", "100 Hz")):
            with pytest.raises(QuantityError, match=client.ranges.name):
                client.step(*values)
        if client.ranges.scans:
            low = stage.elongation
            client.scan(1, "60 V")
            wait(client, 1)
            assert 0.5 * 60 * 0.1275e-6 < stage.elongation - low < 60 * 0.1275e-6
        else:
            with pytest.raises(RigError, match="only steps"):
                client.scan(1, "60 V")
        client.stop()
        client.close()


def test_a_load_makes_steps_uphill_smaller_and_the_end_stop_ends_them() -> None:
    clock = TestClock()
    twin = twin_of("anc300", actuator=ACTUATOR.replace(external_force="-0.15 N"), axes=1, clock=clock)
    module = twin.modules[1]
    stage = module.axis.stage
    session = twin.session()
    session.feed(b"123456\r\necho off\r\nsetm 1 stp\r\nsetv 1 80\r\nsetf 1 100\r\n")

    def moved(command: str) -> float:
        begin = stage.position
        session.feed(f"{command}\r\nstepw 1\r\n".encode())
        clock.sleep(0.05)  # the last step has yet to slip
        module.axis.advance()
        return stage.position - begin

    up, down = moved("stepu 1 20"), moved("stepd 1 20")
    assert 0.0 < up < -down  # the load pulls down
    each = [moved("stepu 1 1") for _ in range(10)]
    assert 1e-4 < np.std(each) / np.mean(each) < 0.3  # no two steps are the same
    moved("stepu 1 1000")
    assert 2e-4 - 10e-6 < stage.position <= stage.end == 2e-4  # it slips back by a step below the stop


def test_the_nv200_is_a_rig() -> None:
    twin = twin_of("nv200", axes=1)
    with served(twin) as port:
        rig = Nv200Rig("127.0.0.1", port=port, interval="100 us", timeout="30 s")
        channels = {
            "drive_voltage": ss.rig.Channel("drive"),
            "end_effector_position": ss.rig.Channel("position"),
        }
        capture = ss.rig.Capture(length="0.12 s", interval="100 us", pre_trigger="5 ms")
        limits = ss.rig.Limits(max_voltage="100 V")
        drive = ss.Sawtooth("80 V", "50 Hz", periods=5)
        recording = ss.rig.measure(rig, drive, channels, capture, limits)
        assert "NV200/D_NET" in recording.attrs["device"]
        volts, position = recording.drive_voltage.values, recording.end_effector_position.values
        assert volts.max() == pytest.approx(80.0, abs=0.5)
        assert np.all(volts[:50] == 0.0)
        assert 5 * 1e-6 < position[-1] - position[0] < 5 * 80 * 0.1275e-6
        assert twin.output.axis.state()[0] == 0.0  # the ramp
        with pytest.raises(ss.rig.LimitError, match="above the greatest voltage"):
            ss.rig.measure(rig, ss.Step("120 V"), channels, capture, limits)
        with pytest.raises(RigError, match="has 1024"):
            ss.rig.measure(rig, ss.Sine("20 V", "7.3 Hz", offset="20 V"), channels, capture, limits)
        with pytest.raises(RigError, match=r"gtarb,0: admissible range exceeded \(error,4\)"):
            rig._do("gtarb,0")
        rig.close()
        with pytest.raises(RigError, match="NV200 at"):
            rig.load(np.zeros(5))


def test_the_nv200_ramps_to_rest_what_a_killed_program_left() -> None:
    twin = twin_of("nv200", axes=1)
    axis, played = twin.output.axis, list[np.ndarray]()
    with served(twin) as port:
        killed = Nv200Rig("127.0.0.1", port=port, timeout="30 s")
        killed._do("set,60")
        killed.close()  # and no stop before
        assert axis.state()[0] == pytest.approx(60.0)
        heard = axis._heard
        axis._heard = lambda path: (played.append(np.diff(path.volts) / np.diff(path.times)), heard(path))
        Nv200Rig("127.0.0.1", port=port, ramp="2000 V/s", timeout="30 s").close()
        assert axis.state()[0] == 0.0
    # Downwards alone: what the killed program set can be told of late, by the server's thread.
    assert np.concatenate(played).min() == pytest.approx(-2000.0, rel=1e-3)
    with pytest.raises(QuantityError, match="ramp = 0"):
        Nv200Rig("127.0.0.1", port=1, ramp=0.0)


def test_a_drive_becomes_the_shortest_table() -> None:
    ramp = np.arange(1.0, 6.0)
    rest = np.zeros(7)
    for drive in (
        np.concatenate([rest, np.tile(ramp, 4)]),
        np.concatenate([rest, np.tile(np.append(ramp, 0.0), 4), np.zeros(9)]),
        np.concatenate([rest, np.full(20, 3.0)]),
        np.arange(30.0),
        np.zeros(4),
    ):
        first, period, cycles = loop_of(drive, 1e-9)
        played = np.concatenate([drive[:first], np.tile(drive[first : first + period], cycles)])
        played = np.append(played, np.full(drive.size, played[-1]))
        assert np.array_equal(played[: drive.size], drive)
        assert first + period <= min(drive.size, 13) or np.all(np.diff(drive) > 0)


@contextmanager
def answering(reply: bytes) -> Iterator[int]:
    """A device that answers everything alike, and then is gone."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            connection, _ = listening.accept()
            with connection, suppress(OSError):
                while reply and connection.recv(4096):
                    connection.sendall(reply)

        threading.Thread(target=serve, daemon=True).start()
        yield listening.getsockname()[1]


@pytest.mark.parametrize(
    "reply",
    [b"", b"\x00\xff\x13\x11", b"error,99\r\n\x11", b"garbage\r\n\x11", b"1,2,3\r\nOK\r\n\x11", b"9" * 70],
    ids=["gone", "binary", "error", "garbage", "numbers", "partial"],
)
@pytest.mark.parametrize("name", ["nv200", "mcs2", "anc300", "kim101"])
def test_what_is_no_such_device_is_a_clear_error(name: str, reply: bytes) -> None:
    with answering(reply) as port, pytest.raises(RigError, match=f"{name.upper()} at 127.0.0.1:{port}"):
        client_of(name, port, 0.2)


@pytest.mark.parametrize("name", ["nv200", "mcs2", "anc300", "kim101"])
def test_a_second_program_does_not_get_the_device(name: str) -> None:
    with served(twin_of(name, axes=1 if name == "nv200" else 3)) as port:
        first = client_of(name, port)
        with pytest.raises(RigError, match=r"connection ended|could not be sent|reset"):
            client_of(name, port)
        first.stop(1e6) if name == "nv200" else first.stop()  # it goes on
        first.close()
        again = client_of(name, port)  # free again
        again.close()


def test_back_ends_are_listed_and_found() -> None:
    said = CliRunner().invoke(app, ["rigs"])
    assert said.exit_code == 0, said.output
    for name in (*registry.rigs.packaged(), *registry.positioners.packaged()):
        assert f"\n{name} (" in f"\n{said.output}"
    assert said.output.count("not run on hardware") >= 4
    with served(twin_of("kim101")) as port:
        (found,) = probe("127.0.0.1", port)
        assert found.name == "kim101"
        listed = CliRunner().invoke(app, ["rigs", "--at", f"127.0.0.1:{port}"])
        assert "KIM101 97000001, kim101" in listed.output
