"""Mutated replies to rigs that put out tables, and requests to twins: an error of ours or none, no hang, no
voltage beyond limits.

The devices are in this process, and time goes on when it is told to: thousands of replies take seconds.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip.quantities.units import QuantityError
from stickslip.rig import Gate, Limits, RigError
from stickslip.rig.devices.physik_instrumente import E871Client, PiRig
from stickslip.rig.devices.red_pitaya import RedPitayaRig
from stickslip.rig.devices.scpi import PairRig
from stickslip.rig.devices.scpi.twin_generator import GeneratorTwin
from stickslip.rig.devices.scpi.twin_oscilloscope import OscilloscopeTwin
from stickslip.rig.devices.scpi.twin_wiring import Wiring
from stickslip.rig.scpi import ScpiInstrument
from stickslip.rig.table import check_followed
from stickslip.rig.twins import Stage
from stickslip.rig.twins.server import HangUp
from stickslip.rig.variation import EXACT

from .serving import TestClock
from .simulated import Board, PiezoController, StepController
from .wired import PER_VOLT, PLANT

COUNT = 2000  # replies, and requests
SHARE = 0.02  # of them are mutated
HIGHEST = 60.0  # V that is asked for


class Time(TestClock):
    """Time for clients and devices; `asked` is how often the clients looked at it."""

    asked = 0

    def monotonic(self) -> float:
        self.asked += 1
        return self.now()


def mutated(random: np.random.Generator, reply: bytes) -> bytes:
    """A reply with something changed, cut, doubled or put in."""
    made, at = bytearray(reply), int(random.integers(0, len(reply)))
    some = [b"9", b"-", b"e9", b",", b" ", b"nan", b"\n", b"#", b"1" * 30, random.bytes(3)]
    change = int(random.integers(0, 4))
    if change == 0:
        made[at] = int(random.integers(0, 256))
    elif change == 1:
        del made[at : at + int(random.integers(1, 40))]
    elif change == 2:
        made[at:at] = made[: int(random.integers(0, 12))]
    else:
        made[at:at] = some[int(random.integers(len(some)))]
    return bytes(made)


def line_to(
    devices: list[Any], random: np.random.Generator, counts: dict[str, int], share: float = SHARE
) -> Callable[..., Any]:
    """A `Line` to the device of that port, whose replies are mutated now and then."""

    class Mutating:
        def __init__(self, role: str, host: str, port: int, timeout: float) -> None:
            self.device, self._rest = f"{role} at {host}:{port}", b""
            self._session = devices[port].session()

        def send(self, content: bytes) -> None:
            reply = self._session.feed(content)
            counts["replies"] += bool(reply)
            if reply and random.random() < share:
                reply = mutated(random, reply)
            self._rest += reply

        def more(self) -> bytes:
            return self._rest

        def until(self, end: bytes, asked: bytes = b"", timeout: float | None = None) -> bytes:
            if end not in self._rest:
                raise RigError(f"{self.device}: nothing came as the answer to {asked!r}")
            found, _, self._rest = self._rest.partition(end)
            return found

        def exactly(self, count: int, asked: bytes = b"") -> bytes:
            if len(self._rest) < count:
                raise RigError(f"{self.device}: too little came as the answer to {asked!r}")
            found, self._rest = self._rest[:count], self._rest[count:]
            return found

        def close(self) -> None:
            pass

    return Mutating


def made(name: str, clock: Time) -> tuple[list[Any], Callable[[], Any], Any]:
    """Devices by port, what opens the client, and the stage."""
    stage = Stage(PLANT, variation=EXACT.variation, seed=2)
    if name == "e871":
        return [StepController([stage], clock)], lambda: E871Client("here", port=0), stage
    wires = Wiring(stage, {"redpitaya": 100.0, "pi": 1.0}.get(name, 15.0), PER_VOLT, clock=clock)
    if name == "redpitaya":
        options: dict[str, Any] = {"gain": 100.0, "inputs": {"gauge": 1}, "rate": "10 kHz"}
        return [Board(wires)], lambda: RedPitayaRig("here", port=0, **options), stage
    if name == "pi":
        return [PiezoController(wires)], lambda: PiRig("here", port=0), stage
    families = {"infiniivision": "33500", "mso5000": "dg1000z", "dpo3000": "33500"}
    devices = [GeneratorTwin(wires, families[name]), OscilloscopeTwin(wires, name)]
    options = {"gain": 15.0, "inputs": {"gauge": 2}, "rate": "10 kHz"}
    return devices, lambda: PairRig("here:0", "here:1", **options), stage


def run(rig: Any, clock: Time) -> None:
    """A short run through the gate, as `measure` does it."""
    can = rig.capabilities
    gate = Gate(rig, Limits(max_voltage=HIGHEST), can)
    name = next(one for one in can.inputs if one != "drive")
    gate.load(np.append(np.linspace(0.0, HIGHEST, 50), np.zeros(50)))
    gate.arm(("drive", name), 100)
    try:
        gate.start()
        done = 0
        while done < 100:
            block = rig.fetch()
            assert np.all(np.isfinite(block))
            gate.take(block)
            done += block.shape[1]
            clock.sleep(0.02)
            assert clock.asked < 100_000, "it hangs"
    finally:
        gate.stop()


def step(client: Any, clock: Time) -> None:
    """Steps there, and a look."""
    client.step(1, 3, "40 V", "200 Hz")
    for _ in range(100):
        clock.sleep(0.02)
        if not client.moving(1):
            break
    assert np.isfinite(client.position(1))
    client.stop()


@pytest.mark.parametrize("name", ["infiniivision", "mso5000", "dpo3000", "redpitaya", "pi", "e871"])
def test_mutated_replies_do_no_harm(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, random, counts = Time(), np.random.default_rng([7, len(name)]), {"replies": 0, "refused": 0}
    devices, opened, stage = made(name, clock)
    low, high, play = [0.0], [0.0], stage.play

    def watched(piece: Any) -> Any:
        low.append(float(piece.volts.min()))
        high.append(float(piece.volts.max()))
        return play(piece)

    monkeypatch.setattr(stage, "play", watched)
    for module in (
        "gate",
        "devices.scpi.oscilloscopes",
        "devices.scpi.pair",
        "devices.physik_instrumente.piezo_controller",
        "devices.red_pitaya.stemlab",
        "table",
    ):
        monkeypatch.setattr(f"stickslip.rig.{module}.time", clock)
    for module in ("scpi", "devices.physik_instrumente.gcs"):
        monkeypatch.setattr(f"stickslip.rig.{module}.Line", line_to(devices, random, counts))
    client, whole = None, 0
    while counts["replies"] < COUNT:
        clock.asked = 0
        try:
            client = client or opened()
            (step if name == "e871" else run)(client, clock)
            whole += 1
        except (RigError, QuantityError):
            counts["refused"] += 1
            client = None
            clock.sleep(1.0)  # what was put out comes to its end
    assert whole
    assert counts["refused"]
    assert min(low) >= -1e-9
    assert 30.0 < max(high) <= HIGHEST * 1.001


@pytest.mark.parametrize("name", ["infiniivision", "mso5000", "dpo3000"])
def test_mutated_requests_do_no_harm(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a client sends in a run, mutated; whatever a twin raises but the end of a connection is raised."""
    clock, random = Time(), np.random.default_rng([8, len(name)])
    devices, opened, stage = made(name, clock)
    sent: list[tuple[int, bytes]] = []
    base = line_to(devices, random, {"replies": 0}, share=0.0)

    class Listening(base):  # type: ignore[misc, valid-type]
        def __init__(self, role: str, host: str, port: int, timeout: float) -> None:
            super().__init__(role, host, port, timeout)
            self.port = port

        def send(self, content: bytes) -> None:
            sent.append((self.port, content))
            super().send(content)

    for module in ("gate", "devices.scpi.oscilloscopes", "devices.scpi.pair", "table"):
        monkeypatch.setattr(f"stickslip.rig.{module}.time", clock)
    monkeypatch.setattr("stickslip.rig.scpi.Line", Listening)
    run(opened(), clock)
    extremes, play = [0.0], stage.play

    def watched(piece: Any) -> Any:
        extremes.extend((float(piece.volts.min()), float(piece.volts.max())))
        return play(piece)

    monkeypatch.setattr(stage, "play", watched)
    sessions = [device.session() for device in devices]
    some = list(dict.fromkeys(sent))
    starts = [content for port, content in some if port == 0 and b"OFF" not in content]
    for request in range(COUNT):
        if request % 200 == 0:  # a right start among them
            devices[0].session().feed(b"".join(starts))
        port, content = some[int(random.integers(len(some)))]
        clock.sleep(float(random.choice([0.0, 0.002, 0.02])))
        try:
            sessions[port].feed(mutated(random, content))
        except HangUp:
            sessions[port] = devices[port].session()
    assert np.ptp(extremes) > 0.0  # something moved
    assert max(map(abs, extremes)) <= 150.0 + 1e-9  # 10 V of the generator by the amplifier of 15
    assert devices[1].execute("*IDN?").strip().decode() == devices[1].identity


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (b"#15hello\n", ""),
        (b"#15hello\r\n", ""),
        (b"#15hello!\n", "'!' came after its 5 bytes"),
        (b"#16hello\n", "CURV"),
        (b"#15hello\nmore\n", "'more.n' came beside its answer"),
        (b"15hello\n", "no block"),
    ],
)
def test_a_block_is_taken_whole_or_not_at_all(reply: bytes, said: str) -> None:
    """Over a socket: its length, what ends it, and nothing left over."""
    with socket.create_server(("127.0.0.1", 0)) as serving:

        def serve() -> None:
            link = serving.accept()[0]
            for one in (b"a generator\n", reply):
                link.recv(100)
                link.sendall(one)
            link.recv(100)
            link.close()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        link = ScpiInstrument("oscilloscope", f"127.0.0.1:{serving.getsockname()[1]}", timeout=0.5)
        if said:
            with pytest.raises(RigError, match=said):
                link.block("CURV?")
            with pytest.raises(RigError, match="not asked, an answer was late or garbage before"):
                link.ask("*IDN?")
        else:
            assert link.block("CURV?") == b"hello"
        link.close()
        thread.join(10.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda row: b"6.6e35 6.6e35", "drive = 6.6e.35 V came, which is not within -46 to 146 V"),
        (lambda row: row.split()[0] + b" 6.6e35", "position = 6.6e.35 um came, which is not within"),
        (lambda row: b"", "NDATA = 101 was announced, and 100 came"),
        (lambda row: row + b" 1.0", "101 rows came"),
    ],
)
def test_readings_that_a_sensor_cannot_have_are_refused(
    change: Callable[[bytes], bytes], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Time()
    devices, opened, _ = made("pi", clock)

    class Wrong(line_to(devices, np.random.default_rng(0), {"replies": 0}, share=0.0)):  # type: ignore[misc]
        def send(self, content: bytes) -> None:
            super().send(content)
            if content.startswith(b"DRR?"):
                rows = self._rest.split(b"\n")
                rows[60] = change(rows[60])
                self._rest = b"\n".join(one if one.endswith(b" ") else one + b" " for one in rows[:-2] if one)
                self._rest += b"\n" + rows[-2] + b"\n"

    for module in ("gate", "devices.physik_instrumente.piezo_controller", "table"):
        monkeypatch.setattr(f"stickslip.rig.{module}.time", clock)
    monkeypatch.setattr("stickslip.rig.devices.physik_instrumente.gcs.Line", Wrong)
    with pytest.raises(RigError, match=said):
        run(opened(), clock)


def test_a_recorded_drive_is_compared_with_what_was_put_out() -> None:
    played = np.append(np.linspace(0.0, 60.0, 500), np.zeros(500))
    check_followed("a rig", 0.05 * np.roll(played, 4) + 0.3, played)  # a monitor of 1:20, late
    check_followed("a rig", np.zeros(1000), np.full(1000, 0.2))  # next to nothing was put out
    random = np.random.default_rng(1)
    for wrong in (np.zeros(1000), random.standard_normal(1000), np.sin(np.arange(1000.0))):
        with pytest.raises(RigError, match="the recorded drive is not what was put out"):
            check_followed("a rig", wrong, played)
