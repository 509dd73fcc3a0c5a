"""Separate process that runs the fits of the Identify page, so that a fit can be cancelled at any time.

The panel's stream of messages never waits for it. The process starts when the Identify page is first opened,
so that its imports are finished before the first fit. A panel without fits does without these imports.
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
    """A request for a fit, and `out`, the subfolder of the panel's folder for the report."""

    request: FitRequest
    out: str


def work(connection: Connection, root: str, used: Sequence[str] = ()) -> None:
    """Run fits, one after the other, until the panel closes the connection. It is the main function of the
    process.

    It ignores Ctrl-C and lowers the priority of the process.

    Args:
        connection: gives a `FitTask` for each fit, and takes messages, tuples of kind, fields and float32
            arrays. They are those of `fit_recordings`; the last one of a fit is "done", or "failed" with the
            reason as "error".
        root: the panel's folder.
        used: the user's Python files with laws and waveforms, which are run first.
    """
    # Ctrl-C concerns the server alone: it closes the connection, which ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    come_last()
    # The import is slow, and the server, which imports this module, too, makes no fits.
    from .fitting import fit_recordings

    for file in used:  # the server has run these files, but not this process
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
