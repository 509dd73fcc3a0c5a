"""Process that owns a rig, its limits, home, watchdog and the ramp to 0 V. Programs are its clients.

    python -m stickslip.rig.host FOLDER

The folder keeps home.json (origin of positions), interlock.json (fault and permits), rig.json (port, token
and number of the process, readable by this user only), log.jsonl (see `logbook`) and rig.log (error output).
Only one process at a time has the lock of a folder. The process ends when no run is active and the last
client has been gone for `LINGER` seconds; SIGTERM ends it with a ramp to 0 V. `wire` describes the requests.
"""

from __future__ import annotations

import hmac
import json
import os
import secrets
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from ..gate.priority import come_first
from ..recording.calibration.storage import from_text
from .description import open_device
from .gate import PositionInput
from .home import Home
from .interlock import FILE as INTERLOCK
from .interlock import Interlock
from .limits import LONGEST_STOP, Limits, changed_limits
from .lock import locked, own_folder
from .logbook import Logbook
from .memory import collected_on_request, give_memory_back
from .order import Order
from .plausibility import Plausibility
from .protocols import Array, Capabilities, RigError
from .site import site_of
from .supervisor import ANOTHER, Supervisor, state_of
from .wire import WireError, receive, send, text_of

NICE = -10  # nice value that the process requests, so that computations and pages do not delay it
LINGER = 5.0  # time without a client after which the process ends, once no run is active, s
_GREETING = 2.0  # time in which a new connection must send the request "hello" with the token, s
_MOST_STRANGERS = 32  # most connections that have not sent "hello" yet; one more closes the oldest of them
_LONGEST_WAIT = 1.0  # longest time that one request waits for samples or for the end of a run, s
_LONGEST_RAMP = LONGEST_STOP + 5.0  # longest wait for the end of a ramp to 0 V, s
_LEAVING = 0.3  # longest wait of the request "open" for another client to release the rig, s


class Host:
    """Server for the clients of one rig. One client at a time holds the rig; any client may stop it.

    Args:
        folder: folder of the rig, see the module. RigError if its home.json is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self.token = folder, secrets.token_hex(32)
        home = folder / "home.json"
        self._log = Logbook(folder)
        self._limits: Limits | None = None  # limits of the last run, for the log of changes
        self.interlock = Interlock(folder / INTERLOCK, log=self._act)
        self.supervisor = Supervisor(
            Home.load(home),
            lambda: self.supervisor.home.save(home),
            self._ramped,
            self.interlock,
            lambda: site_of(folder.name),
        )
        self._armer: socket.socket | None = None  # connection that armed the output; its end disarms
        self._lock = threading.Lock()
        self._clients: set[socket.socket] = set()
        self._strangers: list[socket.socket] = []
        self._holder: tuple[socket.socket, str] | None = None
        self._device: dict[str, Any] | None = None
        self._left = time.monotonic()
        self.ended = threading.Event()

    def serve(self) -> None:
        """Write rig.json and serve, until no run is active and no client was there for `LINGER` s, or `ended`
        is set. Then remove rig.json and ramp to 0 V."""
        listening = socket.create_server(("127.0.0.1", 0))
        listening.settimeout(0.2)
        self._tell(listening.getsockname()[1])
        try:
            while not self.ended.is_set():
                with suppress(TimeoutError):
                    self._welcome(listening.accept()[0])
                with self._lock:
                    alone = not self._clients and not self.supervisor.busy
                if alone and time.monotonic() - self._left > LINGER:
                    return
        finally:
            (self._folder / "rig.json").unlink(missing_ok=True)
            listening.close()
            self.supervisor.stop("the rig's process ends")
            self.supervisor.join()

    def _tell(self, port: int) -> None:
        """Write rig.json, by which clients find the process, in one step and readable by this user only."""
        path = self._folder / "rig.json"
        temporary = path.with_suffix(".part")
        temporary.unlink(missing_ok=True)
        file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(file, "w", encoding="utf-8") as writing:
            json.dump({"port": port, "token": self.token, "pid": os.getpid()}, writing)
        os.replace(temporary, path)

    def _welcome(self, link: socket.socket) -> None:
        with self._lock:
            if len(self._strangers) >= _MOST_STRANGERS:  # a new client may want a stop: close the oldest one
                with suppress(OSError):
                    self._strangers.pop(0).shutdown(socket.SHUT_RDWR)
            self._strangers.append(link)
            self._clients.add(link)
        threading.Thread(target=self._serve, args=(link,), daemon=True).start()

    def _serve(self, link: socket.socket) -> None:
        try:
            with suppress(OSError, EOFError):
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                link.settimeout(_GREETING)
                said, _ = receive(link)
                if not hmac.compare_digest(str(said.get("token", "")).encode(), self.token.encode()):
                    return
                self._known(link)
                name = f"{str(said.get('name', ''))[:60]} (process {said.get('pid')})"
                send(link, {"pid": os.getpid()})
                link.settimeout(None)
                while True:
                    asked, values = receive(link)
                    answer, block = self._answer(link, name, asked, values)
                    try:
                        send(link, answer, block)
                    except (TypeError, ValueError) as error:  # JSON cannot express data of a user's own rig
                        said = f"{asked.get('do')}: the rig gave what cannot be told: {error}"
                        send(link, {"error": said, "kind": "RigError"})
        except WireError:
            return
        finally:
            self._gone(link)

    def _known(self, link: socket.socket) -> None:
        with self._lock, suppress(ValueError):
            self._strangers.remove(link)

    def _gone(self, link: socket.socket) -> None:
        self._known(link)
        with self._lock:
            self._clients.discard(link)
            self._left = time.monotonic()
            held = self._holder is not None and self._holder[0] is link
        if held:
            self.supervisor.stop("the program that ran it is gone", gone=True)
            self._release(gone=True)
        if self._armer is link:
            self._disarm("the program that armed it is gone", "the rig's process")
        with self._lock:
            if not self._clients and not self.supervisor.busy:
                self.supervisor.let_go()  # closes the device, so that other programs can open it
        with suppress(OSError):
            link.close()

    def _release(self, gone: bool = False) -> None:
        """Let other clients hold the rig, once its run and the ramp to 0 V have ended.

        The end is awaited for `_LONGEST_WAIT`, a ramp for `_LONGEST_RAMP`. If the run has not ended then (a
        virtual rig may compute for long), a thread waits for it. With `gone` True the client has
        disconnected: the samples that it has not stored are appended to its file of samples.
        """
        self.supervisor.join(_LONGEST_WAIT)
        if self.supervisor.phase == "stopping":
            self.supervisor.join(_LONGEST_RAMP)
        if self.supervisor.busy:
            threading.Thread(target=self._release, args=(gone,), daemon=True).start()
            return
        if gone:
            self.supervisor.complete()
        self.supervisor.leave_samples()
        with self._lock:
            self._holder = None

    def _answer(
        self, link: socket.socket, name: str, asked: dict[str, Any], values: Array
    ) -> tuple[dict[str, Any], Array | None]:
        try:
            return self._done(link, name, asked, values)
        except BaseException as error:
            # The answer contains the error's notes: a note may say that the ramp to 0 V failed.
            said = ". ".join((str(error), *getattr(error, "__notes__", ())))
            return {"error": said, "kind": type(error).__name__, **self._progress()}, None

    def _done(
        self, link: socket.socket, name: str, asked: dict[str, Any], values: Array
    ) -> tuple[dict[str, Any], Array | None]:
        do = asked.get("do")
        if do == "stop":
            why = str(asked.get("why", "stop"))[:200]
            stopped = self.supervisor.stop(why)
            if stopped:
                self._said("stop asked for", name, why)
            if asked.get("disarm"):
                self.interlock.disarm(name, why)
            return {"stopped": stopped}, None
        if do == "beat":
            self.supervisor.beat()
            return {}, None
        if do == "state":
            return state_of(self.supervisor, "" if self._holder is None else self._holder[1]), None
        if do in ("arm", "disarm", "acknowledge", "permit"):
            who = ", ".join(filter(None, (str(asked.get("who", ""))[:200], name)))
            self._interlock(link, str(do), asked, who)
            return {"interlock": self.interlock.state()}, None
        if do == "open":
            held = self._holder is not None and self._holder[0] is link
            self._hold(link, name)
            try:
                return self._opened(asked["device"], bool(asked["again"])), None
            except BaseException:
                if not held:  # a client whose rig does not open must not keep others from the rig
                    self._holder = None
                raise
        if self._holder is None or self._holder[0] is not link:
            raise RigError(f"{do}: open the rig first")
        if do == "fetch":
            block = self.supervisor.fetch(min(float(asked["wait"]), _LONGEST_WAIT))
            return self._progress(), block
        if do == "run":
            order = _order(asked, values)
            self._changed(order.limits, name)
            self.supervisor.run(order)
            self._log.write("run started", who=name, why=order.arm)
            return self._progress(), None
        if do == "command":
            self.supervisor.command(dict(asked["what"]))
            return self._progress(), None
        if do == "home_here":
            self.supervisor.home_here(_position(asked), Limits(stop_slew=float(asked["slew"])))
            return self._progress(), None
        if do == "close":
            self.supervisor.stop("the rig was closed")
            self._release()
            self.supervisor.check_stopped()
            return self._progress(), None
        raise RigError(f"{do!r} is no request")

    def _ramped(self, line: str) -> None:
        self._log.write(f"run ended: {line}")

    def _changed(self, limits: Limits, who: str) -> None:
        """Log the limits that differ from those of the previous run; `who` names the client that set them."""
        before, self._limits = self._limits, limits
        if changes := changed_limits(before, limits):
            self._log.write(f"limits: {', '.join(changes)}", who=who)

    def _act(self, act: str, who: str, what: str, why: str) -> None:
        """Log an act on the interlock; this is the argument `log` of `Interlock`, see `interlock.Log`."""
        level = "error" if act == "fault" else "info" if act == "acknowledged" else "warning"
        self._log.write(f"{act}: {what}", who=who, why=why, level=level)

    def _said(self, what: str, who: str, why: str) -> None:
        """Log `what`, `who` and `why` from another thread, so that a stop does not wait for the disk."""
        threading.Thread(target=self._log.write, args=(what,), kwargs={"who": who, "why": why}).start()

    def _interlock(self, link: socket.socket, do: str, asked: dict[str, Any], who: str) -> None:
        """Execute a request to the interlock. Disarming and the withdrawal of a permit also stop the run.

        Args:
            link: connection of the client; the output is disarmed when the connection that armed it ends.
            do: "arm", "disarm", "acknowledge" or "permit".
            asked: the request, with `why`; "permit" has `name` and `given` (False withdraws the permit) too.
            who: name of the person or program, for the log. Errors are those of `Interlock`.
        """
        why = str(asked.get("why", ""))
        if do == "arm":
            self.interlock.arm(who, why)
            self._armer = link
        elif do == "disarm":
            self._disarm(why or "disarmed", who)
        elif do == "acknowledge":
            self.interlock.acknowledge(who, why)
        else:
            name, given = str(asked.get("name", "")), asked.get("given") is True
            self.interlock.permit(name, given, who, why)
            if not given:
                self.supervisor.stop(f"the permit {name!r} was withdrawn by {who}: {why}"[:400])

    def _disarm(self, why: str, who: str) -> None:
        self._armer = None
        self.supervisor.stop(f"disarmed by {who}: {why}"[:400])
        self.interlock.disarm(who, why)

    def _progress(self) -> dict[str, Any]:
        one = self.supervisor
        return {
            "phase": one.phase,
            "position": one.home.position,
            "began": one.began,
            "ramp_after": one.ramp_after,
            "loop": one.said(),
        }

    def _hold(self, link: socket.socket, name: str) -> None:
        end = time.monotonic() + _LEAVING
        while self._held_by_other(link) and time.monotonic() < end:
            time.sleep(0.01)
        with self._lock:
            if self._holder is not None and self._holder[0] is not link:
                raise RigError(f"the rig is held by {self._holder[1]}")
            since = datetime.now().strftime("%H:%M:%S")
            self._holder = (link, f"{name}, since {since}")

    def _held_by_other(self, link: socket.socket) -> bool:
        with self._lock:
            return self._holder is not None and self._holder[0] is not link

    def _opened(self, device: dict[str, Any], again: bool) -> dict[str, Any]:
        """Open the rig; return its `capabilities` and, as `told`, its attributes for recordings (JSON data).

        Args:
            device: description of the rig. The same real rig stays open; a rig with another one is closed.
            again: True if this client has opened the rig before: a virtual rig then stays as it is too.

        Raises:
            RigError, TypeError: a run is active, the device does not answer, or JSON cannot express the data
                of a user's own rig. `open_device` raises further errors.
        """
        capabilities = self._open(device, again)
        told = getattr(self.supervisor.rig, "told", None)
        virtual = device.get("kind") == "virtual"  # its client computes the attributes by `told_of` instead
        said = {"capabilities": capabilities._asdict(), "told": {} if told is None or virtual else told(1)}
        text_of(said)
        return said

    def _open(self, device: dict[str, Any], again: bool) -> Capabilities:
        one = self.supervisor
        if one.busy:
            raise RigError("a run is going on: stop it first")
        # A virtual rig is made again for each recording, because its noise comes from the recording's seed.
        if device != self._device or one.rig is None or (device.get("kind") == "virtual" and not again):
            one.let_go()
            self._device = None
            one.rig, self._device = open_device(device, one.home.origin), device
        self.interlock.simulated = bool(getattr(one.rig, "simulated", False))
        return one.rig.capabilities


def _position(asked: dict[str, Any]) -> PositionInput:
    return PositionInput(str(asked["input"]), tuple(from_text(one) for one in asked["calibration"]))


def _order(asked: dict[str, Any], volts: Array) -> Order:
    position = asked["position"]
    return Order(
        Limits(**asked["limits"]),
        tuple(map(str, asked["inputs"])),
        int(asked["samples"]),
        int(asked["rest"]),
        None if position is None else _position(position),
        volts,
        None if asked.get("keep") is None else Path(str(asked["keep"])),
        asked.get("controller"),
        None if asked.get("plausibility") is None else Plausibility(**asked["plausibility"]),
        None if asked.get("second") is None else _position(asked["second"]),
        str(asked.get("arm", "")),
        asked.get("operated") is True,
    )


def main(folder: Path) -> int:
    """Own the rig of a folder until `Host.serve` ends; return the exit code of the process.

    The code is 0 at the regular end, `ANOTHER` if another process owns the rig, and 1, with a line on stderr,
    if the folder or a file in it cannot be used.
    """
    come_first(NICE)
    give_memory_back()
    try:
        own_folder(folder)
        with locked(folder / "lock") as mine:
            if not mine:
                return ANOTHER
            host = Host(folder)
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda *_: host.ended.set())
            sys.setswitchinterval(1e-3)
            with collected_on_request():
                host.serve()
    except (OSError, RigError) as error:  # the folder cannot be used; clients show this line
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1])))
