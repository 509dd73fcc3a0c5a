"""Command that measures the step size of a stick-slip motor over voltage and direction."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from .frame import Arm, Out, Traceback, app, arming, check_output, errors_in_one_line, progress_bar, write

_KEPT = "finished bursts are kept in bursts-TIME.csv in the folder of --out; fit them with measured: FILE"


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
    """Measure the steps of a motor over voltage and direction. Writes steps.json (to count positions without
    a sensor), if possible steps.csv (for a controller that makes equal steps), and bursts.csv (the
    measurements)."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, _KEPT):
        check_output(out)
        from ..jobs.analysis.stepping import calibrate_steps, read_steps

        read = read_steps(file)
        with progress_bar() as progress, arming(arm):
            document = calibrate_steps(*read, out, progress)
        write(document, out, begun)
