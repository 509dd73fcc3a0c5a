"""The Bench page's routes: the experiment on the bench, start, stop and home, the live view, its files."""

from __future__ import annotations

import itertools
import json
import math
import re
import shutil
import time
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import APIRouter, Request, Response
from numpy.typing import NDArray

from ..experiment.running import check_experiment
from ..history import note_act
from ..input_file import Strict, yaml_text
from ..rig import RigError
from ..rig.measurement import DRIVE, POSITION
from ..units import QuantityError, to_si, with_prefix
from .control import Control
from .document import Document
from .folder import Folder
from .journal import Journal
from .live import Live
from .path import predicted_of
from .running import Arrived, Job, Runner
from .stream import Client, Hub

MOST_POINTS = 20_000
_HOMING = 10.0  # s that a way home may take


class Change(Strict):
    """A place in the experiment and its new value; null takes it away."""

    path: list[str | int]
    value: Any = None


class Undo(Strict):
    """Take the last change of the experiment back, or make it `again`."""

    again: bool = False


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
    folder: Folder,
    hub: Hub,
    control: Control,
    journal: Journal,
    runner: Runner,
    live: Live,
    document: Document,
) -> APIRouter:
    """The routes of the Bench page."""
    routes = APIRouter(prefix="/bench")

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
    async def stop() -> dict[str, bool]:
        """Anybody may stop, in control or not; it waits for no other request."""
        return {"stopped": runner.stop("stop")}

    @routes.post("/start")
    def start(asked: Runs, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        content = document.of_runs(asked.runs)
        title = f"{document.checked.file.title}: {', '.join(asked.runs)}"
        file = check_experiment(content)
        if runner.busy:
            raise RigError("a run is going on: stop it first")
        out = _new_folder(folder, _slug("-".join(asked.runs)))
        columns = document.described()["channels"]

        def finished() -> None:
            for run in content["runs"]:
                prediction = predicted_of(run)
                for path in out.rglob(f"{run['name']}*.nc") if prediction else ():
                    note_act(folder.root, "recorded", folder.name(path), of=prediction)
            hub.tell("recordings")

        job = Job(title, file, folder.root, out, columns, finished=finished)
        try:
            (out / "experiment.yaml").write_text(yaml_text(content), encoding="utf-8")
            runner.start(job)
        except RigError:  # another start was first
            (out / "experiment.yaml").unlink()
            out.rmdir()
            raise
        return {"folder": folder.name(out)}

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
        checked = document.checked
        runner.home_here(checked.file, folder.root, checked.cells[0])
        return {"position": 0.0}

    @routes.post("/set")
    def change(asked: Change, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        document.change(asked.path, asked.value)
        hub.send(described())
        return {"name": document.name}

    @routes.post("/undo")
    def undo(asked: Undo, request: Request) -> dict[str, bool]:
        control.need(request.headers.get("x-client", ""))
        done = document.undo(asked.again)
        hub.send(described())
        return {"done": done}

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


def _new_folder(folder: Folder, slug: str) -> Path:
    """A folder that was not there before, however many runs begin within the same second."""
    stamp = datetime.now().strftime("%Y-%m-%d_%H%M%S")
    for number in itertools.count(1):
        made = folder.path(f"recordings/{stamp}_{slug}" + (f"_{number}" if number > 1 else ""))
        made.parent.mkdir(parents=True, exist_ok=True)
        try:
            made.mkdir()
        except FileExistsError:
            continue
        return made
    raise AssertionError


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
    # Beyond an end stop there is a way back: one stroke farther out is allowed for it.
    cell = document.checked.cells[0]
    stroke = abs(position) + abs(cell.actuator.gain) * max(cell.limits.max_voltage, -cell.limits.min_voltage)
    limits = dict(content.get("limits", {}))
    for name, sign in (("max_position", 1.0), ("min_position", -1.0)):
        if limits.get(name) is not None and sign * position > 0.0:
            limits[name] = sign * max(sign * to_si(limits[name], "m", name), stroke)
    made = check_experiment({**content, "runs": [run], "save_as": [], "limits": limits})
    out = folder.root / ".rig" / "home"  # nobody wants a recording of it
    remove = partial(shutil.rmtree, out, ignore_errors=True)
    return Job("Home", made, folder.root, out, shown, goal=goal, finished=remove)
