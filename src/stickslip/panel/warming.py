"""Preparation in the background: reading of files, then, after the first page, solver, fits and Explore."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..actuator import load_actuator
from ..readers.process import Reader
from ..recording import RecordingError
from ..rig import RigError
from ..simulation import simulate, steady_step
from ..waveform.periodic import Sawtooth
from .fits import USUAL_LAW, Fitting
from .readiness import Readiness
from .reading import ready
from .running import Runner
from .stream import Client, Hub, Message

_WITHOUT_PAGE = 2.0  # s after which the solver is loaded though no page has come
_MOST_WAIT = 60.0  # s that one preparation waits for another, at most


def warm_up(
    hub: Hub, readiness: Readiness, fitting: Fitting, runner: Runner, read: Reader
) -> Callable[[], None]:
    """Begin, in threads; what is returned ends it."""
    page, solver, ended = threading.Event(), threading.Event(), threading.Event()

    def greet(client: Client, said: dict[str, Any]) -> Iterable[Message]:
        page.set()
        return []

    def simulation() -> None:
        page.wait(_WITHOUT_PAGE)
        with readiness.preparing("the simulation"):
            simulate(load_actuator("kang2007"), Sawtooth(65.0, 5.0), 0.01)
        solver.set()
        with readiness.preparing("step curves"):
            fitting.wait(_MOST_WAIT)  # their process may be compiling what step curves need
            if not ended.is_set():
                steady_step(load_actuator("kang2007"), Sawtooth(65.0, 5.0))

    def files() -> None:
        with suppress(RecordingError):
            read.apply(ready, Path(__file__))

    def rig() -> None:
        page.wait()
        if not ended.is_set():
            with suppress(RigError):
                runner.find_position()

    def fits() -> None:
        page.wait()
        solver.wait(_MOST_WAIT)
        if not ended.is_set():
            fitting.prepare(USUAL_LAW)

    def end() -> None:
        ended.set()
        page.set()

    hub.greetings.append(greet)
    for work in (files, simulation, fits, rig):
        threading.Thread(target=work, daemon=True).start()
    return end
