"""What is made ready before somebody needs it: after the first page the solver, then fits and Explore."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Any

from .fits import USUAL_LAW, Fitting
from .readiness import Readiness
from .stream import Client, Hub, Message

_WITHOUT_PAGE = 2.0  # s after which the solver is loaded though no page has come
_ABREAST = 4.0  # s after which the solver is being compiled, and fits are prepared beside it


def warm_up(hub: Hub, readiness: Readiness, fitting: Fitting) -> Callable[[], None]:
    """Begin, in threads; what is returned ends it."""
    page, solver, ended = threading.Event(), threading.Event(), threading.Event()

    def greet(client: Client, said: dict[str, Any]) -> Iterable[Message]:
        page.set()
        return []

    def simulation() -> None:
        from ..actuator import load_actuator
        from ..simulation import simulate, steady_step
        from ..waveform.periodic import Sawtooth

        page.wait(_WITHOUT_PAGE)
        model, drive = load_actuator("kang2007"), Sawtooth(65.0, 5.0)
        with readiness.preparing("the simulation"):
            simulate(model, drive, 0.01)
        solver.set()
        with readiness.preparing("step curves"):
            steady_step(model, drive)

    def fits() -> None:
        page.wait()
        solver.wait(_ABREAST)
        if not ended.is_set():
            fitting.prepare(USUAL_LAW)

    def end() -> None:
        ended.set()
        page.set()

    hub.greetings.append(greet)
    for work in (simulation, fits):
        threading.Thread(target=work, daemon=True).start()
    return end
