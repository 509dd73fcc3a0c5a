"""Mutated requests and replies of each protocol; the benchmark of faults takes them from here as well."""

from __future__ import annotations

import struct
import time
from typing import Any

import numpy as np

from stickslip.twins import Anc300, HangUp, Kim101, Mcs2, Nv200, Stage

from .serving import ACTUATOR, TestClock


def _frame(message: int, data: bytes) -> bytes:
    return struct.pack("<HHBB", message, len(data), 0x50 | 0x80, 1) + data


REQUESTS: dict[str, list[bytes]] = {
    "nv200": [
        *(
            f"{line}\r\n".encode()
            for line in ("", "meas", "stat", "set", "desc", "cl,0", "cl,1", "grun,1", "grun,0")
        ),
        *(
            f"{line}\r\n".encode()
            for line in ("set,12.5", "setst,30,100", "modsrc,3", "modsrc,0", "sr,20", "gcarb,3")
        ),
        *(
            f"{line}\r\n".encode()
            for line in ("gbarb,7,55.5", "gbarb,7", "gsarb,0", "gearb,30", "gtarb,2", "s")
        ),
        *(
            f"{line}\r\n".encode()
            for line in ("recast,2", "recstr,1", "reclen,300", "recrun,1", "recrun", "recidx")
        ),
        *(
            f"{line}\r\n".encode()
            for line in ("recout,0,0,9", "recoutf,1", "recsrc,0,2", "pcf,1,2,3", "reset")
        ),
    ],
    "mcs2": [
        *(f"{line}\n".encode() for line in (":DEV:NOCH?", ":CHAN0:MMOD 4", ":CHAN0:MMOD 2", ":CHAN0:MMOD 0")),
        *(
            f"{line}\n".encode()
            for line in (":MOVE0 20", ":MOVE1 -300", ":MOVE0 65535", ":STOP0", ":CHAN0:POS?")
        ),
        *(
            f"{line}\n".encode()
            for line in (":CHAN0:STEP:FREQ 1000", ":CHAN0:STEP:AMPL 50000", ":CHAN1:HOLD -1")
        ),
        *(
            f"{line}\n".encode()
            for line in (":SYST:ERR?", ":SYST:ERR:COUN?", ":REF0", ":CAL0", ":CHAN0:STAT?")
        ),
        *(
            f"{line}\n".encode()
            for line in (":CHAN0:POS 100", ":CHAN1:SCAN:VEL 10", ":CHAN0:VEL 1000000", "*IDN?")
        ),
    ],
    "anc300": [
        *(
            f"{line}\r\n".encode()
            for line in ("setm 1 stp", "setm 2 off", "setm 1 stp+", "setm 1 gnd", "getm 1")
        ),
        *(
            f"{line}\r\n".encode()
            for line in ("setv 1 80", "setf 1 1000", "seta 2 40", "stepu 1 20", "stepd 1 c")
        ),
        *(
            f"{line}\r\n".encode()
            for line in ("stop 1", "stepw 1", "geto 1", "getc 1", "getpu 1", "ver", "echo on")
        ),
    ],
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
    """A request with some bytes changed, cut, doubled or put in."""
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


def twin_with(name: str, seed: int, clock: TestClock) -> tuple[Any, list[Watched]]:
    """A twin whose stages are watched."""
    stages = [Watched(ACTUATOR, seed=seed + i) for i in range(1 if name == "nv200" else 2)]
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
