"""Views of xarray Datasets, such as step maps, recordings, frequency responses and ensembles."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.design import is_map
from ..figures.plotting import DRAWN, drawn_over, plot
from ..figures.style import svg
from ..viewing import document_of
from .step_map import map_document


@document_of.register
def dataset_document(data: xr.Dataset) -> Document:
    """Return a document with the figure of `plot`, and least and largest value of each variable.

    A step map has the document of `map_document`. Raises QuantityError for a dataset that cannot be drawn.
    """
    if is_map(data):
        return map_document(data)
    axes = plot(data)  # raises QuantityError for a dataset that cannot be drawn
    over = drawn_over(data)
    assert over is not None
    coordinate = data[over]
    title = str(data.attrs.get("title") or DRAWN[over].title)
    numbers = {str(name): _range(one) for name, one in data.data_vars.items() if _has_range(one)}
    said = f"{data.sizes[over]} values over {over}"
    if _has_range(coordinate) and coordinate.attrs.get("units"):
        ends = [Number(float(value), str(coordinate.attrs["units"])) for value in coordinate.values[[0, -1]]]
        numbers[over] = {"first": ends[0], "last": ends[1]}
    picture = Picture("data", f"{title}.", svg(axes.flat[0].figure), f"{title}: every variable over {over}")
    return Document(
        title=title,
        summary=f"{said}: {', '.join(map(str, data.data_vars))}.",
        sections=(Section(title, tables=_ranges(data), figures=(picture,)),),
        numbers=numbers,
    )


def _has_range(one: xr.DataArray) -> bool:
    """Return True for real numbers in one unit, not all NaN.

    A variable without a unit of its own, but with a coordinate such as "parameter_unit", has several units.
    """
    several = "units" not in one.attrs and any(str(name).endswith("unit") for name in one.coords)
    return one.dtype.kind in "fiu" and not several and not np.all(np.isnan(one))


def _range(one: xr.DataArray) -> dict[str, Any]:
    unit = str(one.attrs.get("units", ""))
    return {"least": Number(float(np.nanmin(one)), unit), "largest": Number(float(np.nanmax(one)), unit)}


def _ranges(data: xr.Dataset) -> list[Table]:
    rows = [
        (str(one.attrs.get("long_name", name)), *_range(one).values())
        for name, one in data.data_vars.items()
        if _has_range(one)
    ]
    columns = (Column("variable"), Column("least"), Column("largest"))
    return [Table("Range of each variable.", columns, rows)] if rows else []
