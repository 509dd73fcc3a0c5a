"""The panel's server: the page's files, the routes of all pages, and the stream of messages."""

from __future__ import annotations

import asyncio
import itertools
import json
import re
import secrets
import sys
import threading
from collections.abc import AsyncIterator, Mapping, MutableMapping
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from ..gate.elsewhere import interpret_in
from ..quantities.input_file import Strict, reason
from ..quantities.units import to_si
from ..recording.readers.process import Reader
from ..rig import RigError
from ..rig.memory import collect, collected_on_request
from ..rig.samples import recover
from ..simulation import SimulationError
from ..study import StudyError
from .asking import asking, shown
from .bench import bench_routes
from .control import Control
from .design import Searches, design_routes
from .document import BenchDocument
from .explore import explore_routes
from .fits import Fitting
from .folder import Folder
from .guard import LARGEST_BODY, LOOPBACK, Guard
from .historical import history_routes
from .identifying import identify_routes
from .interlocking import Interlocks, interlock_routes
from .journal import Journal
from .live import Live
from .move import move_routes
from .moving import Moves
from .path import path_routes
from .recordings import recording_routes
from .running import Runner
from .sequence import Sequencer, sequence_routes
from .sets import Sets
from .starting import Starter
from .statistics import Statistics, statistics_routes
from .stream import Client, Hub
from .studies import Studies, study_routes

STATIC = Path(__file__).parent / "static"
# Modules that the process for reading files imports when it starts, because it runs their functions. The
# imports take 1.5 s of computing, which the first answer would have to wait for.
READ_BY = (
    "stickslip.recording.readers.reading",
    "stickslip.history.describing",
    "stickslip.rig.logbook",
    "stickslip.parameters.load",
    "stickslip.study.picture",
    "stickslip.jobs.analysis.fit_parameters",
)
_IDLE = 600  # time between garbage collections while no run is active, s


# Pattern of comment lines in a script of the page.
_COMMENT = re.compile(rb"^[ \t]*(?://.*|/\*\*.*\*/)\n", re.MULTILINE)


class _Static(StaticFiles):
    """Server of the page's files, without the comment lines of its scripts: 5 % fewer bytes are sent."""

    async def get_response(self, path: str, scope: MutableMapping[str, Any]) -> Response:
        """Return the response with a file, or the response (304) that it has not changed."""
        answer = await super().get_response(path, scope)
        if not isinstance(answer, FileResponse) or not path.endswith(".js") or path.startswith("vendor"):
            return answer
        kept = {name: answer.headers[name] for name in ("etag", "last-modified")}
        content = _COMMENT.sub(b"", Path(answer.path).read_bytes())
        return Response(content, media_type=answer.media_type, headers=kept)


class Text(Strict):
    """Request for the value of a `text` that was typed into a field with the SI unit `unit`."""

    text: str
    unit: str = ""


def create_app(
    folder: Path,
    *,
    token: str | None = None,
    tokens: Mapping[str, str] | None = None,
    hosts: frozenset[str] = LOOPBACK,
    any_address: bool = False,
    largest_body: int = LARGEST_BODY,
) -> FastAPI:
    """Return the panel's application for a folder; the caller serves it.

    Samples of runs that were killed are first turned into recordings.

    Args:
        folder: the panel's folder; requests can name files in this folder only.
        token: token of the role "maintain". Without any token everybody has that role; the server must then
            be reachable from this machine only.
        tokens: role of each further token, see `roles`.
        hosts, any_address: see `guard.Guard`.
        largest_body: largest size of a request, bytes.
    """
    files = Folder(folder)
    hub = _greeting()
    control = Control(hub)
    journal = Journal(hub, files)
    live = Live(hub)
    read = Reader(READ_BY)
    interpret_in(read)
    recovered = [one for made in sorted(files.root.glob("recordings/*/")) for one in recover(made)]
    statistics = Statistics(hub, journal, files.root)
    runner = Runner(hub, live, journal, files.root / ".rig", read, statistics)
    for one in recovered:
        journal(f"{files.name(one)}: kept of a run that was killed", "warning")
    document = BenchDocument(files, read)
    journal.operator = lambda: document.checked.file.operator
    interlocks = Interlocks(hub, journal, document, files, files.root / ".rig")
    runner.asks.append(interlocks.need)
    control.gone.append(lambda: interlocks.disarm("who was in control has left"))
    starter = Starter(files, hub, journal, document, runner, read)
    sequencer = Sequencer(hub, document, runner, starter)
    moves = Moves(files, hub, control, journal, document, runner, live, starter, read)
    fitting, searches = Fitting(files, hub), Searches(hub)
    studies, sets = Studies(files, journal), Sets(files)

    async def beat() -> None:
        """Send a sign of life every second: a page that hears nothing knows that the connection is lost.

        Also take control from a lost page, and collect garbage every `_IDLE` seconds while no run is active.
        """
        for second in itertools.count(1):
            await asyncio.sleep(1.0)
            control.watch()
            hub.tell("beat")
            if second % _IDLE == 0 and not runner.busy:
                collect()

    @asynccontextmanager
    async def life(app: FastAPI) -> AsyncIterator[None]:
        beating = asyncio.create_task(beat())
        # Longest time for which a thread computes before others may run, s. Python's default, 5 ms, is a
        # third of a video frame.
        sys.setswitchinterval(1e-3)
        _start_processes(hub, runner, read)
        interlocks.watch()
        with collected_on_request():
            yield
            beating.cancel()
            fitting.close()
            searches.stop()
            studies.close()
            if runner.stop("the panel closes"):
                await asyncio.to_thread(runner.join)
            await asyncio.to_thread(sequencer.join)
        interlocks.close()
        runner.close()
        read.close()

    def logs() -> dict[str, Path]:
        return {"panel": files.root, "rig": interlocks.place}

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=life)
    app.state.hub, app.state.live = hub, live

    app.include_router(
        bench_routes(files, hub, control, journal, runner, live, document, starter, interlocks)
    )
    app.include_router(interlock_routes(control, interlocks))
    app.include_router(sequence_routes(control, sequencer))
    app.include_router(statistics_routes(control, statistics))
    app.include_router(move_routes(control, moves))
    app.include_router(path_routes(files, hub, control, journal, document, read, sets))
    app.include_router(recording_routes(files, hub, control, read))
    app.include_router(history_routes(files, hub, control, read, logs))
    app.include_router(study_routes(files, studies, journal, read))

    app.include_router(explore_routes(sets))
    app.include_router(design_routes(sets, searches, control, journal, hub, document))
    app.include_router(identify_routes(files, fitting, read, sets))

    _page_routes(app, hub)
    _explain_errors(app, files)
    shown_tokens = {**(tokens or {}), **({} if token is None else {token: "maintain"})}
    app.add_middleware(
        Guard, hosts=hosts, any_address=any_address, tokens=shown_tokens, largest_body=largest_body
    )
    return app


def _greeting() -> Hub:
    """Return the stream of messages, whose first message to a page has the page's public name and role.

    Its key "boot" is random at each start of the server, so that a page that connects again notices a
    restart.
    """
    hub, boot = Hub(), secrets.token_hex(8)

    def hello(client: Client, said: dict[str, Any]) -> list[str]:
        you, role = shown(client.identity), asking().role
        return [json.dumps({"kind": "hello", "boot": boot, "you": you, "role": role})]

    hub.greetings.append(hello)
    return hub


def _start_processes(hub: Hub, runner: Runner, read: Reader) -> None:
    """Let the process that reads files start now, in a thread, and the virtual rig's when the first page
    connects."""
    first = threading.Lock()

    def rig() -> None:
        with suppress(RigError):
            runner.find_position()

    def changed() -> None:
        if first.acquire(blocking=False):
            threading.Thread(target=rig, daemon=True).start()

    hub.changed.append(changed)
    threading.Thread(target=read.start, daemon=True).start()


def _page_routes(app: FastAPI, hub: Hub) -> None:
    """Add the routes of every page: page and files, stream of messages, and value of a typed quantity."""

    @app.websocket("/stream")
    async def stream(socket: WebSocket) -> None:
        await hub.serve(socket)

    @app.post("/quantity")
    def quantity(asked: Text) -> dict[str, float]:
        return {"value": to_si(asked.text, asked.unit, "value")}

    @app.get("/")
    def page() -> FileResponse:
        return FileResponse(STATIC / "index.html")

    app.mount("/static", _Static(directory=STATIC), name="static")


def _explain_errors(app: FastAPI, folder: Folder) -> None:
    """Answer every error with {"error": sentence}, without this machine's paths.

    The status is 400 for a wrong request or a refusal, 500 for an unexpected error, or that of an
    HTTPException.
    """

    def answer(status: int, text: str) -> JSONResponse:
        return JSONResponse({"error": folder.told(" ".join(text.split()))}, status)

    @app.exception_handler(RequestValidationError)
    async def malformed(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        return answer(400, f"{'.'.join(str(part) for part in first['loc'])}: {reason(first)}")

    @app.exception_handler(HTTPException)
    async def known(request: Request, error: HTTPException) -> JSONResponse:
        return answer(error.status_code, str(error.detail))

    @app.exception_handler(Exception)
    async def other(request: Request, error: Exception) -> JSONResponse:
        return answer(500, f"the server failed at this ({type(error).__name__}); its terminal says more")

    async def explained(request: Request, error: Exception) -> JSONResponse:
        return answer(400, str(error))

    for kind in (ValueError, OSError, ArithmeticError, RigError, SimulationError, StudyError):
        app.add_exception_handler(kind, explained)
