"""Supervision of a rig in its own process: every run ends with a ramp to 0 V, also without its client.

A run is a thread that fetches and checks the samples, even if no client asks for them. The run is ended, with
a ramp to 0 V, when its client has been silent for too long or is gone.
"""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from ..quantities.units import with_prefix
from .gate import SWITCH_OFF, Gate, PositionInput, stop_failed
from .home import Home
from .interlock import Interlock, is_fault
from .limits import LimitError, Limits
from .memory import collect
from .order import Order
from .protocols import Array, Rig, RigError, StopRequested, StreamingRig, controller_of
from .samples import complete, shared
from .site import Site, refreshed
from .turns import LoopRig

ANOTHER = 3  # exit code of the process `host` if another process already owns the rig
HOMING = 0.02  # duration of the run at 0 V whose mean reading defines home, s
MONITORED = 1.0  # time after the ramp within which the amplifier's monitor must read 0 V, s
AT_ZERO = 0.01  # largest monitor reading that counts as 0 V, as a fraction of the output's voltage range
_LOOKS = 0.2  # longest time between two checks of a run for a silent operator or a hanging rig, s
_LOST = 1.0  # a call of the rig's `fetch` counts as hanging after `Limits.watchdog` plus this time, s


class Supervisor:
    """Supervisor of a rig's runs: starts, watches and stops them, one at a time. Nothing else drives the rig.

    Args:
        home: origin of positions.
        changed: called without arguments after a run or a change of home, to store `home`.
        log: called at the end of each run, with a line of text about the end and the ramp to 0 V.
        interlock: decides whether a run may start; by default the interlock of a simulated rig.
        site: called for each run of a rig that is not simulated; returns the site's limits and permits.

    Attributes:
        rig: the open rig, which the owner of this object sets; None without one.
        phase: "idle", "preparing", "running" or "stopping".
        began: position before the drive of the run, m (rad) from home; None until it was read.
    """

    def __init__(
        self,
        home: Home,
        changed: Callable[[], None],
        log: Callable[[str], None] = lambda line: None,
        interlock: Interlock | None = None,
        site: Callable[[], Site] = Site,
    ) -> None:
        self.home, self._changed, self._log = home, changed, log
        self.interlock, self._site = interlock or Interlock(simulated=True), site
        self.rig: Rig | None = None
        self.phase = "idle"
        self.began: float | None = None
        self.ramp_after: float | None = None  # time from the request for a stop to its ramp, s
        # Last stop: {"measured": monitor reading, V, or None} or {"failed": error, a text}; {} before it.
        self.stopped: dict[str, Any] = {}
        self._news = threading.Condition()
        self._blocks: deque[Array] = deque()
        self._sent: list[Array] = []  # blocks sent by the last `fetch`; the next `fetch` confirms them
        self._stored = 0  # number of samples whose receipt the client has confirmed by a later `fetch`
        self._keep: Path | None = None
        self._kept: BinaryIO | None = None  # the client's file of samples, while it may need completion
        self._failure: BaseException | None = None
        self._unsafe: BaseException | None = None  # error of a failed ramp to 0 V, until a client knows it
        self._stop: tuple[str, float] | None = None
        self._left = False  # True if the program that started the run is gone
        self._asked = self._alive = self._beat = 0.0
        self._limits = Limits()
        self._wanting = False  # True once a client waits for samples that the rig has not delivered
        self._thread: threading.Thread | None = None
        self._loop: LoopRig | None = None  # closed loop of the active or last run; None if open-loop

    @property
    def busy(self) -> bool:
        """Return True while a run is prepared, runs or is stopped."""
        return self.phase in ("preparing", "running", "stopping")

    def run(self, order: Order) -> None:
        """Start a run in a thread of its own and return immediately; with `Order.arm` first arm the output.
        Raises RigError if another run is active, no rig is open or the rig allows no closed loop,
        InterlockError if the interlock forbids the run, LimitError if the limits forbid the drive, and
        QuantityError."""
        if self.rig is None:
            raise RigError("no rig is open")
        with self._news:
            if self.busy:
                raise RigError("a run is going on: stop it first")
            rig, order = self._sited(self.rig, order)
            self._loop = None
            if order.controller is not None:
                rig = self._loop = self._looped(rig, order)
            if order.drives:
                if order.arm:
                    self.interlock.arm("the program that runs it", order.arm)
                self.interlock.need()
            self.phase, self._stop, self._failure, self._unsafe = "preparing", None, None, None
            self._left = False
            self.began, self.ramp_after, self.stopped = None, None, {}
            self._blocks.clear()
            self._sent, self._stored, self._keep = [], 0, order.keep
            self.leave_samples()
            self._kept = None if order.keep is None else shared(order.keep)
            self._limits = order.limits
            self._asked = self._alive = self._beat = time.monotonic()
        self._thread = threading.Thread(target=self._run, args=(rig, order), name="run")
        self._thread.start()
        threading.Thread(target=self._watch, args=(rig, self._thread, order), daemon=True).start()

    def _sited(self, rig: Rig, order: Order) -> tuple[Rig, Order]:
        """Return the rig with checks of the site's permits, and the order with the stricter of its own and
        the site's limits, after the device's limits were read again. A simulated rig and its order are
        returned unchanged. Raises LimitError if the limits forbid the drive."""
        if self.interlock.simulated:
            return rig, order
        site = self._site()
        refreshed(rig)
        self.interlock.require(site.permits)
        if order.controller is None:
            site.check(order.volts, order.limits, rig.capabilities)
        return site.around(rig), order._replace(limits=site.narrowed(order.limits))

    def _looped(self, rig: Rig, order: Order) -> LoopRig:
        if order.position is None or order.controller is None:
            raise RigError("a closed loop needs the input that shows the position")
        made = controller_of(order.controller)
        beliefs = order.plausibility, order.second
        return LoopRig(cast(StreamingRig, rig), made, order.position, self.home, order.limits, *beliefs)

    def command(self, what: dict[str, Any]) -> None:
        """Call the method `command` of the active loop's controller with the arguments `what`, by name.
        Raises RigError if no loop that takes commands is active, or the controller's error if it refuses."""
        act = getattr(None if self._loop is None else self._loop.controller, "command", None)
        if act is None or not self.busy:
            raise RigError("no loop goes on that takes commands")
        act(**what)

    def beat(self) -> None:
        """Store the time at which the operator's page of the panel reported, for `Limits.heartbeat`."""
        self._beat = time.monotonic()

    def said(self) -> dict[str, Any] | None:
        """Return statistics of the active or last run, as `LoopRig.said`; None if it is no closed loop."""
        return None if self._loop is None else self._loop.said()

    def stop(self, why: str, gone: bool = False) -> bool:
        """Request the end of the run with a ramp to 0 V. Return True at once; False if no run is active.

        Args:
            why: reason for the end; later requests do not change the reason of the first.
            gone: True if the program that started the run is gone, which is a fault for the interlock.
        """
        with self._news:
            if not self.busy:
                return False
            self._left = self._left or gone
            if self._stop is None:
                self._stop = (why, time.perf_counter())
            self._news.notify_all()
        interrupt = getattr(self.rig, "interrupt", None)
        if interrupt is not None:
            interrupt()
        return True

    def join(self, most: float | None = None) -> None:
        """Wait until the run and its ramp to 0 V have ended, `most` s at most; None is no limit."""
        if self._thread is not None:
            self._thread.join(most)

    def fetch(self, wait: float) -> Array | None:
        """Return the samples since the last call [inputs, n], in the inputs' units; None if none came.

        Samples are awaited for `wait` s at most. The call restarts the watchdog and confirms the receipt of
        the last call's samples. Raises the error that ended the run, once all samples were fetched.
        """
        self._asked = time.monotonic()
        with self._news:
            self._stored += sum(block.shape[1] for block in self._sent)
            self._sent = []
            if not self._blocks and self.busy:
                self._wanting = True
                self._news.notify_all()
                self._news.wait_for(lambda: self._blocks or not self.busy, wait)
            if self._blocks:
                self._sent = list(self._blocks)
                self._blocks.clear()
                return np.concatenate(self._sent, axis=1)
            if self._failure is not None and not self.busy:
                self._unsafe = None
                raise self._failure
        return None

    def check_stopped(self) -> None:
        """Raise the error of a failed ramp to 0 V after the last run, once, unless `fetch` has raised it. A
        client with all samples does not fetch again, but must learn that the output may be under voltage."""
        failed, self._unsafe = self._unsafe, None
        if failed is not None:
            raise failed

    def complete(self) -> None:
        """Append samples that the client, which is gone, has not stored, to its file of samples."""
        with self._news:
            blocks, keep = [*self._sent, *self._blocks], self._keep
            self._sent, self._keep = [], None
            self._blocks.clear()
        if blocks and keep is not None:
            with suppress(OSError, ValueError, struct.error):
                complete(keep, self._stored, np.concatenate(blocks, axis=1))

    def leave_samples(self) -> None:
        """Close the client's file of samples, which releases its lock: the file needs no completion."""
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()

    def home_here(self, position: PositionInput, limits: Limits) -> None:
        """Make the present position home: the mean reading of the input `position` in a run at 0 V within
        `limits`, which lasts `HOMING` seconds. Wait for its end. Homes of other inputs are forgotten. Raises
        RigError if no rig is open or no reading came, and as `run` and `fetch`."""
        if self.rig is None:
            raise RigError("no rig is open")
        can = self.rig.capabilities
        samples = max(int(HOMING * can.sample_rate), 2)
        home = Home()
        volts = np.zeros(max(int(HOMING * can.update_rate), 2))
        self.run(Order(limits, (position.name,), samples, samples, None, volts))
        self.join()
        readings = self.fetch(0.0)
        if readings is None or not readings.size:
            raise RigError("the rig gave no reading of the position")
        home.set(position.name, float(readings.mean()), getattr(self.rig, "origin", 0.0))
        self.home.readings, self.home.position = home.readings, 0.0
        self._changed()

    def _run(self, rig: Rig, order: Order) -> None:
        gate = Gate(rig, order.limits, rig.capabilities, self.home)
        failure: BaseException | None = None
        drove = False  # True once the output may differ from 0 V: an error is then a fault
        try:
            if isinstance(rig, LoopRig):  # the loop checks position and voltages at each update
                rig.load(order.volts)
                gate.arm(order.inputs, order.samples)
            else:
                gate.load(order.volts)
                gate.arm(order.inputs, order.samples, order.position, order.rest)
            self._go_on()
            drove = not self.interlock.simulated
            gate.start()  # may take long, because a virtual rig computes the whole run here
            drove = True
            self._asked = self._alive = self._beat = time.monotonic()
            self.phase = "running"
            done, pause = 0, 0.0
            while done < order.samples and not getattr(rig, "ended", False):
                self._keep_pace(pause)
                self._go_on()
                begun = time.monotonic()
                block = rig.fetch()
                self._alive = time.monotonic()
                gate.take(block)
                done += block.shape[1]
                pause = block.shape[1] / rig.capabilities.sample_rate
                if isinstance(rig, LoopRig):  # less the time that its updates took
                    pause -= self._alive - begun
                with self._news:
                    self._blocks.append(block)
                    self.began = gate.began
                    self._news.notify_all()
        except BaseException as error:
            failure = error
        self.phase = "stopping"
        if self._stop is not None:
            self.ramp_after = time.perf_counter() - self._stop[1]
        try:
            gate.stop()
            self.stopped = {"measured": _monitored(self.rig)}
        except BaseException as error:
            error.__traceback__ = None
            self.stopped = {"failed": f"the stop failed ({error}): {SWITCH_OFF}"}
            self._unsafe = error
            failure = stop_failed(error, failure)
            self.let_go()  # some devices end their output when the connection is closed
        ended = "complete" if failure is None else str(failure) or type(failure).__name__
        said = self.stopped.get("failed") or "ramped to 0 V" + (
            "" if (volts := self.stopped["measured"]) is None else f", the monitor reads {volts:.3g} V"
        )
        self._log(f"{ended}; {said}")
        self._settle(order, ended, drove and (self._left or is_fault(failure)))
        with self._news:
            self.home.origin = getattr(rig, "origin", 0.0)
            if failure is not None:  # its traceback would keep rig and samples in memory (100 MB and more)
                failure.__traceback__ = None
            self._failure = failure
            with suppress(OSError):
                self._changed()
            self.phase = "idle"
            self._news.notify_all()
        collect()

    def _settle(self, order: Order, ended: str, fault: bool) -> None:
        """Update the interlock after the run `order`, which ended for the reason `ended` (words).

        A failed ramp to 0 V is latched as a fault, and so is a run with `fault` True. After any other end
        the output is disarmed if it was armed for this run only (`Order.arm`).
        """
        if "failed" in self.stopped:
            self.interlock.latch(f"{ended}; {self.stopped['failed']}")
        elif fault:
            self.interlock.latch(ended)
        elif order.arm:
            self.interlock.disarm("the program that runs it", "the run has ended")

    def _keep_pace(self, pause: float) -> None:
        """Wait until the client requests samples or a stop, at most `pause` s (duration of the last block). A
        rig that computes faster than real time would otherwise be far ahead of its client and stop late."""
        with self._news:
            self._news.wait_for(lambda: self._wanting or self._stop is not None, pause)
            self._wanting = False

    def let_go(self) -> None:
        """Close the rig and set `rig` to None. Errors of closing are ignored."""
        rig, self.rig = self.rig, None
        close = getattr(rig, "close", None)
        if close is not None:
            with suppress(Exception):
                close()

    def _go_on(self) -> None:
        """Raise StopRequested if a stop was requested, and LimitError if the client of a running run has not
        called `fetch` for `Limits.watchdog` seconds."""
        if self._stop is not None:
            raise StopRequested(self._stop[0])
        silent = time.monotonic() - self._asked
        if self.phase == "running" and silent > self._limits.watchdog:
            raise LimitError(
                f"watchdog: the program that runs it has been silent for {with_prefix(silent, 's')}"
            )

    def _watch(self, rig: Rig, thread: threading.Thread, order: Order) -> None:
        """Watch the run `order` until its `thread` has ended. If the operator is silent for
        `Limits.heartbeat`, end the run and disarm. If the rig's `fetch` hangs (see `_LOST`), ramp to 0 V from
        this thread."""
        allowed, who = order.limits.heartbeat, "operator's page" if order.operated else "program"
        while thread.is_alive():
            thread.join(min(_LOOKS, 0.1 * allowed))
            now = time.monotonic()
            silent = now - (self._beat if order.operated else self._asked)
            if self.phase == "running" and silent > allowed and self._stop is None:
                why = f"the {who} fell silent for {with_prefix(silent, 's')}"
                self.stop(why)
                self.interlock.disarm("the rig's process", why)
            silent = now - self._alive
            if self.phase == "running" and silent > self._limits.watchdog + _LOST:
                with suppress(Exception):
                    rig.stop(self._limits.stop_slew)
                return


def _monitored(rig: Rig | None) -> float | None:
    """Return the reading of the amplifier's monitor after a ramp, V; None without a monitor.

    Raises:
        RigError: the monitor does not read 0 V (within `AT_ZERO`) within `MONITORED` seconds.
    """
    monitor = getattr(rig, "monitor", None)
    if rig is None or monitor is None:
        return None
    can, end = rig.capabilities, time.monotonic() + MONITORED
    allowed = AT_ZERO * (can.max_voltage - can.min_voltage) + 2.0 * can.step
    while abs(volts := float(monitor())) > allowed:
        if time.monotonic() > end:
            raise RigError(f"after the ramp the amplifier's monitor reads {with_prefix(volts, 'V')}")
        time.sleep(0.01)
    return volts


def state_of(supervisor: Supervisor, holder: str) -> dict[str, Any]:
    """Return the answer to the request "state": `phase`, `position` (last one, m or rad from home; or None),
    `holder` (client that holds the rig; or ""), `stopped` (last stop), `interlock` (`Interlock.state`)."""
    return {
        "phase": supervisor.phase,
        "position": supervisor.home.position,
        "holder": holder,
        "stopped": supervisor.stopped,
        "interlock": supervisor.interlock.state(),
    }
