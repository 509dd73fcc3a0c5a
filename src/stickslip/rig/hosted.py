"""A rig in a process of its own, from the side of a program that uses it."""

from __future__ import annotations

import os
import re
import select
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np

from ..quantities.units import QuantityError
from ..recording.calibration.storage import to_text
from ..recording.replacing import read_small
from .devices import told_of
from .gate import PositionInput
from .interlock import HostedInterlock, InterlockError, arming
from .limits import LONGEST_STOP, LimitError, Limits
from .lock import own_folder
from .plausibility import Plausibility
from .protocols import Array, Capabilities, ControllerSpec, RigError, RigWarning, StopRequested
from .supervisor import ANOTHER
from .wire import receive, send

STARTS = 30.0  # s that the process may take to be there
UNANSWERED = "the rig does not answer: switch the amplifier off"
KEPT = "the output may keep its voltage: switch the amplifier off"  # of a process that ended in a run
LATE = 1.0  # s without an answer to a stop, after which people are told
_LAST = LONGEST_STOP + 10.0  # s after which an answer to a stop is waited for no more
_ANSWER = 10.0  # s in which the process answers a request that nobody waits for in a hurry
_SILENT = 3.0  # s in which it answers a request for samples, however short the watchdog
_OPENED = 60.0  # s in which it opens a device
_BUSY = ("preparing", "running", "stopping")  # phases of a run that goes on
_WAIT = 0.1  # s that a request for samples waits for some
_KINDS: dict[str, type[Exception]] = {
    one.__name__: one for one in (LimitError, RigError, StopRequested, InterlockError, QuantityError)
}


def folder_of(resource: str) -> Path:
    """Where the process that owns a real rig keeps what it knows: one place for each rig and user, whoever
    asks. The environment variable STICKSLIP_RIGS names another."""
    given = os.environ.get("STICKSLIP_RIGS")
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    base = Path(given) if given else Path(state) / "stickslip" / "rigs"
    return base / (re.sub(r"[^A-Za-z0-9.-]+", "-", resource)[:100].strip("-.") or "rig")


class Link:
    """One connection to the process that owns the rig of a folder; the process is started if there is none.

    Args:
        folder: see `host`.
        name: who asks, for those who find the rig held.

    Raises:
        RigError: the process does not start.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._link = _connected(folder, name)
        _LINKS.add(self)

    def ask(
        self,
        do: str,
        values: Array | None = None,
        *,
        within: float | None = None,
        late: float = LATE,
        **what: Any,
    ) -> tuple[dict[str, Any], Array]:
        """The answer to a request, and the numbers with it.

        Args:
            do, values, what: the request; see `host`.
            within: s in which the answer must come; later answers cannot be told apart, so the connection
                ends then.
            late: s without an answer after which a `RigWarning` tells people to switch the amplifier off.

        Raises:
            RigError, QuantityError: what the process says is wrong; RigError where it is gone, or silent.
        """
        try:
            with self._lock:
                send(self._link, {"do": do, **what}, values)
                if within is not None:
                    self._await(within, late)
                answer, block = receive(self._link)
        except (OSError, EOFError) as error:
            raise RigError(f"the rig's process has ended ({error})") from None
        if "error" in answer:
            raised = _KINDS.get(answer["kind"], RigError)(answer["error"])
            raised.answer = answer  # type: ignore[attr-defined]
            raise raised
        return answer, block

    def tell_stop(self, why: str) -> None:
        """Ask for a stop and wait for nothing, by a connection that serves nothing else; raises RigError."""
        try:
            send(self._link, {"do": "stop", "why": why})
        except OSError as error:
            raise RigError(f"the rig's process has ended ({error})") from None

    def heard_stop(self) -> None:
        """Wait for the answer to `tell_stop`; raises RigError where the process is gone."""
        try:
            with self._lock:
                receive(self._link)
        except (OSError, EOFError) as error:
            raise RigError(f"the rig's process has ended ({error})") from None

    def _await(self, within: float, late: float) -> None:
        """Wait for the begin of an answer; RigError where none comes."""
        if select.select([self._link], [], [], min(within, late))[0]:
            return
        if within > late:
            warnings.warn(UNANSWERED, RigWarning, stacklevel=4)
            if select.select([self._link], [], [], within - late)[0]:
                return
        self._link.close()
        raise RigError(UNANSWERED)

    def close(self) -> None:
        """Let go; a run of this connection is stopped."""
        self._link.close()


_LINKS: WeakSet[Link] = WeakSet()


def stop_all(most: float = 3.0) -> None:
    """Have every rig of this program ramped to 0 V, and wait for it, so long at most, s."""
    end = time.monotonic() + most
    for folder in {link.folder for link in list(_LINKS)}:
        other = greeted(folder, "a stop")
        if other is None:
            continue
        with other, suppress(OSError, EOFError):
            other.settimeout(1.0)
            while time.monotonic() < end:
                send(other, {"do": "stop", "why": "the program ends"})
                if not receive(other)[0].get("stopped"):
                    break
                time.sleep(0.01)


class HostedRig:
    """A rig; see `protocols.Rig`. Its process watches the limits, and stops when this program dies or stalls.

    Args:
        link: to the process.
        device: what it is to open; see `devices`.
        capabilities: of the rig, where they are known: then it is opened when it is first used.
        said: what recordings say of the device, where that is known.

    Raises:
        RigError: another program holds the rig, or it does not answer.
    """

    def __init__(
        self,
        link: Link,
        device: dict[str, Any],
        capabilities: Capabilities | None = None,
        said: dict[str, str] | None = None,
    ) -> None:
        self._link, self._device, self._opened, self.phase = link, device, False, ""
        self._told, self.interlock = said or {}, HostedInterlock(link.ask)
        self.capabilities = capabilities or self._open()
        self._volts = np.zeros(0)
        self._guard: dict[str, Any] = {}
        self._first: Array | None = None  # samples that came while the start was awaited
        self._inputs: tuple[str, ...] = ()
        self._samples = self._runs = 0
        self.position: float | None = None
        self.began: float | None = None
        self.ramp_after: float | None = None
        self._said: dict[str, Any] = {}
        self.ended = False  # whether the run is over and all of it was fetched
        self.waiting: Callable[[], object] = lambda: None  # called again and again while a start is awaited

    def guard(
        self, limits: Limits, position: PositionInput | None, rest: int, keep: Path | None = None
    ) -> None:
        """What the process is to watch in the next run, and the file of samples that it completes should this
        program be killed."""
        self._guard = {
            "limits": limits._asdict(),
            "rest": rest,
            "keep": None if keep is None else str(keep.resolve()),
            "position": None if position is None else position_document(position.name, position.calibration),
        }

    def told(self, runs: int) -> dict[str, str]:
        """What a recording made of the next runs says: of their truth, where the rig is a virtual one; of the
        device, where it is another."""
        return told_of(self._device, runs, self._runs) or self._told

    def controlled(
        self,
        controller: ControllerSpec,
        plausibility: Plausibility | None = None,
        second: PositionInput | None = None,
    ) -> None:
        """The next run is a closed loop in the rig's process; what is loaded are targets, m. To be said after
        `guard`. For the other two see `supervisor.Order`."""
        self._guard["controller"] = controller.document()
        self._guard["plausibility"] = None if plausibility is None else plausibility._asdict()
        self._guard["second"] = None if second is None else position_document(second.name, second.calibration)

    def command(self, **what: Any) -> None:
        """Tell the controller of the loop that goes on; raises QuantityError for what it refuses."""
        self._ask("command", what=what)

    def said(self) -> dict[str, Any]:
        """How the closed loop goes, as far as was heard: see `turns.LoopRig.said`."""
        return self._said

    def load(self, volts: Array) -> None:
        """Take the drive, V at the piezo, one value per update."""
        self._volts = volts

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Record these inputs when the output starts."""
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start output and recording; returns when the output has begun."""
        if not self._guard:
            raise RigError("a hosted rig is started by `measure`, which says what to watch")
        self._open()
        self.ramp_after, self.ended, self._said = None, False, {}
        wanted = {"inputs": self._inputs, "samples": self._samples, "arm": arming()}
        self._ask("run", self._volts, **wanted, **self._guard)
        self._runs += 1
        self._first = self._fetched()
        while self.phase == "preparing":
            self.waiting()
            self._first = self._fetched()

    def fetch(self) -> Array:
        """The next samples [inputs, n]."""
        block, self._first = self._first, None
        return self._fetched() if block is None else block

    def _fetched(self) -> Array:
        silence = _WAIT + max(float(self._guard["limits"]["watchdog"]), _SILENT)
        block = self._ask("fetch", wait=_WAIT, within=silence, late=silence)
        self.ended = self.phase == "idle" and not block.size
        return block if block.size else np.zeros((len(self._inputs), 0))

    def stop(self, slew: float) -> None:
        """Ramp to 0 V, at the slew that `guard` was told."""
        del slew
        try:
            self._ask("close", within=_LAST, late=LATE)
        except RigError as error:
            if str(error).startswith("close: open the rig first"):
                return  # it never began
            raise

    def home_here(self, position: PositionInput, slew: float) -> None:
        """Call where the end-effector is now home; the output is at 0 V while it is read."""
        self._open()
        try:
            self._ask("home_here", **position_document(position.name, position.calibration), slew=slew)
        finally:
            self._ask("close")

    def _open(self) -> Capabilities:
        asked = {"device": self._device, "again": self._opened}
        answer, _ = self._link.ask("open", within=_OPENED, late=_OPENED, **asked)
        self._opened, self._told = True, answer.get("told", {})
        return Capabilities(**answer["capabilities"])

    def _ask(
        self,
        do: str,
        values: Array | None = None,
        *,
        within: float = _ANSWER,
        late: float = _ANSWER,
        **what: Any,
    ) -> Array:
        try:
            answer, block = self._link.ask(do, values, within=within, late=late, **what)
        except (RigError, QuantityError) as error:
            said: dict[str, Any] | None = getattr(error, "answer", None)
            if said is None and self.phase in _BUSY and str(error) != UNANSWERED:
                raise RigError(f"{error}; {KEPT}") from None
            self._take(said or {})
            raise
        self._take(answer)
        return block

    def _take(self, answer: dict[str, Any]) -> None:
        self.phase = answer.get("phase", "")
        if "position" in answer:
            self.position, self.began = answer["position"], answer["began"]
            self.ramp_after = answer["ramp_after"]
            self._said = answer.get("loop") or self._said


def position_document(name: str, calibration: Sequence[Any]) -> dict[str, Any]:
    """What shows the position, as JSON."""
    return {"input": name, "calibration": [to_text(one) for one in calibration]}


def _connected(folder: Path, name: str) -> socket.socket:
    started: int | None = None
    try:
        own_folder(folder)
    except OSError as error:
        raise RigError(str(error)) from None
    end = time.monotonic() + STARTS
    while True:
        link = greeted(folder, name)
        if link is not None:
            return link
        left = None if started is None else _left(started)
        if left not in (None, 0, ANOTHER):
            raise RigError(f"the rig's process ended at once ({left}): {_last_line(folder / 'rig.log')}")
        if started is None or left is not None:
            started = _started(folder)
        if time.monotonic() > end:
            raise RigError(f"the rig's process does not answer; see {folder / 'rig.log'}")
        time.sleep(0.02)


def _started(folder: Path) -> int:
    """The number of a new process, of a session of its own: what ends the terminal, or a Ctrl-C in it, does
    not reach it."""
    command = [sys.executable, "-m", "stickslip.rig.host", str(folder)]
    with suppress(OSError):  # what the process before said of its ramps
        os.replace(folder / "rig.log", folder / "rig.log.before")
    log = os.open(folder / "rig.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        return os.posix_spawn(
            sys.executable,
            command,
            os.environ,
            file_actions=[
                (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                (os.POSIX_SPAWN_DUP2, log, 1),
                (os.POSIX_SPAWN_DUP2, log, 2),
            ],
            setsid=True,
        )
    finally:
        os.close(log)


def _last_line(log: Path) -> str:
    """What a process said last, why it ended; where that can be read if it said nothing."""
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), f"see {log}")


def _left(process: int) -> int | None:
    """With what a process that was started here has ended; None while it runs."""
    try:
        ended, status = os.waitpid(process, os.WNOHANG)
    except ChildProcessError:
        return 0
    return os.waitstatus_to_exitcode(status) if ended else None


def greeted(folder: Path, name: str, within: float = 5.0) -> socket.socket | None:
    """A connection to the process that is there; None where none is, or where none answers in so long [s]."""
    try:
        known = read_small(folder / "rig.json") or {}
        token, port = str(known["token"]), int(known["port"])
        link = socket.create_connection(("127.0.0.1", port), timeout=within)
    except (OSError, ValueError, LookupError, TypeError, OverflowError):  # damaged: the next process mends it
        return None
    try:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send(link, {"do": "hello", "token": token, "name": name, "pid": os.getpid()})
        receive(link)
        link.settimeout(None)
    except (OSError, EOFError):
        link.close()
        return None
    return link
