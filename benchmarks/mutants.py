"""Mutated requests to twins, and mutated replies to clients: no hang, no crash, no voltage beyond the limits.

python -m benchmarks.mutants [COUNT] [--seed S]

Requests go into a twin, a connection after another, and what comes out of its amplifier is watched. Replies
go over a socket to a client that moves a twin within 80 V (85 V where a device does no less), some of them
mutated by the way. It may refuse, with a RigError or a QuantityError; anything else is raised here.
"""

from __future__ import annotations

import argparse
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
from tests.twins.serving import ACTUATOR, TestClock

from stickslip.quantities.units import QuantityError
from stickslip.rig import RigError
from stickslip.rig.devices.attocube import Anc300Client
from stickslip.rig.devices.attocube.twin import Anc300
from stickslip.rig.devices.piezosystem_jena import Nv200Rig
from stickslip.rig.devices.piezosystem_jena.twin import Nv200
from stickslip.rig.devices.smaract import Mcs2Client
from stickslip.rig.devices.smaract.twin import Mcs2
from stickslip.rig.devices.thorlabs import Kim101Client
from stickslip.rig.devices.thorlabs.twin import Kim101
from stickslip.rig.twins import HangUp, Stage

ASKED = 80.0  # V that a client asks for at most
# Of the replies, so many are mutated: a KIM101 gives few when it is opened.
SHARE = {"nv200": 0.15, "mcs2": 0.15, "anc300": 0.15, "kim101": 0.4}
TIMEOUT = 0.04  # s that a client waits for an answer
LONGEST = 10.0  # s that a call of a client may take: each of its questions may find no answer
_NV200 = """
meas stat set desc cl,0 cl,1 grun,1 grun,0 set,12.5 setst,30,100 modsrc,3 modsrc,0 sr,20 gcarb,3 gbarb,7,55.5
gbarb,7 gsarb,0 gearb,30 gtarb,2 s recast,2 recstr,1 reclen,300 recrun,1 recrun recidx recout,0,0,9 recoutf,1
recsrc,0,2 pcf,1,2,3 reset
"""
_MCS2 = """
:DEV:NOCH?;:CHAN0:MMOD 4;:CHAN0:MMOD 2;:CHAN0:MMOD 0;:MOVE0 20;:MOVE1 -300;:MOVE0 65535;:STOP0;:CHAN0:POS?;
:CHAN0:STEP:FREQ 1000;:CHAN0:STEP:AMPL 50000;:CHAN1:HOLD -1;:SYST:ERR?;:SYST:ERR:COUN?;:REF0;:CAL0;
:CHAN0:STAT?;:CHAN0:POS 100;:CHAN1:SCAN:VEL 10;:CHAN0:VEL 1000000;*IDN?
"""
_ANC300 = """
setm 1 stp;setm 2 off;setm 1 stp+;setm 1 gnd;getm 1;setv 1 80;setf 1 1000;seta 2 40;stepu 1 20;stepd 1 c;
stop 1;stepw 1;geto 1;getc 1;getpu 1;ver;echo on
"""


def _frame(message: int, data: bytes) -> bytes:
    return struct.pack("<HHBB", message, len(data), 0x50 | 0x80, 1) + data


REQUESTS: dict[str, list[bytes]] = {
    "nv200": [f"{line}\r\n".encode() for line in ("", *_NV200.split())],
    "mcs2": [f"{line.strip()}\n".encode() for line in _MCS2.split(";")],
    "anc300": [f"{line.strip()}\r\n".encode() for line in _ANC300.split(";")],
    "kim101": [
        struct.pack("<HBBBB", 0x0005, 0, 0, 0x50, 1),
        struct.pack("<HBBBB", 0x08E0, 0, 0, 0x50, 1),
        struct.pack("<HBBBB", 0x08D9, 1, 1, 0x50, 1),
        struct.pack("<HBBBB", 0x08C1, 0x07, 2, 0x50, 1),
        _frame(0x08C0, struct.pack("<HH", 0x2B, 1)),
        _frame(0x08C0, struct.pack("<HHHII", 0x07, 1, 110, 500, 1000)),
        _frame(0x08C0, struct.pack("<HHHIIII", 0x2D, 1, 1, 50, 60, 300, 1000)),
        _frame(0x08D4, struct.pack("<Hi", 1, 50)),
        _frame(0x08D4, struct.pack("<Hi", 1, -50)),
    ],
}
RANGE = {"nv200": (-20.0, 180.0), "mcs2": (0.0, 100.0), "anc300": (0.0, 150.0), "kim101": (0.0, 125.0)}


def mutated(random: np.random.Generator, content: bytes) -> bytes:
    """A message with some bytes changed, cut, doubled or put in."""
    made = bytearray(content)
    for _ in range(int(random.integers(0, 4))):
        at = int(random.integers(0, len(made) + 1))
        what = int(random.integers(0, 5))
        if what == 0 and made:
            made[at % len(made)] = int(random.integers(0, 256))
        elif what == 1:
            del made[at : at + int(random.integers(1, 4))]
        elif what == 2:
            made[at:at] = made[: int(random.integers(0, 12))]
        elif what == 3:
            made[at:at] = random.choice([b"9", b"-", b"e9", b",", b" ", b"nan", b"\x00", b"\r", b"1" * 30])
        else:
            made[at:at] = random.bytes(int(random.integers(1, 6)))
    return bytes(made)


class Watched(Stage):
    """A stage that remembers the extremes of its voltage."""

    low = high = 0.0

    def play(self, piece: Any) -> Any:
        self.low, self.high = (
            min(self.low, float(piece.volts.min())),
            max(self.high, float(piece.volts.max())),
        )
        return super().play(piece)


def twin_with(name: str, seed: int, clock: TestClock) -> tuple[Any, list[Any]]:
    """A twin whose stages are watched."""
    stages: list[Any] = [Watched(ACTUATOR, seed=seed + i) for i in range(1 if name == "nv200" else 2)]
    if name == "nv200":
        return Nv200(stages[0], clock=clock), stages
    if name == "anc300":
        return Anc300(stages, clock=clock, longest_wait=0.1), stages
    return (Mcs2 if name == "mcs2" else Kim101)(stages, clock=clock), stages


def besiege(name: str, count: int, seed: int) -> dict[str, float]:
    """Feed so many mutated requests; what the longest took, s, and the voltages that came out.

    Whatever the twin raises but `HangUp`, which ends a connection, is raised here.
    """
    random, clock = np.random.default_rng([seed, len(name)]), TestClock()
    twin, stages = twin_with(name, seed, clock)
    session, longest, hung = None, 0.0, 0
    for _ in range(count):
        if session is None:
            session = twin.session()
            if name == "anc300":
                session.feed(b"123456\r\n")
        request = mutated(random, REQUESTS[name][int(random.integers(len(REQUESTS[name])))])
        clock.sleep(float(random.choice([0.0, 0.002, 0.02])))
        began = time.perf_counter()
        try:
            session.feed(request)
        except HangUp:
            twin.leave()
            session, hung = None, hung + 1
        longest = max(longest, time.perf_counter() - began)
    low, high = min(stage.low for stage in stages), max(stage.high for stage in stages)
    return {"longest": longest, "low": low, "high": high, "hung_up": hung}


class _Misleading:
    """A relay before a twin, on a socket of this machine, that mutates some of what it says."""

    def __init__(self, twin: Any, clock: TestClock, random: np.random.Generator, share: float) -> None:
        self._twin, self._clock, self._random, self._share = twin, clock, random, share
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port, self.mutated = self._listening.getsockname()[1], 0
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """No more."""
        self._listening.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                link, _ = self._listening.accept()
                with link, suppress(OSError, HangUp):
                    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._serve(link)
                self._twin.leave()

    def _serve(self, link: socket.socket) -> None:
        session = self._twin.session()
        link.sendall(session.greeting)
        while asked := link.recv(65536):
            self._clock.sleep(0.02)
            answer = session.feed(asked)
            if answer and self._random.random() < self._share:
                changed = mutated(self._random, answer)
                self.mutated += changed != answer
                answer = changed
            if answer:
                link.sendall(answer)


def _client(name: str, port: int) -> Any:
    made = {"nv200": Nv200Rig, "mcs2": Mcs2Client, "anc300": Anc300Client, "kim101": Kim101Client}[name]
    return made("127.0.0.1", port=port, timeout=TIMEOUT)


def _calls(name: str, client: Any) -> Iterator[Callable[[], object]]:
    """What a program does with it."""
    if name == "nv200":
        saw = np.tile(np.append(np.linspace(0.0, ASKED, 5), 0.0), 3)
        yield lambda: client.load(np.append(np.zeros(3), saw))
        yield lambda: client.arm(("drive", "position"), 30)
        yield client.start
        yield client.fetch
        yield lambda: client.stop(np.inf)
        return
    yield lambda: client.step(1, 5, ASKED if name != "kim101" else "85 V", "500 Hz")
    yield lambda: client.moving(1)
    yield lambda: client.position(1)
    if client.ranges.scans:
        yield lambda: client.scan(1, ASKED)
    yield client.stop


def mislead(name: str, count: int, seed: int) -> dict[str, float]:
    """Mutate so many replies; what the longest call of the client took, s, how often it refused, and the
    voltages that came out."""
    random, clock = np.random.default_rng([seed, len(name), 1]), TestClock()
    twin, stages = twin_with(name, seed, clock)
    relay, longest, refused, calls = _Misleading(twin, clock, random, SHARE[name]), 0.0, 0, 0
    while relay.mutated < count:
        began = time.perf_counter()
        client = None
        with suppress(RigError, QuantityError):
            client = _client(name, relay.port)
        longest, calls = max(longest, time.perf_counter() - began), calls + 1
        if client is None:
            refused += 1
            continue
        for call in _calls(name, client):
            began, calls = time.perf_counter(), calls + 1
            try:
                call()
            except (RigError, QuantityError):
                refused += 1
            longest = max(longest, time.perf_counter() - began)
        client.close()
    relay.close()
    low, high = min(stage.low for stage in stages), max(stage.high for stage in stages)
    return {"longest": longest, "low": low, "high": high, "refused": refused, "calls": calls}


def main() -> None:
    """A line for each protocol and direction."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=20)
    given = parser.parse_args()
    for name in REQUESTS:
        for what, act in (("requests", besiege), ("replies", mislead)):
            began = time.perf_counter()
            found = act(name, given.count, given.seed)
            said = ", ".join(f"{key} {value:.3g}" for key, value in found.items())
            print(f"{name} {what}: {said}; {time.perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
