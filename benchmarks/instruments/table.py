"""The table of campaigns: what was said, which intervals hold, and how far the others are off."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

FAR = 3.0  # half-widths outside an interval beyond which a truth without a remark is a wrong answer
# Remarks that leave the intervals to be believed: of what they allow for, of what was freed, of the drive.
HARMLESS = re.compile(
    r"the intervals allow for it|it is part of the fit|hard to tell apart|free besides|was set free"
    r"|searches|stands for the drive|moves \w+ by 0\.\d+ standard errors"
)
# Remarks on one parameter alone.
OF_ONE = re.compile(r"(?P<names>\w+(?:(?:, | and )\w+)*) (?:is|are) not determined")


def off(truth: float, low: float, high: float) -> float:
    """Return by how many half-widths a truth is outside an interval; 0 inside."""
    if low <= truth <= high:
        return 0.0
    half = 0.5 * (high - low)
    return float("inf") if half <= 0 else max(low - truth, truth - high) / half


def doubted(one: dict[str, Any], name: str) -> bool:
    """Return whether the campaign says anything against its intervals, or against this parameter's."""
    if "error" in one or one["failures"]:
        return True
    return any(_against(text, name) for text in one["said"])


def _against(text: str, name: str) -> bool:
    of_one = OF_ONE.match(text)
    if of_one is not None:
        return name in re.split(", | and ", of_one["names"])
    return not HARMLESS.search(text)


def table(found: list[dict[str, Any]]) -> str:
    """Return a Markdown table by kind of fault."""
    rows = [
        "| fault | campaigns | refused | with a failure | silent intervals | contain the truth "
        "| worst, half-widths |",
        "|---|---|---|---|---|---|---|",
    ]
    kinds = list(dict.fromkeys(one["kind"] for one in found))
    for kind in [*kinds, "all"]:
        some = [one for one in found if kind in (one["kind"], "all")]
        refused = sum("error" in one for one in some)
        failed = sum(bool(one.get("failures")) for one in some)
        offs = [
            off(one["truth"][name], *one["found"][name][1:])
            for one in some
            if "error" not in one
            for name in one["found"]
            if not doubted(one, name)
        ]
        hold = f"{np.mean(np.array(offs) == 0.0):.1%}" if offs else ""
        worst = f"{max(offs):.1f}" if offs else ""
        rows.append(f"| {kind} | {len(some)} | {refused} | {failed} | {len(offs)} | {hold} | {worst} |")
    return "\n".join(rows)
