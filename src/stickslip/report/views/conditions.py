"""View of fits under several conditions: change of each parameter with the condition."""

from __future__ import annotations

from ...identify.walk.conditions import Conditions
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.identification import Estimates, parameter_intervals
from ..figures.style import svg
from ..fits import estimates
from ..viewing import document_of


@document_of.register
def conditions_document(found: Conditions) -> Document:
    """Return a document that compares the parameters fitted under each condition, such as a temperature.

    It says whether one set of parameters explains all conditions, and which parameters change.
    """
    table, names = found.table, [p.name for p in found.together.shown]
    own = [estimates(fit) for fit in found.fits]
    rows = [
        (Number(at, found.unit), *(by[name] for name in names)) for at, by in zip(found.at, own, strict=True)
    ]
    value, low, high = (table[key] for key in ("value", "low", "high"))
    drawn = {
        p.name: Estimates(*(of.sel(parameter=p.name).values for of in (value, low, high)), unit=p.unit)
        for p in found.together.shown
    }
    said = f"{found.statement[0].upper()}{found.statement[1:]}."
    section = Section(
        f"By {found.by}",
        paragraphs=(said,),
        tables=(
            Table(
                f"Fitted for each {found.by} alone; 95 % intervals.",
                (Column(found.by), *map(Column, names)),
                rows,
            ),
        ),
        figures=(
            Picture(
                "conditions",
                f"How each parameter moves with {found.by}.",
                svg(parameter_intervals(found.at, drawn, setting_name=found.by, setting_unit=found.unit)),
                f"One panel for each parameter, values with confidence intervals over {found.by}",
            ),
        ),
    )
    numbers = {
        "chance": Number(found.chance, ""),
        "one_set_explains_all": found.one_set_explains_all,
        "moving": {name: Number(chance, "") for name, chance in found.moving.items()},
        "conditions": {
            f"condition_{i}": {found.by: Number(at, found.unit), **by}
            for i, (at, by) in enumerate(zip(found.at, own, strict=True), start=1)
        },
    }
    return Document(
        title=f"By {found.by}", summary=said, sections=(section,), numbers={"by_condition": numbers}
    )
