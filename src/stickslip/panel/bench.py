"""Routes of the Bench page: experiment and its files, choice of the rig, start and stop of runs, home, notes,
zoom into live curves; also the messages for an emergency stop and heartbeats."""

from __future__ import annotations

import json
import math
from typing import Any

from fastapi import APIRouter, Request, Response

from ..quantities.input_file import Strict
from ..quantities.units import QuantityError
from ..rig import Limits
from ..rig.limits import changed_limits
from .control import Control
from .document import BenchDocument
from .folder import Folder
from .interlocking import Interlocks
from .journal import Journal
from .live import Live
from .rigs import offered
from .roles import need_role
from .running import Runner
from .starting import Starter
from .stream import Client, Hub

MOST_POINTS = 20_000  # largest number of points of a curve in one answer to a zoom


class Change(Strict):
    """Request to change one value in the content of the experiment file on the bench.

    `path` lists the keys of mappings and the indices (from 0) of lists that lead to the value. A `value` of
    null deletes a key of a mapping; an entry of a list becomes null.
    """

    path: list[str | int]
    value: Any = None


class Undo(Strict):
    """Request to undo the last change of the experiment, or with `again` to redo the change last undone."""

    again: bool = False


class Runs(Strict):
    """Request to record some runs of the experiment: `runs` are their names in the experiment file."""

    runs: list[str]


class NamedFile(Strict):
    """Request that names a file of the panel's folder by its path relative to that folder."""

    name: str


class Chosen(Strict):
    """Request to choose a rig.

    `kind` is "virtual" or the name of a back end (driver). `bench` names the bench of the virtual rig.
    `options` are the arguments of the back end as text, such as "host: 192.168.0.20"; a virtual rig has none.
    """

    kind: str
    bench: str = ""
    options: str = ""


class Note(Strict):
    """Request to add a user's note, `text`, to the recordings of the current or last run."""

    text: str


class Window(Strict):
    """Request for a part of the curves of the current or last run, to zoom in.

    `trace` is the number of this run, counted since the panel started. `begin` and `end` [s] count from the
    start of the drive. `points` is the wished number of points of each curve.
    """

    trace: int
    begin: float
    end: float
    points: int = 2000


def bench_routes(
    folder: Folder,
    hub: Hub,
    control: Control,
    journal: Journal,
    runner: Runner,
    live: Live,
    document: BenchDocument,
    starter: Starter,
    interlocks: Interlocks,
) -> APIRouter:
    """Return the router with the routes of the Bench page, below "/bench".

    The function also adds to `hub` the state that a new page receives, and the handlers of the messages
    "emergency_stop" and "beat" (heartbeat of the page in control). It sets `document.limits_change`, which
    checks the role of whoever changes limits.

    Args:
        folder: the panel's folder.
        hub: stream of messages to and from all pages.
        control: which page controls the rig.
        journal: log of the panel.
        runner: current run.
        live: samples of the current or last run.
        document: experiment on the bench.
        starter: start of runs and notes.
        interlocks: interlock of the rig; an emergency stop disarms the rig.
    """
    routes = APIRouter(prefix="/bench")

    def greet(client: Client, said: dict[str, Any]) -> list[str]:
        state = {"kind": "run", **runner.state, **runner.where}
        return [_described(document), json.dumps(state)]

    def emergency(client: Client, said: dict[str, Any]) -> None:
        stopped = runner.stop("emergency stop")
        interlocks.disarm("emergency stop")
        if not stopped:
            text = "Nothing was running: the output is at 0 V."
            client.put(json.dumps({"kind": "notice", "text": text, "level": ""}))

    hub.greetings.append(greet)

    def beat(client: Client, said: dict[str, Any]) -> None:
        if client.identity == control.holder:
            runner.beating.heard()

    hub.hears |= {"emergency_stop": emergency, "beat": beat}
    _add_runs(routes, folder, control, runner, document, starter)
    _add_experiment(routes, folder, hub, control, journal, runner, document)

    @routes.post("/window")
    def window(asked: Window) -> Response:
        if not math.isfinite(asked.end - asked.begin):
            raise QuantityError("a window has a finite begin and end")
        points = min(max(asked.points, 2), MOST_POINTS)
        shown = live.window(asked.trace, asked.begin, asked.end, points)
        return Response(shown, media_type="application/octet-stream")

    return routes


def _described(document: BenchDocument) -> str:
    return json.dumps({"kind": "experiment", **document.described()})


def _add_runs(
    routes: APIRouter,
    folder: Folder,
    control: Control,
    runner: Runner,
    document: BenchDocument,
    starter: Starter,
) -> None:
    """Add the routes "/stop", "/start", "/home", "/home_here" and "/note".

    All but "/stop" and "/note" need control of the rig.
    """

    @routes.post("/stop")
    async def stop() -> dict[str, bool]:
        """Stop the run. Every page may stop it, in control or not; a stop waits for no other request."""
        return {"stopped": runner.stop("stop")}

    @routes.post("/start")
    def start(asked: Runs, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        starter.need_free()
        content = document.of_runs(asked.runs)
        named = ", ".join(asked.runs)
        return {
            "folder": starter.start(content, f"{document.checked.file.title}: {named}", "-".join(asked.runs))
        }

    @routes.post("/home")
    def home(request: Request) -> dict[str, float]:
        control.need(request.headers.get("x-client", ""))
        starter.need_free()
        starter.home()
        return {"position": runner.position}

    @routes.post("/home_here")
    def home_here(request: Request) -> dict[str, float]:
        control.need(request.headers.get("x-client", ""))
        if runner.busy:
            raise QuantityError("a run is going on: home can be set when it has ended")
        checked = document.checked
        runner.home_here(checked.file, folder.root, checked.cells[0])
        return {"position": 0.0}

    @routes.post("/note")
    def note(asked: Note) -> dict[str, str]:
        """Add a note to the recordings of the current or last run; pages without control may do so too."""
        return {"kept": starter.note(asked.text)}


def _add_experiment(
    routes: APIRouter,
    folder: Folder,
    hub: Hub,
    control: Control,
    journal: Journal,
    runner: Runner,
    document: BenchDocument,
) -> None:
    """Add the routes that change, undo, list, load and save experiments, and list and choose rigs.

    All but the lists need control of the rig. Loading and choosing are refused during a run. Every change is
    sent to all pages through `hub`. The function also sets `document.limits_change`.
    """

    def limits_change(before: Limits, after: Limits) -> None:
        """Refuse a change of the rig's limits without the required role, with a RoleError; log a permitted
        one.

        The role "operate" may change only the heartbeat; all other limits need "maintain". `before` and
        `after` are all limits before and after the change.
        """
        need_role("operate" if before._replace(heartbeat=after.heartbeat) == after else "maintain")
        changes = changed_limits(before, after, document.checked.unit)
        journal(f"limits changed: {', '.join(changes)}", "warning")

    document.limits_change = limits_change

    @routes.post("/set")
    def change(asked: Change, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        document.change(asked.path, asked.value)
        hub.send(_described(document))
        return {"name": document.name}

    @routes.post("/undo")
    def undo(asked: Undo, request: Request) -> dict[str, bool]:
        control.need(request.headers.get("x-client", ""))
        done = document.undo(asked.again)
        hub.send(_described(document))
        return {"done": done}

    @routes.get("/rigs")
    def rigs() -> dict[str, Any]:
        return offered(folder)

    @routes.post("/rig")
    def choose(asked: Chosen, request: Request) -> dict[str, list[str]]:
        control.need(request.headers.get("x-client", ""))
        if runner.busy:
            raise QuantityError("a run is going on: another rig can be chosen when it has ended")
        left_out = document.choose_rig(asked.kind, asked.bench, asked.options)
        journal("; ".join([f"the rig is now {document.checked.can.name}", *left_out]))
        hub.send(_described(document))
        return {"left_out": left_out}

    @routes.get("/experiments")
    def experiments() -> list[str]:
        return [name for name, *_ in folder.files(".yaml") if not name.startswith("recordings/")][:200]

    @routes.post("/load")
    def load(asked: NamedFile, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        if runner.busy:
            raise QuantityError("a run is going on: another experiment can be loaded when it has ended")
        document.load(asked.name)
        journal(f"loaded {asked.name}")
        hub.send(_described(document))
        return {"name": document.name}

    @routes.post("/save")
    def save(asked: NamedFile, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        document.save(asked.name)
        journal(f"saved {asked.name}")
        hub.send(_described(document))
        return {"name": document.name}
