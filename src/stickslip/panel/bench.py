"""The Bench page's routes: the experiment on the bench, start, stop and home, the live view, its files."""

from __future__ import annotations

import json
import math
import re
import time
from datetime import datetime
from typing import Any

import numpy as np
from fastapi import APIRouter, Request, Response
from numpy.typing import NDArray

from ..experiment.running import check_experiment
from ..input_file import Strict, yaml_text
from ..rig.measurement import DRIVE, POSITION
from ..units import QuantityError, with_prefix
from .control import Control
from .document import Document
from .folder import Folder
from .journal import Journal
from .live import Live
from .running import Arrived, Job, Runner
from .stream import Client, Hub

MOST_POINTS = 20_000
_HOMING = 10.0  # s that a way home may take


class Change(Strict):
    """A place in the experiment and its new value; null takes it away."""

    path: list[str | int]
    value: Any = None


class Runs(Strict):
    """Runs of the experiment, by name."""

    runs: list[str]


class Named(Strict):
    """A file of the folder."""

    name: str


class Window(Strict):
    """Part of the live run."""

    trace: int
    begin: float
    end: float
    points: int = 2000


def bench_routes(
    folder: Folder, hub: Hub, control: Control, journal: Journal, runner: Runner, live: Live
) -> APIRouter:
    """The routes of the Bench page."""
    routes = APIRouter(prefix="/bench")
    document = Document(folder)

    def described() -> str:
        return json.dumps({"kind": "experiment", **document.described()})

    def greet(client: Client, said: dict[str, Any]) -> list[str]:
        state = {"kind": "run", **runner.state, "position": runner.position}
        return [described(), json.dumps(state)]

    def emergency(client: Client, said: dict[str, Any]) -> None:
        if not runner.stop("emergency stop"):
            text = "Nothing was running: the output is at 0 V."
            client.put(json.dumps({"kind": "notice", "text": text, "level": ""}))

    hub.greetings.append(greet)
    hub.hears["emergency_stop"] = emergency

    @routes.post("/stop")
    def stop() -> dict[str, bool]:
        """Anybody may stop, in control or not."""
        return {"stopped": runner.stop("stop")}

    @routes.post("/start")
    def start(asked: Runs, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        content = document.of_runs(asked.runs)
        title = f"{document.checked.file.title}: {', '.join(asked.runs)}"
        stamp = datetime.now().strftime("%Y-%m-%d_%H%M%S")
        name = f"recordings/{stamp}_{_slug('-'.join(asked.runs))}"
        out = folder.path(name)
        file = check_experiment(content)
        columns = document.described()["channels"]

        def finished() -> None:
            hub.tell("recordings")

        job = Job(title, file, folder.root, out, columns, finished=finished)
        runner.start(job)
        out.mkdir(parents=True, exist_ok=True)
        (out / "experiment.yaml").write_text(yaml_text(content), encoding="utf-8")
        return {"folder": name}

    @routes.post("/home")
    def home(request: Request) -> dict[str, float]:
        control.need(request.headers.get("x-client", ""))
        runner.start(_homing(folder, document, runner.position))
        return {"position": runner.position}

    @routes.post("/home_here")
    def home_here(request: Request) -> dict[str, float]:
        control.need(request.headers.get("x-client", ""))
        if runner.busy:
            raise QuantityError("a run is going on: home can be set when it has ended")
        runner.home_here()
        return {"position": 0.0}

    @routes.post("/set")
    def change(asked: Change, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        document.change(asked.path, asked.value)
        hub.send(described())
        return {"name": document.name}

    @routes.get("/experiments")
    def experiments() -> list[str]:
        return [name for name in folder.files(".yaml") if not name.startswith("recordings/")][:200]

    @routes.post("/load")
    def load(asked: Named, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        if runner.busy:
            raise QuantityError("a run is going on: another experiment can be loaded when it has ended")
        document.load(asked.name)
        journal(f"loaded {asked.name}")
        hub.send(described())
        return {"name": document.name}

    @routes.post("/save")
    def save(asked: Named, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        document.save(asked.name)
        journal(f"saved {asked.name}")
        hub.send(described())
        return {"name": document.name}

    @routes.post("/window")
    def window(asked: Window) -> Response:
        if not math.isfinite(asked.end - asked.begin):
            raise QuantityError("a window has a finite begin and end")
        points = min(max(asked.points, 2), MOST_POINTS)
        shown = live.window(asked.trace, asked.begin, asked.end, points)
        return Response(shown, media_type="application/octet-stream")

    return routes


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9-]+", "-", text)[:60].strip("-") or "run"


def _homing(folder: Folder, document: Document, position: float) -> Job:
    """Walk towards home until the end-effector is there while the drive is at 0 V."""
    content, file, _, units = document.checked
    walk = {"forward_voltage", "reverse_voltage", "frequency"}
    if not walk <= file.variables.keys() or POSITION not in units:
        raise QuantityError(
            f"the way home needs the variables {', '.join(sorted(walk))} and the channel {POSITION}"
        )
    shape, voltage = (
        ("ReverseSawtooth", "$reverse_voltage") if position > 0 else ("Sawtooth", "$forward_voltage")
    )
    waveform = {"shape": shape, "fields": {"amplitude": voltage, "frequency": "$frequency"}}
    run = {"name": "home", "waveform": [waveform], "capture": {"length": _HOMING, "down_sampling": 1}}
    drive = next((name for name, one in file.channels.items() if one.input == DRIVE), None)
    begun = time.monotonic()

    def goal(now: float, block: dict[str, NDArray[np.float64]]) -> None:
        at = block[POSITION]
        if drive is not None:
            volts = block[drive]
            at = at[np.abs(volts) < 0.03 * max(float(np.abs(volts).max()), 1.0)]
        if at.size and (float(at[-1]) <= 0.0 if position > 0 else float(at[-1]) >= 0.0):
            raise Arrived(
                f"home, to {with_prefix(float(at[-1]), 'm', 2)}, after {time.monotonic() - begun:.1f} s"
            )

    shown = document.described()["channels"]
    made = check_experiment({**content, "runs": [run], "save_as": []})
    return Job("Home", made, folder.root, folder.path("recordings/home"), shown, goal=goal)
