"""Separate process that runs the fits of the Identify page, so that a fit can be cancelled at any time.

The page's stream of messages never waits for it. The process starts when the Identify page is first opened: a
fit then need not wait for the imports, and a panel without fits does not load them.
"""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gate.priority import come_last
from ..quantities.registry import use_file
from ..simulation import SimulationError
from .fit_request import FitRequest
from .folder import Folder


class FitTask(NamedTuple):
    """A request for a fit; `out` is the subfolder of the panel's folder for its report."""

    request: FitRequest
    out: str


def work(connection: Connection, root: str, used: Sequence[str] = ()) -> None:
    """Run fits in the process for fits until the panel closes the connection.

    Args:
        connection: gives a `FitTask` for each fit, and takes messages (kind, fields, float32 arrays): those
            of `fit_recordings`, and "done" or "failed" as the last one of a fit.
        root: the panel's folder.
        used: the user's own Python files to run first, with laws and waveforms.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which closes the connection
    come_last()
    from .fitting import fit_recordings  # not above: the server imports this module, but fits nothing

    for file in used:  # the server has run these files already; this process needs their laws too
        use_file(file)
    while True:
        try:
            _fit(connection, connection.recv(), root, fit_recordings)
        except (EOFError, OSError):
            return


def _fit(connection: Connection, asked: FitTask, root: str, fit_recordings: Callable[..., None]) -> None:
    def say(kind: str, fields: dict[str, Any], arrays: Sequence[NDArray[np.float64]] = ()) -> None:
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
