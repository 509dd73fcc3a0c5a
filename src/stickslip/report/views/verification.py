"""View of a verification: measured and predicted, one row for each recording."""

from __future__ import annotations

import math
from typing import Any

from ...identify.verification import Verification
from ...quantities.units import near_one, with_prefix
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.fits import called
from ..fits import prediction_picture
from ..viewing import document_of

MOST_PICTURES = 8  # largest number of recordings that have a figure; further ones have none


@document_of.register
def verification_document(found: Verification) -> Document:
    """Return a document with the predictions of a verification and their errors, a row per recording."""
    count, least = len(found.recordings), float(min(found.table["r_squared"].values))
    sentences = (*found.statements, *found.remarks, *found.taken)
    return Document(
        title="Verification",
        summary=f"{count} recording{'s' * (count > 1)} predicted, nothing fitted: r² {near_one(least)} "
        f"or more, rms error {with_prefix(found.rmse, found.unit, 3)}."
        + "".join(f" {text[0].upper()}{text[1:]}." for text in sentences),
        sections=(
            Section(
                "Recordings",
                points=found.taken,
                tables=(verification_table(found),),
                figures=prediction_pictures(found),
            ),
        ),
        highlights=(("least r²", Number(least, "")), ("rms error", Number(found.rmse, found.unit))),
        numbers={"verification": verification_numbers(found), "drives": list(found.taken)},
        failures=found.statements,
    )


def verification_table(found: Verification) -> Table:
    """Return a table with one row for each recording of a verification.

    A row has the number of judged samples, r², the rms error, the measured net step per period, and the error
    of the predicted net step [%]; the last two are empty if the net step is not known.
    """
    table = found.table
    rows = []
    for i, name in enumerate(table["recording"].values):
        r_squared, rmse, step, error = (
            float(table[key][i]) for key in ("r_squared", "rmse", "net_step", "net_step_error")
        )
        net = (step, 100.0 * error) if math.isfinite(step) else (None, None)
        rows.append((str(name), int(table["n_data"][i]), r_squared, rmse, *net))
    columns = (
        Column("recording"),
        Column("samples", ""),
        Column("r²", "", 5),
        Column("rms error", found.unit, 3),
        Column("net step, measured", found.unit),
        Column("error of the net step", "%", 2),
    )
    notes = "r² = (SST − SSE)/SST; the net step is the displacement per period of the drive."
    return Table("Measured and predicted.", columns, rows, notes=notes)


def verification_numbers(found: Verification) -> dict[str, Any]:
    """Return the figures of merit of a verification by recording and name, for results.json.

    The names are those of the variables of `Verification.table`, such as "r_squared" and "rmse".
    """
    table = found.table
    return {
        str(name): {
            key: Number(float(table[key][i]), str(table[key].attrs["units"])) for key in table.data_vars
        }
        for i, name in enumerate(table["recording"].values)
    }


def prediction_pictures(found: Verification) -> list[Picture]:
    """Return pictures of measured and predicted curves with residuals, for the first `MOST_PICTURES`
    recordings.
    """
    channel = called(found.observed)
    return [
        prediction_picture(
            f"prediction_{i}", f"{good.name}: {channel}, measured and predicted.", one, channel, found.unit
        )
        for i, (good, one) in enumerate(
            zip(found.recordings[:MOST_PICTURES], found.predictions, strict=False), start=1
        )
    ]
