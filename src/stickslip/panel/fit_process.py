"""The process in which fits run: it can be ended at any time, and the page's stream never waits for it.

It is there before the first fit, and compiles what that needs while the page is looked at.
"""

from __future__ import annotations

import os
import signal
import traceback
import warnings
from collections.abc import Sequence
from contextlib import redirect_stderr, suppress
from io import StringIO
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..registry import use_file
from ..simulation import SimulationError
from ..units import QuantityError
from .fitting import Array, FitRequest, fit_recordings
from .folder import Folder
from .sliders import law_types, laws_like

_NICE = 10  # below the server, whose stream and runs come first


class Prepare(NamedTuple):
    """A request to compile what fits of a law need, or to load it."""

    law: str


class Begin(NamedTuple):
    """A request for a fit; its report goes into the folder `out`."""

    request: FitRequest
    out: str


def work(connection: Connection, root: str, used: Sequence[str] = ()) -> None:
    """What the process does until the panel is gone: requests come and messages go through the connection.

    Of a fit come those of `fit_recordings`, at last "done" or "failed"; of a preparation "prepared".
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which closes the connection
    if hasattr(os, "nice"):
        os.nice(_NICE)
    for file in used:  # the user's own, which the server has run already
        use_file(file)
    while True:
        try:
            asked = connection.recv()
            if isinstance(asked, Prepare):
                _prepare(connection, asked.law)
            else:
                _fit(connection, asked, root)
        except (EOFError, OSError):
            return


def _prepare(connection: Connection, law: str) -> None:
    try:
        with redirect_stderr(StringIO()):  # that it compiles is said by the page
            prepare(law)
    except Exception:  # a fit of that law will say what is wrong
        traceback.print_exc()
    connection.send(("prepared", {"law": law}, []))


def _fit(connection: Connection, asked: Begin, root: str) -> None:
    def say(kind: str, fields: dict[str, Any], arrays: Sequence[Array] = ()) -> None:
        connection.send((kind, fields, [np.asarray(one, dtype="<f4") for one in arrays]))

    try:
        fit_recordings(asked.request, Folder(Path(root)), asked.out, say)
        say("done", {})
    except (ValueError, OSError, SimulationError) as error:
        if isinstance(error, BrokenPipeError):
            raise
        say("failed", {"error": str(error)})
    except Exception as error:
        traceback.print_exc()
        say("failed", {"error": f"unexpected {type(error).__name__}: {error}"})


def prepare(law: str) -> None:
    """Go through a fit once, of a short walk of the thesis's actuator with such a law: the same kernels and
    modules as any other."""
    from ..actuator import load_actuator
    from ..analysis.walk import UsedWalk, walk_document
    from ..identify.walk.friction import identify_friction
    from ..simulation import sensitivities, simulate
    from ..simulation.varied import NORMAL_FIELDS, with_normal_force
    from ..verification import verify
    from ..waveform.periodic import Sawtooth

    model = load_actuator("kang2007")
    model = model.replace(friction=laws_like(model.friction, law_types())[law])
    drive = Sawtooth(65.0, 100.0)
    with suppress(QuantityError):  # a law of several states has no derivatives
        for one in (model, with_normal_force(model, NORMAL_FIELDS)):  # the second asks what a model lacks
            sensitivities(one, drive, 0.01, parameters=["end_effector_mass"])
    walk = simulate(model, drive, 0.04, sample_rate=1e4)
    noise = np.random.default_rng(0).normal(0.0, 1e-8, walk.sizes["time"])
    moved = walk["end_effector_position"]
    walk = walk.assign(end_effector_position=("time", moved.values + noise, moved.attrs), title="")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nobody looks at this fit
        fit = identify_friction(walk, model, ["end_effector_mass", "offset"], hops=0, max_evaluations=3)
        verify(fit, [walk])
        walk_document("", fit, model, {"walk": UsedWalk("fit", walk)})
