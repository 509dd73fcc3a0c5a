"""View of a planned experiment: recordings to make, and expected intervals of the parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...design import Plan
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.plotting import plot
from ..figures.style import svg
from ..viewing import document_of


@document_of.register
def plan_document(plan: Plan) -> Document:
    """Return a document with the planned recordings, and the expected 95 % interval of each parameter.

    The intervals are compared with those that the default recording gives in equal time.
    """
    section = Section(
        "Planned recordings",
        tables=(_recordings_table(plan), _parameters_table(plan)),
        figures=(
            Picture(
                "plan",
                "Left, how many times smaller the error of the goal is by each candidate than by the "
                "default in equal time; right, expected 95 % intervals.",
                svg(plot(plan)[0].figure),
                "Gain of each candidate over frequency, and half-widths of the intervals",
            ),
        ),
    )
    said = " ".join(line for line in plan.report().split("\n\n")[0].splitlines() if line)
    return Document("Planned experiment", said, (section,), numbers=_plan_numbers(plan))


def _recordings_table(plan: Plan) -> Table:
    rows = [(name, walk.duration, walk.sample_rate, walk.repeats) for name, walk in plan.recordings.items()]
    columns = (Column("recording"), Column("length", "s"), Column("sample rate", "Hz"), Column("times", ""))
    return Table("What to record.", columns, rows)


def _parameters_table(plan: Plan) -> Table:
    of, rows = plan.dataset, []
    for name in of["parameter"].values.tolist():
        row = of.sel(parameter=name)
        shares = [float(row[n]) for n in ("half_width", "worst_half_width", "default_half_width")]
        cells = [Number(x, "", note="" if np.isfinite(x) else "not told") for x in shares]
        rows.append((name, Number(float(row["value"]), str(row["unit"].values)), *cells))
    columns = ("parameter", "value", "planned", "in the worst draw", "default in equal time")
    return Table(
        "Expected half-widths of 95 % intervals, as shares of the value.",
        tuple(Column(one) for one in columns),
        rows,
        notes="Linearised; the model and the noise are taken to be as told.",
    )


def _plan_numbers(plan: Plan) -> dict[str, Any]:
    of = plan.dataset
    shares = ("half_width", "worst_half_width", "default_half_width")
    found: dict[str, Any] = {
        "parameters": {
            name: {
                "value": float(of["value"].sel(parameter=name)),
                "unit": str(of["unit"].sel(parameter=name).values),
                **{n: float(of[n].sel(parameter=name)) for n in shares},
            }
            for name in of["parameter"].values.tolist()
        },
        "recordings": {
            name: {"duration": Number(walk.duration, "s"), "repeats": Number(walk.repeats, "")}
            for name, walk in plan.recordings.items()
        },
        "undetermined": list(plan.undetermined),
        "goal": plan.goal,
        "duration": Number(plan.duration, "s"),
    }
    return found
