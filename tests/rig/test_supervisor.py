"""The supervisor ends every run safe: whatever the rig, the program and the disk do."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.rig import Capabilities, LimitError, RigError, VirtualRig
from stickslip.rig.gate import Gate, PositionInput
from stickslip.rig.home import Home
from stickslip.rig.interlock import Interlock, InterlockError
from stickslip.rig.limits import Limits, check_drive, check_edges
from stickslip.rig.order import Order
from stickslip.rig.protocols import ControllerSpec, StopRequested
from stickslip.rig.supervisor import Supervisor, state_of

from rig.laboratory import ACTUATOR, BENCH  # isort: skip
from rig.own_controllers import Ramping  # isort: skip

DRIVE = np.linspace(0.0, 50.0, 200)
CARD = Capabilities("a card", 1e3, 1e3, 0.0, 150.0, 0.01, 10**6, {"drive": "V", "laser": "m"})


class Card:
    """An output card that streams in real time; it does what it is told to do wrong."""

    def __init__(self, wrong: str = "") -> None:
        self.capabilities, self.wrong = CARD, wrong
        self.volts, self.rows, self.done, self.output = np.zeros(1), 1, 0, 0.0
        self.stops: list[float] = []
        self.closed = False
        self.hangs = threading.Event()

    def load(self, volts: np.ndarray) -> None:
        self.volts = volts

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        self.rows, self.done = len(inputs), 0

    def start(self) -> None:
        if self.wrong == "start":
            raise RigError("it does not start")

    def fetch(self) -> np.ndarray:
        time.sleep(0.01)
        if self.wrong == "hangs":
            self.hangs.wait(30.0)
        if self.wrong == "fetch" and self.done:
            raise RigError("it gives nothing")
        if self.wrong == "empty":
            return np.zeros((self.rows, 0))
        block = self.volts[self.done : self.done + 10]
        self.done += 10
        self.output = float(block[-1]) if block.size else self.output
        return np.tile(block, (self.rows, 1))

    def stop(self, slew: float) -> None:
        self.hangs.set()
        if self.wrong in ("stop", "fetch and stop") or (self.wrong == "fetch" and slew > 1e9):
            raise RigError("it does not stop")
        self.stops.append(slew)
        self.output = 0.0

    def close(self) -> None:
        self.closed = True
        if self.wrong == "stop":
            raise OSError("the cable is out")


class Interrupted(Card):
    """One whose `fetch` waits for nothing once a stop comes."""

    def __init__(self) -> None:
        super().__init__()
        self.interrupted = 0

    def interrupt(self) -> None:
        self.interrupted += 1


def order(limits: Limits | None = None, **more: Any) -> Order:
    made = Order(limits or Limits(watchdog=100.0), ("drive",), DRIVE.size, 0, None, DRIVE)
    return made._replace(**more)


def supervised(card: Any) -> Supervisor:
    one = Supervisor(Home(), lambda: None)
    one.rig = card
    return one


def fetched(one: Supervisor) -> np.ndarray:
    """All samples of a run; what ended it is raised."""
    blocks = []
    while one.busy or blocks == []:
        block = one.fetch(0.05)
        if block is not None:
            blocks.append(block)
    last = one.fetch(0.0)
    return np.concatenate(blocks + ([] if last is None else [last]), axis=1)


def emptied(one: Supervisor) -> None:
    """Take all samples that are left; what ended the run is raised."""
    while one.fetch(0.0) is not None:
        pass


def asked_for_ever(one: Supervisor) -> None:
    """Ask for samples until the run has ended, as a program does."""
    while True:
        one.fetch(0.02)


def test_a_run_goes_to_its_end_and_the_output_to_zero() -> None:
    card = Card()
    one = supervised(card)
    one.run(order())
    np.testing.assert_array_equal(fetched(one)[0], DRIVE)
    one.join()
    assert (one.phase, card.output, card.stops) == ("idle", 0.0, [1000.0])
    assert one.stopped == {"measured": None}
    assert one.ramp_after is None
    assert state_of(one, "somebody")["phase"] == "idle"
    one.check_stopped()


def test_what_cannot_begin_is_refused_and_nothing_is_put_out() -> None:
    one = supervised(None)
    for act in (lambda: one.run(order()), lambda: one.home_here(PositionInput("laser", ()), Limits())):
        with pytest.raises(RigError, match="no rig is open"):
            act()
    one.join()  # of a run that never was
    card = Card()
    one.rig = card
    spec = ControllerSpec(Ramping, {"slope": 0.05, "top": 40.0}).document()
    with pytest.raises(RigError, match="closed loop needs the input that shows the position"):
        one.run(order(controller=spec))
    with pytest.raises(RigError, match="takes whole drives only"):
        one.run(order(controller=spec, position=PositionInput("laser", ())))
    with pytest.raises(RigError, match="no loop goes on that takes commands"):
        one.command({})
    one.run(order())
    with pytest.raises(RigError, match="a run is going on"):
        one.run(order())
    with pytest.raises(RigError, match="no loop goes on that takes commands"):
        one.command({})
    assert one.stop("enough")
    one.join()
    assert not one.stop("again")


@pytest.mark.parametrize("card", [Card(), Interrupted()], ids=["plain", "interrupted"])
def test_the_first_reason_for_a_stop_counts(card: Card) -> None:
    one = supervised(card)
    one.run(order())
    while one.phase != "running":
        time.sleep(0.001)
    assert one.stop("first")
    assert one.stop("second") or not one.busy
    one.join()
    with pytest.raises(StopRequested, match="first"):
        emptied(one)
    assert card.output == 0.0
    assert one.ramp_after is not None
    assert 0.0 <= one.ramp_after < 60.0
    assert getattr(card, "interrupted", 1) >= 1


def test_a_rig_that_does_not_start_is_stopped_all_the_same() -> None:
    card = Card("start")
    one = supervised(card)
    one.run(order())
    one.join()
    with pytest.raises(RigError, match="it does not start"):
        one.fetch(0.0)
    assert card.stops == [1000.0]


@pytest.mark.parametrize(("wrong", "said"), [("fetch", "it gives nothing"), ("stop", "it does not stop")])
def test_what_the_rig_fails_with_is_told_once(wrong: str, said: str) -> None:
    card = Card(wrong)
    one = supervised(card)
    one.run(order())
    one.join()
    with pytest.raises(RigError, match=said):
        emptied(one)
    one.check_stopped()  # it was told
    assert card.closed == (wrong == "stop")


def test_a_stop_that_fails_is_told_to_a_client_that_asks_for_no_more() -> None:
    one = supervised(Card("stop"))
    one.run(order())
    one.join()
    assert "switch the amplifier off" in one.stopped["failed"]
    assert one.rig is None  # nobody talks to it any more
    with pytest.raises(RigError, match="it does not stop") as caught:
        one.check_stopped()
    assert "switch the amplifier off" in " ".join(caught.value.__notes__)
    one.check_stopped()


def test_a_run_and_its_stop_that_both_fail_are_both_told() -> None:
    one = supervised(Card("fetch"))
    one.run(order(Limits(watchdog=100.0, stop_slew=2e9)))
    one.join()
    with pytest.raises(RigError, match="it does not stop") as caught:  # of a client that fetches no more
        one.check_stopped()
    assert caught.value.__notes__ == ["The stop failed: switch the amplifier off"]
    with pytest.raises(RigError, match="it gives nothing") as caught:
        emptied(one)
    assert "The stop failed too (it does not stop): switch the amplifier off" in caught.value.__notes__


def test_a_program_that_is_silent_has_its_run_stopped() -> None:
    card = Card()
    one = supervised(card)
    one.run(order(Limits(watchdog=0.05)))
    one.join()
    assert card.output == 0.0
    with pytest.raises(LimitError, match="watchdog: the program that runs it has been silent for"):
        emptied(one)


def test_a_rig_whose_fetch_hangs_is_told_to_stop_from_outside() -> None:
    card = Card("hangs")
    one = supervised(card)
    one.run(order(Limits(watchdog=0.05, stop_slew=700.0)))
    one.join(60.0)
    assert not one.busy
    assert 700.0 in card.stops


def test_a_rig_that_gives_nothing_is_silent() -> None:
    one = supervised(Card("empty"))
    one.run(order(Limits(watchdog=0.1)))
    with pytest.raises(LimitError, match="watchdog: nothing came from a card"):
        asked_for_ever(one)
    one.join()


def test_samples_that_a_program_did_not_store_are_completed(tmp_path: Path) -> None:
    one = supervised(Card())
    kept = tmp_path / "samples"
    kept.write_bytes(b"no samples file")
    one.run(order(keep=kept))
    one.join()
    one.complete()  # a file that says nothing is left as it is
    assert kept.read_bytes() == b"no samples file"
    one.complete()  # nothing is left to complete
    one.leave_samples()
    one.leave_samples()


def test_home_is_where_the_position_reads_while_the_output_is_zero() -> None:
    kept: list[float | None] = []
    one = Supervisor(Home(), lambda: kept.append(one.home.position))
    one.rig = Card()
    one.home_here(PositionInput("laser", ()), Limits())
    assert kept[-1] == 0.0
    assert "laser" in one.home.readings


def test_home_is_not_set_by_a_rig_that_gives_nothing() -> None:
    one = supervised(Card("empty"))
    with pytest.raises((RigError, LimitError)):
        one.home_here(PositionInput("laser", ()), Limits(watchdog=0.05))


def test_a_disk_that_fails_does_not_keep_a_run_from_ending() -> None:
    def full() -> None:
        raise OSError(28, "no space left on device")

    one = Supervisor(Home(), full)
    one.rig = Card()
    one.run(order())
    fetched(one)
    one.join()
    assert one.phase == "idle"


class Bare(Card):
    """A rig that has nothing to let go."""

    close = None  # type: ignore[assignment]


def test_a_rig_that_has_nothing_to_let_go_is_let_go() -> None:
    one = supervised(Bare("stop"))
    one.run(order())
    one.join()
    assert one.rig is None


def test_a_closed_loop_takes_commands_while_it_goes_on() -> None:
    one = supervised(VirtualRig(ACTUATOR, BENCH))
    spec = ControllerSpec(Ramping, {"slope": 0.05, "top": 40.0}).document()
    targets = np.full(4000, 1e-6)
    wanted = {"inputs": ("drive", "ideal"), "samples": 4000, "volts": targets, "controller": spec}
    assert one.said() is None
    one.run(order(position=PositionInput("ideal", ()), **wanted))
    if one.busy:
        one.command({"top": 10.0})
    block = fetched(one)
    one.join()
    assert block.shape[0] == 2
    assert block[0].max() <= 40.1
    said = one.said()
    assert said is not None
    assert said["limited_updates"] >= 0
    with pytest.raises(RigError, match="no loop goes on that takes commands"):
        one.command({"top": 20.0})


class Monitored(Card):
    """One whose amplifier says what it puts out, which falls to 0 V after the ramp."""

    def __init__(self, *, settles: bool) -> None:
        super().__init__()
        self.looks, self.settles = 0, settles

    def monitor(self) -> float:
        self.looks += 1
        return 0.0 if self.settles and self.looks > 3 else 20.0


def test_the_monitor_is_waited_for() -> None:
    one = supervised(Monitored(settles=True))
    one.run(order())
    fetched(one)
    one.join()
    assert one.stopped == {"measured": 0.0}


def test_a_monitor_that_stays_is_a_stop_that_failed() -> None:
    one = supervised(Monitored(settles=False))
    one.run(order())
    one.join()
    assert "the amplifier's monitor reads 20 V" in one.stopped["failed"]


@pytest.mark.parametrize("block", [None, [1.0, 2.0], np.zeros(3), np.zeros((2, 5)), np.zeros((1, 2, 3))])
def test_what_is_no_block_of_samples_is_refused_by_the_gate(block: Any) -> None:
    gate = Gate(Card(), Limits(), CARD)
    gate.load(DRIVE)
    gate.arm(("drive",), 100)
    gate.start()
    with pytest.raises(RigError, match="a card: fetch gave"):
        gate.take(block)
    gate.take(np.zeros((1, 5)))


@pytest.mark.parametrize("volts", [np.zeros((2, 2)), np.zeros(0), np.array([0.0, np.nan])])
def test_a_drive_that_is_no_row_of_numbers_is_refused(volts: np.ndarray) -> None:
    with pytest.raises(LimitError, match="one row of finite voltages"):
        check_drive(volts, Limits(), CARD)


def test_limits_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="stop_slew = 1000 V/s is out of range: it must be <= max_slew"):
        Limits(max_slew=10.0)
    with pytest.raises(ValueError, match="a stop from the greatest voltage may take 10 s"):
        Limits(max_voltage=150.0, stop_slew=1.0)
    with pytest.raises(LimitError, match="ends a drive with a ramp of 1e"):
        check_drive(DRIVE, Limits(max_slew=1e5), CARD._replace(own_slew=1e6))
    with pytest.raises(LimitError, match="takes 10"):
        check_drive(DRIVE, Limits(), CARD._replace(max_points=10))
    with pytest.raises(LimitError, match="away from 0 V for"):
        check_drive(DRIVE, Limits(max_duty=0.1), CARD)


def test_a_real_rig_is_armed_for_a_run_and_disarmed_after_it() -> None:
    card = Card()
    one = Supervisor(Home(), lambda: None, interlock=Interlock())
    one.rig = card
    with pytest.raises(InterlockError):
        one.run(order())
    one.run(order(arm="a test"))
    np.testing.assert_array_equal(fetched(one)[0], DRIVE)
    one.join()
    with pytest.raises(InterlockError):
        one.run(order())
    rest = np.zeros(DRIVE.size)  # at 0 V nobody needs to arm
    one.run(order(volts=rest))
    np.testing.assert_array_equal(fetched(one)[0], rest)
    one.join()


def test_a_closed_loop_of_a_real_rig_is_armed_too() -> None:
    one = Supervisor(Home(), lambda: None, interlock=Interlock())
    one.rig = Card()
    spec = ControllerSpec(Ramping, {"slope": 0.05, "top": 40.0}).document()
    with pytest.raises(RigError, match="takes whole drives only"):
        one.run(order(arm="a test", controller=spec, position=PositionInput("laser", ())))


@pytest.mark.parametrize("wrong", ["fetch", "stop"])
def test_what_a_real_rig_fails_with_latches(wrong: str) -> None:
    one = Supervisor(Home(), lambda: None, interlock=Interlock())
    one.rig = Card(wrong)
    one.run(order(arm="a test"))
    one.join()
    one.rig = Card()
    with pytest.raises(InterlockError, match=r"it gives nothing|it does not stop"):
        one.run(order(arm="another test"))
    one.interlock.acknowledge("a test", "it was mended")
    one.run(order(arm="another test"))
    fetched(one)
    one.join()


def test_a_drive_with_slip_edges_needs_a_slew_that_allows_them() -> None:
    check_edges(Limits(), CARD)
    with pytest.raises(ValueError, match=r"the slip edge of a step needs 1.5e.05 V/s"):
        check_edges(Limits(max_slew=1e4), CARD)
