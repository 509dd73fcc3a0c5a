"""Client of a rig that is owned by another process, a `host`: connection, and the rig as `protocols.Rig`."""

from __future__ import annotations

import os
import re
import select
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
from .description import told_of
from .gate import PositionInput
from .interlock import HostedInterlock, InterlockError, arming
from .limits import LONGEST_STOP, LimitError, Limits
from .plausibility import Plausibility
from .protocols import Array, Capabilities, ControllerSpec, RigError, RigWarning, StopRequested
from .reaching import addressed, connected
from .wire import receive, send

UNANSWERED = "the rig does not answer: switch the amplifier off"
KEPT = "the output may keep its voltage: switch the amplifier off"  # if the process ended during a run
LATE = 1.0  # time without an answer to a stop until a warning says to switch the amplifier off, s
_LAST = LONGEST_STOP + 10.0  # longest wait for the answer to a stop, s
_ANSWER = 10.0  # longest wait for the answer to any other request, s
_SILENT = 3.0  # shortest time that the process has to answer a request for samples, s
_OPENED = 60.0  # longest wait for the process to open a device, s
_BUSY = ("preparing", "running", "stopping")  # values of `Supervisor.phase` during a run
_WAIT = 0.1  # longest time that the process waits for samples before it answers a request for samples, s
_KINDS: dict[str, type[Exception]] = {
    one.__name__: one for one in (LimitError, RigError, StopRequested, InterlockError, QuantityError)
}


def folder_of(resource: str) -> Path:
    """Return the folder of the process that owns a real rig, named by `resource`, a text that identifies the
    rig, such as its address. Its parent is $STICKSLIP_RIGS, or stickslip/rigs in the user's state folder."""
    given = os.environ.get("STICKSLIP_RIGS")
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    base = Path(given) if given else Path(state) / "stickslip" / "rigs"
    return base / (re.sub(r"[^A-Za-z0-9.-]+", "-", resource)[:100].strip("-.") or "rig")


class Link:
    """Connection to the process that owns the rig of a folder; starts the process if it does not run.

    Args:
        folder: folder of the rig's process, see `host` and `folder_of`.
        name: name of this client, shown to others who find the rig in use.

    Raises:
        RigError: the process does not start or answer, or others can access the folder.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._link = connected(folder, name)
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
        """Send a request; return the head of its answer (by key) and its array, which may be empty.

        Args:
            do, values, what: name, array and other content of the request; see `wire`.
            within: s in which the answer must come, else the connection is closed. None: no limit.
            late: s without an answer before a `RigWarning` asks to switch the amplifier off (with `within`).

        Raises:
            RigError, QuantityError: refusal by the process, with its `answer`; RigError also if the process
                is gone or silent.
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
        """Request a stop for `why` at once; call `heard_stop` next. RigError if the process is gone."""
        try:
            send(self._link, {"do": "stop", "why": why})
        except OSError as error:
            raise RigError(f"the rig's process has ended ({error})") from None

    def heard_stop(self) -> None:
        """Wait for the answer to `tell_stop`, without a limit. Raises RigError if the process is gone."""
        try:
            with self._lock:
                receive(self._link)
        except (OSError, EOFError) as error:
            raise RigError(f"the rig's process has ended ({error})") from None

    def _await(self, within: float, late: float) -> None:
        """Wait for an answer. Warn (RigWarning) after `late` s; close and raise RigError after `within` s."""
        if select.select([self._link], [], [], min(within, late))[0]:
            return
        if within > late:
            warnings.warn(UNANSWERED, RigWarning, stacklevel=4)
            if select.select([self._link], [], [], within - late)[0]:
                return
        self._link.close()
        raise RigError(UNANSWERED)

    def close(self) -> None:
        """Close the connection. The process then stops its run, and disarms if this connection has armed."""
        self._link.close()


_LINKS: WeakSet[Link] = WeakSet()


def stop_all(most: float = 3.0) -> None:
    """Stop the runs of all rigs of this program: tell all of them first, then wait for the ends of the runs,
    `most` s at most."""
    end, request = time.monotonic() + most, {"do": "stop", "why": "the program ends"}
    links = []
    for folder in {link.folder for link in list(_LINKS)}:
        # The request follows the greeting at once: a process that does not answer must not delay the others.
        if (link := addressed(folder, "a stop", 1.0)) is not None:
            with suppress(OSError):
                send(link, request)
            links.append(link)
    while links and (left := end - time.monotonic()) > 0.0:
        for link in select.select(links, [], [], left)[0]:
            try:
                answer = receive(link)[0]
                over = "error" in answer or answer.get("stopped") is False
                if answer.get("stopped"):
                    time.sleep(0.01)
                    send(link, request)
            except (OSError, EOFError):
                over = True
            if over:
                link.close()
                links.remove(link)
    for link in links:
        link.close()


class HostedRig:
    """A rig in its own process, which checks the limits and ramps the rig to 0 V when this program dies or
    stalls; see `protocols.Rig`.

    Args:
        link: connection to the process.
        device: description of the device to open; see `description`.
        capabilities: capabilities of the rig, if known: the rig is then opened only when it is first used.
        said: attributes for recordings that describe the device, texts by name, if known.

    Raises:
        RigError: another program holds the rig, or it does not answer (only if it is opened here).
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
        self._first: Array | None = None  # samples that `start` has fetched; the next `fetch` returns them
        self._inputs: tuple[str, ...] = ()
        self._samples = self._runs = 0
        self.position: float | None = None
        self.began: float | None = None
        self.ramp_after: float | None = None
        self._said: dict[str, Any] = {}
        self.ended = False  # True once the run is over and all of its samples were fetched
        self.operated = False  # True if a page of the panel reports by "beat" while its operator is there
        self.waiting: Callable[[], object] = lambda: None  # called again and again while a run is prepared

    def guard(
        self, limits: Limits, position: PositionInput | None, rest: int, keep: Path | None = None
    ) -> None:
        """Set limits, position input (None: no end stops) and number of samples before the drive (`rest`) of
        the next run. The process completes the file of samples `keep` if this program is killed."""
        self._guard = {
            "limits": limits._asdict(),
            "rest": rest,
            "keep": None if keep is None else str(keep.resolve()),
            "position": None if position is None else position_document(position.name, position.calibration),
        }

    def told(self, runs: int) -> dict[str, str]:
        """Return attributes, texts by name, for a recording of the next `runs` runs: the true contact of a
        virtual rig if it varies, otherwise those that describe the device."""
        return told_of(self._device, runs, self._runs) or self._told

    def controlled(
        self,
        controller: ControllerSpec,
        plausibility: Plausibility | None = None,
        second: PositionInput | None = None,
    ) -> None:
        """Make the next run a closed loop in the rig's process; `load` then takes targets, m (rad) from home.
        Call this after `guard`. `order.Order` explains `plausibility` and `second`."""
        self._guard["controller"] = controller.document()
        self._guard["plausibility"] = None if plausibility is None else plausibility._asdict()
        self._guard["second"] = None if second is None else position_document(second.name, second.calibration)

    def command(self, **what: Any) -> None:
        """Call the method `command` of the active loop's controller. Raises RigError or QuantityError."""
        self._ask("command", what=what)

    def said(self) -> dict[str, Any]:
        """Return the statistics of the last run, as `turns.LoopRig.said`; {} if it was no closed loop."""
        return self._said

    def load(self, volts: Array) -> None:
        """Store the drive [n], V at the piezo (or targets, see `controlled`), one value per update."""
        self._volts = volts

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Choose the inputs of the next run, by name, and the number of samples to record of each."""
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start output and recording; return when the run is no longer prepared. RigError before `guard`."""
        if not self._guard:
            raise RigError("a hosted rig is started by `measure`, which says what to watch")
        self._open()
        self.ramp_after, self.ended, self._said = None, False, {}
        wanted = {"inputs": self._inputs, "samples": self._samples, "arm": arming()}
        self._ask("run", self._volts, **wanted, **self._guard, operated=self.operated)
        self._runs += 1
        self._first = self._fetched()
        while self.phase == "preparing":
            self.waiting()
            self._first = self._fetched()

    def fetch(self) -> Array:
        """Return the next samples [inputs, n], in their units; n may be 0. Raises the error of the run."""
        block, self._first = self._first, None
        return self._fetched() if block is None else block

    def _fetched(self) -> Array:
        limits = self._guard["limits"]
        wait = min(_WAIT, 0.25 * limits["heartbeat"])
        silence = wait + max(float(limits["watchdog"]), _SILENT)
        block = self._ask("fetch", wait=wait, within=silence, late=silence)
        self.ended = self.phase == "idle" and not block.size
        return block if block.size else np.zeros((len(self._inputs), 0))

    def stop(self, slew: float) -> None:
        """Ramp to 0 V at `guard`'s `stop_slew` (not `slew`), release the rig; RigError if it fails."""
        del slew
        try:
            self._ask("close", within=_LAST, late=LATE)
        except RigError as error:
            if str(error).startswith("close: open the rig first"):
                return  # this client does not hold the rig, so it has nothing to stop
            raise

    def home_here(self, position: PositionInput, slew: float) -> None:
        """Make the position in a run at 0 V home, with a stop at `slew` [V/s], then release the rig."""
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
    """Return {"input": name, "calibration": [JSON texts]} of the input that measures the position."""
    return {"input": name, "calibration": [to_text(one) for one in calibration]}
