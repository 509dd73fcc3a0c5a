"""View of a map of the net step over voltage, frequency, load and other quantities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...quantities.units import QuantityError
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.design import draw_map
from ..figures.style import svg

if TYPE_CHECKING:
    import xarray as xr


def map_document(found: xr.Dataset) -> Document:
    """Return a document with maps of step and speed over the varied quantities, and their greatest
    magnitudes.

    The numbers of points without a steady step are given with a reason. Points that are not computed yet,
    after an interruption, are a failure. `found` is the result of `step_map`.
    """
    flags = str(found["status"].attrs["flag_meanings"]).split()
    counts = {name: int((found["status"] == i).sum()) for i, name in enumerate(flags)}
    size, left = int(found["status"].size), counts["not_computed"]
    best = {name: _best(found, name) for name in ("net_step", "speed")}
    said = f"{counts['converged']} of {size} points have a steady step."
    if best["speed"]:
        said += f" The fastest walk is at {_place(best['speed'])}."
    figures, undrawn = map_pictures(found)
    section = Section(
        "Map of the step",
        paragraphs=undrawn,
        tables=(_points_table(found, counts),),
        figures=figures,
    )
    words = {"net_step": "longest step", "speed": "fastest walk"}
    highlights = [
        (words[name], Number(float(one["value"]), str(found[name].attrs["units"])))
        for name, one in best.items()
        if one
    ]
    failures = [f"stopped: {left} of {size} points are not computed"] if left else []
    return Document(
        title="Map of the step",
        summary=said,
        sections=(section,),
        highlights=highlights,
        numbers=map_numbers(found),
        failures=failures,
        interrupted=bool(left),
    )


def map_numbers(found: xr.Dataset) -> dict[str, Any]:
    """Return every variable and coordinate of a map for results.json: "value" and "unit" by name.

    "dimensions" has the names of the arrays' dimensions. Reasons, which are texts, are left out.
    """
    made: dict[str, Any] = {"dimensions": list(map(str, found["net_step"].dims))}
    for name, one in (found.coords | found.data_vars).items():
        if name == "reason":
            continue
        made[str(name)] = {"value": one.values, "unit": str(one.attrs.get("units", ""))}
    return made


def map_pictures(found: xr.Dataset) -> tuple[list[Picture], list[str]]:
    """Return pictures of step and speed, then of further results of a map that have values; and sentences on
    results that are not drawn, because their picture needs too many lines or panels.

    Both lists are empty for a map without dimensions.
    """
    made, undrawn = [], []
    for name in ("net_step", "speed", "backlash", "backward_rate", "ringing", "ripple"):
        if name not in found or not found[name].dims or not np.any(np.isfinite(found[name].values)):
            continue
        words = str(found[name].attrs["long_name"])
        called = f"{words[0].upper()}{words[1:]}"
        try:
            figure = draw_map(found, name)[0].figure
        except QuantityError as error:
            undrawn.append(f"{called} is not drawn: {error}.")
            continue
        over = ", ".join(map(str, found[name].dims))
        made.append(
            Picture(f"map-{name.replace('_', '-')}", f"{called}.", svg(figure), f"{words} over {over}")
        )
    return made, undrawn


def _best(found: xr.Dataset, name: str) -> dict[str, Any]:
    """Return the "value" of greatest magnitude of the result `name`, and its coordinates "at" by name.

    The mapping is empty if all values are NaN.
    """
    sizes = np.abs(found[name].values)
    if not np.any(np.isfinite(sizes)):
        return {}
    at = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
    one = found.isel(dict(zip(found[name].dims, at, strict=True)))
    return {"value": float(one[name]), "at": {str(n): one[n] for n in found.coords}}


def _place(best: dict[str, Any]) -> str:
    said = [f"{name} {float(c):.4g} {c.attrs.get('units', '')}".strip() for name, c in best["at"].items()]
    return ", ".join(said) or "the one point there is"


def _points_table(found: xr.Dataset, counts: dict[str, int]) -> Table:
    """Return a table of the number of points of each status, with the reason given for the first point.

    `counts` has the numbers by status, in the order of the status numbers.
    """
    rows = []
    for i, (name, count) in enumerate(counts.items()):
        if count:
            which = found["reason"].values[found["status"].values == i]
            rows.append([name.replace("_", " "), count, str(which.reshape(-1)[0])])
    return Table("Points", (Column("status"), Column("points", ""), Column("reason of the first")), rows)
