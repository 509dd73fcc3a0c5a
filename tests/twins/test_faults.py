"""Faults of a controller and the way to it: a clear error, the safe state where it can be, nothing lost."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
import yaml

import stickslip as ss
from panel.serving import Link
from stickslip.rig import RigError
from stickslip.rig.experiment import run_experiment
from stickslip.rig.positioner import wait

from .serving import served, twin_of
from .test_clients import client_of, stage_of

POSITIONERS = ["mcs2", "anc300", "kim101"]
LONG = (1, 1000, "90 V", "200 Hz")  # 5 s


@pytest.mark.parametrize("name", POSITIONERS)
def test_the_cable_comes_out_while_it_steps(name: str) -> None:
    twin = twin_of(name)
    with served(twin) as port:
        cable = Link(port)
        client = client_of(name, cable.port)
        client.step(*LONG)
        assert client.moving(1)
        cable.cut()
        with pytest.raises(RigError, match=rf"{name.upper()} at 127.0.0.1:{cable.port}: .*'.+'"):
            client.moving(1)
        with pytest.raises(RigError, match=r"cannot be reached.*the output may keep its voltage"):
            client.stop()
        with pytest.raises(RigError, match="connection is closed"):
            client.moving(1)
        cable.mend()
        client.stop()  # by a connection of its own
        wait(client, 1)
        stage = stage_of(name, twin, 1)
        assert stage.voltage == 0.0
        client.step(1, 5, "90 V", "200 Hz")  # and goes on
        client.close()
        cable.cut()


@pytest.mark.parametrize("name", POSITIONERS)
def test_a_slow_answer_is_not_taken_for_that_to_something_else(name: str) -> None:
    twin, slow, given_up = twin_of(name), False, threading.Event()
    session = twin.session

    def dawdling() -> Any:
        made = session()
        feed = made.feed

        def late(data: bytes) -> bytes:
            if slow:
                given_up.wait(60.0)
            return feed(data)

        made.feed = late
        return made

    twin.session = dawdling
    with served(twin) as port:
        client = client_of(name, port, 1.0)
        client.step(*LONG)
        slow = True
        with pytest.raises(RigError, match=rf"{name.upper()} at .*nothing came as the answer to"):
            client.moving(1)
        slow = False
        given_up.set()
        with pytest.raises(RigError, match="connection is closed"):
            client.moving(1)
        client.stop()
        wait(client, 1)
        assert stage_of(name, twin, 1).voltage == 0.0
        client.close()


@pytest.mark.parametrize(
    ("name", "known", "refusal"),
    [
        ("mcs2", ":CHAN1:STEP:FREQ", r":CHAN1:STEP:FREQ 200: -113,\"Undefined header\""),
        ("anc300", "setf", r"setf 1 200: Unknown command"),
        ("kim101", 0x08D4, r"0x08D5 is refused: b'not understood'"),
    ],
)
def test_firmware_that_does_not_know_a_command(name: str, known: Any, refusal: str) -> None:
    twin = twin_of(name)
    execute = twin.execute

    def older(first: Any, *rest: Any) -> Any:
        if first == known:
            return execute(first + 1, *rest)
        lacks = isinstance(first, str) and first.startswith(known)
        return execute("unheard:of" if lacks and name == "mcs2" else "unheard 1" if lacks else first, *rest)

    twin.execute = older
    with served(twin) as port:
        client = client_of(name, port)
        said = rf"{name.upper()} at 127.0.0.1:{port}: {refusal}"
        if name == "kim101":  # which answers with the next question
            client.step(1, 5, "90 V", "200 Hz")
            with pytest.raises(RigError, match=said):
                client.position(1)
        else:
            with pytest.raises(RigError, match=said):
                client.step(1, 5, "90 V", "200 Hz")
        client.stop()
        client.close()


def experiment(port: int) -> dict[str, Any]:
    """Two walks from an NV200."""
    options = {"host": "127.0.0.1", "port": port, "timeout": 20.0, "interval": "50 us"}
    walk = {"shape": "Sawtooth", "fields": {"amplitude": "80 V", "frequency": "50 Hz"}}
    capture = {"length": "0.1 s", "interval": "50 us"}
    return {
        "title": "Reset",
        "rig": {"kind": "nv200", "options": options},
        "limits": {"max_voltage": "100 V"},
        "channels": {"drive_voltage": {"input": "drive"}, "end_effector_position": {"input": "position"}},
        "runs": [{"name": "walk", "repeats": 2, "waveform": [walk], "capture": capture}],
    }


def test_an_nv200_that_is_reset_in_mid_run_keeps_what_was_finished(tmp_path: Path, monkeypatch: Any) -> None:
    """The second of two recordings ends; the first is there, and says what it was made with."""
    monkeypatch.setenv("STICKSLIP_RIGS", str(tmp_path / "rigs"))
    twin, file = twin_of("nv200", axes=1), tmp_path / "reset.yaml"
    execute, lost = twin.execute, False

    def resetting(line: str) -> str:
        if lost and line.startswith("recrun") and "," not in line:
            cable.cut()
            cable.mend()
        return execute(line)

    twin.execute = resetting
    with served(twin) as port:
        cable = Link(port)
        file.write_text(yaml.safe_dump(experiment(cable.port)))

        def each(*_: Any) -> None:
            nonlocal lost
            lost = True

        with pytest.raises(RigError, match=r"NV200 at 127.0.0.1:\d+: .*'recrun'"):
            run_experiment(file, tmp_path / "out", each=each)
        cable.cut()
    (kept,) = (tmp_path / "out").glob("*.nc")
    recording = ss.open_recording(kept)
    assert recording.attrs["outcome"] == "complete"
    assert '"device": "NV200/D_NET"' in recording.attrs["device"]
    assert twin.output.axis.state()[0] == 0.0  # by a connection of its own
