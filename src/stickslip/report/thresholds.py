"""Thresholds of a decision in a report: their values and meanings."""

from __future__ import annotations

from typing import Any

from ..quantities.records import quantities
from ..quantities.units import coordinate_of
from .document import Column, Number, Section, Table


def thresholds_table(policy: Any, caption: str, unit: str = "m") -> Table:
    """Return a table with a row for each threshold of a record such as `Judgement` or `Plausibility`.

    Args:
        policy: record of the thresholds.
        caption: caption of the table.
        unit: unit of positions, m or rad, from which the units of the thresholds follow.
    """
    rows = []
    for name, quantity in quantities(type(policy)).items():
        own = quantity.along(coordinate_of(unit))
        rows.append((name, Number(getattr(policy, name), own.unit), own.meaning))
    return Table(caption, (Column("threshold"), Column("value"), Column("meaning")), rows)


def threshold_numbers(policy: Any) -> dict[str, Number]:
    """Return the thresholds of a record such as `Judgement` by name, with their units, for results.json."""
    return {name: Number(getattr(policy, name), q.unit) for name, q in quantities(type(policy)).items()}


def judgement_section(judgement: Any) -> Section:
    """Return a section with a table of the thresholds (`Judgement`) by which a fit was judged."""
    said = "Thresholds of the statements on the fit. fit.judged(...) judges it by others."
    return Section("How the fit was judged", tables=(thresholds_table(judgement, said),))
