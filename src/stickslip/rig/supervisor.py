"""Supervision of a rig in the process that owns it: every run ends at 0 V, also without its client.

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

ANOTHER = 3  # exit code of a process whose rig belongs to another process
HOMING = 0.02  # s of readings at 0 V that define home
MONITORED = 1.0  # s after the ramp within which the amplifier's monitor must read 0 V
AT_ZERO = 0.01  # fraction of the output's range that counts as 0 V at the monitor
_LOOKS = 0.2  # s, longest time between two checks of a run for silence
_LOST = 1.0  # s in addition to `Limits.watchdog`, after which a call of the rig's `fetch` counts as hanging


class Supervisor:
    """The only object that talks to the rig: it starts, watches and stops runs.

    Args:
        home: origin of positions.
        changed: called to store `home` after a run or a change of home.
        log: called at the end of each run, with a line of text about the end and the ramp to 0 V.
        interlock: decides whether a run may start; by default the interlock of a simulated rig.
        site: returns the limits and permits of the site, for each run of a rig that is not simulated.

    Attributes:
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
        self.ramp_after: float | None = None  # s from the request to stop to the start of the ramp
        self.stopped: dict[str, Any] = {}  # last stop: "measured", V or None, or "failed", a text
        self._news = threading.Condition()
        self._blocks: deque[Array] = deque()
        self._sent: list[Array] = []  # blocks whose receipt the program has not confirmed
        self._stored = 0  # number of samples whose receipt the program has confirmed
        self._keep: Path | None = None
        self._kept: BinaryIO | None = None  # the file of samples `_keep`, open while it may need completion
        self._failure: BaseException | None = None
        self._unsafe: BaseException | None = None  # error of a failed stop, until a client has received it
        self._stop: tuple[str, float] | None = None
        self._left = False  # True if the program that started the run is gone
        self._asked = self._alive = self._beat = 0.0
        self._limits = Limits()
        self._wanting = False  # True while a client waits for samples
        self._thread: threading.Thread | None = None
        self._loop: LoopRig | None = None  # loop of the last run, if it was closed-loop

    @property
    def busy(self) -> bool:
        """Return True while a run is active."""
        return self.phase in ("preparing", "running", "stopping")

    def run(self, order: Order) -> None:
        """Start a run and return immediately. Raises RigError if another run is active or no rig is open, and
        InterlockError if the interlock forbids the run."""
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
        """Return the rig with checks of the site's permits, and the order with the stricter of both limits.
        Read the device's limits again. Leave a simulated rig alone. Raises LimitError for a refused drive."""
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
        """Call the method `command` of the active loop's controller with the arguments `what`, by name. The
        controller's refusal is raised here; RigError if no loop that takes commands is active."""
        act = getattr(None if self._loop is None else self._loop.controller, "command", None)
        if act is None or not self.busy:
            raise RigError("no loop goes on that takes commands")
        act(**what)

    def beat(self) -> None:
        """Note that the page that operates the run is alive, for `Limits.heartbeat`."""
        self._beat = time.monotonic()

    def said(self) -> dict[str, Any] | None:
        """Return `LoopRig.said` of the closed loop of the active or last run; None if that is no loop."""
        return None if self._loop is None else self._loop.said()

    def stop(self, why: str, gone: bool = False) -> bool:
        """Request the end of the run with a ramp to 0 V, and return at once: False if no run is active.

        Args:
            why: the reason; the reason of the first request counts.
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
        """Wait until the run has ended, `most` seconds at most; None is no limit."""
        if self._thread is not None:
            self._thread.join(most)

    def fetch(self, wait: float) -> Array | None:
        """Return the samples since the last call [inputs, n], or None. Wait `wait` seconds for them at most.

        Raises:
            RigError, QuantityError, ...: the error that ended the run, once all earlier samples were fetched.
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
        """Raise the error of the last run's stop, once, unless `fetch` has raised it. A client that has all
        samples fetches no more, but the output may have kept its voltage."""
        failed, self._unsafe = self._unsafe, None
        if failed is not None:
            raise failed

    def complete(self) -> None:
        """Store the samples of an ended run that its program, which is gone, has not stored."""
        with self._news:
            blocks, keep = [*self._sent, *self._blocks], self._keep
            self._sent, self._keep = [], None
            self._blocks.clear()
        if blocks and keep is not None:
            with suppress(OSError, ValueError, struct.error):
                complete(keep, self._stored, np.concatenate(blocks, axis=1))

    def leave_samples(self) -> None:
        """Close the file of samples, so that its lock is released: nothing has to be added any more."""
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()

    def home_here(self, position: PositionInput, limits: Limits) -> None:
        """Make the present position home, read by the input `position` in a run of `HOMING` seconds at 0 V.
        Raises RigError if no rig is open, a run is active, or the rig gives no reading."""
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
        drove = False  # True if the output may have been driven
        try:
            if isinstance(rig, LoopRig):  # the loop checks position and voltages at each update
                rig.load(order.volts)
                gate.arm(order.inputs, order.samples)
            else:
                gate.load(order.volts)
                gate.arm(order.inputs, order.samples, order.position, order.rest)
            self._go_on()
            drove = not self.interlock.simulated
            gate.start()  # a virtual rig computes before it puts out
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
                if isinstance(rig, LoopRig):  # a loop in real time sets its own pace
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
            self.let_go()  # some devices stop when their connection is closed
        ended = "complete" if failure is None else str(failure) or type(failure).__name__
        said = self.stopped.get("failed") or "ramped to 0 V" + (
            "" if (volts := self.stopped["measured"]) is None else f", the monitor reads {volts:.3g} V"
        )
        self._log(f"{ended}; {said}")
        self._settle(order, ended, drove and (self._left or is_fault(failure)))
        with self._news:
            self.home.origin = getattr(rig, "origin", 0.0)
            if failure is not None:  # its frames refer to the rig and its samples (100 MB and more)
                failure.__traceback__ = None
            self._failure = failure
            with suppress(OSError):
                self._changed()
            self.phase = "idle"
            self._news.notify_all()
        collect()

    def _settle(self, order: Order, ended: str, fault: bool) -> None:
        """Update the interlock after a run: latch a fault, or disarm if the run was armed by itself.

        Args:
            order: the request for the run.
            ended: end of the run in words.
            fault: True if the run ended by a fault. A failed stop always is one.
        """
        if "failed" in self.stopped:
            self.interlock.latch(f"{ended}; {self.stopped['failed']}")
        elif fault:
            self.interlock.latch(ended)
        elif order.arm:
            self.interlock.disarm("the program that runs it", "the run has ended")

    def _keep_pace(self, pause: float) -> None:
        """Wait until the client asks for samples or a stop, at most `pause` s (duration of the last block). A
        rig faster than real time would otherwise be far ahead of its client, and a stop come late."""
        with self._news:
            self._news.wait_for(lambda: self._wanting or self._stop is not None, pause)
            self._wanting = False

    def let_go(self) -> None:
        """Close the rig and forget it, even if closing fails."""
        rig, self.rig = self.rig, None
        close = getattr(rig, "close", None)
        if close is not None:
            with suppress(Exception):
                close()

    def _go_on(self) -> None:
        """Raise StopRequested if a stop was requested, LimitError if the client is silent for too long."""
        if self._stop is not None:
            raise StopRequested(self._stop[0])
        silent = time.monotonic() - self._asked
        if self.phase == "running" and silent > self._limits.watchdog:
            raise LimitError(
                f"watchdog: the program that runs it has been silent for {with_prefix(silent, 's')}"
            )

    def _watch(self, rig: Rig, thread: threading.Thread, order: Order) -> None:
        """Stop a run whose operator is silent, and a rig whose `fetch` hangs, from a thread other than the
        run's `thread`."""
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
    """Return the state of rig and interlock for clients, as JSON data; `holder` is the client's name."""
    return {
        "phase": supervisor.phase,
        "position": supervisor.home.position,
        "holder": holder,
        "stopped": supervisor.stopped,
        "interlock": supervisor.interlock.state(),
    }
