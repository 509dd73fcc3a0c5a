"""Preparation in the background: on the first start the solver, before the page is opened; else after the
first page the solver, then fits and Explore."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from ..actuator import load_actuator
from ..friction import LuGre
from ..rig import RigError
from ..simulation import simulate, steady_step
from ..solve.periods import integrate
from ..waveform.periodic import Sawtooth
from .fits import USUAL_LAW, Fitting
from .readiness import Readiness
from .running import Runner
from .stream import Client, Hub, Message

_WITHOUT_PAGE = 2.0  # s after which the solver is loaded though no page has come
_ABREAST = 4.0  # s after which the solver is being compiled, and fits are prepared beside it
_MOST_WAIT = 60.0  # s that step curves wait for fits, which need the same kernel


def solver_kept() -> bool:
    """Whether this machine keeps what the first run of a newcomer needs: Numba's index of that kernel, which
    is void after an installation or for another Numba, names the law."""
    kernel: Any = integrate._dispatcher((LuGre,))
    try:
        index = kernel._cache._cache_file._load_index()
    except AttributeError:  # nothing is compiled at all, or another Numba keeps it in a way of its own
        return True
    return any(USUAL_LAW in str(signature) for signature, *_ in index)


def compile_solver(fitting: Fitting) -> None:
    """Compile it here, and in the process of the fits what those need besides."""
    fitting.prepare(USUAL_LAW)
    _simulate()


def _simulate() -> None:
    simulate(load_actuator("kang2007"), Sawtooth(65.0, 5.0), 0.01)


def warm_up(hub: Hub, readiness: Readiness, fitting: Fitting, runner: Runner) -> Callable[[], None]:
    """Begin, in threads; what is returned ends it."""
    page, solver, ended = threading.Event(), threading.Event(), threading.Event()

    def greet(client: Client, said: dict[str, Any]) -> Iterable[Message]:
        page.set()
        return []

    def simulation() -> None:
        page.wait(_WITHOUT_PAGE)
        with readiness.preparing("the simulation"):
            _simulate()
        solver.set()
        with readiness.preparing("step curves"):
            fitting.wait(_MOST_WAIT)  # on a first start their process is compiling what step curves need
            if not ended.is_set():
                steady_step(load_actuator("kang2007"), Sawtooth(65.0, 5.0))

    def rig() -> None:
        page.wait()
        if not ended.is_set():
            with suppress(RigError):
                runner.find_position()

    def fits() -> None:
        page.wait()
        solver.wait(_ABREAST)
        if not ended.is_set():
            fitting.prepare(USUAL_LAW)

    def end() -> None:
        ended.set()
        page.set()

    hub.greetings.append(greet)
    for work in (simulation, fits, rig):
        threading.Thread(target=work, daemon=True).start()
    return end
