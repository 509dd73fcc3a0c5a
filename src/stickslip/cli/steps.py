"""Command that calibrates the steps of a motor."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from .frame import Arm, Out, Traceback, app, arming, check_output, errors_in_one_line, progress_bar, write


@app.command()
def steps(
    file: Annotated[
        Path,
        typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="Positioner, bursts, sensor."),
    ],
    out: Out = Path("out/steps"),
    arm: Arm = "",
    show_traceback: Traceback = False,
) -> None:
    """Calibrate the steps of a motor: steps.json for a position without a sensor, steps.csv (equal steps)
    for a controller, bursts.csv with what was measured."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..control import write_bursts
        from ..jobs.analysis.stepping import read_steps, run_steps
        from ..quantities.units import QuantityError
        from ..report import view

        read = read_steps(file)
        with progress_bar() as progress, arming(arm):
            bursts, law = run_steps(*read, progress)
            document = view(law, read[0].title)
        out.mkdir(parents=True, exist_ok=True)
        write_bursts(bursts, out / "bursts.csv")
        law.save(out / "steps.json")
        try:
            law.save(out / "steps.csv")
        except QuantityError as error:
            typer.echo(f"steps.csv is not written: {error}", err=True)
        write(document, out, begun)
