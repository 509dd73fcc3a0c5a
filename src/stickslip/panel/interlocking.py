"""The interlock of the rig on the bench: its state for the pages, and the acts that pages may request."""

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
from ..rig.hosted import Link, greeted
from ..rig.interlock import FILE, Interlock, InterlockError
from ..rig.site import site_of
from ..rig.wire import receive, send
from .asking import asking
from .control import Control
from .document import BenchDocument
from .folder import Folder
from .journal import Journal
from .roles import need_role
from .stream import Client, Hub

LOOKS = 0.5  # s between two queries of the interlock's state, which other programs may change
_ANSWERS = 1.0  # s in which the rig's process must answer


class Why(Strict):
    """Request with the reason for an act on the interlock."""

    why: str = Field(max_length=400)


class PermitAct(Why):
    """Request to give or withdraw a permit (a condition of the interlock without which no run starts)."""

    name: str = Field(max_length=60)
    given: bool


class Interlocks:
    """Last known state of the interlock; `state` has the fields of `rig.interlock.Interlock.state`.

    Args:
        hub: sends every change of the state to the pages.
        journal: logs the acts of pages.
        document: names the rig on the bench.
        folder: the panel's.
        rigs: the folder of the process that owns the panel's virtual rig.
    """

    def __init__(
        self, hub: Hub, journal: Journal, document: BenchDocument, folder: Folder, rigs: Path
    ) -> None:
        self._hub, self._journal, self._document = hub, journal, document
        self._folder, self._rigs = folder, rigs
        self._link: Link | None = None  # the output stays enabled while this link is open
        self._asking = threading.RLock()
        self._closing = threading.Event()
        self.state = {**Interlock(simulated=True).state(), "site": []}
        hub.greetings.append(self._greet)

    @property
    def simulated(self) -> bool:
        """Return True if the rig on the bench is virtual."""
        return isinstance(self._document.checked.file.rig, VirtualRigSpec)

    def need(self) -> None:
        """Raise InterlockError if a run would be refused. The rig's process checks again at the start."""
        self.look()
        Interlock.of_state(self.state).need()

    def look(self) -> None:
        """Ask the rig's process for the interlock's state and send changes to the pages.

        If the process does not answer, the state stays as it was. If there is no process, it is read from the
        interlock's file.
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
        """Arm or disarm the output, acknowledge a fault, or change a permit.

        `do` is "arm", "disarm", "acknowledge" or "permit"; `what` has `why`, and for a permit `name` and
        `given`. Raises ValueError or RigError if the act is refused.
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
            except RigError:  # the rig's process was restarted
                self.close_link()
                self._link = Link(place, "the panel")
                self._link.ask(do, who=who, **what)
        done = _DONE.get(do) or f"permit {what['name']} {'given' if what['given'] else 'withdrawn'}"
        self._journal(done, "warning", why=what["why"])
        self.look()

    def disarm(self, why: str) -> None:
        """Disable the output, in a thread: the caller does not wait."""
        threading.Thread(target=self._disarmed, args=(why,), daemon=True).start()

    def watch(self) -> None:
        """Start to query the interlock's state every `LOOKS` seconds, until `close`."""
        threading.Thread(target=self._watch, daemon=True).start()

    def close(self) -> None:
        """Stop the queries and close the connection; an output that was enabled through it is disabled."""
        self._closing.set()
        self.close_link()

    def close_link(self) -> None:
        """Close the connection through which the output was enabled."""
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
        """Return the limits of the site in words, or why they cannot be read; [] for a virtual rig."""
        try:
            return [] if self.simulated else site_of(place.name).told()
        except RigError as error:
            return [str(error)]

    @property
    def place(self) -> Path:
        """Return the folder of the process that owns the rig on the bench."""
        return rigs_of(self._document.checked.file, self._rigs, self._folder.root)

    def _seen(self, place: Path) -> dict[str, Any] | None:
        """Return the interlock's state from the rig's process, None if it does not answer.

        If no process runs, the state comes from the interlock's file.
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
    """Return the routes of the interlock.

    The page in control may arm, acknowledge and give permits; every page may disarm and withdraw permits.
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
