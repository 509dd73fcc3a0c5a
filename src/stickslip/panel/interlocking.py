"""The interlock of the rig on the bench: its last known state for the pages, and acts that pages request.

The interlock itself is in the process that owns the rig, see `rig.interlock`. It decides whether a run may
start.
"""

from __future__ import annotations

import json
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from pydantic import Field

from ..quantities.input_file import Strict
from ..rig import RigError
from ..rig.experiment.file import VirtualRigSpec
from ..rig.experiment.laboratory import rigs_of
from ..rig.hosted import Link
from ..rig.interlock import FILE, Interlock, InterlockError
from ..rig.reaching import greeted
from ..rig.site import site_of
from ..rig.wire import receive, send
from .asking import asking
from .control import Control
from .document import BenchDocument
from .folder import Folder
from .journal import Journal
from .roles import need_role
from .stream import Client, Hub

# Time between two updates of the state, s. Other programs can change the interlock, too.
LOOKS = 0.5
_ANSWERS = 1.0  # time within which the rig's process must answer, s


class Why(Strict):
    """Request for an act on the interlock, with the user's reason `why`, which is logged."""

    why: str = Field(max_length=400)


class PermitAct(Why):
    """Request to give a permit (`given` is True) or to withdraw it, with the user's reason.

    A permit is a condition without which no run starts, such as "operators".
    """

    name: str = Field(max_length=60)
    given: bool


class Interlocks:
    """Last known state of the interlock of the rig on the bench.

    `state` has the keys of `rig.interlock.Interlock.state` and "site", the limits of the site as sentences.
    The rig is disarmed when the connection through which the panel armed it is closed.

    Args:
        hub: sends every change of the state to the pages.
        journal: log in which the acts of pages are written.
        document: experiment on the bench, which names its rig.
        folder: the panel's folder.
        rigs: folder of the process that owns the panel's virtual rig.
    """

    def __init__(
        self, hub: Hub, journal: Journal, document: BenchDocument, folder: Folder, rigs: Path
    ) -> None:
        self._hub, self._journal, self._document = hub, journal, document
        self._folder, self._rigs = folder, rigs
        # Connection through which the panel arms the rig. The output stays armed only while it is open.
        self._link: Link | None = None
        self._asking = threading.RLock()
        self._closing = threading.Event()
        self.state = {**Interlock(simulated=True).state(), "site": []}
        hub.greetings.append(self._greet)

    @property
    def simulated(self) -> bool:
        """Return True if the rig on the bench is virtual."""
        return isinstance(self._document.checked.file.rig, VirtualRigSpec)

    def need(self) -> None:
        """Update `state`; raise InterlockError if the interlock would refuse a run now. A page thus learns
        this at once.

        The rig's process checks again when the run starts.
        """
        self.look()
        Interlock.of_state(self.state).need()

    def look(self) -> None:
        """Update `state` with the interlock's state in the rig's process, and send a change to the pages.

        If the process does not answer, `state` stays as it was. If there is no process, the state of the file
        that keeps fault and permits is taken.
        """
        with self._asking:
            place = self.place
            found = self._seen(place)
            if found is None:
                return
            found = {**found, "simulated": self.simulated, "site": self._site(place)}
            if found == self.state:
                return
            self.state = found
        self._hub.tell("interlock", **found)

    def act(self, do: str, **what: Any) -> None:
        """Execute an act of the page whose request is being answered, log it, and update `state`.

        The act is sent through the panel's own connection, which stays open; if needed, the rig's process is
        started. A refused act is not logged here.

        Args:
            do: "arm" or "disarm" the output, "acknowledge" a fault, or "permit".
            what: `why`, the user's reason; for "permit" also `name` of the permit and `given`, True or False.

        Raises:
            QuantityError, RigError: the act is refused, or the rig's process does not answer.
        """
        asker = asking()
        who = asker.named(self._document.checked.file.operator)
        who += f" at {asker.address}" if asker.address else ""
        with self._asking:
            place = self.place
            if self._link is None or self._link.folder != place:
                self.close_link()
                self._link = Link(place, "the panel")
            try:
                self._link.ask(do, who=who, **what)
            except InterlockError:
                raise
            except RigError:
                # The connection is lost, for example because the rig's process was restarted: try once more.
                self.close_link()
                self._link = Link(place, "the panel")
                self._link.ask(do, who=who, **what)
        done = _DONE.get(do) or f"permit {what['name']} {'given' if what['given'] else 'withdrawn'}"
        self._journal(done, "warning", why=what["why"])
        self.look()

    def disarm(self, why: str) -> None:
        """Disarm an armed output in a thread, without waiting; errors are ignored.

        `why` is the reason for the log.
        """
        threading.Thread(target=self._disarmed, args=(why,), daemon=True).start()

    def watch(self) -> None:
        """Start a thread that updates the state every `LOOKS` seconds until `close`."""
        threading.Thread(target=self._watch, daemon=True).start()

    def close(self) -> None:
        """End the updates, and disarm the rig if the panel armed it, by closing the connection."""
        self._closing.set()
        self.close_link()

    def close_link(self) -> None:
        """Close the connection of the panel, if any; the rig's process disarms what was armed through it."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _disarmed(self, why: str) -> None:
        with suppress(RigError, ValueError):
            if self.state["state"] == "armed":
                self.act("disarm", why=why)

    def _watch(self) -> None:
        while not self._closing.wait(LOOKS):
            with suppress(RigError, ValueError, OSError):
                self.look()

    def _site(self, place: Path) -> list[str]:
        """Return the limits of the site for the rig as sentences, [] for a virtual rig.

        If their file cannot be read, the only sentence is the reason. `place` is the folder of the rig's
        process.
        """
        try:
            return [] if self.simulated else site_of(place.name).told()
        except RigError as error:
            return [str(error)]

    @property
    def place(self) -> Path:
        """Return the folder of the process that owns the rig on the bench."""
        return rigs_of(self._document.checked.file, self._rigs, self._folder.root)

    def _seen(self, place: Path) -> dict[str, Any] | None:
        """Return the state in the rig's process, with the keys of `Interlock.state`; None without an answer.

        If no process runs, the state is that of its file. `place` is the folder of the rig's process.
        """
        if not (place / "rig.json").exists():
            return Interlock(place / FILE).state()
        link = greeted(place, "the panel", _ANSWERS)
        if link is None:
            return None
        with link, suppress(OSError, EOFError):
            link.settimeout(_ANSWERS)
            send(link, {"do": "state"})
            return receive(link)[0]["interlock"]
        return None

    def _greet(self, client: Client, said: dict[str, Any]) -> list[str]:
        return [json.dumps({"kind": "interlock", **self.state})]


_DONE = {"arm": "armed", "disarm": "disarmed", "acknowledge": "fault acknowledged"}


def interlock_routes(control: Control, interlocks: Interlocks) -> APIRouter:
    """Return the router with the routes of the interlock, below "/interlock".

    The page in control may arm, acknowledge a fault and give permits, with the role "operate". Every page may
    disarm, and withdraw permits. Each answer is the new state, see `Interlocks`.
    """
    routes = APIRouter(prefix="/interlock")

    def done(do: str, **what: Any) -> dict[str, Any]:
        interlocks.act(do, **what)
        return interlocks.state

    @routes.post("/arm")
    def arm(asked: Why, request: Request) -> dict[str, Any]:
        control.need(request.headers.get("x-client", ""))
        return done("arm", why=asked.why)

    @routes.post("/disarm")
    def disarm(asked: Why) -> dict[str, Any]:
        return done("disarm", why=asked.why)

    @routes.post("/acknowledge")
    def acknowledge(asked: Why, request: Request) -> dict[str, Any]:
        control.need(request.headers.get("x-client", ""))
        return done("acknowledge", why=asked.why)

    @routes.post("/permit")
    def permit(asked: PermitAct, request: Request) -> dict[str, Any]:
        if asked.given:
            need_role("operate")
            control.need(request.headers.get("x-client", ""))
        return done("permit", name=asked.name, given=asked.given, why=asked.why)

    return routes
