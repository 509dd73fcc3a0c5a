"""Routes of the Design page: step maps, searches for a drive, Pareto fronts, motions, expected confidence
intervals.

The route "/send" puts a designed drive on the bench, as a run of the experiment.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable
from datetime import datetime
from typing import Any, TypeVar

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from ..quantities.progress import Progress
from ..quantities.units import QuantityError, to_si, with_prefix
from ..simulation import SimulationError
from . import designing as of
from .control import Control
from .document import BenchDocument
from .explore import binary, refused
from .journal import Journal
from .sets import Sets
from .stream import Hub

DESIGNED = "designed"  # name of the run of the experiment on the bench that has the designed drive
# A designed drive on the bench. LENGTH: shortest duration of the drive, s. REST: time by which the recording
# is longer than the drive, s; half of it is before the drive. FEWEST: smallest number of periods, even if
# they take longer than LENGTH. The drive is short because a fast one soon leaves the range of a sensor.
LENGTH, REST, FEWEST = 0.1, 0.1, 8
_TOLD = 0.1  # shortest time between two messages on the progress of a search, s

Made = TypeVar("Made")


class Searches:
    """Runs at most one search for a drive at a time.

    All pages receive its finished fraction as messages "design", and can stop the search. A stopped search
    returns the best drive so far; if there is no drive yet, an error is raised.
    """

    def __init__(self, hub: Hub) -> None:
        self._hub, self._busy, self._stop = hub, threading.Lock(), threading.Event()

    def run(self, search: Callable[[Progress], Made]) -> Made:
        """Run a search for a drive in this thread, and return its result.

        `stop` ends the search: the next call of its progress callback raises KeyboardInterrupt, at which the
        search should return its best drive so far.

        Args:
            search: takes a progress callback, which it calls with the activity in words and the finished
                fraction (0 to 1); returns the result.

        Raises:
            QuantityError: another search runs, or the search was stopped before it had a result.
        """
        if not self._busy.acquire(blocking=False):
            raise QuantityError("a search is going on: stop it, or let it end")
        told = -math.inf

        def progress(doing: str, share: float) -> None:
            nonlocal told
            if self._stop.is_set():
                self._stop.clear()
                raise KeyboardInterrupt
            if time.monotonic() - told > _TOLD:
                told = time.monotonic()
                self._hub.tell("design", share=share)

        try:
            self._stop.clear()
            return search(progress)
        except KeyboardInterrupt:
            raise QuantityError("stopped before a drive was found") from None
        finally:
            self._busy.release()

    def stop(self) -> None:
        self._stop.set()


def design_routes(
    sets: Sets, searches: Searches, control: Control, journal: Journal, hub: Hub, document: BenchDocument
) -> APIRouter:
    """Return the router with the routes of the Design page, below "/api/design".

    An answer has the status 422 if a value is out of range, a motion cannot be simulated, or another search
    runs. Its `error` is the reason, and `field` the field of the request.

    Args:
        sets: parameter sets on offer.
        searches: runs the searches for a drive.
        control, journal, hub, document: control of the rig, log, stream and experiment. The route "/send"
            needs control, and replaces the run `DESIGNED` of the experiment.
    """
    routes = APIRouter(prefix="/api/design")

    def answered(does: Callable[[], Any]) -> Any:
        try:
            return does()
        except (QuantityError, SimulationError, ArithmeticError) as error:
            return refused(error)

    @routes.get("/fields")
    def fields() -> dict[str, Any]:
        return {"m": of.fields(rotary=False), "rad": of.fields(rotary=True)}

    @routes.post("/map")
    def step_map(asked: of.MapRequest) -> Response:
        return answered(lambda: binary({}, of.step_map(asked, sets)))

    @routes.post("/check")
    def check(asked: of.TypedValue) -> Response:
        def checked() -> Response:
            asked.check(sets)
            return JSONResponse({})

        return answered(checked)

    @routes.post("/search")
    def search(asked: of.DriveSearch) -> Response:
        return answered(lambda: JSONResponse(searches.run(lambda told: of.searched(asked, sets, told))))

    @routes.post("/front")
    def front(asked: of.FrontRequest) -> Response:
        return answered(lambda: JSONResponse(searches.run(lambda told: of.front(asked, sets, told))))

    @routes.post("/stop")
    def stop() -> dict[str, Any]:
        searches.stop()
        return {}

    @routes.post("/motion")
    def motion(asked: of.DrivenActuator) -> Response:
        def moved() -> Response:
            speed, curves = of.motion(asked, sets)
            return binary({"speed": speed}, curves)

        return answered(moved)

    @routes.post("/tells")
    def tells(asked: of.InformationRequest) -> Response:
        return answered(lambda: JSONResponse(of.told(asked, sets)))

    @routes.post("/send")
    def send(drive: of.DesignedDrive, request: Request) -> Response:
        def sent() -> Response:
            control.need(request.headers.get("x-client", ""))
            runs = document.checked.content["runs"]
            kept = [one for one in runs if one["name"] != DESIGNED]
            document.change(["runs"], [*kept, bench_run(drive, kept)])
            hub.send(json.dumps({"kind": "experiment", **document.described()}))
            journal(f"a designed drive is on the bench, as the run {DESIGNED}")
            return JSONResponse({"run": DESIGNED})

        return answered(sent)

    return routes


def bench_run(drive: of.DesignedDrive, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a run with this drive, as an entry of "runs" in an experiment file.

    The drive lasts for `LENGTH` or slightly longer, but at least `FEWEST` periods. The recording is longer by
    `REST`, half of it before the drive. It is sampled at the shortest interval of the other `runs`, or at the
    rig's full rate if they give none.
    """
    waveform = of.from_lowest(drive.waveform())
    periods = max(FEWEST, math.ceil(LENGTH / waveform.period))
    fields = of.described(waveform)["fields"] | {"periods": periods}
    captures = [run.get("capture", {}) for run in runs]
    kept = {"down_sampling": 1}
    if sampled := [one["interval"] for one in captures if "interval" in one]:
        kept = {"interval": min(sampled, key=lambda text: to_si(text, "s", "interval"))}
    length = periods * waveform.period + REST
    return {
        "name": DESIGNED,
        "notes": f"Designed on {datetime.now():%Y-%m-%d %H:%M}: {with_prefix(1 / waveform.period, 'Hz', 4)}.",
        "waveform": [{"shape": type(waveform).__name__, "fields": fields}],
        "capture": {"length": f"{length:.6g} s", **kept, "pre_trigger": "50 ms"},
    }
