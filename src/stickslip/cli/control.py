"""Commands of closed loops: move and hold."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from .frame import (
    FINISHED,
    Changes,
    Out,
    Traceback,
    app,
    check_output,
    errors_in_one_line,
    progress_bar,
    write,
)

_File = Annotated[
    Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="Rig, actuator and target.")
]


@app.command()
def move(
    file: _File,
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/move"),
    show_traceback: Traceback = False,
) -> None:
    """Move to a position by steps, then by the piezo alone, and hold; the recording goes to move.nc."""
    _closed_loop(file, changes, out, show_traceback, only_hold=False)


@app.command()
def hold(
    file: _File,
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/hold"),
    show_traceback: Traceback = False,
) -> None:
    """Hold a position within the stroke of the piezo; the recording goes to hold.nc."""
    _closed_loop(file, changes, out, show_traceback, only_hold=True)


def _closed_loop(file: Path, changes: list[str], out: Path, show_traceback: bool, only_hold: bool) -> None:
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, FINISHED):
        check_output(out)
        from ..jobs.analysis.moving import read_move, run_move

        with progress_bar() as progress:
            document = run_move(*read_move(file, changes), out, progress, only_hold=only_hold)
        write(document, out, begun)
