"""Samples that are numbered, their start and their increment in s standing in the header, as Rigol writes:

X,CH1,CH2,Start,Increment
Sequence,Volt,Volt,-5.0e-02,5.0e-04

or, before a column of times that is there or left blank:

Time(s),CH1V,CH2V,t0 =-5.0e-02,tInc = 5.0e-04
"""

from __future__ import annotations

import re
from typing import NamedTuple

from .file_units import is_unit


class Counting(NamedTuple):
    """The time of sample k, in s, is ``start + k * increment``; `blank`: no column says k."""

    start: float
    increment: float
    blank: bool = False


_SAID = re.compile(r"\s*(?P<name>t0|tInc)\s*=\s*(?P<number>[-+]?\d+(\.\d*)?([eE][-+]?\d+)?)\s*")


def counted(rows: dict[int, list[str]], width: int) -> tuple[dict[int, list[str]], Counting | None]:
    """The lines above the data as if the first column were the time in s, and how its numbers become it; as
    they are, and None, where they say nothing of the kind."""
    for i, fields in rows.items():
        said = {m["name"]: float(m["number"]) for field in fields if (m := _SAID.fullmatch(field))}
        if said.keys() == {"t0", "tInc"}:
            heads = ["" if _SAID.fullmatch(field) else field for field in fields]
            return rows | {i: heads}, Counting(said["t0"], said["tInc"], True)
        words = [field.lower() for field in fields]
        below = rows.get(i + 1, [])
        if words[:1] != ["x"] or "start" not in words or below[:1] != ["Sequence"]:
            continue
        k = words.index("start")
        try:
            start, increment = float(below[k]), float(below[k + 1])
        except (IndexError, ValueError):
            continue
        if words[k + 1] != "increment" or not increment > 0.0:
            continue
        blank = [""] * width
        units = [unit if is_unit(unit) else "" for unit in below[1:k]]
        heads = {i: ["time", *fields[1:k], *blank][:width], i + 1: ["s", *units, *blank][:width]}
        return rows | heads, Counting(start, increment)
    return rows, None
