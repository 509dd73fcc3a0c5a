"""Commands of the laboratory: calibrate."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from .frame import Out, Traceback, app, check_output, errors_in_one_line, write


@app.command()
def calibrate(
    file: Annotated[str, typer.Argument(metavar="TABLE|FILE.csv", help="Truth, then readings, with units.")],
    order: Annotated[
        str,
        typer.Option(help='Order of the polynomial, or "auto": what predicts points left out best.'),
    ] = "auto",
    after: Annotated[
        list[str],
        typer.Option(help="A calibration that the readings go through first: the new one corrects it."),
    ] = [],  # noqa: B006  # typer copies it
    name: Annotated[str, typer.Option(help="What to call it; that of the table and the order.")] = "",
    out: Out = Path("out/calibrate"),
    show_traceback: Traceback = False,
) -> None:
    """Calibrate a sensor from a table; the calibration goes to calibration.json."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..calibration import cross_validation, fit_calibration, read_table, save_calibration
        from ..calibration.applying import calibration_chain
        from ..report.calibration import calibration_document

        table = read_table(file)
        for calibration in calibration_chain(after, table.x_unit) if after else ():
            table = table._replace(x=calibration(table.x), x_unit=calibration.y_unit)
        if order != "auto" and not order.isdecimal():
            raise ValueError(f"--order {order}: a whole number, or auto")
        orders = range(1, 8)
        left_out = cross_validation(table.x, table.y, orders) if table.y.size > 3 else {}
        if order == "auto" and not left_out:
            raise ValueError(f"--order auto: {table.name} has too few points, name an order")
        power = min(left_out, key=left_out.__getitem__) if order == "auto" else int(order)
        made = fit_calibration(
            table.x,
            table.y,
            power,
            name=name or f"{table.name}-{power}",
            x_unit=table.x_unit,
            y_unit=table.y_unit,
            source=table.source,
        )
        document = calibration_document(made, table, left_out)
        out.mkdir(parents=True, exist_ok=True)
        save_calibration(made, out / "calibration.json")
        write(document, out, begun)
