"""View of an actuator model from a data sheet: the sheet's numbers, and the parameters' intervals."""

from __future__ import annotations

from ...design import SheetModel
from ...identify.results import model_numbers
from ...parameters import bibtex
from ...quantities.records import quantities
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.plotting import plot
from ..figures.style import svg
from ..viewing import document_of


@document_of.register
def sheet_document(found: SheetModel) -> Document:
    """Return a document on an actuator model that was found from a data sheet.

    It has the numbers of the sheet with their sources, the model's numbers for comparison, the parameters
    with 95 % intervals, the names of parameters that the sheet does not determine, and the assumptions: first
    those about the sheet's own numbers.
    """
    of, known = found.dataset, quantities(type(found.sheet))
    numbers = found.sheet.numbers
    stated = Table(
        "Numbers of the data sheet.",
        (Column("number"), Column("value"), Column("source")),
        [(name, Number(value, known[name].unit), found.sources[name]) for name, value in numbers.items()],
        notes=f"Each may be off by {100.0 * found.sheet.tolerance:g} %.",
    )
    rows = []
    for name in of["quantity"].values.tolist():
        row = of.sel(quantity=name)
        unit = str(row["quantity_unit"].values)
        low, high = float(row["predicted_low"]), float(row["predicted_high"])
        rows.append(
            (
                name,
                Number(float(row["stated"]), unit),
                Number(float(row["of_model"]), unit),
                Number(float(row["predicted"]), unit, low, high),
            )
        )
    columns = (Column("number"), Column("data sheet"), Column("model"), Column("draws"))
    reproduced = Table("The data sheet beside the simulations.", columns, rows)
    parameters = [
        (name, _number(found, name), str(of["reason"].sel(parameter=name).values), _said(found, name))
        for name in of["parameter"].values.tolist()
    ]
    table = Table(
        "Parameters with 95 % intervals.",
        (Column("parameter"), Column("value"), Column("expected by"), Column("the sheet")),
        parameters,
    )
    figure = Picture(
        "data-sheet",
        "Left, the numbers of the data sheet as the draws have them; right, intervals before the sheet was "
        "used (grey) and after.",
        svg(plot(found)[0].figure),
        "Numbers of the data sheet and of the draws, and intervals of the parameters before and after",
    )
    left = ", ".join(found.open) or "nothing"
    return Document(
        title=f"Data sheet: {found.sheet.title}",
        summary=f"The model reproduces the data sheet, which leaves open: {left}. {found.posterior.message}.",
        sections=[
            Section("Data sheet", tables=(stated, reproduced), figures=(figure,)),
            Section("Parameters", tables=(table,)),
        ],
        highlights=[(name, _number(found, name)) for name in found.determined],
        numbers={
            "parameters": {name: _number(found, name) for name in of["parameter"].values.tolist()},
            "reproduced": {row[0]: row[3] for row in rows},
            "model": model_numbers(found.model),
        },
        assumptions=[
            *(f"{name}: {reason}" for name, reason in found.assumptions.items()),
            *(f"{name}: {reason}" for name, _, reason, said in parameters if said != "prints it"),
        ],
        citations=bibtex(*found.citations) if found.citations else "",
        failures=[] if found.posterior.converged else [found.posterior.message],
    )


def _number(found: SheetModel, name: str) -> Number:
    row = found.dataset.sel(parameter=name)
    unit = str(row["parameter_unit"].values)
    return Number(float(row["value"]), unit, float(row["low"]), float(row["high"]))


def _said(found: SheetModel, name: str) -> str:
    if name not in found.determined:
        return "leaves it open"
    printed = str(found.dataset["reason"].sel(parameter=name).values) == "printed"
    return "prints it" if printed else "determines it"
