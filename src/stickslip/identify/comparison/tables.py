"""Comparisons of friction laws as tables in Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ...quantities.units import with_prefix
from .laws import LawCharacter
from .limits import Limit

# Stiction and Stribeck effect up to _NO_SHARE of the sliding force are shown as "no", a drift up to
# _NO_LENGTH [m] as 0.
_NO_SHARE, _NO_LENGTH = 5e-3, 1e-12


def laws_as_markdown(rows: Iterable[LawCharacter]) -> str:
    """Return a Markdown table with one row per friction law and its results. The columns are the fields of
    `LawCharacter`, with stiffness, elastic range and presliding range in one column."""
    heads = (
        "law",
        "states",
        "presliding",
        "stiction",
        "Stribeck effect",
        "viscous",
        "drift per cycle",
        "force",
        "net step",
        "solver steps",
    )
    return _table(heads, [_cells(row) for row in rows])


def limits_as_markdown(rows: Iterable[Limit]) -> str:
    """Return a Markdown table with one row per limit: the law, the condition, the law that it becomes, and
    the largest difference [m] between the two simulated walks."""
    heads = ("law", "with", "becomes", "largest difference")
    return _table(heads, [(r.law, r.condition, r.becomes, with_prefix(r.difference, "m", 3)) for r in rows])


def _cells(row: LawCharacter) -> tuple[str, ...]:
    return (
        row.name,
        str(row.states),
        _presliding(row),
        _share(row.stiction),
        _share(row.stribeck_fall),
        f"{row.viscous:.3g} N s/m" if abs(row.viscous) > 1e-6 else "no",
        with_prefix(row.drift, "m", 3) if abs(row.drift) > _NO_LENGTH else "0",
        f"jumps by {with_prefix(row.force_jump, 'N', 3)}" if row.force_jump else "continuous",
        with_prefix(row.net_step, "m"),
        str(row.solver_steps),
    )


def _presliding(row: LawCharacter) -> str:
    if math.isinf(row.stiffness):
        return "none: rigid"
    until = with_prefix(row.presliding_range, "m", 3)
    stiffness = with_prefix(row.stiffness, "N/m", 3)
    if row.elastic_range == 0.0:
        return f"{stiffness}, plastic from the start, over {until}"
    elastic = with_prefix(row.elastic_range, "m", 3)
    if row.elastic_range > row.presliding_range:
        return f"{stiffness}, elastic to {elastic}, then slides"
    return f"{stiffness}, elastic to {elastic}, plastic to {until}"


def _share(share: float) -> str:
    return f"+{100.0 * share:.0f} %" if share > _NO_SHARE else "no"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
