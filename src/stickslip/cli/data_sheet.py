"""Command that makes an actuator from a data sheet."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from . import completion
from .frame import Out, Traceback, app, check_output, errors_in_one_line, progress_bar, write


@app.command("data-sheet")
def data_sheet(
    sheet: Annotated[
        str,
        typer.Argument(
            metavar="[SHEET|FILE.toml]",
            help="A data sheet of the package (stickslip list 'data sheets') or a file; else use --set.",
            autocompletion=completion.data_sheets,
        ),
    ] = "",
    changes: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="NUMBER=VALUE",
            help="A number of the sheet: step='50 nm', speed='2 mm/s', stall_force=1N, ...",
        ),
    ] = [],  # noqa: B006  # typer copies it
    draws: Annotated[int, typer.Option(help="Number of draws of the posterior.")] = 960,
    seed: Annotated[int, typer.Option(help="Seed of the draws.")] = 0,
    out: Out = Path("out/data-sheet"),
    show_traceback: Traceback = False,
) -> None:
    """Make an actuator that reproduces a data sheet, and draws of what the sheet leaves open: model.toml and
    posterior.nc, which design files and other commands take."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..design import DataSheet, from_data_sheet
        from ..quantities.places import assignment
        from ..quantities.records import did_you_mean
        from ..quantities.units import QuantityError
        from ..report import view

        numbers = dict(assignment("--set", one, "NUMBER=VALUE, such as step='50 nm'") for one in changes)
        for name in numbers:
            if name not in DataSheet._fields:
                option = f" (an option of the command: --{name})" if name in ("draws", "seed") else ""
                hint = option or did_you_mean(name, DataSheet._fields)
                raise QuantityError(
                    f"--set {name}: a data sheet has no number {name!r}{hint}; it has "
                    f"{', '.join(DataSheet._fields)}"
                )
        with progress_bar() as progress:
            found = from_data_sheet(sheet or None, draws=draws, seed=seed, progress=progress, **numbers)
            document = view(found)
        found.save(out)
        write(document, out, begun)
