"""The twins answer what open drivers send, as it stands in the drivers' sources."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from .serving import TestClock, twin_of

DRIVERS = yaml.safe_load(Path(__file__).with_name("strings.yaml").read_text())
# Bits of an MCS2's state: moving, closed loop, sensor, calibrated, in position; no error of a command.
MOVING, CLOSED, IN_POSITION = 1 << 0, 1 << 1, 1 << 19
NAMED = {"fine": '0,"No error"\r\n', "moving": "(?P<moving>\\d+)", "still": "(?P<still>\\d+)"}
NAMED["holding"] = "(?P<holding>\\d+)"


def check_bits(found: re.Match[str]) -> None:
    """A channel moves, rests, or holds its position: that is not moving, with the loop closed."""
    for name, text in found.groupdict().items():
        bits = int(text)
        assert bool(bits & MOVING) == (name == "moving"), (name, bits)
        if name == "holding":
            assert bits & CLOSED
            assert bits & IN_POSITION


@pytest.mark.parametrize("driver", DRIVERS, ids=[one["driver"] for one in DRIVERS])
def test_twin_answers_the_strings_of_a_driver(driver: dict[str, Any]) -> None:
    clock = TestClock()
    twin = twin_of(driver["twin"], clock=clock)
    session = twin.serial_session() if driver.get("serial") else twin.session()
    frames = driver["twin"] == "kim101"
    for exchange in driver["exchanges"]:
        if not isinstance(exchange, list):
            clock.sleep(exchange)
            continue
        sent, expected = exchange
        if frames:
            answer = (session.unasked() if sent == "unasked" else session.feed(bytes.fromhex(sent))).hex()
            expected = expected.replace(" ", "")
        else:
            answer = session.feed((sent + driver["ends"]).encode()).decode()
            expected = expected.format(**NAMED) if driver["twin"] == "mcs2" else expected
        found = re.fullmatch(expected, answer)
        assert found, f"{sent!r} is answered by {answer!r}"
        check_bits(found)


def test_status_messages_end_when_nobody_acknowledges_them() -> None:
    clock = TestClock()
    session = twin_of("kim101", clock=clock).session()
    session.feed(bytes.fromhex("110000005001"))
    said = 0
    for _ in range(200):
        clock.sleep(0.1)
        said += bool(session.unasked())
    assert said == 50


def test_an_amplifier_that_is_switched_off_ends_a_motion() -> None:
    clock = TestClock()
    twin = twin_of("mcs2", clock=clock)
    session = twin.session()
    session.feed(b":CHAN0:MMOD 4\n:CHAN0:STEP:FREQ 100\n:MOVE0 1000\n")
    clock.sleep(0.2)
    assert int(session.feed(b":CHAN0:STAT?\n")) & MOVING
    session.feed(b":CHAN0:AMPL 0\n")
    clock.sleep(0.1)
    before = twin.channels[0].axis.state()[2]
    clock.sleep(1.0)
    assert not int(session.feed(b":CHAN0:STAT?\n")) & MOVING
    assert abs(twin.channels[0].axis.state()[2] - before) < 1e-6  # less than a step


@pytest.mark.parametrize("number", ["1e6", "1.0.0", ".", "1000000000000000000000", "0x10", "nan"])
def test_what_is_no_number_is_refused(number: str) -> None:
    twin = twin_of("mcs2", clock=TestClock())
    session = twin.session()
    session.feed(f":CHAN0:VEL {number}\n".encode())
    assert session.feed(b":SYST:ERR?\n") == b'-104,"Data type error"\r\n'
    assert session.feed(b":CHAN0:VEL?\n") == b"0\r\n"
