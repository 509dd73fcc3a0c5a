"""The interlock: enabled on purpose, permits, faults that latch; and what it never stands before."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stickslip.quantities.units import QuantityError
from stickslip.rig import (
    Capture,
    HostedRig,
    InterlockError,
    LimitError,
    Limits,
    Link,
    RigError,
    armed,
    interlock_of,
    measure,
    regulate,
)
from stickslip.rig.description import own_device, virtual_device
from stickslip.rig.gate import PositionInput
from stickslip.rig.interlock import OPERATORS, Interlock
from stickslip.waveform import Sawtooth, Step

from rig.laboratory import ACTUATOR, IDEAL  # isort: skip
from rig.own_controllers import PATIENCE, Ramping  # isort: skip
from rig.own_rigs import Powered  # isort: skip

WALK, CAPTURE = Sawtooth(65.0, 20.0), Capture(0.3, 1e-3, 0.02)
STOPS = Limits(max_position=5e-6)


def noted(path: Path | None = None, **options: object) -> tuple[Interlock, list[tuple[str, ...]]]:
    acts: list[tuple[str, ...]] = []
    return Interlock(path, log=lambda *act: acts.append(act), **options), acts  # type: ignore[arg-type]


def test_the_output_is_enabled_on_purpose_and_with_a_reason() -> None:
    one, acts = noted()
    with pytest.raises(InterlockError, match="the output is not armed"):
        one.need()
    for nothing in ("", "  "):
        with pytest.raises(QuantityError, match="say why"):
            one.arm("Ada", nothing)
    one.arm("Ada", " the first\n walk ")
    one.need()
    assert one.state()["state"] == "armed"
    assert one.state()["armed_by"] == "Ada"
    one.disarm("Ada", "home")
    with pytest.raises(InterlockError, match="not armed"):
        one.need()
    assert [act[0] for act in acts] == ["refused", "armed", "disarmed", "refused"]
    assert acts[1] == ("armed", "Ada", "the output", "the first walk")


def test_a_fault_disarms_and_latches_until_it_is_acknowledged_with_a_reason() -> None:
    one, acts = noted()
    one.arm("Ada", "a walk")
    one.latch("the sensor is frozen")
    one.latch("a later one")
    for act in (one.need, lambda: one.arm("Ada", "again")):
        with pytest.raises(InterlockError, match=r"not acknowledged: the sensor is frozen\. Look"):
            act()
    with pytest.raises(QuantityError, match="say why"):
        one.acknowledge("Bob", "")
    one.acknowledge("Bob", "the cable was loose")
    assert ("acknowledged", "Bob", "the sensor is frozen", "the cable was loose") in acts
    with pytest.raises(InterlockError, match="not armed"):
        one.need()  # to acknowledge is not to arm
    with pytest.raises(QuantityError, match="no fault"):
        one.acknowledge("Bob", "again")


def test_a_permit_is_withdrawn_and_given_by_name() -> None:
    one, _ = noted(required=["door"])
    with pytest.raises(InterlockError, match="the permit 'door' is missing: nobody, it was never given"):
        one.arm("Ada", "a walk")
    one.permit("door", True, "Ada", "it is shut")
    one.arm("Ada", "a walk")
    one.permit(OPERATORS, False, "Bob", "I am in the beam")
    assert one.state()["state"] == "withheld"
    with pytest.raises(InterlockError, match="'operators' is missing: Bob, I am in the beam"):
        one.need()
    one.permit(OPERATORS, True, "Bob", "out again")
    with pytest.raises(InterlockError, match="not armed"):
        one.need()
    with pytest.raises(
        QuantityError,
        match=r"'dor' is no permit of this rig \(did you mean 'door'\?\); there are operators, door",
    ):
        one.permit("dor", True, "Ada", "it is shut")


def test_a_restart_clears_neither_fault_nor_permit_and_disarms(tmp_path: Path) -> None:
    path = tmp_path / "interlock.json"
    one, _ = noted(path, required=["door"])
    one.permit("door", True, "Ada", "shut")
    one.arm("Ada", "a walk")
    assert Interlock(path, ["door"]).state()["state"] == "disarmed"
    one.permit(OPERATORS, False, "Bob", "lunch")
    one.latch("the sensor is frozen")
    again = Interlock(path, ["door"]).state()
    assert again["state"] == "fault"
    assert again["permits"]["door"]["given"]
    assert again["permits"][OPERATORS]["why"] == "lunch"
    path.write_text('{"fault": "", "permits": {"door": 3}}')
    with pytest.raises(InterlockError, match=r"interlock\.json is damaged"):
        Interlock(path, ["door"], simulated=True).need()


def test_a_simulated_rig_needs_no_arming_but_its_faults_latch() -> None:
    one, _ = noted(simulated=True)
    one.need()
    one.latch("an end stop")
    with pytest.raises(InterlockError, match="an end stop"):
        one.need()


def test_a_rig_in_this_program_is_armed_by_a_context() -> None:
    rig = Powered()
    with pytest.raises(InterlockError, match="not armed"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    assert rig.origin == 0.0, "nothing was put out"
    with pytest.raises(QuantityError, match="say why"), armed(""):
        pass
    with armed("a test"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    with pytest.raises(InterlockError, match="not armed"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    measure(rig, Step(0.0), IDEAL, CAPTURE, Limits())  # at 0 V nobody is asked


def test_after_a_fault_the_next_start_is_refused_until_it_is_acknowledged() -> None:
    rig = Powered()
    with armed("a test"):
        with pytest.raises(LimitError, match="end stop"):
            measure(rig, WALK, IDEAL, CAPTURE, STOPS)
        with pytest.raises(InterlockError, match=r"not acknowledged.*end stop"):
            measure(rig, WALK, IDEAL, CAPTURE, Limits())
        with pytest.raises(InterlockError, match=r"not acknowledged.*end stop"):
            regulate(rig, Ramping(0.05, 40.0), 0.0, IDEAL, Limits(), 0.02)
        interlock_of(rig).acknowledge("a test", "the end stop was meant")
        regulate(rig, Ramping(0.05, 40.0), 0.0, IDEAL, Limits(), 0.02)
        with pytest.raises(LimitError, match="end stop"):
            regulate(rig, Ramping(0.5, 90.0), 0.0, IDEAL, STOPS, 0.5)
        assert interlock_of(rig).state()["state"] == "fault"


@pytest.mark.parametrize("ends", [KeyboardInterrupt, ValueError])
def test_what_the_program_itself_ends_is_no_fault(ends: type[BaseException]) -> None:
    def stop(doing: str, done: float) -> None:
        raise ends

    rig = Powered()
    with armed("a test"):
        with pytest.raises(ends):
            measure(rig, WALK, IDEAL, CAPTURE, Limits(), progress=stop)
        measure(rig, WALK, IDEAL, CAPTURE, Limits())


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Link]:
    made = Link(tmp_path / "rig", "a test")
    yield made
    made.close()


def powered(link: Link, real_time: bool = False) -> HostedRig:
    return HostedRig(link, own_device(Powered, {"real_time": real_time}))


def running(link: Link, rig: HostedRig) -> None:
    """A walk of some seconds in real time that goes on."""
    rig.guard(Limits(watchdog=100.0), None, 0)
    rig.load(np.tile(np.linspace(0.0, 65.0, 400), 250))
    rig.arm(("drive",), 100_000)
    rig.start()
    assert link.ask("state")[0]["phase"] == "running"


def idle(link: Link) -> dict:
    end = time.monotonic() + PATIENCE
    while (said := link.ask("state")[0])["phase"] != "idle":
        assert time.monotonic() < end, "it goes on"
        time.sleep(0.01)
    return said["interlock"]


def test_the_process_of_a_rig_asks_whoever_runs_it(link: Link) -> None:
    rig = powered(link)
    with pytest.raises(InterlockError, match="not armed"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    with armed("a test"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    assert rig.interlock.state()["state"] == "disarmed", "armed for its run only"
    rig.home_here(PositionInput("ideal", ()), 1000.0)  # at 0 V
    other = Link(link.folder, "another operator")
    rig = powered(link)
    powered_by = HostedRig(link, own_device(Powered, {})).interlock
    powered_by.arm("Ada", "all day")
    measure(rig, WALK, IDEAL, CAPTURE, Limits())
    measure(rig, WALK, IDEAL, CAPTURE, Limits())
    said = powered_by.state()
    assert said["state"] == "armed"
    assert said["armed_by"].startswith("Ada, a test (process ")
    other.close()


def test_who_armed_it_and_is_gone_has_disarmed_it(link: Link) -> None:
    powered(link)
    other = Link(link.folder, "another")
    other.ask("arm", who="Ada", why="a test")
    assert idle(link)["state"] == "armed"
    other.close()
    end = time.monotonic() + PATIENCE
    while idle(link)["state"] == "armed":
        assert time.monotonic() < end
        time.sleep(0.01)


def all_of(rig: HostedRig) -> None:
    while not rig.ended:
        rig.fetch()


@pytest.mark.parametrize("act", ["permit", "disarm"])
def test_another_operator_ends_a_run(link: Link, act: str) -> None:
    other = Link(link.folder, "another operator")
    rig = powered(link, True)
    with armed("a test"):
        running(link, rig)
    other.ask(act, who="Bob", name=OPERATORS, given=False, why="the door is open")
    assert idle(link)["state"] == ("withheld" if act == "permit" else "disarmed")
    with pytest.raises(RigError, match=r"Bob, another operator .*the door is open"):
        all_of(rig)
    rig.stop(1000.0)
    with pytest.raises(InterlockError, match="'operators' is missing" if act == "permit" else "not armed"):
        running(link, rig)
    other.close()


def test_nothing_stands_before_a_stop(link: Link) -> None:
    """In each state of the interlock, from a connection that has armed nothing."""
    other = Link(link.folder, "another operator")
    rig = powered(link, True)
    for why in ("armed", "a fault", "withheld"):
        with armed("a test"):
            running(link, rig)
        assert other.ask("stop", why=why)[0]["stopped"]
        assert idle(link)["state"] == "disarmed", "a stop is no fault"
        rig.stop(1000.0)
    other.ask("permit", name=OPERATORS, given=False, why="lunch")
    assert not other.ask("stop", why="nothing runs")[0]["stopped"]
    other.close()


def test_a_program_that_is_gone_is_a_fault_that_the_next_process_knows(link: Link) -> None:
    user = Link(link.folder, "a script")
    rig = powered(user, True)
    with armed("a test"):
        running(link, rig)
    user.close()
    said = idle(link)
    assert said["state"] == "fault"
    assert said["fault"] == "the program that ran it is gone"
    again = Interlock(link.folder / "interlock.json").state()
    assert again["fault"] == "the program that ran it is gone"


def test_the_fault_of_a_simulated_rig_is_acknowledged_too(link: Link) -> None:
    rig = HostedRig(link, virtual_device(ACTUATOR, "kang2007-bench", 3, False))
    measure(rig, WALK, IDEAL, CAPTURE, Limits())
    assert rig.interlock.state()["state"] == "disarmed"
    with pytest.raises(LimitError):
        measure(rig, WALK, IDEAL, CAPTURE, STOPS)
    with pytest.raises(InterlockError, match="end stop at 5 µm"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    rig.interlock.acknowledge("a test", "it was meant")
    measure(rig, WALK, IDEAL, CAPTURE, Limits())
