"""The virtual rig as an instrument on TCP: driven by PyVISA as it is, by our back end, and by nonsense."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
import pyvisa
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip.experiment import run_experiment
from stickslip.recording import open_recording
from stickslip.rig import Capture, LimitError, Limits, RigError, ScpiRig, VirtualRig, measure
from stickslip.rig.instrument import Instrument
from stickslip.rig.server import LARGEST_BLOCK, LONGEST_LINE, InstrumentServer
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.shapes import Step

from experiment.files import NAMES, SMALL, written  # isort: skip
from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip


class Served:
    """A server in a thread of its own."""

    def __init__(self, real_time: bool = False, limits: Limits | None = None) -> None:
        self.rig = VirtualRig(ACTUATOR, BENCH, seed=5, real_time=real_time)
        self.server = InstrumentServer(Instrument(self.rig, limits or Limits()), port=0)
        self.port = self.server.server_address[1]
        self.resource = f"TCPIP::127.0.0.1::{self.port}::SOCKET"
        threading.Thread(
            target=self.server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        ).start()

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()

    def says(self, *messages: bytes) -> bytes:
        """All that comes back for raw bytes, until the instrument has nothing more to say, or hangs up: which
        it may, after nonsense, while there is more to come."""
        answer = b""
        with socket.create_connection(("127.0.0.1", self.port), timeout=60.0) as link:
            with contextlib.suppress(OSError):
                for message in messages:
                    link.sendall(message)
                link.shutdown(socket.SHUT_WR)
            with contextlib.suppress(ConnectionResetError):
                while part := link.recv(1 << 16):
                    answer += part
        return answer


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    found = Served()
    yield found
    found.close()


@pytest.fixture
def visa(served: Served) -> Iterator[pyvisa.resources.MessageBasedResource]:
    manager = pyvisa.ResourceManager("@py")
    link = manager.open_resource(
        served.resource, read_termination="\n", write_termination="\n", timeout=10_000
    )
    yield link  # type: ignore[misc]
    link.close()
    manager.close()


def test_bound_to_this_machine_only(served: Served) -> None:
    assert served.server.server_address[0] == "127.0.0.1"


def test_upload_arm_trigger_and_read_back_with_pyvisa(served: Served, visa) -> None:
    assert visa.query("*IDN?").startswith("stickslip,virtual rig kang2007-bench,0,")
    visa.write("*RST")
    drive = np.concatenate([np.zeros(100), np.linspace(0.0, 65.0, 2000)])
    visa.write_binary_values("SOURce:DATA ", drive, datatype="d")
    visa.write("sense:configure 2100,drive,ideal")
    visa.write("INIT")
    visa.write("*TRG")
    assert visa.query("SYST:ERR?") == '0,"No error"'
    blocks = []
    while sum(b.shape[1] for b in blocks) < 2100:
        values = visa.query_binary_values("FETCh?", datatype="d", container=np.array)
        blocks.append(values.reshape(2, -1))
    seen, position = np.concatenate(blocks, axis=1)
    visa.write("OUTP:STOP 1000")
    assert visa.query("SYST:ERR?") == '0,"No error"'
    np.testing.assert_allclose(seen, drive, atol=0.51 * served.rig.capabilities.step)
    assert position[-1] == pytest.approx(0.1057e-6 * 65.0, rel=0.02)
    assert served.rig.output()[1][-1] == pytest.approx(0.0, abs=0.1)


def test_errors_are_told_in_order_and_then_forgotten(visa) -> None:
    visa.write("*RST")
    for command in ("NONSENSE", "SENS:CONF", "SOUR:DATA 5", "INIT", "OUTP:STOP fast", "SYSTE:ERR?"):
        visa.write(command)
    told = [visa.query("SYST:ERR?") for _ in range(7)]
    assert [int(text.partition(",")[0]) for text in told] == [-113, -104, -161, -221, -104, -113, 0]
    visa.write_binary_values("SOUR:DATA ", [200.0], datatype="d")
    assert visa.query("SYST:ERR?").startswith('-222,"Data out of range; the drive reaches 200 V')
    for _ in range(50):
        visa.write("NONSENSE")
    visa.write("*CLS")
    assert visa.query("SYST:ERR?") == '0,"No error"'


def test_the_back_end_records_bit_for_bit_what_the_rig_itself_does(served: Served) -> None:
    drive, capture = Sawtooth(65.0, 20.0, periods=4), Capture(0.3, 1e-3, 0.05)
    fresh = Served()
    link = ScpiRig(fresh.resource)
    far = measure(link, drive, CHANNELS, capture, Limits())
    link.close()
    fresh.close()
    near = measure(VirtualRig(ACTUATOR, BENCH, seed=5), drive, CHANNELS, capture, Limits())
    for name in CHANNELS:
        np.testing.assert_array_equal(far[name], near[name])
    assert far.attrs["source"] == near.attrs["source"]


def test_the_same_experiment_file_on_the_network(served: Served, tmp_path) -> None:
    content = {**SMALL, "rig": {"kind": "scpi", "resource": served.resource}}
    content["channels"] = {
        "drive_voltage": {"input": "drive"},
        "end_effector_position": {"input": "ideal", "zero": True},
    }
    run_experiment(written(tmp_path, content), tmp_path / "far")
    content["rig"] = {"kind": "virtual"}
    content["actuator"] = {"change": {"stage_reaction": False}}
    run_experiment(written(tmp_path, content), tmp_path / "near")
    for name in NAMES:
        far, near = (open_recording(tmp_path / out / f"{name}.nc") for out in ("far", "near"))
        np.testing.assert_array_equal(far["end_effector_position"], near["end_effector_position"])


def test_limits_hold_on_both_sides(served: Served) -> None:
    strict = Served(limits=Limits(max_voltage=50.0))
    link = ScpiRig(strict.resource)
    with pytest.raises(LimitError, match="above the greatest voltage of 40 V"):
        measure(link, Step(45.0), IDEAL, Capture(0.1, 1e-3), Limits(max_voltage=40.0))
    with pytest.raises(RigError, match="the drive reaches 60 V, above the greatest voltage of 50 V"):
        measure(link, Step(60.0), IDEAL, Capture(0.1, 1e-3), Limits())
    assert strict.rig.output()[1].tolist() == [0.0]
    measure(link, Step(45.0), IDEAL, Capture(0.1, 1e-3), Limits())
    link.close()
    strict.close()


@pytest.mark.parametrize("leave", ["disconnect", "silence"])
def test_a_program_that_goes_or_falls_silent_leaves_no_voltage_behind(leave: str) -> None:
    served = Served(real_time=True, limits=Limits(watchdog=0.3))
    link = ScpiRig(served.resource)
    link.load(np.full(200_000, 60.0))
    link.arm(("drive",), 200_000)
    link.start()
    assert sum(link.fetch().shape[1] for _ in range(3)) == 1200
    if leave == "disconnect":
        link.close()
    deadline = time.monotonic() + 60.0
    while served.rig.output()[1][-1] > 1.0 and time.monotonic() < deadline:
        time.sleep(0.05)
    times, volts = served.rig.output()
    assert volts.max() > 59.0
    assert volts[-1] == pytest.approx(0.0, abs=0.1)
    assert times[-1] < 1.0
    with pytest.raises(RigError):
        link.fetch()
    served.close()


def test_nobody_there() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(RigError, match="SOCKET"):
        ScpiRig(f"TCPIP::127.0.0.1::{port}::SOCKET", timeout=1.0)
    with pytest.raises(RigError, match="cannot be opened"):
        ScpiRig("nonsense")


@pytest.mark.parametrize(
    ("message", "number"),
    [
        (b"X" * (LONGEST_LINE + 10) + b"\n", -363),
        (b"SOUR:DATA #9999999999", -363),
        (f"SOUR:DATA #9{LARGEST_BLOCK + 1:09d}".encode(), -363),
        (b"SOUR:DATA #0abc\n", -161),
        (b"SOUR:DATA #x\n", -161),
        (b"SOUR:DATA #2ab\n", -161),
        (b"SOUR:DATA #3800" + b"\0" * 17, -161),
        (b"SOUR:DATA #14abc\n", -161),
        (b"SOUR:DATA #18" + b"\0" * 8 + b"tail\n", -161),
        (b"SOUR:DATA #13abc\n", -161),
        (b"SENS:CONF 10,nose\nINIT\n", -200),
        (b"SENS:CONF 99999999999999999999,drive\n", -104),
        (b"SENS:CONF 999999999,drive\nINIT\n", -200),
        (b"INIT\n", -221),
        (b"OUTP:STOP nan\n", -222),
        (b"\xff\xfe\x00\n", -113),
    ],
)
def test_malformed_messages_become_errors(served: Served, message: bytes, number: int) -> None:
    served.says(b"*RST\n*CLS\n")
    served.says(message)
    told = served.says(b"SYST:ERR?\n").decode()
    assert told.startswith(f"{number},"), told
    assert served.says(b"*IDN?\r\n").startswith(b"stickslip")


WORDS = b"*IDN?|*RST|*TRG|INIT|FETC?|SOUR:DATA |SENS:CONF |10,drive|#|#18|\n|\r\n|;"
WORDS += b"|OUTP:STOP 5|SYST:ERR?|#6999999"
pieces = st.sampled_from([*WORDS.split(b"|"), b"\0" * 8, b"#216" + b"\0" * 16 + b"\n"])


@settings(max_examples=100)
@given(st.lists(pieces | st.binary(max_size=30), max_size=12))
def test_nothing_that_is_sent_kills_it(served: Served, sent: list[bytes]) -> None:
    served.says(*sent)
    assert served.says(b"*RST\n*IDN?\n").startswith(b"stickslip")
    low, high = served.rig.output()[1].min(), served.rig.output()[1].max()
    assert low >= -0.1
    assert high <= 150.0


def test_capabilities_are_those_of_the_rig(served: Served) -> None:
    answer = served.says(b"SYST:CAP?\n")
    assert json.loads(answer[2 + int(answer[1:2]) :])["update_rate"] == 20e3


def test_a_stop_is_short_whatever_slew_is_asked_for(served: Served) -> None:
    """An ask for a ramp of hours is refused, and what stops is as fast as the limits say."""
    served.says(b"*RST\n*CLS\n")
    drive = np.full(2000, 79.0, dtype="<f8").tobytes()
    begin = (
        b"SOUR:DATA #5" + str(len(drive)).encode() + drive + b"\nSENS:CONF 2000,drive\nINIT\n*TRG\nFETC?\n"
    )
    told = served.says(begin + b"OUTP:STOP 0.01\nSYST:ERR?\n")
    assert b'-222,"Data out of range; a slew from 15 to inf V/s"' in told
    times, volts = served.rig.output()  # the connection has ended, and so the output
    assert times[-1] < 0.3
    assert abs(volts[-1]) < 0.1
    for slew in (1e-9, float("nan"), 0.0, -5.0):  # nor does the rig itself take forever
        served.rig.load(np.full(200, 79.0))
        served.rig.arm(("drive",), 2000)
        served.rig.start()
        served.rig.fetch()
        served.rig.stop(slew)
        times, volts = served.rig.output()
        assert times[-1] < 10.5
        assert abs(volts[-1]) < 0.1


def test_a_second_program_is_told_who_holds_it(monkeypatch: pytest.MonkeyPatch) -> None:
    served = Served()
    first = ScpiRig(served.resource)
    with pytest.raises(RigError, match=r"held by 127\.0\.0\.1:\d+, heard \d+ s ago"):
        ScpiRig(served.resource)
    silent = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(30)]  # bounded, too
    monkeypatch.setattr("stickslip.rig.server.TAKEN", 0.2)
    for one in silent:
        one.close()
    time.sleep(0.5)
    second = ScpiRig(served.resource)  # the first has been silent, and nothing runs
    assert second.capabilities == first.capabilities
    with pytest.raises(RigError):
        first.load(np.zeros(5))
    second.close()
    first.close()
    served.close()


def test_home_counts_over_runs_of_a_rig_on_the_network(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole way: program, the process that owns the rig, the instrument; a second program goes on
    there."""
    monkeypatch.setenv("STICKSLIP_RIGS", str(tmp_path / "rigs"))
    fresh = Served()
    content = {
        **SMALL,
        "rig": {"kind": "scpi", "resource": fresh.resource},
        "channels": {"drive_voltage": {"input": "drive"}, "end_effector_position": {"input": "ideal"}},
        "limits": {"max_position": "14 um"},
    }
    content["runs"] = [
        {**SMALL["runs"][0], "matrix": {"voltage": ["65 V"], "frequency": [100.0]}, "repeats": 1}
    ]
    path = written(tmp_path, content)
    run_experiment(path, tmp_path / "first")
    content["runs"][0]["repeats"] = 8
    with pytest.raises(LimitError, match="beyond the end stop at 14 µm"):
        run_experiment(written(tmp_path, content), tmp_path / "second")
    recorded = [*(tmp_path / "second").glob("*.nc")]
    walked = float(open_recording(tmp_path / "first" / "walk_65V_100.nc")["end_effector_position"][-1])
    assert (len(recorded) + 1) * walked < 14e-6, "the first experiment's walk counts"
    fresh.close()
